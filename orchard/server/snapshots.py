"""Writes snapshots of a run at intervals, and finds the newest one to go on from.

A snapshot is a file with the whole state of a run; a keyframe is one that stays, for forks.
orchard/sim/snapshot.py says which files a folder holds. Both loops use this: that with a network
(run.py) and that of local mode (orchard/launch/local_run.py).
"""

import fcntl
import logging
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP
from orchard.net.refusals import RefusalTotals
from orchard.sim.snapshot import KEYFRAME, SNAPSHOT, Snapshot, SnapshotError, as_file, newest, store

SNAPSHOT_SECONDS = 2.0  # s of wall time between two snapshots
KEYFRAME_SECONDS = 60.0  # s, simulated, between two keyframes
# s that the reply to an emergency stop waits for the disk.
KEPT_SECONDS = 2.0

log = logging.getLogger("orchard")


@contextmanager
def sole_writer(folder: Path | None) -> Iterator[None]:
    """Lock a folder, so that only one process writes snapshots there.

    Raises SnapshotError if another one does.
    """
    opened: int | None = None
    # A folder that cannot be made or opened is not locked. SnapshotWriter, which cannot write there
    # either, logs the error.
    with suppress(OSError):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    with ExitStack() as stack:
        if opened is not None:
            stack.callback(os.close, opened)
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise SnapshotError(
                    f"{folder}: the run of these snapshots is still active; stop it first"
                ) from error
        yield


class SnapshotWriter:
    """Writes snapshots into a folder, if there is one.

    An executor does that in a thread of its own, so a slow disk does not delay the run.

    Snapshots at multiples of `keyframe_seconds` are keyframes too: they stay when the run goes on,
    and after its end.
    """

    def __init__(
        self,
        folder: Path | None,
        executor: Executor,
        clock: Callable[[], float],
        seconds: float = SNAPSHOT_SECONDS,
        keyframe_seconds: float = KEYFRAME_SECONDS,
    ) -> None:
        """`folder`: if None, nothing is written. `executor`: with one thread, so that snapshots are
        written in their order.

        `seconds`: of wall time between two snapshots. `keyframe_seconds`: simulated, between two
        keyframes.
        """
        self.folder = folder
        self._executor = executor
        self._clock = clock
        self._seconds = seconds
        # An infinite distance becomes one beyond the last tick.
        self._keyframe_ticks = max(1, round(min(keyframe_seconds, LAST_TICK) / TIME_STEP))
        self._due = -math.inf  # s, on the clock
        # The snapshot that was given to the executor last; its result says whether it is written.
        self._writing: Future[bool] | None = None
        # Whether that snapshot is a keyframe too.
        self._is_keyframe = False
        # Whether a snapshot could not be written: that is logged once.
        self._failed = False

    def is_due(self, tick: int) -> bool:
        """Whether a snapshot is due at a tick: a keyframe always, another one if none waits."""
        if self.folder is None:
            return False
        if tick % self._keyframe_ticks == 0:
            return True
        is_idle = self._writing is None or self._writing.done()
        return is_idle and self._clock() >= self._due

    def keep(self, snapshot: Snapshot) -> None:
        """Write a snapshot after the one that is being written.

        It replaces an older one that still waits, but no keyframe.
        """
        if self.folder is None:
            return
        if self._writing is not None and not self._is_keyframe:
            # This has no effect on one that is being written.
            self._writing.cancel()
        name, content = as_file(snapshot)
        self._is_keyframe = snapshot.tick % self._keyframe_ticks == 0
        if self._is_keyframe:
            names = [name, name.replace(SNAPSHOT, KEYFRAME)]
        else:
            names = [name]
        self._writing = self._executor.submit(
            self._store, names, content, self.folder, snapshot.run
        )
        self._due = self._clock() + self._seconds

    def _store(self, names: list[str], content: bytes, folder: Path, run: str) -> bool:
        """Write a snapshot under these names. Return whether that worked."""
        try:
            for name in names:
                store(name, content, folder, run)
        except OSError as error:
            if not self._failed:
                fault = f"a snapshot could not be written in {folder}: {error.strerror or error}"
                log.error("%s; without one the run cannot be resumed", fault)
            self._failed = True
            return False
        return True

    def finish(self, seconds: float | None = None) -> bool:
        """Wait until the last snapshot is on the disk, at most `seconds`; None: without a limit.

        Return whether it is there.
        """
        try:
            return self._writing is not None and self._writing.result(seconds)
        except TimeoutError:
            return False


def examine(snapshot: Snapshot) -> None:
    """Raise SnapshotError unless a run can go on from this snapshot.

    A file that can be read may hold what no run can be in. So all is made from it once, and thrown
    away.
    """
    # These are imported here, because numba takes seconds to load.
    from orchard.server.figures import RunFigures
    from orchard.sim.engine import Engine

    RunFigures(Engine.resume(snapshot), lambda: 0.0, snapshot.figures)
    RefusalTotals(snapshot.figures.get("refused"))


def last(folder: Path, run: str = "") -> Snapshot | None:
    """Return the newest usable snapshot of a run in a folder; None if there is none.

    Without one the run begins anew, from its first tick. `run`: its id; '' for the run to which the
    folder belongs. Snapshots that are not usable are logged.
    """
    refused: list[str] = []
    snapshot = None
    with suppress(SnapshotError):
        snapshot = newest(folder, refused, run, examine)
    for why in refused:
        log.warning("not used: %s", why)
    if refused and snapshot is None:
        effect = "the run begins anew, and no robot is stopped any more"
        log.warning("%s: no usable snapshot; %s", folder, effect)
    return snapshot
