"""The logger process: records a run with Rerun, into a file, to live viewers, or both.

    python -m orchard.processes.logger --connect tcp/127.0.0.1:7447 --record runs/harvest.rrd

Killing it does not disturb the run. If it is started again with the same file, it continues in a
further part of the recording.
"""

import logging
import os
import sys
from contextlib import suppress
from pathlib import Path

from orchard.field.problems import ScenarioError
from orchard.net.bus import Inbox
from orchard.net.endpoints import BusError
from orchard.net.options import LoggerOptions
from orchard.net.process import run_process
from orchard.net.zenoh_bus import client
from orchard.record.logger import record
from orchard.security.identity import identity_in
from orchard.view.files import check_recording
from orchard.view.reader import optimize
from orchard.wire.keys import Keys

log = logging.getLogger("orchard")


def main(argv: list[str] | None = None) -> int:
    """Record a run until it ends. Return the exit code."""
    # On Linux, a process of this policy interrupts no other one when it wakes up. The run waits for
    # the others.
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    mistakes = (BusError, ScenarioError, ValueError, OSError, RuntimeError)
    return run_process("logger", LoggerOptions, argv, _run, *mistakes)


def _run(inbox: Inbox, options: LoggerOptions) -> int:
    """Record over Zenoh. Return the exit code."""
    if options.record is None:
        part = None
    else:
        part = Path(options.record)
    if part is not None:
        check_recording(part)
    identity = identity_in(options.secure, options.prefix)
    with client(options.connect, inbox, identity=identity) as bus:
        code, file = record(bus, Keys(options.prefix), part, options.serve, options.session)
    if file is not None and code == 0:
        try:
            optimize(file)
        except OSError as error:
            log.error("%s", error)
    return code


if __name__ == "__main__":
    sys.exit(main())
