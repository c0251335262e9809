"""The moments of a run that has left keyframes, and runs that go on from one of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from orchard.fork.forked import forked
from orchard.local import Local
from orchard.server.figures import RunFigures
from orchard.server.snapshots import examine
from orchard.sim.snapshot import Snapshot, SnapshotError, newest, ticks_of
from orchard.terminal.values import clock

Say = Callable[[str], None]
Future = dict[str, Any]  # the figures of its summary, and why it `ended`


class WatchedRun:
    """A run in local mode with its figures, from a snapshot on.

    `RunFigures` are those that the physics process keeps of a run: so the summary is the same.
    """

    def __init__(self, snapshot: Snapshot, is_hashed: bool = True) -> None:
        """Raises SnapshotError."""
        self.local = Local.resume(snapshot, is_hashed=is_hashed)
        # No wall clock counts here, so it stands still.
        self.figures = RunFigures(self.local.engine, lambda: 0.0, snapshot.figures)
        self._before = snapshot

    @property
    def tick(self) -> int:
        """The tick that comes next."""
        return self.local.engine.tick

    @property
    def ended(self) -> str:
        """Why the run is over; "duration" if it could go on."""
        if self.local.engine.over:
            return "harvested"
        return self.figures.fault or "duration"

    def go_on(self, until: float) -> None:
        """Go on to a tick, at most to the end of the run."""
        while self.tick < until and self.ended == "duration":
            self.figures.update(self.local.tick())

    def snapshot(self) -> Snapshot:
        """Return the state of the run, with all that it knows of the snapshot before."""
        snapshot = self.local.snapshot()
        snapshot.run = self._before.run
        snapshot.lost = self._before.lost
        snapshot.elsewhere = self._before.elsewhere
        snapshot.figures = self._before.figures | self.figures.as_data()
        return snapshot


def live(until: float, job: tuple[int, Snapshot]) -> Future:
    """Return what a future gives that is over at a tick `until` at the latest.

    `job`: its number, and its first moment. This function stands in this module so that the
    processes that live futures load nothing else.
    """
    _, first_moment = job
    run = WatchedRun(first_moment, is_hashed=False)
    run.go_on(until)
    return run.figures.figures() | {"ended": run.ended}


def snapshot_at(folder: Path, tick: int, say: Say) -> Snapshot:
    """Return the state of a run at a tick. It is run again from the nearest snapshot before.

    `folder`: has the keyframes and snapshots of the run. `say`: gets what the user should know:
    which files are not used, and that the run was not left to its agents, as by a stop. Raises
    SnapshotError.
    """
    known = ticks_of(folder)
    if not known:
        raise SnapshotError(f"{folder}: no keyframe up to {clock(tick)}; the run has left none")
    if tick < known[0]:
        raise SnapshotError(
            f"{folder}: no keyframe up to {clock(tick)}; its first one is at {clock(known[0])}"
        )
    refused: list[str] = []
    begin = newest(folder, refused, examine=examine, until=tick)
    for reason in refused:
        say(f"not used: {reason}")
    # A fork without changes: agents that clients drove elsewhere are those of the scenario again.
    run = WatchedRun(forked(begin, {}))
    run.go_on(tick)
    if run.tick < tick:
        raise SnapshotError(
            f"{folder}: {clock(tick)} is after the end of the run, at {clock(run.tick)}"
        )
    snapshot = run.snapshot()
    later = next((known_tick for known_tick in known if known_tick > tick), tick)
    if begin.tick < tick and not _goes_the_same_way(run, later, folder):
        say(
            f"after {clock(begin.tick)} the run was not left to its own agents: "
            f"at {clock(tick)} the fork begins with what they would have done"
        )
    return snapshot


def _goes_the_same_way(run: WatchedRun, later: int, folder: Path) -> bool:
    """Whether a run that is run again comes to the state that was kept at a later tick.

    `later`: the tick of the next snapshot, or the run's own tick if none follows. The run is
    changed: it goes on to that tick. If no later snapshot can be used, nothing shows a difference,
    and this returns True.
    """
    if later <= run.tick:
        return True
    run.go_on(later)
    kept = newest(folder, [], until=later)
    if run.tick != later or kept.tick != later:
        return True
    return run.local.engine.digest == kept.digest
