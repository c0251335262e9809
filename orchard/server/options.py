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
Simulated = Annotated[float, Meta(gt=0.0, le=LAST_TICK * TIME_STEP)]  # s


def last_tick(duration: float | None) -> float:
    """Return the tick at which a run of this duration (s, simulated) ends; infinity without one."""
    return math.inf if duration is None else round(duration / TIME_STEP)


class RunOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How physics runs an orchard: the options of its command line, or of the request that `run.py` hands over."""

    scenario: dict[str, Any] = {}  # a value that is missing keeps its default
    listen: Annotated[str | None, Meta(description="endpoint; default: a free port of 127.0.0.1")] = None
    connect: Annotated[str | None, Meta(description="endpoint of another router, instead of --listen")] = None
    secure: Annotated[str | None, Meta(description="directory of the role; endpoints are tls/..., and rights depend on the role")] = None
    prefix: Annotated[str, Meta(description="first part of every key")] = PREFIX
    run: Annotated[str, Meta(description="id of the run; default: a new one")] = ""
    mode: Annotated[Mode, Meta(description="lockstep: wait for all agents; realtime: for none")] = "lockstep"
    speed: Annotated[Positive | None, Meta(description="simulated s per s of wall time; default: max, in realtime 1")] = None
    duration: Annotated[Simulated | None, Meta(description="simulated s after which the run ends")] = None
    patience: Annotated[Positive, Meta(description="s of wall time that an agent may take to answer")] = PATIENCE
    absent: Annotated[list[str], Meta(description="agent or kind for which the first tick does not wait (repeatable)")] = []
    recorded: Annotated[bool, Meta(description="wait for a logger before the first tick, at most 10 s")] = False
    snapshots: Annotated[str | None, Meta(description="folder for snapshots of the run")] = None
    table: Annotated[str | None, Meta(description="folder for tables of the run; those of the same run there go on")] = None
    snapshot_every: Annotated[Positive, Meta(description="s of wall time between two snapshots")] = SNAPSHOT_SECONDS
    result: Annotated[str | None, Meta(description="file for the end of the run, for the program that started this one")] = None
    resume: Annotated[bool, Meta(description="continue from the newest snapshot in the folder, if there is one")] = False
    paused: Annotated[bool, Meta(description="begin when a client lets the run play, or does steps")] = False
    holds: Annotated[Holds, Meta(description="on, ignored, checked: ask agents that hold, and check them")] = "on"

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
