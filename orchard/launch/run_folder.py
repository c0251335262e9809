"""The folder of runs, for recordings and snapshots: names for new ones, and the newest one."""

import fcntl
import glob
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from orchard.folders import newest_path, real
from orchard.sim.snapshot import SNAPSHOT, SnapshotError, snapshots_in
from orchard.terminal.files import check_writable
from orchard.view.files import check_recording

LAST = "last"  # for --resume: the run with the newest snapshots


@dataclass(frozen=True)
class RunFolder:
    """The folder of recordings and snapshots. It need not exist yet."""

    folder: Path

    def recording(self, wanted: str | None) -> Path | None:
        """Return the path of a new recording; None for "none".

        `wanted`: the file that a user has named, or None. Raises OSError or ValueError.
        """
        if wanted == "none":
            return None
        path = self.folder / f"{_new_name()}.rrd" if wanted is None else Path(wanted)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            check_writable(path)
        except OSError as error:
            if error.strerror is None:
                reason = str(error)
            else:
                reason = f"{path.parent}: cannot be made: {error.strerror}"
            raise OSError(
                f"{reason}; --record FILE.rrd records elsewhere, --record none not at all"
            ) from error
        check_recording(path)
        return path

    def new_snapshots(self, recording: Path | None) -> Path:
        """Return the folder for the snapshots of a new run.

        It has the name of the run's recording, if that is in the folder of runs too.
        """
        if recording is None:
            name = _new_name()
        elif real(recording).parent == real(self.folder):
            name = recording.stem
        else:
            name = f"{recording.stem}-{_new_name()}"
        return self.folder / f"{name}.snapshots"

    def snapshots(self, run: str, suffix: str = SNAPSHOT) -> Path:
        """Return the folder with the snapshots, or keyframes, of a run.

        `run`: its folder, recording or name, or "last". Raises SnapshotError.
        """
        if run == LAST:
            return self._last_snapshots(suffix)
        for path in self._named(run):
            if path.is_dir():
                return path
        raise SnapshotError(
            f"{run}: no snapshots of such a run; expected the folder, the recording or the name "
            f"of a run, NAME.snapshots, NAME.rrd or NAME, or {LAST}"
        )

    def _last_snapshots(self, suffix: str) -> Path:
        """Return the newest folder that has snapshots. Raises SnapshotError."""
        folders = self.folder.glob("*.snapshots")
        last = newest_path(path for path in folders if snapshots_in(path, suffix))
        if last is None:
            raise SnapshotError(
                f"{self.folder}: no run there to resume; "
                "a run leaves its snapshots there when it is stopped"
            )
        return last

    def _named(self, run: str) -> Iterator[Path]:
        """Yield the folders that may be meant by the name of a run, or by its recording."""
        yield Path(run)
        name = Path(run).stem if run.endswith(".rrd") else run
        yield self.folder / f"{name}.snapshots"
        of_recordings_elsewhere = f"{glob.escape(Path(name).name)}-harvest-*.snapshots"
        yield from sorted(self.folder.glob(of_recordings_elsewhere), reverse=True)


@contextmanager
def alone(*paths: Path | None) -> Iterator[None]:
    """In this context no other run writes to these paths. Raises ValueError if one does.

    A lock needs a file, so files are made. A file that is still empty at the end is removed.
    """
    with ExitStack() as stack:
        for path in filter(None, paths):
            flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT
            opened = os.open(path, flags, 0o666)
            stack.callback(os.close, opened)
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(
                    f"{path}: another run writes there now; "
                    "name another one, or wait until it has ended"
                ) from None
            stack.callback(_remove_empty, path)
        yield


def _remove_empty(path: Path) -> None:
    """Remove a path if it is an empty file."""
    if path.is_file() and not path.stat().st_size:
        path.unlink()


def _new_name() -> str:
    """Return a name that no other run has: the time, and this process."""
    return f"harvest-{datetime.now():%Y%m%d-%H%M%S}-{os.getpid()}"
