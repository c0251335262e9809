"""A disk of its own for the files of one run, which can be full for a time."""

import subprocess
from contextlib import suppress
from pathlib import Path

# The size of the disk, which is in memory: more than a whole harvest writes.
SIZE = "256m"
# What is written again and again until the disk is full.
CHUNK = bytes(1 << 20)


class Disk:
    """A disk in memory, mounted on a folder. Most users may not mount one: then there is none."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._filler = folder / "filler"

    @property
    def is_there(self) -> bool:
        """Whether the disk is mounted."""
        return self._folder.is_mount()

    def mount(self) -> None:
        """Mount the disk, if that is allowed."""
        command = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "none", str(self._folder)]
        with suppress(FileNotFoundError):
            subprocess.run(command, capture_output=True, check=False)

    def unmount(self) -> None:
        """Remove the disk, and all files on it. Without a disk nothing happens."""
        if self.is_there:
            subprocess.run(["umount", "--lazy", str(self._folder)], check=True)

    def fill(self) -> bool:
        """Fill the disk to the last byte. Return whether there is one."""
        if self.is_there:
            with suppress(OSError), self._filler.open("ab", buffering=0) as file:
                while True:
                    file.write(CHUNK)
        return self.is_there

    def clear(self) -> None:
        """Remove what `fill` has written."""
        self._filler.unlink(missing_ok=True)
