"""What the physics process owns of a run: its world, drivers, reports and snapshots.

`RunLoop` (loop.py) calls it, and decides when a step is done. `Inbound` (inbound.py) reaches the
parts of the run through it.
"""

import uuid
from functools import partial
from typing import Any

from orchard.contract.events import Event
from orchard.field.kinds import select_agents
from orchard.field.scenario import TIME_STEP
from orchard.net.bus import Bus
from orchard.net.refusals import RefusalTotals
from orchard.server.account import RunAccount
from orchard.server.barriers import LockstepBarrier, RealtimeBarrier
from orchard.server.control import RunClock, SimulationControl
from orchard.server.drivers import Drivers
from orchard.server.options import RunOptions
from orchard.server.publisher import Publisher
from orchard.server.roster import RecoveryLog, Roster
from orchard.server.snapshots import KEPT_SECONDS, SnapshotWriter
from orchard.sim.engine import Engine
from orchard.sim.snapshot import Snapshot
from orchard.wire.codec import picture_of
from orchard.wire.keys import Keys
from orchard.wire.messages import RESET, End, Events, Letters


class RunEnded(Exception):
    """A command or a signal ends the run; the text says why."""


class RunReset(RunEnded):
    """A command ends the run so that it begins again with `scenario`."""

    def __init__(self, scenario: dict[str, Any]) -> None:
        super().__init__(RESET)
        self.scenario = scenario


class PhysicsRun:
    """The parts of one run, its steps and their reports."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        engine: Engine,
        options: RunOptions,
        before: Snapshot | None = None,
    ) -> None:
        """Make the parts. `before`: the snapshot from which the engine was resumed.

        Raises SnapshotError if its figures are malformed.
        """
        self.engine = engine
        self.id = _id_of(options, before)
        # The agents that clients elsewhere drive, for forks of this run.
        self._elsewhere: list[str] = []
        if options.without:
            self._elsewhere = select_agents(engine.layout.agents, options.without, [])
        # The agents that had a session in the snapshot. A snapshot that is written before the first
        # tick names them again, for not all may have come back yet.
        if before:
            self._owned_before = before.owned
        else:
            self._owned_before = []
        self.refusal_totals = RefusalTotals()
        if before is not None:
            self.refusal_totals = RefusalTotals(before.figures.get("refused"))
        clock = RunClock(bus.clock)
        if options.paused:
            clock.pause()
        roster = Roster(engine.layout.agents)
        answers = _barrier(options, roster, clock)
        recovery_log = RecoveryLog()
        if before is not None:
            recovery_log = RecoveryLog(before.memories, before.letters)
        self.publisher = Publisher(bus, keys, self.id, engine.layout, answers.newest_wins)
        publish_state = partial(self.publisher.publish, "simulation_state")
        self.control = SimulationControl(clock, publish_state, self.id, lambda: engine.tick)
        self.drivers = Drivers(
            engine,
            roster,
            answers,
            recovery_log=recovery_log,
            publisher=self.publisher,
            clock=clock,
        )
        if before is not None:
            self.drivers.lost |= before.lost
        snapshot_writer = SnapshotWriter(
            folder=options.snapshot_folder,
            executor=bus.executor,
            clock=bus.clock,
            seconds=options.snapshot_every,
            keyframe_seconds=options.keyframes,
        )
        self.account = RunAccount(engine, before, snapshot_writer, options.table, clock)
        # The tick and the events of a step that is not reported yet.
        self._pending: tuple[int, list[Event]] | None = None

    @property
    def has_begun(self) -> bool:
        """Whether the first tick has been published."""
        return self.drivers.answers.tick >= 0

    def begin(self) -> None:
        """Begin with the first tick: all that are waited for are there."""
        self.control.begin()
        self.account.figures.begin()
        self._publish_figures()

    def step(self) -> None:
        """Do the step with the velocities that have come.

        `report` counts and publishes it later, while the agents think about the next tick.
        """
        tick = self.engine.tick
        actions = self.drivers.actions(tick)
        events = self.engine.step(actions, self.drivers.answers.digests())
        self._pending = (tick, events)
        self.control.clock.count_step()

    def report(self) -> None:
        """Count and publish the results of the last step, unless that has been done."""
        if self._pending is None:
            return
        tick, events = self._pending
        self._pending = None
        letters = self.drivers.letters_of(tick)
        self.account.update(events, letters)
        if events:
            self.publisher.tell("events", lambda: Events(self.id, tick, events))
        if letters:
            self.publisher.tell("letters", lambda: Letters(self.id, tick, letters))
        self.publisher.tell("picture", lambda: picture_of(self.id, self.account.frame(events)))
        if self.publisher.is_bundle_due():
            self.publisher.send_bundle(tick)
        if self.account.figures.is_due():
            self._publish_figures()

    def _publish_figures(self) -> None:
        """Publish the figures so far."""
        refused = self.refusal_totals.total()
        self.publisher.publish("figures", self.account.figures.message(self.id, refused))

    @property
    def may_be_kept(self) -> bool:
        """Whether the run has a folder for snapshots."""
        return self.account.snapshot_writer.folder is not None

    def keep_at_once(self) -> bool:
        """Write a snapshot, and wait for it. Return whether it is on the disk."""
        self.keep()
        return self.is_kept()

    def is_kept(self) -> bool:
        """Wait for the last snapshot, at most KEPT_SECONDS. Return whether it is on the disk."""
        return self.account.snapshot_writer.finish(KEPT_SECONDS)

    def keep_if_due(self) -> None:
        """Write a snapshot if one is due at this tick."""
        if self.account.is_due_to_keep(self.engine.tick):
            self.keep()

    def keep(self) -> None:
        """Write a snapshot of the run as it is, unless it has no folder for snapshots."""
        engine = self.engine
        drivers = self.drivers
        if self.has_begun:
            owned = sorted(drivers.roster.owners)
        else:
            owned = self._owned_before
        figures = self.account.figures.as_data() | {"refused": self.refusal_totals.as_data()}
        snapshot = Snapshot(
            run=self.id,
            scenario=engine.scenario.model_dump(),
            world=engine.as_data(),
            digest=engine.digest,
            memories=drivers.memories(),
            letters=drivers.letters(),
            figures=figures,
            owned=owned,
            lost=drivers.lost,
            elsewhere=self._elsewhere,
        )
        self.account.keep(snapshot)

    def end(self, why: str) -> End:
        """Return the message of the end, with the summary. `why`: a word of `End.why`."""
        engine = self.engine
        answers = self.drivers.answers
        summary = self.account.summary(
            why=why,
            mode=answers.mode,
            hosts=len(self.drivers.roster.sessions),
            refused=self.refusal_totals.total(),
            answers=answers.figures(),
        )
        return End(
            run=self.id,
            tick=engine.tick,
            finished=engine.over,
            why=why,
            hash=engine.hash,
            summary=summary,
        )


def _id_of(options: RunOptions, before: Snapshot | None) -> str:
    """Return the run's id: that of the options, or of the run that is resumed, or a new one."""
    if options.run:
        return options.run
    if before:
        return before.run
    return uuid.uuid4().hex[:16]


def _barrier(
    options: RunOptions, roster: Roster, clock: RunClock
) -> LockstepBarrier | RealtimeBarrier:
    """Return the barrier of the run's mode."""
    if options.mode == "realtime":
        return RealtimeBarrier(roster, TIME_STEP / options.pace, clock)
    return LockstepBarrier(roster, clock, options.patience)
