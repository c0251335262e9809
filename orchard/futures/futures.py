"""Futures of a run: how it may go on from a moment, as it was and with changes.

A future is a run in local mode from that moment to its end. Each has a seed of its own, for all
that is random from there on.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import typer
from rich.progress import Progress

from orchard.field.repeatable import draw
from orchard.field.scenario import check, with_changes
from orchard.fork.forked import forked
from orchard.futures.forecasts import forecast
from orchard.futures.moments import Future, live
from orchard.futures.options import ForkOptions
from orchard.launch.beginning import check_end
from orchard.server.options import last_tick
from orchard.sim.restore import world_from
from orchard.sim.snapshot import Snapshot
from orchard.study.comparing import interval
from orchard.study.result import Interval
from orchard.study.settings import Setting
from orchard.study.workers import Workers
from orchard.terminal.exits import FAILED
from orchard.terminal.output import print_error

Result = TypeVar("Result")
# What is done with a future, of which it gets the number and the first moment.
Work = Callable[[tuple[int, Snapshot]], Result]

CONFIDENCE = 0.95
FUTURES = 8  # for each moment, if a user says nothing else
# Figure of a summary -> its head in a table.
SHOWN = {
    "sim_seconds": "ends at, s",
    "bins_per_hour": "bins/h",
    "picker_waiting_seconds": "wait, s",
    "collisions": "collisions",
}


class Branch(NamedTuple):
    """What is changed at a moment: dotted path -> value, and the robots that stand from then on."""

    changes: dict[str, Any]
    stop: Sequence[str] = ()

    @property
    def words(self) -> str:
        """What is changed, as a user types it."""
        changed = [f"{key}={value}" for key, value in self.changes.items()]
        return ", ".join([*changed, *(f"{name} stopped" for name in self.stop)])


class Futures:
    """Lives futures side by side."""

    def __init__(
        self,
        chosen: ForkOptions,
        workers: Workers,
        is_stopped: Callable[[], bool],
        progress: Progress,
    ) -> None:
        """`is_stopped`: whether the user stops the command. `progress`: shows how far it is."""
        self._count = chosen.futures or FUTURES
        self._duration = chosen.duration
        self._live = partial(live, last_tick(chosen.duration))
        self._workers = workers
        self._is_stopped = is_stopped
        self._progress = progress
        self._task = progress.add_task("", total=0)

    def of(self, moment: Snapshot, *branches: Branch) -> list[Snapshot]:
        """Return the first moments of all futures, branch by branch on the same seeds.

        The futures of one number have the same seed in all branches, so that they can be compared
        in pairs. Raises ScenarioError for what cannot change, SnapshotError for a run that nothing
        ends.
        """
        begun: list[Snapshot] = []
        seeds = self._seeds(moment, branches)
        for branch in branches:
            of_branch = [
                forked(moment, {**branch.changes, "seed": seed}, branch.stop) for seed in seeds
            ]
            check_end(world_from(of_branch[0]), self._duration)
            begun += of_branch
        return begun

    def _seeds(self, moment: Snapshot, branches: Sequence[Branch]) -> list[int]:
        """Return a seed for each future of a branch; the run's own one if nothing is random."""
        scenario = check(moment.scenario)
        for branch in branches:
            if Setting({}, with_changes(scenario, **branch.changes)).is_random:
                # Shares of 1 as whole numbers: a float holds 53 bits.
                shares = [draw(scenario.seed, "future", number)[0] for number in range(self._count)]
                return [int(share * 2**53) for share in shares]
        return [scenario.seed]

    def live(self, begun: Sequence[Snapshot]) -> list[Future]:
        """Return what these futures give. Raises typer.Exit if the user stops the command."""
        return self._do(self._live, begun)

    def forecast(self, begun: Sequence[Snapshot]) -> list[Future | None]:
        """Return what the event model expects of these futures; None of one that it cannot do.

        Raises typer.Exit if the user stops the command.
        """
        return self._do(forecast, begun)

    def _do(self, work: Work[Result], begun: Sequence[Snapshot]) -> list[Result]:
        """Return what a work gives for each of these first moments, done side by side."""
        done: dict[int, Result] = {}
        self._progress.update(self._task, completed=0, total=len(begun))
        jobs = list(enumerate(begun))
        for (number, _), result in self._workers.do(work, jobs, self._may_begin):
            done[number] = result
            self._progress.advance(self._task)
        if len(done) < len(begun):
            print_error("stopped; nothing is kept")
            raise typer.Exit(FAILED)
        return [done[number] for number in range(len(begun))]

    def _may_begin(self) -> bool:
        return not self._is_stopped()


def well_ended(futures: Sequence[Future]) -> list[Future]:
    """Return the futures in which nothing went wrong."""
    return [future for future in futures if future["ended"] in ("harvested", "duration")]


def mean_of(key: str, futures: Sequence[Future]) -> Interval | None:
    """Return the mean of a figure over the futures that end well; None without any."""
    values = [float(future[key]) for future in well_ended(futures)]
    return interval(values, CONFIDENCE) if values else None
