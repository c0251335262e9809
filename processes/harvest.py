"""All that physics owns of a run: the world, those who drive in it, what is told of it, and its snapshots."""

import math
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orchard.bus import Bus
from orchard.config import TIME_STEP
from orchard.keys import Keys
from orchard.lockstep import PATIENCE, Answers, Ledger, Roster
from orchard.realtime import Live
from orchard.snapshot import Snapshot
from orchard.wire.course import End
from processes.account import Account
from processes.announcer import Announcer
from processes.chronicle import Chronicle
from processes.drivers import Drivers
from processes.keeper import SNAPSHOT_SECONDS, Keeper
from processes.tally import Tally

if TYPE_CHECKING:
    from orchard.engine import Engine


@dataclass(frozen=True)
class Options:
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


class Ended(Exception):
    """Somebody ended the run."""


class Harvest:
    """One run. What arrives, and what is done when, is for others."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: Options, before: Snapshot | None = None) -> None:
        """`before`: the snapshot that the engine was made of."""
        self.engine, self.tally, self.keeper = engine, Tally(), Keeper(options.snapshots, options.snapshot_every)
        self.run = options.run or (before.run if before else uuid.uuid4().hex[:16])
        roster, ledger = Roster(engine.agents), Ledger(before.memories, before.letters) if before else Ledger()
        answers = _answers(roster, options)
        self.announcer = Announcer(bus, keys, self.run, engine.layout, answers.newest_wins)
        self.drivers = Drivers(engine, roster, answers, ledger, self.announcer)
        account = Account(engine, before.figures if before else {})
        self.chronicle = Chronicle(engine, account, self.announcer, ledger, self.tally)

    @property
    def has_begun(self) -> bool:
        """Whether the first tick was shown."""
        return self.drivers.answers.tick >= 0

    def keep(self) -> None:
        """Begin to write a snapshot."""
        self.keeper.keep(self._snapshot())

    def _snapshot(self) -> Snapshot:
        """The run between two ticks, as data."""
        engine, ledger = self.engine, self.drivers.ledger
        scenario, held = engine.layout.scenario.model_dump(), sorted(self.drivers.roster.holders)
        letters, figures = sorted(ledger.letters.items()), self.chronicle.account.as_data()
        return Snapshot(self.run, scenario, engine.as_data(), engine.digest, ledger.memories, letters, figures, held)

    def end(self, why: str) -> End:
        """The end, as it is told to everybody."""
        engine, answers = self.engine, self.drivers.answers
        run = {"mode": answers.mode, "hosts": len(set(self.drivers.roster.holders.values()))}
        figures = self.chronicle.account.figures() | answers.figures()
        summary = {"hash": engine.hash} | run | figures | {"messages_refused": self.tally.total()}
        summary |= {"finished": engine.over, "violations": engine.violations()}
        return End(self.run, engine.tick, engine.over, why, engine.hash, summary)


def _answers(roster: Roster, options: Options) -> Answers | Live:
    """Who decides when a tick's answers are in."""
    return Live(roster, TIME_STEP / options.speed) if options.mode == "realtime" else Answers(roster, options.patience)
