"""The command `orchard view`: shows a recording, in Rerun's window or in a browser."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from orchard.folders import runs_folder
from orchard.launch.web_ports import check_ports
from orchard.net.endpoints import BusError
from orchard.terminal.exits import exit_on_errors
from orchard.terminal.options import Recording
from orchard.terminal.output import print_error, print_line
from orchard.view.files import (
    IN_A_BROWSER,
    existing_recording,
    parts_of,
    viewer_program,
    window,
)
from orchard.view.web import how_to_open, serve_web

_WEB = "Show it in a browser on this machine."
# The viewer's data takes the port after this one, so the last of all ports is left out.
Browser = Annotated[int | None, Option("--web", min=1024, max=65534, metavar="PORT", help=_WEB)]


def view(recording: Recording = None, web: Browser = None) -> None:
    """Open a recording, with all its parts, in the Rerun viewer."""
    with exit_on_errors(OSError, ValueError):
        parts = parts_of(existing_recording(recording, runs_folder()))
    with exit_on_errors(BusError, OSError, ValueError):
        code = _open_window(parts) if web is None else _serve(parts, web)
    raise typer.Exit(code)


def _open_window(parts: Sequence[Path]) -> int:
    """Open a window, and return its exit code when it is closed.

    Raises OSError without a viewer or a screen.
    """
    code = subprocess.run(window(*map(str, parts)), check=False).returncode
    if code:
        print_error(f"the viewer ended with exit code {code}; if no window opened: {IN_A_BROWSER}")
    return code


def _serve(parts: Sequence[Path], port: int) -> int:
    """Serve a recording to browsers until Ctrl-C. Return the exit code.

    Raises OSError, BusError or ValueError.
    """
    # Raises OSError if the viewer is not installed.
    viewer_program()
    check_ports(port)
    with serve_web(port, *map(str, parts)) as server:
        for line in how_to_open("In a browser on this machine", port, str(parts[0])):
            print_line(line)
        print_line("Ctrl-C ends it.")
        try:
            code = server.wait()
        finally:
            server.terminate()
        if code:
            print_error(
                f"the web viewer has ended with exit code {code}; "
                "is the recording whole? without --web it opens in a window"
            )
        return code
