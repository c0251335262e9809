"""The router process: only a router, to which all other processes connect, for several machines.

    python -m orchard.processes.router --listen tcp/0.0.0.0:7447

It serves any number of runs, one after another or with different prefixes, until it is stopped.
"""

import sys

from orchard.net.bus import Inbox, Signal
from orchard.net.endpoints import BusError, check_free, with_port
from orchard.net.options import RouterOptions
from orchard.net.process import run_process
from orchard.net.zenoh_bus import router
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX


def main(argv: list[str] | None = None) -> int:
    """Route messages until a signal asks to stop. Return the exit code."""
    mistakes = (BusError, ValueError)
    return run_process("router", RouterOptions, argv, _run, *mistakes)


def _run(inbox: Inbox, options: RouterOptions) -> int:
    """Route messages until a signal comes. Return the exit code."""
    identity = identity_in(options.secure, PREFIX)
    protocol = "tcp" if identity is None else "tls"
    endpoint = with_port(options.listen or f"{protocol}/127.0.0.1:7447")
    check_free(endpoint)
    with router(endpoint, inbox, identity) as bus:
        print(f"listening on {bus.endpoint}", flush=True)
        while not isinstance(inbox.take(), Signal):
            pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
