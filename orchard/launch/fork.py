"""The moments of a run that has left keyframes, and a run that goes on from one of them with changes."""

import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from orchard.field.kinds import kind_of
from orchard.field.scenario import TICKS_PER_SECOND, Scenario, check
from orchard.fork import forked
from orchard.launch.options import ForkOptions
from orchard.launch.runs import Runs
from orchard.launch.terminal import as_typed
from orchard.local import Local
from orchard.server.figures import RunFigures
from orchard.server.snapshots import examine
from orchard.sim.snapshot import KEYFRAME, Snapshot, SnapshotError, newest, ticks_of
from orchard.sim.stops import stopped
from orchard.sim.world import World
from orchard.study.settings import value_of

Say = Callable[[str], None]
Future = dict[str, Any]  # the figures of its summary, and why it `ended`


def clock(tick: int) -> str:
    """Return the simulated time of a tick as a user reads it: 12:00 or 12:00.5."""
    minutes, ticks = divmod(tick, 60 * TICKS_PER_SECOND)
    seconds, tenths = divmod(ticks, TICKS_PER_SECOND)
    return f"{minutes}:{seconds:02d}" + (f".{tenths}" if tenths else "")


class WatchedRun:
    """A run in local mode with its figures, from a snapshot on."""

    def __init__(self, snapshot: Snapshot, is_hashed: bool = True) -> None:
        """Raises SnapshotError."""
        self.local = Local.resume(snapshot, is_hashed=is_hashed)
        self.figures = RunFigures(self.local.engine, lambda: 0.0, snapshot.figures)
        self._before = snapshot

    @property
    def tick(self) -> int:
        return self.local.engine.tick

    @property
    def ended(self) -> str:
        """Why the run is over; "duration" if it could go on."""
        return "harvested" if self.local.engine.over else self.figures.fault or "duration"

    def go_on(self, until: float) -> None:
        """Go on to a tick, at most to the end of the run."""
        while self.tick < until and self.ended == "duration":
            self.figures.update(self.local.tick())

    def snapshot(self) -> Snapshot:
        now = self.local.snapshot()
        now.run, now.lost, now.elsewhere = (
            self._before.run,
            self._before.lost,
            self._before.elsewhere,
        )
        now.figures = self._before.figures | self.figures.as_data()
        return now


def check_end(world: World, duration: float | None) -> None:
    """Raise SnapshotError if nothing ends a run without a network: robots stand, and it has no `duration`, s."""
    if duration is None and (standing := stopped(world)):
        raise SnapshotError(
            f"--duration: is missing: a harvest does not end while robots stand: {', '.join(standing)}"
        )


def live(until: float, job: tuple[int, Snapshot]) -> Future:
    """Return what a future gives that is over at a tick `until` at the latest. `job`: its number, and its first moment.

    It stands here for the processes that live futures: they load nothing else.
    """
    run = WatchedRun(job[1], is_hashed=False)
    run.go_on(until)
    return run.figures.figures() | {"ended": run.ended}


def snapshot_at(folder: Path, tick: int, say: Say) -> Snapshot:
    """Return the state of a run at a tick: it is run again from the nearest keyframe or snapshot before. Raises SnapshotError.

    `say`: gets what the user should know: files that are not used, and that the run was not left to its agents, as by a stop.
    """
    known, refused = ticks_of(folder), list[str]()
    if not known or tick < known[0]:
        first = f"its first one is at {clock(known[0])}" if known else "the run has left none"
        raise SnapshotError(f"{folder}: no keyframe up to {clock(tick)}; {first}")
    begun = newest(folder, refused, examine=examine, until=tick)
    for why in refused:
        say(f"not used: {why}")
    run = WatchedRun(forked(begun, {}))
    run.go_on(tick)
    if run.tick < tick:
        raise SnapshotError(
            f"{folder}: {clock(tick)} is after the end of the run, at {clock(run.tick)}"
        )
    found, later = run.snapshot(), next((one for one in known if one > tick), tick)
    run.go_on(later)
    if (
        begun.tick < tick < run.tick == later == (kept := newest(folder, [], until=later)).tick
        and run.local.engine.digest != kept.digest
    ):
        alone = f"at {clock(tick)} the fork begins with what they would have done"
        say(f"after {clock(begun.tick)} the run was not left to its own agents: {alone}")
    return found


def changes_of(chosen: ForkOptions, scenario: Scenario) -> dict[str, Any]:
    """Return what is changed: dotted path -> value. "+1" is one more than there are, or more than what null stands for."""
    changes = dict(chosen.changes)
    for word in chosen.settings or []:
        path, _, text = word.partition("=")
        if not path or not text:
            raise ValueError(
                f"--set {word}: expected KEY=VALUE, such as carriers=+1 or picking.spread.cv=0.5"
            )
        if path in changes:
            raise ValueError(f"--set {word}: {path} is given twice; once is allowed")
        value = value_of(text.removeprefix("+"))
        if text[0] in "+-" and isinstance(value, int | float):
            value += _present(scenario, path)
        changes[path] = value
    return changes


def _present(scenario: Scenario, path: str) -> float:
    values: Any = scenario.model_dump() | scenario.chosen
    for key in path.split("."):
        values = values.get(key) if isinstance(values, Mapping) else None
    if not isinstance(values, int | float):
        raise ValueError(
            f"--set {path}: it has no number to which something can be added; expected KEY=VALUE"
        )
    return values


def fork_of(chosen: ForkOptions, runs: Runs, say: Say) -> Snapshot:
    """Return the first moment of the fork that a user has chosen. Raises SnapshotError, ScenarioError or ValueError."""
    moment = snapshot_at(runs.snapshots(chosen.run, KEYFRAME), chosen.at or 0, say)
    if others := [
        name
        for name in moment.elsewhere
        if not {name, kind_of(name)}.intersection(chosen.without or [])
    ]:
        say(
            f"clients elsewhere drove {', '.join(others)}: here the agents of the scenario do; --without leaves them to clients again"
        )
    with as_typed():
        fork = forked(moment, changes_of(chosen, check(moment.scenario)), chosen.stop or [])
    fork.run = uuid.uuid4().hex[:16]
    return fork
