"""Hosts any number of agents over one session.

    python -m processes.agents --connect tcp/127.0.0.1:7447 --only picker --only bin_03

The scenario comes from physics. Without --only and --without it hosts all agents; --share 0/3 takes every third.
"""

import argparse
import importlib
import logging
import signal
import sys
from collections.abc import Callable, Collection

from orchard.contract.agent import Agent
from orchard.contract.guard import place
from orchard.field.kinds import select_agents
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check
from orchard.launch.options_time import seconds
from orchard.net import deadline_monitor
from orchard.net.bus import Bus, Inbox, Item, Signal, client
from orchard.net.endpoints import BusError
from orchard.net.host import GONE_SECONDS, Host, HostEnded
from orchard.net.process import settle
from orchard.net.requests import fetch_run
from orchard.security.identity import Identity, identity_in
from orchard.wire.keys import PREFIX, Keys

log = logging.getLogger("orchard")

Factory = Callable[[Layout, Collection[str]], dict[str, Agent]]


def _only_signals(item: Item) -> None:
    if isinstance(item, Signal):
        raise HostEnded(0, "asked to stop")


# -- which agents


def factory(path: str) -> Factory:
    """The function behind 'package.module:name'."""
    module, _, name = path.partition(":")
    try:
        found: Factory = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"agents {path}: {error}; wanted is package.module:function") from error
    return found


def made(path: str, layout: Layout, names: Collection[str]) -> dict[str, Agent]:
    """name -> the agent that it makes. Raises ValueError where it has a mistake, with its place."""
    make = factory(path)
    try:
        agents = make(layout, names)
        return {name: agents[name] for name in names}
    except Exception as error:
        wanted = "a function of (layout, names) that gives a map with an agent for each name"
        raise ValueError(f"agents {path}: {type(error).__name__}: {error}{place(error)}; wanted is {wanted}") from error


# -- the process


def main(argv: list[str] | None = None) -> int:
    options = _options(argv)
    logging.basicConfig(level=logging.WARNING, format="agents: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        identity = identity_in(options.secure, options.prefix)
        with client(options.connect, inbox, identity=identity) as bus:
            _host(bus, options, identity).run()
    except HostEnded as end:
        if end.code:
            log.error("%s", end)
        return end.code
    except (BusError, ValueError, ScenarioError) as error:
        log.error("%s", error)
        return 2
    return 0


def _host(bus: Bus, options: argparse.Namespace, identity: Identity | None) -> Host:
    keys = Keys(options.prefix)
    run = fetch_run(bus, keys, _only_signals)
    layout = lay_out(check(run.scenario, "the scenario that physics sent"))
    allowed = run.agents if identity is None else set(run.agents) & set(identity.role.names)
    names = select_agents(sorted(allowed), options.only, options.without, options.share)
    agents = made(options.agents, layout, names)  # no others: a class that ends its process shall end no more than its own
    host = Host(bus, keys, run.run, run.mode, layout, agents, options.patience)
    host.listen()
    settle()
    deadline_monitor.monitor(host)
    return host


def _options(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.agents", description="Host agents of an orchard.")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="where physics or a router listens: tcp/127.0.0.1:7447")
    parser.add_argument("--secure", metavar="DIR", help="the role's directory; it may host that role's agents only")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--only", action="append", default=[], metavar="KIND|NAME", help="host these (repeatable)")
    parser.add_argument("--without", action="append", default=[], metavar="KIND|NAME", help="host all but these (repeatable)")
    parser.add_argument("--share", default="0/1", metavar="I/N", help="of those, host the I-th (from 0) and every N-th after it")
    parser.add_argument("--patience", type=seconds, default=GONE_SECONDS, metavar="SECONDS", help="how long physics may be gone")
    parser.add_argument(
        "--agents", default="orchard.agents.catalogue:make_agents", metavar="MODULE:FUNCTION", help="(layout, names) -> {name: agent}"
    )
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
