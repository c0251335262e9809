"""The physics process: it owns the world and the clock of a run.

    python -m orchard.processes.physics --listen tcp/127.0.0.1:7447

It is the router for the other processes, unless `--connect` names another one.
"""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from orchard.field.kinds import select_agents
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check, load
from orchard.memory import settle
from orchard.net.bus import Bus, Inbox
from orchard.net.endpoints import LOOPBACK, SECURE_LOOPBACK, BusError
from orchard.net.process import run_process
from orchard.net.zenoh_bus import client, router
from orchard.security.identity import identity_in
from orchard.server.options import RunOptions
from orchard.server.snapshots import last, sole_writer
from orchard.sim.snapshot import Snapshot, SnapshotError
from orchard.wire.keys import Keys
from orchard.wire.messages import End

if TYPE_CHECKING:
    from orchard.server.loop import RunLoop

# Opens the session of physics, whose items arrive in an inbox.
Opened = Callable[[RunOptions, Inbox], AbstractContextManager[Bus]]
# Gets a run ready for its first tick.
Ready = Callable[["RunLoop"], None]


def opened_over_zenoh(options: RunOptions, inbox: Inbox) -> AbstractContextManager[Bus]:
    """Open the session of physics: a client of another router, or the router itself."""
    identity = identity_in(options.secure, options.prefix)
    if options.connect:
        return client(options.connect, inbox, identity=identity)
    default = LOOPBACK if identity is None else SECURE_LOOPBACK
    return router(options.listen or default, inbox, identity)


def rehearsed(loop: "RunLoop") -> None:
    """Get a run ready for its first tick: load its kernels, and settle its memory."""
    loop.run.engine.rehearse()
    settle()


def main(argv: list[str] | None = None) -> int:
    """Run an orchard.

    Return the exit code: 0; 1 for a bad run, unless its end is in the file of --result; 2 for bad
    input.
    """
    mistakes = (BusError, ScenarioError, SnapshotError, ValueError, OSError)
    return run_process("physics", RunOptions, argv, simulate, *mistakes)


def simulate(
    inbox: Inbox, options: RunOptions, opened: Opened = opened_over_zenoh, ready: Ready = rehearsed
) -> int:
    """Simulate an orchard until its run ends, again after each reset. Return the exit code.

    `ready` is called before the first tick of each run.
    """
    keys = Keys(options.prefix)
    snapshots = options.snapshot_folder
    with sole_writer(snapshots):
        before = last(snapshots, options.run) if options.resume and snapshots else None
        if before is None and isinstance(options.scenario, str):
            # A snapshot holds the scenario, and its file may be gone then.
            options = msgspec.structs.replace(options, scenario=load(options.scenario).model_dump())
        if options.table is not None and not options.resume:
            # It is imported here, because pyarrow takes some time to load.
            from orchard.tables.folder import check_folder

            check_folder(Path(options.table), check(options.scenario, "the scenario"))
        while True:
            with opened(options, inbox) as bus:
                code, again = _simulate_once(bus, keys, before, options, ready)
            if again is None:
                return code
            inbox.forget()
            options = again
            # After a reset it does not go on from the snapshot.
            before = None


def _simulate_once(
    bus: Bus, keys: Keys, before: Snapshot | None, options: RunOptions, ready: Ready
) -> tuple[int, RunOptions | None]:
    """Simulate a run up to its end.

    Return the exit code, and the options with which the run begins again; None if it does not.
    """
    # These are imported here, because other processes can connect while numba loads.
    from orchard.server.loop import RunLoop
    from orchard.sim.engine import Engine
    from orchard.sim.lookahead import HOLDS, IgnoredHolds

    holds = HOLDS[options.holds]
    if options.mode == "realtime":
        # In realtime all agents are asked at each tick.
        holds = IgnoredHolds
    if before is None:
        engine = Engine.begin(check(options.scenario, "the scenario"), holds)
    else:
        engine = Engine.resume(before, holds)
    if options.absent:
        absent = select_agents(engine.layout.agents, options.absent, [])
        options = msgspec.structs.replace(options, absent=absent)
    physics = RunLoop(bus, keys, engine, options, before)
    if before is None:
        # Hosts learn the scenario of this run soon, which a reset may have changed. If physics is
        # killed after that, it must go on with the same one, so a snapshot is written first.
        physics.run.keep_at_once()
    physics.arrivals.listen()
    if options.connect:
        where = "connected to"
    else:
        where = "listening on"
    print(f"{where} {bus.endpoint}, prefix {keys.prefix}, run {physics.run.id}", flush=True)
    end = physics.play(lambda: ready(physics))
    _print_end(end)
    # `orchard` reads the end from the file of --result, and reports what is bad.
    is_reported = options.result is not None
    code = 0
    if _is_bad(end) and not is_reported:
        code = 1
    return code, physics.again


def _print_end(end: End) -> None:
    """Print why a run has ended, its last tick, its hash, and what was violated."""
    seconds = end.summary["wall_seconds"]
    print(f"{end.why}: tick {end.tick}, {seconds} s, hash {end.hash}", flush=True)
    for violation in end.summary["violations"]:
        print(f"violated: {violation}", flush=True)


def _is_bad(end: End) -> bool:
    """Whether a run has jammed, broken a rule, or lost an agent."""
    summary = end.summary
    return end.why == "jammed" or bool(summary["violations"] or summary["broken_agents"])


if __name__ == "__main__":
    sys.exit(main())
