"""The router process: a separate router, to which physics and all other processes connect as clients. For several machines.

    python -m orchard.processes.router --listen tcp/0.0.0.0:7447

It serves any number of runs, one after another or with different prefixes, until it is stopped.
"""

import argparse
import sys

from orchard.net.bus import Inbox, Signal
from orchard.net.endpoints import BusError, check_free, with_port
from orchard.net.process import run_process
from orchard.net.zenoh_bus import router
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX


def main(argv: list[str] | None = None) -> int:
    """Route messages until a signal asks to stop. Return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m orchard.processes.router", description="Route messages between the processes of an orchard."
    )
    parser.add_argument("--listen", metavar="ENDPOINT", help="default: tcp/127.0.0.1:7447; with --secure tls/127.0.0.1:7447")
    parser.add_argument("--secure", metavar="DIR", help="directory of the router's role")
    arguments = parser.parse_args(argv)

    def run(inbox: Inbox) -> int:
        identity = identity_in(arguments.secure, PREFIX)
        endpoint = with_port(arguments.listen or f"{'tcp' if identity is None else 'tls'}/127.0.0.1:7447")
        check_free(endpoint)
        with router(endpoint, inbox, identity) as bus:
            print(f"listening on {bus.endpoint}", flush=True)
            while not isinstance(inbox.take(), Signal):
                pass
        return 0

    return run_process("router", run, BusError, ValueError)


if __name__ == "__main__":
    sys.exit(main())
