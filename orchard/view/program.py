"""Where Rerun's own program is: the viewer, which also serves browsers, and packs and mends recordings."""

import os
from pathlib import Path

import rerun_cli

CHOSEN = "RERUN_CLI_PATH"  # Rerun's own variable, which names another one
PACKAGED = Path(rerun_cli.__file__).with_name("rerun")  # found also where the virtual environment is not activated


def viewer_program() -> str:
    """The program itself: `python -m rerun` would start it as a child, which stays behind when its parent is ended.

    Raises FileNotFoundError where there is none.
    """
    path = Path(os.environ.get(CHOSEN) or PACKAGED)
    if not path.is_file():
        which = f"{CHOSEN}={path}" if os.environ.get(CHOSEN) else str(path)
        raise FileNotFoundError(f"{which}: no such program; wanted is Rerun's viewer, which the package rerun-sdk brings along")
    return str(path)


def window(*what: str) -> list[str]:
    """The command line of a viewer in a window of its own; it too takes data, from this machine only. Raises FileNotFoundError."""
    return [viewer_program(), "--bind", "127.0.0.1", *what]
