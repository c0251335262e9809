"""The folder of the compiled kernels, and whether they exist. This module does not import numba, which takes long to load."""

import hashlib
import os
from pathlib import Path

COMPILING = "compiling for this machine; this is done once and takes some ten seconds"

_HERE = Path(__file__).parent
_FIELD = _HERE.parent.parent / "field"
_SOURCES = [*sorted(_HERE.glob("*.py")), *(_FIELD / f"{module}.py" for module in ("kinds", "layout", "repeatable", "scenario"))]


def kernels_folder() -> Path | None:
    """Return a folder whose name contains a hash of the sources; None if kernels cannot be stored.

    numba checks only a kernel's own file for changes, not the constants and functions that the kernel imports from other files.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen and not os.access(_HERE, os.W_OK):
        return None
    sources = b"".join(path.read_bytes() for path in _SOURCES)
    return Path(chosen or _HERE / "__pycache__") / f"kernels-{hashlib.sha256(sources).hexdigest()[:16]}"


def are_compiled() -> bool:
    """Whether compiled kernels exist for this machine; if not, the first tick waits until they are compiled."""
    folder = kernels_folder()
    return folder is not None and any(folder.rglob("*.nbc"))
