"""The folder runs/: where harvests leave their recordings and snapshots, and which of those are the newest."""

import itertools
import os
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from orchard.sim.snapshot import SnapshotError
from orchard.view.files import is_further_part, remove_further_parts

LAST = "last"  # of all runs: the one that went on most recently


@dataclass(frozen=True)
class Runs:
    """That folder, which need not be there yet."""

    folder: Path

    def recording(self, wanted: str | None) -> Path | None:
        """Where a new recording goes: a file that a user names, or one here; None for "none". Raises OSError."""
        if wanted == "none":
            return None
        path = self.folder / f"{_now()}-{os.getpid()}.rrd" if wanted is None else Path(wanted)
        path.parent.mkdir(parents=True, exist_ok=True)
        check_writable(path)
        remove_further_parts(path)
        return path

    def newest_recording(self) -> Path | None:
        """Its first part."""
        return _newest(itertools.filterfalse(is_further_part, self.folder.glob("*.rrd")))

    def snapshots(self, resume: str | None) -> Path:
        """The folder for the snapshots of a run that is new, or of one that goes on. Raises SnapshotError where none can."""
        if resume is None:
            return self.folder / f"{_now()}-{os.getpid()}.snapshots"
        if resume != LAST:
            return Path(resume)
        last = _newest(self.folder.glob("*.snapshots"))
        if last is None:
            raise SnapshotError(f"{self.folder}: no run there that could go on; one leaves its snapshots there when it is stopped")
        return last


def check_writable(path: Path) -> None:
    """Raises OSError where no file can be written; what is there stays as it is."""
    new = not path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        raise OSError(f"{path}: cannot be written: {error.strerror}; wanted is a file in a directory that is there") from error
    if new:
        path.unlink()


def _newest(paths: Iterable[Path]) -> Path | None:
    return max(paths, key=lambda path: path.stat().st_mtime, default=None)


def _now() -> str:
    return f"harvest-{datetime.now():%Y%m%d-%H%M%S}"
