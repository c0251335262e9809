"""Commands as a user types them in the current directory, for what the program proposes."""

import os
import shlex
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path


def program() -> str:
    """Return the words with which a user starts this program again in the current directory."""
    started = Path(sys.argv[0])
    python = _shown(Path(sys.executable))
    if started.name == "__main__.py":
        return f"{python} -m orchard"
    if started.suffix == ".py":
        return f"{python} {_shown(started)}"
    is_on_path = shutil.which(started.name) == str(started)
    if is_on_path:
        return started.name
    return _shown(started)


def typed(*words: object) -> str:
    """Return a command of this program as a user types it, with short paths."""
    texts = []
    for word in words:
        if isinstance(word, Path):
            texts.append(_shown(word))
        else:
            texts.append(str(word))
    return f"{program()} {shlex.join(texts)}"


def named(parameters: Iterable[str]) -> str:
    """Return the options of these parameters as a user types them: --row-width, --seed."""
    return ", ".join(f"--{name.replace('_', '-')}" for name in parameters)


def _shown(path: Path) -> str:
    """Return the shortest of the paths to a file that no command takes for an option."""
    try:
        relative = os.path.relpath(path)
    except OSError:
        # The current directory has been removed.
        return str(path)
    if relative.startswith(".."):
        return str(path)
    if relative.startswith("-"):
        return f"./{relative}"
    return relative
