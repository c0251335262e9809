"""The host process: hosts any number of agents over one session.

    python -m orchard.processes.agents --connect tcp/127.0.0.1:7447 --only picker --only bin_03

The scenario comes from physics. Without --only and --without it hosts all agents; --share 0/3 hosts
every third agent. orchard/net/host.py does the ticks.
"""

import logging
import sys
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NoReturn

from orchard.behaviour.catalogue import guarded
from orchard.contract.agent import Agent
from orchard.contract.printed import printed
from orchard.field.kinds import select_agents
from orchard.field.layout import Layout
from orchard.field.plugins import contained, end_soon, import_own, place_of_error
from orchard.field.problems import ScenarioError
from orchard.memory import settle
from orchard.net.bus import Bus, Inbox
from orchard.net.endpoints import BusError
from orchard.net.host import Host, HostEnded, end_if_asked
from orchard.net.options import HostOptions
from orchard.net.process import monitor, run_process
from orchard.net.requests import TRIES, fetch_layout
from orchard.net.zenoh_bus import client
from orchard.security.identity import Identity, identity_in
from orchard.wire.keys import Keys
from orchard.wire.messages import RESET

log = logging.getLogger("orchard")

# Makes the agents of some names of a layout, name -> agent.
Factory = Callable[[Layout, Collection[str]], dict[str, Agent]]
# Opens a session whose items arrive in an inbox.
Opened = Callable[[Inbox], AbstractContextManager[Bus]]
# Sessions that are opened after a reset, until one finds the run. All but the last one try for a
# sixth of the usual time.
SESSIONS = 6


def made(path: str, layout: Layout, names: Collection[str]) -> dict[str, Agent]:
    """Return the agents that the factory 'package.module:name' makes, name -> agent.

    Raises ValueError for its faults.
    """
    module, _, name = path.partition(":")
    try:
        make: Factory = getattr(import_own(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"agents {path}: {error}; expected package.module:function") from error
    try:
        agents = contained(make, layout, names)
        return {name: agents[name] for name in names}
    except Exception as error:
        expected = "a function of (layout, names) that returns a map with an agent for each name"
        fault = f"{type(error).__name__}: {error}{place_of_error(error)}"
        raise ValueError(f"agents {path}: {fault}; expected {expected}") from error


def watched(host: Host) -> None:
    """Get a host ready: let it log agents that are too slow."""
    settle()
    monitor(host)


def main(argv: list[str] | None = None) -> int:
    """Host agents until the run ends. Return the exit code."""
    mistakes = (BusError, ValueError, ScenarioError)
    return run_process("agents", HostOptions, argv, _run, *mistakes)


def _run(inbox: Inbox, options: HostOptions) -> NoReturn:
    """Host agents over Zenoh. Raises HostEnded."""
    identity = identity_in(options.secure, options.prefix)

    def opened(inbox: Inbox) -> AbstractContextManager[Bus]:
        return client(options.connect, inbox, identity=identity)

    with printed(log.warning):
        host(inbox, options, opened, identity)


def host(
    inbox: Inbox,
    options: HostOptions,
    opened: Opened,
    identity: Identity | None = None,
    ready: Callable[[Host], None] = watched,
) -> NoReturn:
    """Host agents until the run ends, again after each reset.

    `ready` gets each host before its first tick. Raises HostEnded.
    """
    # One session at first. After a reset more, because the first ones may find the router of the
    # run before, which closes soon.
    sessions_left = 1
    while True:
        sessions_left -= 1
        is_last = sessions_left == 0
        tries = TRIES
        if not is_last:
            tries = TRIES // SESSIONS
        try:
            with opened(inbox) as bus:
                agents = _host(bus, options, identity, tries)
                ready(agents)
                agents.run()
        except HostEnded as end:
            if str(end) != RESET:
                raise
            sessions_left = SESSIONS
        except BusError:
            if is_last:
                raise
        # Nothing of this session counts for the next one.
        inbox.forget()


def _host(bus: Bus, options: HostOptions, identity: Identity | None, tries: int) -> Host:
    """Return a host with its agents, which listens to a run. Raises BusError, ValueError."""
    keys = Keys(options.prefix)
    run, layout = fetch_layout(bus, keys, end_if_asked, tries)
    allowed = run.agents if identity is None else set(run.agents) & set(identity.role.names)
    names = select_agents(sorted(allowed), options.only, options.without, options.share)
    # Only these are made: a user's class may end its process.
    agents = made(options.agents, layout, names)
    if options.replay is not None:
        # It is imported here, because its packages are an extra.
        from orchard.bags.replay import read_commands, replayed

        commands = read_commands(Path(options.replay), options.from_first_stamp)
        agents = replayed(agents, commands)
    guards = {name: guarded(layout, name, agent) for name, agent in agents.items()}
    if options.check_agents:
        for guard in guards.values():
            guard.check()
    host = Host(
        bus,
        keys,
        run=run.run,
        mode=run.mode,
        layout=layout,
        agents=guards,
        patience=options.patience,
    )
    host.listen()
    return host


if __name__ == "__main__":
    code = main()
    end_soon(code, log.error)
    sys.exit(code)
