"""How physics runs an orchard: the options of a run."""

import math
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from orchard.contract.agent import Holds
from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP
from orchard.server.snapshots import SNAPSHOT_SECONDS
from orchard.wire.keys import PREFIX
from orchard.wire.messages import Mode

PATIENCE = 15.0  # s of wall time that an agent may take to answer
Positive = Annotated[float, Meta(gt=0.0, le=1e12)]  # neither NaN nor infinite


def last_tick(duration: float | None) -> float:
    """Return the tick at which a run of this duration (s, simulated) ends; infinity without one."""
    return math.inf if duration is None else round(duration / TIME_STEP)


class RunOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How physics runs an orchard: the options of its command line, or of the request that `run.py` hands over."""

    scenario: dict[str, Any] = {}  # a value that is missing keeps its default
    listen: str | None = None  # endpoint; None: a free port of 127.0.0.1
    connect: str | None = None  # endpoint of another router, instead of listening
    secure: str | None = None  # directory of the role
    prefix: str = PREFIX
    run: str = ""  # the run's id; '': a new one
    mode: Mode = "lockstep"
    speed: Positive | None = None  # simulated s per s of wall time; None: as fast as possible, in realtime 1
    duration: Annotated[float, Meta(gt=0.0, le=LAST_TICK * TIME_STEP)] | None = None  # s, simulated
    patience: Positive = PATIENCE  # s of wall time that an agent may take to answer
    absent: list[str] = []  # agents for which the first tick does not wait
    recorded: bool = False  # the first tick waits for a logger, at most loop.LOGGER_SECONDS
    snapshots: str | None = None  # folder
    table: str | None = None  # folder for tables; None: none are written
    snapshot_every: Positive = SNAPSHOT_SECONDS  # s of wall time
    result: str | None = None  # file for a copy of the last message, which may be lost on the network
    resume: bool = False  # continue from the newest snapshot in the folder
    paused: bool = False  # the first tick waits until a client lets the run play, or does steps
    holds: Holds = "on"  # which agents are asked at a tick, see orchard.sim.lookahead; in realtime all are

    @property
    def pace(self) -> float:
        """Simulated seconds per second of wall time."""
        return self.speed if self.speed is not None else 1.0 if self.mode == "realtime" else math.inf

    @property
    def ticks(self) -> float:
        """The tick at which the run ends; infinity without a duration."""
        return last_tick(self.duration)

    @property
    def snapshot_folder(self) -> Path | None:
        """The folder for snapshots; None if none are written."""
        return None if self.snapshots is None else Path(self.snapshots)
