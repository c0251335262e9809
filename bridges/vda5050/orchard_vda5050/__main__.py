"""`orchard-vda5050`, or `python -m orchard_vda5050`: drive the robots of a run by orders."""

import argparse
import os
import sys
import time
from collections.abc import Sequence

from orchard import BusError, ScenarioError, connect
from orchard.field.kinds import DISPATCH
from orchard.net.endpoints import NO_ENDPOINT, check_security
from orchard.processes import agents
from orchard_vda5050 import fleet

# Between two looks for a run.
AGAIN_SECONDS = 1.0
# Option -> what the help says of it.
HELP = {
    "broker": "mqtt://host:port, or mqtts://user:password@host:port",
    "interface": "first part of the topics",
    "manufacturer": "part of the topics",
    "version": "of VDA 5050: 3.0.0, 2.1.0 or 2.0.0",
    "state": "simulated seconds between two states, unless something happens",
    "visualization": "simulated seconds between two visualizations; 0: none",
    "patience": (
        "simulated seconds after which a vehicle that is left standing on the roads clears them by"
        " itself"
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Drive the robots of a run. Return the exit code: 0 after a run, 2 for a user's mistake."""
    options = _parser().parse_args(argv)
    try:
        return int(options.do(options))
    except KeyboardInterrupt:
        return 0
    except (ValueError, OSError, ScenarioError, BusError) as error:
        print(f"orchard-vda5050: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="orchard-vda5050", description="Drive robots of the Orchard by orders of VDA 5050."
    )
    commands = parser.add_subparsers(required=True)
    drive = commands.add_parser(
        "drive",
        help="drive carriers and pickers of a run by orders",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    drive.add_argument("endpoint", help="where the run listens, such as tcp/127.0.0.1:7447")
    drive.add_argument(
        "--robots", nargs="+", default=["carrier"], help="the carriers and pickers, or the kinds"
    )
    drive.add_argument("--secure", metavar="DIR", help="directory of the role, in a secured run")
    for name, default in fleet.DEFAULTS.items():
        drive.add_argument(f"--{name}", default=default, type=type(default), help=HELP[name])
    drive.set_defaults(do=_drive)
    return parser


def _drive(options: argparse.Namespace) -> int:
    for name in fleet.DEFAULTS:
        os.environ[fleet.ENVIRONMENT + name.upper()] = str(getattr(options, name))
    # A mistake in them is reported before a run is there.
    fleet.broker()
    fleet.timing()
    robots = list(options.robots)
    if DISPATCH in wait_for_a_run(options.endpoint, options.secure):
        robots.append(DISPATCH)
    words = ["--connect", options.endpoint, "--agents", "orchard_vda5050.fleet:vehicles"]
    for robot in robots:
        words += ["--only", robot]
    if options.secure:
        words += ["--secure", options.secure]
    try:
        code = agents.main(words)
        if code and DISPATCH in robots:
            print(
                "orchard-vda5050: if dispatch is taken, start the run with --without dispatch too:"
                " fleet control sends",
                file=sys.stderr,
            )
        return code
    finally:
        fleet.lines().close()


def wait_for_a_run(endpoint: str, secure: str | None) -> Sequence[str]:
    """Wait until there is a run. Return the names of its agents.

    Says meanwhile what it waits for. Raises BusError for an endpoint at which no run can be.
    """
    check_security(endpoint, secure is not None)
    reported = ""
    while True:
        try:
            with connect(endpoint, secure=secure) as run:
                return run.names
        except BusError as error:
            why = str(error)
            if NO_ENDPOINT in why:
                raise
            if why != reported:
                reported = why
                print(f"orchard-vda5050: waiting for a run: {why}", file=sys.stderr, flush=True)
            time.sleep(AGAIN_SECONDS)


if __name__ == "__main__":
    sys.exit(main())
