"""Rerun's viewer in a browser: a web server on the loopback that hands out the viewer and says what it is to show.

`python -m orchard.view.web rerun+http://127.0.0.1:9091/proxy --port 9090` is that server until it is told to end;
`serve_web` starts the same beside a running program. `rr.serve_web_viewer` is not used: it listens on all interfaces.
"""

import argparse
import os
import socket
import subprocess
from urllib.parse import urlencode

from orchard.view.program import viewer_program

LOOPBACK = "127.0.0.1"


def data_uri(port: int) -> str:
    """Where a viewer served on a port finds its data: on the next port."""
    return f"rerun+http://{LOOPBACK}:{port + 1}/proxy"


def page_url(port: int) -> str:
    """What to open in a browser, or to put into a frame."""
    wishes = {"url": data_uri(port), "hide_welcome_screen": "1", "persist": "0", "theme": "dark"}
    return f"http://{LOOPBACK}:{port}/?{urlencode(wishes)}"


def command(port: int, *what: str) -> list[str]:
    """The server's command line. `what` is the address of live data, or a recording's parts, which it then serves on the next port."""
    return [viewer_program(), "--serve-web", "--bind", LOOPBACK, "--web-viewer-port", str(port), "--port", str(port + 1), *what]


def serve_web(port: int, *what: str) -> subprocess.Popen[bytes]:
    """Serve the viewer at `page_url(port)`; `terminate()` what it gives when it is no longer wanted."""
    line, null = command(port, *what), subprocess.DEVNULL
    return subprocess.Popen(line, env=_environment(), start_new_session=True, stdin=null, stdout=null, stderr=null)


def free_pair() -> int:
    """A port of the loopback that was free a moment ago, as the next one was: for the viewer, and for its data."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind((LOOPBACK, 0))
            port = int(first.getsockname()[1])
            try:
                second.bind((LOOPBACK, port + 1))
            except (OSError, OverflowError):
                continue
            return port


def _environment() -> dict[str, str]:
    return os.environ | {"RUST_LOG": "error"}


def main() -> None:
    """Become the server, so that a signal to this process reaches it."""
    parser = argparse.ArgumentParser(prog="python -m orchard.view.web", description="Serve Rerun's viewer on the loopback.")
    parser.add_argument("what", help="the address of live data, or a recording")
    parser.add_argument("--port", type=int, default=9090, help="of the viewer; its data are expected on the next one")
    arguments = parser.parse_args()
    line = command(arguments.port, arguments.what)
    os.execve(line[0], line, _environment())


if __name__ == "__main__":
    main()
