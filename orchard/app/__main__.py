"""Serve the page: `python -m orchard.app [--port N] [--host 127.0.0.1]`."""

import signal

if __name__ == "__main__":  # Ctrl-C during the imports ends the process at once and without a message
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import argparse
import sys
from pathlib import Path

from orchard.app.run_controls import ROOT


def main(argv: list[str] | None = None) -> int:
    """Serve the page until Ctrl-C. Return the exit code: 2 if NiceGUI is missing or the address cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m orchard.app", description="Set up an orchard in the browser, run it, and watch it.")
    parser.add_argument("--port", type=int, default=8080, help="port of the page")
    parser.add_argument("--host", default="127.0.0.1", help="any client that reaches it can start runs; pictures stay on the loopback")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs", metavar="DIRECTORY", help="directory of recordings and summaries")
    parser.add_argument("--quiet", action="store_true", help="do not open a browser")
    arguments = parser.parse_args(argv)
    try:
        from orchard.app.serve import serve
    except ModuleNotFoundError as missing:
        print(f"The page needs the package {missing.name}: pip install 'orchard[app]'", file=sys.stderr)
        return 2
    return serve(arguments.host, arguments.port, arguments.runs, not arguments.quiet)


if __name__ == "__main__":
    sys.exit(main())
