"""The process that owns the world and the clock: its command line.

    python -m processes.physics config/orchard.yaml --listen tcp/127.0.0.1:7447

It is the router for the others, unless it is told where another one is. What it does then is in ticks.py.
"""

import argparse
import logging
import math
import signal
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from orchard.field.kinds import select_agents
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP, Scenario, load
from orchard.launch.options_time import seconds, simulated_seconds
from orchard.net.bus import Bus, Inbox, Signal, client, router
from orchard.net.endpoints import LOOPBACK, SECURE_LOOPBACK, BusError
from orchard.net.lockstep import PATIENCE
from orchard.net.process import settle
from orchard.security.identity import Identity, identity_in
from orchard.server.harvest import RunOptions
from orchard.server.loop import Physics
from orchard.server.result import leave
from orchard.server.snapshots import SNAPSHOT_SECONDS, last, sole
from orchard.sim.snapshot import Snapshot, SnapshotError
from orchard.wire.keys import PREFIX, Keys

if TYPE_CHECKING:
    from orchard.sim.engine import Engine

log = logging.getLogger("orchard")


def main(argv: list[str] | None = None) -> int:
    arguments = _arguments(argv)
    logging.basicConfig(level=logging.WARNING, format="physics: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        keys = Keys(arguments.prefix)
        with sole(arguments.snapshots):
            before = last(arguments.snapshots) if arguments.resume else None
            with _meeting(arguments, inbox, identity_in(arguments.secure, arguments.prefix)) as bus:
                return _run(bus, keys, before, arguments)
    except (BusError, ScenarioError, SnapshotError, ValueError) as error:
        log.error("%s", error)
        return 2


def _meeting(arguments: argparse.Namespace, inbox: Inbox, identity: Identity | None) -> AbstractContextManager[Bus]:
    """The session: with a router elsewhere, or as the router."""
    if arguments.connect:
        return client(arguments.connect, inbox, identity=identity)
    return router(arguments.listen or (LOOPBACK if identity is None else SECURE_LOOPBACK), inbox, identity)


def _run(bus: Bus, keys: Keys, before: Snapshot | None, arguments: argparse.Namespace) -> int:
    # Late, because numba takes seconds to load on a busy machine, and meanwhile the others can find the router.
    from orchard.sim.engine import Engine

    scenario = load(arguments.scenario) if arguments.scenario else Scenario()
    engine = Engine.begin(scenario) if before is None else Engine.resume(before)
    absent = select_agents(engine.agents, arguments.absent, []) if arguments.absent else []
    ticks = math.inf if arguments.duration is None else round(arguments.duration / TIME_STEP)
    pace, kept = _pace(arguments), (arguments.snapshots, arguments.snapshot_every)
    options = RunOptions(arguments.mode, pace, ticks, arguments.patience, tuple(absent), arguments.run, arguments.recorded, *kept)
    physics = Physics(bus, keys, engine, options, before)
    physics.listen()
    where = "connected to" if arguments.connect else "listening on"
    print(f"{where} {bus.endpoint}, prefix {keys.prefix}, run {physics.harvest.run}", flush=True)
    end = physics.run(lambda: _get_ready(engine))
    if arguments.result is not None:
        leave(end, arguments.result)
    print(f"{end.why}: tick {end.tick}, {end.summary['wall_seconds']} s, hash {end.hash}", flush=True)
    for violation in end.summary["violations"]:
        print(f"violated: {violation}", flush=True)
    return 1 if end.why.startswith("jammed") or end.summary["violations"] else 0


def _get_ready(engine: "Engine") -> None:
    engine.rehearse()
    settle()


def _speed(text: str) -> float:
    speed = math.inf if text == "max" else float(text)
    if not speed > 0:
        raise ValueError
    return speed


def _pace(arguments: argparse.Namespace) -> float:
    """Simulated seconds to a second, which realtime needs to know."""
    speed = arguments.speed if arguments.speed is not None else 1.0 if arguments.mode == "realtime" else math.inf
    if arguments.mode == "realtime" and math.isinf(speed):
        raise ValueError("--speed max: in realtime the wall clock sets the pace; wanted is a number, 1 for real time")
    return speed


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.physics", description="Own the world and the clock of an orchard.")
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO.yaml", help="default: the built-in scenario")
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--listen", metavar="ENDPOINT", help="default: a free port of 127.0.0.1")
    place.add_argument("--connect", metavar="ENDPOINT", help="that of a router elsewhere")
    parser.add_argument("--secure", metavar="DIR", help="the role's directory: endpoints are tls/..., and each role may do its own only")
    parser.add_argument("--run", default="", metavar="ID", help="the run's id; default: a new one")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--mode", choices=["lockstep", "realtime"], default="lockstep", help="wait for all agents, or for none")
    parser.add_argument("--speed", type=_speed, metavar="X|max", help="simulated seconds to a second; default max, in realtime 1")
    parser.add_argument("--duration", type=simulated_seconds, metavar="SECONDS", help="simulated seconds after which the run ends")
    parser.add_argument("--patience", type=seconds, default=PATIENCE, metavar="SECONDS", help="how long an agent may be silent")
    parser.add_argument("--absent", action="append", default=[], metavar="KIND|NAME", help="do not wait for these (repeatable)")
    parser.add_argument("--recorded", action="store_true", help="begin when a logger is there, or after 10 s")
    parser.add_argument("--snapshots", type=Path, metavar="DIR", help="keep snapshots of the run there")
    parser.add_argument("--snapshot-every", type=seconds, default=SNAPSHOT_SECONDS, metavar="SECONDS", help="wall time; default 2")
    parser.add_argument("--result", type=Path, metavar="FILE", help="leave there how it ended, for whoever started this")
    parser.add_argument("--resume", action="store_true", help="go on from the newest snapshot in there, if there is one")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
