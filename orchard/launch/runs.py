"""The folder of runs, for recordings and snapshots: names for new ones, and the newest of the existing ones."""

import fcntl
import glob
import itertools
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from orchard.sim.snapshot import SNAPSHOT, SnapshotError, snapshots_in
from orchard.view.files import check_recording, is_further_part

LAST = "last"  # for --resume: the run with the newest snapshots


@dataclass(frozen=True)
class Runs:
    """The folder; it need not exist yet."""

    folder: Path

    def recording(self, wanted: str | None) -> Path | None:
        """Return the path of a new recording, None for "none". Raises OSError or ValueError."""
        if wanted == "none":
            return None
        path = self.folder / f"{_new_name()}.rrd" if wanted is None else Path(wanted)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            check_writable(path)
        except OSError as error:
            why = (
                str(error)
                if error.strerror is None
                else f"{path.parent}: cannot be made: {error.strerror}"
            )
            raise OSError(
                f"{why}; --record FILE.rrd records elsewhere, --record none not at all"
            ) from error
        check_recording(path)
        return path

    def newest_recording(self) -> Path | None:
        """Return the first part of the newest recording; None if there is none."""
        return _newest(itertools.filterfalse(is_further_part, self.folder.glob("*.rrd")))

    def new_snapshots(self, recording: Path | None) -> Path:
        """Return the folder for the snapshots of a new run. It is named after its recording, if that is in the folder of runs too."""
        is_here = recording is not None and recording.resolve().parent == self.folder.resolve()
        name = (
            recording.stem
            if recording is not None and is_here
            else f"{'' if recording is None else recording.stem + '-'}{_new_name()}"
        )
        return self.folder / f"{name}.snapshots"

    def snapshots(self, run: str, suffix: str = SNAPSHOT) -> Path:
        """Return the folder with the snapshots, or keyframes, of a run: its folder, recording or name, or "last". Raises SnapshotError."""
        if run != LAST:
            folder = next((path for path in self._named(run) if path.is_dir()), None)
            if folder is None:
                expected = f"expected the folder, the recording or the name of a run, NAME.snapshots, NAME.rrd or NAME, or {LAST}"
                raise SnapshotError(f"{run}: no snapshots of such a run; {expected}")
            return folder
        last = _newest(
            path for path in self.folder.glob("*.snapshots") if snapshots_in(path, suffix)
        )
        if last is None:
            raise SnapshotError(
                f"{self.folder}: no run there to resume; a run leaves its snapshots there when it is stopped"
            )
        return last

    def _named(self, run: str) -> Iterator[Path]:
        """The folders that may be meant by the name of a run, or by its recording."""
        yield Path(run)
        name = Path(run).stem if run.endswith(".rrd") else run
        yield self.folder / f"{name}.snapshots"
        yield from sorted(
            self.folder.glob(f"{glob.escape(Path(name).name)}-harvest-*.snapshots"), reverse=True
        )


@contextmanager
def alone(*paths: Path | None) -> Iterator[None]:
    """In this context no other run writes to these paths. An empty file goes at the end. Raises ValueError."""
    with ExitStack() as stack:
        for path in filter(None, paths):
            opened = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT, 0o666)
            stack.callback(os.close, opened)
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(
                    f"{path}: another run writes there now; name another one, or wait until it has ended"
                ) from None
            stack.callback(_remove_empty, path)
        yield


def _remove_empty(path: Path) -> None:
    if path.is_file() and not path.stat().st_size:
        path.unlink()


def check_writable(path: Path) -> None:
    """Raise OSError if a file cannot be written. An existing file is not changed."""
    if (
        path.resolve().is_fifo()
    ):  # it would wait for a reader; /dev/stdout is none, whatever stdout is
        raise OSError(f"{path}: is a named pipe; expected a file")
    new = not path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        expected = "expected a file in a directory that exists and can be written"
        raise OSError(f"{path}: cannot be written: {error.strerror}; {expected}") from error
    if new:
        path.resolve().unlink()  # a link stays


def _newest(paths: Iterable[Path]) -> Path | None:
    return max(filter(Path.exists, paths), key=lambda path: path.stat().st_mtime, default=None)


def _new_name() -> str:
    return f"harvest-{datetime.now():%Y%m%d-%H%M%S}-{os.getpid()}"
