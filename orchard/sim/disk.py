"""Files that are on the disk whole or not at all."""

import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, in place of an old one, so that a kill leaves the old file or the new one. Raises OSError, and leaves nothing then."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")  # readers of a folder pass over names with a dot
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
