"""What the physics process owns of a run: its world, drivers, reports and snapshots."""

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


class Run:
    """The parts of one run, its steps and their reports. `RunLoop` decides when each step is done."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        engine: Engine,
        options: RunOptions,
        before: Snapshot | None = None,
    ) -> None:
        self.engine = engine
        self._elsewhere = (
            select_agents(engine.layout.agents, options.without, []) if options.without else []
        )
        self._owned_before = (
            before.owned if before else []
        )  # the agents that had a session; some may not come back
        self.refusal_totals = RefusalTotals(before.figures.get("refused") if before else None)
        self.id = options.run or (before.run if before else uuid.uuid4().hex[:16])
        roster, recovery_log = (
            Roster(engine.layout.agents),
            RecoveryLog(before.memories, before.letters) if before else RecoveryLog(),
        )
        is_paced = options.mode == "realtime"
        clock = RunClock(bus.clock)
        if options.paused:
            clock.pause()
        answers = (
            RealtimeBarrier(roster, TIME_STEP / options.pace, clock)
            if is_paced
            else LockstepBarrier(roster, clock, options.patience)
        )
        self.publisher = Publisher(bus, keys, self.id, engine.layout, answers.newest_wins)
        self.control = SimulationControl(
            clock, partial(self.publisher.publish, "simulation_state"), self.id, lambda: engine.tick
        )
        self.drivers = Drivers(engine, roster, answers, recovery_log, self.publisher, clock)
        self.drivers.lost |= before.lost if before else {}
        snapshot_writer = SnapshotWriter(
            options.snapshot_folder,
            bus.executor,
            bus.clock,
            options.snapshot_every,
            options.keyframes,
        )
        self.account = RunAccount(engine, before, snapshot_writer, options.table, clock)
        self._pending: tuple[int, list[Event]] | None = None  # a step that is not reported yet

    @property
    def has_begun(self) -> bool:
        return self.drivers.answers.tick >= 0

    def begin(self) -> None:
        self.control.begin()
        self.account.figures.begin()
        self._publish_figures()

    def step(self) -> None:
        """Step with the velocities that have come. `report` reports it later, while the agents think."""
        tick = self.engine.tick
        actions = self.drivers.actions(tick)
        events = self.engine.step(actions, self.drivers.answers.digests())
        self._pending = tick, events
        self.control.clock.count_step()

    def report(self) -> None:
        """Count and publish the results of the last step, unless that is done."""
        if self._pending is None:
            return
        (tick, events), self._pending = self._pending, None
        letters = self.drivers.recovery_log.letters.get(tick, {})
        self.account.update(events, letters)
        if events:
            self.publisher.tell("events", lambda: Events(self.id, tick, events))
        if letters:
            self.publisher.tell("letters", lambda: Letters(self.id, tick, letters))
        self.publisher.tell(
            "picture", lambda: picture_of(self.id, self.account.frame_builder.frame(events))
        )
        if self.publisher.is_bundle_due():
            self.publisher.send_bundle(tick)
        if self.account.figures.is_due():
            self._publish_figures()

    def _publish_figures(self) -> None:
        self.publisher.publish(
            "figures", self.account.figures.message(self.id, self.refusal_totals.total())
        )

    def keep_at_once(self) -> bool:
        self.keep()
        return self.is_kept()

    def is_kept(self) -> bool:
        return self.account.snapshot_writer.finish(KEPT_SECONDS)

    def keep(self) -> None:
        engine, recovery_log = self.engine, self.drivers.recovery_log
        scenario = engine.layout.scenario.model_dump()
        owned = sorted(self.drivers.roster.owners) if self.has_begun else self._owned_before
        letters, figures = (
            sorted(recovery_log.letters.items()),
            self.account.figures.as_data() | {"refused": self.refusal_totals.as_data()},
        )
        memories, rest = recovery_log.memories, (figures, owned, self.drivers.lost, self._elsewhere)
        self.account.keep(
            Snapshot(self.id, scenario, engine.as_data(), engine.digest, memories, letters, *rest)
        )

    def end(self, why: str) -> End:
        engine, answers = self.engine, self.drivers.answers
        hosts, refused = len(set(self.drivers.roster.owners.values())), self.refusal_totals.total()
        summary = self.account.summary(why, answers.mode, hosts, refused, answers.figures())
        return End(self.id, engine.tick, engine.over, why, engine.hash, summary)
