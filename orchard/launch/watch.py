"""Shows a recording, in Rerun's window or in a browser on this machine."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from orchard.launch.terminal import print_error, print_line
from orchard.net.endpoints import check_free
from orchard.view.files import IN_A_BROWSER, viewer_program, window
from orchard.view.web import how_to_open, serve_web


def open_window(parts: Sequence[Path]) -> int:
    """Open a window, and return its exit code when it is closed. Raises OSError without a viewer or a screen."""
    code = subprocess.run(window(*map(str, parts))).returncode
    if code:
        print_error(f"the viewer ended with exit code {code}; if no window opened: {IN_A_BROWSER}")
    return code


def serve(parts: Sequence[Path], port: int) -> int:
    """Serve a recording to browsers until Ctrl-C. Return the exit code. Raises FileNotFoundError or BusError."""
    viewer_program()
    check_ports(port)
    with serve_web(port, *map(str, parts)) as server:
        print_line(
            "\n".join(
                [
                    *how_to_open("In a browser on this machine", port, str(parts[0])),
                    "Ctrl-C ends it.",
                ]
            )
        )
        try:
            code = server.wait()
        finally:
            server.terminate()
        if code:
            print_error(
                f"the web viewer has ended with exit code {code}; is the recording whole? without --web it opens in a window"
            )
        return code


def check_ports(port: int) -> None:
    """Raise BusError if the web viewer cannot have its port and that of its data, the next one."""
    for number in (port, port + 1):
        check_free(f"tcp/127.0.0.1:{number}")
