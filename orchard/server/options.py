"""How physics runs an orchard: the options of its process.

`orchard` starts the process with them (orchard/launch/distributed.py); --help of
processes/physics.py shows them.
"""

import math
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from orchard.contract.agent import Holds
from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP
from orchard.net.options import Positive, ProcessOptions, option
from orchard.server.snapshots import KEYFRAME_SECONDS, SNAPSHOT_SECONDS
from orchard.wire.keys import PREFIX
from orchard.wire.messages import Mode

PATIENCE = 15.0  # s of wall time that an agent may take to answer
Duration = Annotated[float, Meta(gt=0.0, le=LAST_TICK * TIME_STEP)]  # s, simulated


def last_tick(duration: float | None) -> float:
    """Return the tick at which a run of this duration (s, simulated) ends; infinity without one."""
    if duration is None:
        return math.inf
    return round(duration / TIME_STEP)


class RunOptions(ProcessOptions, frozen=True, kw_only=True):
    """Simulate the world of an orchard."""

    # Its values, name -> value, or the path of its file.
    scenario: Annotated[
        dict[str, Any] | str, option("SCENARIO.yaml", "default: the built-in scenario", nargs="?")
    ] = {}
    listen: Annotated[str | None, option("ENDPOINT", "default: a free port of 127.0.0.1")] = None
    connect: Annotated[
        str | None, option("ENDPOINT", "endpoint of another router, instead of listening")
    ] = None
    prefix: Annotated[str, option("PREFIX", "first part of every key")] = PREFIX
    run: Annotated[str, option("ID", "id of the run; default: a new one")] = ""
    mode: Annotated[Mode, option("lockstep|realtime", "wait for all agents, or for none")] = (
        "lockstep"
    )
    speed: Annotated[
        Positive | None,
        option("X", "simulated seconds per second; default: as fast as possible, in realtime 1"),
    ] = None
    duration: Annotated[
        Duration | None, option("SECONDS", "simulated seconds, above 0, after which the run ends")
    ] = None
    patience: Annotated[
        Positive, option("SECONDS", "wall time, above 0, that an agent may take to answer")
    ] = PATIENCE
    absent: Annotated[
        list[str], option("KIND|NAME", "the first tick does not wait for these agents (repeatable)")
    ] = []
    without: Annotated[
        list[str],
        option("KIND|NAME", "clients elsewhere drive these agents, which forks say (repeatable)"),
    ] = []
    recorded: Annotated[bool, option("", "the first tick waits for a logger, at most 60 s")] = False
    snapshots: Annotated[str | None, option("DIR", "folder for snapshots of the run")] = None
    snapshot_every: Annotated[
        Positive, option("SECONDS", "wall time, above 0, between two snapshots; default: 2")
    ] = SNAPSHOT_SECONDS
    keyframes: Annotated[
        Positive, option("SECONDS", "simulated time, above 0, between two keyframes; default: 60")
    ] = KEYFRAME_SECONDS
    table: Annotated[
        str | None, option("DIR", "folder for tables of the run; those of the same run there go on")
    ] = None
    result: Annotated[
        str | None,
        option("FILE", "file for the end of the run: its message may be lost on the network"),
    ] = None
    resume: Annotated[
        bool, option("", "continue from the newest snapshot in the folder, if there is one")
    ] = False
    paused: Annotated[
        bool, option("", "the first tick waits until a client lets the run play, or does steps")
    ] = False
    holds: Annotated[
        Holds,
        option(
            "on|ignored|checked", "ask agents that hold, and check them; in realtime all are asked"
        ),
    ] = "on"

    def __post_init__(self) -> None:
        if self.listen and self.connect:
            raise ValueError(
                "a run either listens or uses another router: give --listen or --connect"
            )

    @property
    def pace(self) -> float:
        """Simulated seconds per second of wall time."""
        if self.speed is not None:
            return self.speed
        if self.mode == "realtime":
            return 1.0
        return math.inf

    @property
    def snapshot_folder(self) -> Path | None:
        """The folder for snapshots; None if there are none."""
        if self.snapshots is None:
            return None
        return Path(self.snapshots)
