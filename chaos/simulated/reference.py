"""What local mode does in place of a run of many processes: its hash, its figures, and its steps.

The course of a run (course.py) is compared with it.
"""

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from itertools import groupby
from typing import Any, Protocol

from chaos.simulated.harvest import Harvest, digest_of_figures, digest_of_step
from orchard.contract.events import Event
from orchard.field.kinds import ROBOTS, kind_of
from orchard.field.scenario import Scenario
from orchard.futures.moments import WatchedRun
from orchard.local import Local
from orchard.sim.snapshot import Snapshot

# Tick -> the events of robots that are stopped or reset at it.
Commands = Mapping[int, Sequence[Event]]


class Reference(Protocol):
    """A run in local mode, from one tick to its end."""

    def hash_at(self, tick: int) -> bytes:
        """Return the hash at a tick; empty if the run has no such tick."""

    def figures_at(self, tick: int) -> bytes:
        """Return the digest of the figures at a tick; empty if the run has no such tick."""

    def step_at(self, tick: int) -> bytes:
        """Return the digest of the step from a tick; empty if the run has no such step."""

    def commanded(self, commands: Commands, figures: Collection[int]) -> "Reference":
        """Return the same run, in which robots are stopped and reset.

        `figures`: the ticks at which its figures are wanted; more may be added until it is asked.
        """


def _at(found: Sequence[bytes], tick: int) -> bytes:
    """Return the bytes of a tick; empty if there is no such tick."""
    if 0 <= tick < len(found):
        return found[tick]
    return b""


class HarvestReference:
    """The harvest of a scene, which is known from its first tick to its end."""

    def __init__(self, harvest: Harvest) -> None:
        self._harvest = harvest

    def hash_at(self, tick: int) -> bytes:
        return _at(self._harvest.hashes, tick)

    def figures_at(self, tick: int) -> bytes:
        return _at(self._harvest.figures, tick)

    def step_at(self, tick: int) -> bytes:
        return _at(self._harvest.steps, tick)

    def commanded(self, commands: Commands, figures: Collection[int]) -> Reference:
        # Up to the first command the harvest is the same, and need not be done again.
        first = self._harvest.last_keyframe(min(commands))
        return Replay(self._harvest.snapshot(first), commands, self, figures)


class Replay:
    """A run in local mode that goes on from a snapshot, as far as it is asked for."""

    def __init__(
        self,
        begin: Snapshot,
        commands: Commands | None = None,
        before: Reference | None = None,
        figures: Collection[int] | None = None,
    ) -> None:
        """`before`: the same run up to the snapshot. `figures`: as for `commanded`; None: all."""
        self._begin = begin
        self._commands = commands or {}
        self._before = before
        # The ticks at which figures are wanted.
        self._wanted = figures
        self._first = begin.tick
        # The hash at each tick, from the first one on.
        self._hashes: list[bytes] = []
        # Tick -> the digest of its figures.
        self._figures: dict[int, bytes] = {}
        # The digest of the step from each tick, from the first one on.
        self._steps: list[bytes] = []

    @cached_property
    def _run(self) -> WatchedRun:
        """The run, at the tick that it has come to. Many replays are never asked."""
        return WatchedRun(self._begin)

    def hash_at(self, tick: int) -> bytes:
        if tick < self._first and self._before is not None:
            return self._before.hash_at(tick)
        self._go_to(tick)
        return _at(self._hashes, tick - self._first)

    def figures_at(self, tick: int) -> bytes:
        if tick < self._first and self._before is not None:
            return self._before.figures_at(tick)
        self._go_to(tick)
        is_wanted = self._wanted is None or tick in self._wanted
        if is_wanted:
            return self._figures.get(tick, b"")
        raise ValueError(f"figures of tick {tick} were not wanted")

    def step_at(self, tick: int) -> bytes:
        if tick < self._first and self._before is not None:
            return self._before.step_at(tick)
        self._go_to(tick + 1)
        return _at(self._steps, tick - self._first)

    def commanded(self, commands: Commands, figures: Collection[int]) -> Reference:
        return Replay(self._begin, commands, figures=figures)

    def _go_to(self, tick: int) -> None:
        """Do all steps up to a tick that are not done yet, or up to the end of the run."""
        if not self._hashes:
            self._record()
        # A run that goes on says that it would end by its duration.
        while self._run.tick < tick and self._run.ended == "duration":
            self._step()
            self._record()

    def _step(self) -> None:
        """Do the next step, after the emergency stops of its tick in their order."""
        run = self._run
        engine = run.local.engine
        tick = self._run.tick
        # Events of the same kind that follow each other are one command.
        for what, commands in groupby(self._commands.get(tick, ()), lambda event: event.what):
            # A coupled bin is stopped with its robot, and no stop names it.
            robots = [event.who for event in commands if kind_of(event.who) in ROBOTS]
            if what == "stopped":
                engine.stop(robots)
            else:
                engine.reset(robots)
        events = run.local.tick()
        run.figures.update(events)
        self._steps.append(digest_of_step(events, run.local.post.written.get(tick, {})))

    def _record(self) -> None:
        """Store the hash and, if they are wanted, the figures of the present tick."""
        tick = self._run.tick
        self._hashes.append(self._run.local.engine.digest)
        if self._wanted is None or tick in self._wanted:
            self._figures[tick] = digest_of_figures(self._run.figures.figures())


def first_moment(scenario: Mapping[str, Any]) -> Snapshot:
    """Return the state of a scenario at its first tick."""
    return WatchedRun(Local(Scenario(**scenario)).snapshot()).snapshot()
