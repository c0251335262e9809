"""The logger process: records a run with Rerun, into a file, to live viewers, or both.

    python -m orchard.processes.logger --connect tcp/127.0.0.1:7447 --record runs/harvest.rrd

Killing it does not disturb the run. If it is started again with the same file, it continues in a further part of the recording.
"""

import argparse
import logging
import sys
from pathlib import Path

from orchard.field.problems import ScenarioError
from orchard.net.bus import Inbox
from orchard.net.endpoints import BusError
from orchard.net.process import run_process
from orchard.net.zenoh_bus import client
from orchard.record.logger import record
from orchard.security.identity import identity_in
from orchard.view.files import check_recording
from orchard.view.reader import optimize
from orchard.wire.keys import PREFIX, Keys

log = logging.getLogger("orchard")


def main(argv: list[str] | None = None) -> int:
    """Record a run until it ends; the exit code."""
    arguments = _arguments(argv)

    def run(inbox: Inbox) -> int:
        if arguments.record is not None:
            check_recording(arguments.record)
        with client(arguments.connect, inbox, identity=identity_in(arguments.secure, arguments.prefix)) as bus:
            code, file = record(bus, Keys(arguments.prefix), arguments.record, arguments.serve, arguments.session)
        if file is not None and code == 0:
            _pack(file)
        return code

    return run_process("logger", run, BusError, ScenarioError, ValueError, OSError, RuntimeError)


def _pack(file: Path) -> None:
    """Pack a recording. If that fails, it stays as it is, which is said."""
    try:
        optimize(file)
    except OSError as error:
        log.error("%s", error)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m orchard.processes.logger", description="Record a run for Rerun.")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="where physics or a router listens, like tcp/127.0.0.1:7447")
    parser.add_argument("--secure", metavar="DIR", help="directory of the logger's role")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="write a recording, or a further part of one of the same run")
    parser.add_argument("--serve", type=int, metavar="PORT", help="serve live viewers on this port of 127.0.0.1")
    parser.add_argument("--session", default="", metavar="ID", help="session id in the liveliness token: letters and digits")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
