"""All that physics owns of a run: the world, those who drive in it, what is told of it, and its snapshots."""

import math
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orchard.field.scenario import TIME_STEP
from orchard.net.bus import Bus
from orchard.net.lockstep import PATIENCE, LockstepBarrier
from orchard.net.realtime import RealtimeBarrier
from orchard.net.recovery import RecoveryLog
from orchard.net.refusals import RefusalTotals
from orchard.net.roster import Roster
from orchard.server.drivers import Drivers
from orchard.server.figures import RunFigures
from orchard.server.publisher import Publisher
from orchard.server.snapshots import SNAPSHOT_SECONDS, SnapshotWriter
from orchard.server.step_reporter import StepReporter
from orchard.sim.snapshot import Snapshot
from orchard.wire.keys import Keys
from orchard.wire.messages import End

if TYPE_CHECKING:
    from orchard.sim.engine import Engine


@dataclass(frozen=True)
class RunOptions:
    """How a run is run."""

    mode: str = "lockstep"
    speed: float = math.inf  # simulated seconds to one second of wall time
    ticks: float = math.inf  # after which it ends
    patience: float = PATIENCE  # s, for how long an agent may be silent
    absent: tuple[str, ...] = ()  # agents that are not waited for at the beginning
    run: str = ""  # the run's id; '': one is made
    recorded: bool = False  # a logger comes: wait for it, but not for long
    snapshots: Path | None = None  # the folder for them
    snapshot_every: float = SNAPSHOT_SECONDS  # s of wall time


class RunEnded(Exception):
    """Somebody ended the run."""


class Harvest:
    """One run. What arrives, and what is done when, is for others."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: RunOptions, before: Snapshot | None = None) -> None:
        """`before`: the snapshot that the engine was made of."""
        self.engine, self.refusal_totals, self.snapshot_writer = (
            engine,
            RefusalTotals(),
            SnapshotWriter(options.snapshots, options.snapshot_every),
        )
        self.run = options.run or (before.run if before else uuid.uuid4().hex[:16])
        roster, ledger = Roster(engine.agents), RecoveryLog(before.memories, before.letters) if before else RecoveryLog()
        answers = _answers(roster, options)
        self.publisher = Publisher(bus, keys, self.run, engine.layout, answers.newest_wins)
        self.drivers = Drivers(engine, roster, answers, ledger, self.publisher)
        account = RunFigures(engine, before.figures if before else {})
        self.reporter = StepReporter(engine, account, self.publisher, ledger, self.refusal_totals)

    @property
    def has_begun(self) -> bool:
        """Whether the first tick was shown."""
        return self.drivers.answers.tick >= 0

    def keep(self) -> None:
        """Begin to write a snapshot."""
        self.snapshot_writer.keep(self._snapshot())

    def _snapshot(self) -> Snapshot:
        """The run between two ticks, as data."""
        engine, ledger = self.engine, self.drivers.ledger
        scenario, held = engine.layout.scenario.model_dump(), sorted(self.drivers.roster.holders)
        letters, figures = sorted(ledger.letters.items()), self.reporter.account.as_data()
        return Snapshot(self.run, scenario, engine.as_data(), engine.digest, ledger.memories, letters, figures, held)

    def end(self, why: str) -> End:
        """The end, as it is told to everybody."""
        engine, answers = self.engine, self.drivers.answers
        run = {"mode": answers.mode, "hosts": len(set(self.drivers.roster.holders.values()))}
        figures = self.reporter.account.figures() | answers.figures()
        summary = {"hash": engine.hash} | run | figures | {"messages_refused": self.refusal_totals.total()}
        summary |= {"finished": engine.over, "violations": engine.violations()}
        return End(self.run, engine.tick, engine.over, why, engine.hash, summary)


def _answers(roster: Roster, options: RunOptions) -> LockstepBarrier | RealtimeBarrier:
    """Who decides when a tick's answers are in."""
    return RealtimeBarrier(roster, TIME_STEP / options.speed) if options.mode == "realtime" else LockstepBarrier(roster, options.patience)
