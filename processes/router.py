"""A router of its own, where physics and all others meet as clients: for several machines.

    python -m processes.router --listen tcp/0.0.0.0:7447

It carries every run that comes along, and stays until it is stopped.
"""

import argparse
import logging
import signal
import sys

from orchard.net.bus import Inbox, Signal, router
from orchard.net.endpoints import BusError, check_free, with_port
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX

log = logging.getLogger("orchard")


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m processes.router", description="Route for an orchard's processes.")
    parser.add_argument("--listen", metavar="ENDPOINT", help="default: tcp/127.0.0.1:7447; with --secure tls/127.0.0.1:7447")
    parser.add_argument("--secure", metavar="DIR", help="the role's directory: that of the router")
    arguments = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="router: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        identity = identity_in(arguments.secure, PREFIX)
        endpoint = with_port(arguments.listen or f"{'tcp' if identity is None else 'tls'}/127.0.0.1:7447")
        check_free(endpoint)
        with router(endpoint, inbox, identity) as bus:
            print(f"listening on {bus.endpoint}", flush=True)
            while not isinstance(inbox.take(), Signal):
                pass
    except (BusError, ValueError) as error:
        log.error("%s", error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
