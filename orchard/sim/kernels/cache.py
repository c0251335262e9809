"""Where the compiled kernels are kept, and whether there are any: to be known without numba, which takes long to load."""

import hashlib
import os
from pathlib import Path

COMPILING = "compiling for this machine, which is done once and takes some ten seconds"

_HERE = Path(__file__).parent
_FIELD = _HERE.parent.parent / "field"
_SOURCES = [*sorted(_HERE.glob("*.py")), *(_FIELD / f"{module}.py" for module in ("kinds", "layout", "repeatable", "scenario"))]


def kernels_folder() -> Path | None:
    """A folder that is named for the sources; None where nothing can be kept.

    numba looks only at a kernel's own file to see whether it is stale, not at the constants and functions that it takes from others.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen and not os.access(_HERE, os.W_OK):
        return None
    sources = b"".join(path.read_bytes() for path in _SOURCES)
    return Path(chosen or _HERE / "__pycache__") / f"kernels-{hashlib.sha256(sources).hexdigest()[:16]}"


def are_compiled() -> bool:
    """Whether there are kernels for this machine; else the first tick waits until they are compiled."""
    folder = kernels_folder()
    return folder is not None and any(folder.rglob("*.nbc"))
