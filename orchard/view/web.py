"""Rerun's viewer in a browser: a web server on the loopback that serves the viewer, and a recording
for it to play.

`python -m orchard.view.web rerun+http://127.0.0.1:9091/proxy --port 9090` runs until its standard
input ends, as `serve_web` starts it. `rr.serve_web_viewer` is not used: it listens on all
interfaces. A recording goes to the viewer over HTTP, which plays it from its beginning. What comes
from Rerun's own server opens at the end, and keeps a core busy (rerun-io/rerun#10944). The parts of
a recording are one answer, in their order: of two answers the viewer begins with either.
"""

import argparse
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar, NoReturn
from urllib.parse import quote, urlencode, urlsplit

from orchard.start_module import command_for
from orchard.view.files import QUIET, viewer_program

LOOPBACK = "127.0.0.1"
# The names under which a browser may ask.
LOCAL = (LOOPBACK, "localhost")
ROOT = Path(__file__).parents[2]
# Between two checks that the server still runs.
LOOK_SECONDS = 1.0


def data_uri(port: int) -> str:
    """Return the address of the data of a live run, for a viewer that is served on a port: on the
    next port.
    """
    return f"rerun+http://{LOOPBACK}:{port + 1}/proxy"


def address(port: int, source: str) -> str:
    """Return where a viewer that is served on a port finds data: a file on the next port, live data
    at their own address.
    """
    if _is_address(source):
        return source
    return f"http://{LOOPBACK}:{port + 1}/{quote(Path(source).name)}"


def _is_address(source: str) -> bool:
    """Whether a source of data is an address, and no file."""
    return "://" in source


def page_url(port: int, *sources: str) -> str:
    """Return the address to open in a browser or a frame.

    `sources`: recordings that are served, or addresses of data.
    """
    options = {
        "url": [address(port, source) for source in sources],
        "hide_welcome_screen": "1",
        "persist": "0",
        "theme": "dark",
    }
    return f"http://{LOOPBACK}:{port}/?{urlencode(options, doseq=True)}"


def command(port: int, source: str) -> list[str]:
    """Return the command line of the viewer's server. `source`: as in `page_url`."""
    return [
        viewer_program(),
        "--serve-web",
        "--bind",
        LOOPBACK,
        "--web-viewer-port",
        str(port),
        address(port, source),
    ]


def how_to_open(words: str, port: int, source: str) -> list[str]:
    """Return lines for the user: a viewer's address after some words and, over ssh, how to reach
    it.
    """
    lines = [f"{words}: {page_url(port, source)}"]
    # ssh sets it to four words: the client's address, its port, the server's address, its port.
    connection = os.environ.get("SSH_CONNECTION", "").split()
    if len(connection) > 2:
        server = connection[2]
        forward = f"-L {port}:{LOOPBACK}:{port} -L {port + 1}:{LOOPBACK}:{port + 1}"
        lines.append(f"Over ssh, first on your own machine: ssh -N {forward} {server}")
    return lines


def serve_web(port: int, *sources: str) -> subprocess.Popen[bytes]:
    """Serve the viewer at `page_url(port, sources[0])`.

    The caller ends the returned process with `terminate()`.

    `sources`: the address of live data, or the parts of a recording. Each part but the last must be
    whole.
    """
    shown = []
    for source in sources:
        if _is_address(source):
            shown.append(source)
        else:
            # The server has another working directory.
            shown.append(str(Path(source).resolve()))
    return subprocess.Popen(
        command_for("orchard.view.web", [*shown, "--port", str(port)]),
        cwd=ROOT,
        start_new_session=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def free_pair() -> int:
    """Return a port of the loopback that was free a moment ago, as was the next port: for the
    viewer, and for its data.
    """
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind((LOOPBACK, 0))
            port = int(first.getsockname()[1])
            try:
                second.bind((LOOPBACK, port + 1))
            except (OSError, OverflowError):
                continue
            return port


def is_open(port: int) -> bool:
    """Whether something listens on a port of the loopback."""
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((LOOPBACK, port)) == 0


class _Recording(BaseHTTPRequestHandler):
    """Answers with a recording, on this machine only: a page of another site must not read it."""

    parts: ClassVar[list[Path]] = []

    def do_GET(self) -> None:
        """Send all parts as one answer if this machine is asked for the first one."""
        host = urlsplit(f"//{self.headers.get('Host', '')}").hostname
        origin = self.headers.get("Origin", "")
        if host not in LOCAL or urlsplit(self.path).path != f"/{quote(self.parts[0].name)}":
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Length", str(sum(part.stat().st_size for part in self.parts)))
        if urlsplit(origin).hostname in LOCAL:
            self.send_header("Access-Control-Allow-Origin", origin)
        self.end_headers()
        for part in self.parts:
            with part.open("rb") as file:
                shutil.copyfileobj(file, self.wfile)

    def log_message(self, *_: object) -> None:
        """Print nothing."""


def main() -> None:
    """Replace this process by the viewer's server, so that a signal reaches it.

    A child serves files, and ends it.
    """
    parser = argparse.ArgumentParser(
        prog="python -m orchard.view.web", description="Serve Rerun's viewer on the loopback."
    )
    parser.add_argument(
        "what",
        nargs="+",
        help="the address of live data, or the parts of a recording",
    )
    parser.add_argument(
        "--port",
        type=int,
        default=9090,
        help="port of the viewer; its data are expected on the next port",
    )
    arguments = parser.parse_args()
    viewer_command = command(arguments.port, arguments.what[0])
    viewer = os.getpid()
    _Recording.parts = [Path(source) for source in arguments.what if not _is_address(source)]
    server = None
    if _Recording.parts:
        server = ThreadingHTTPServer((LOOPBACK, arguments.port + 1), _Recording)
    if os.fork() == 0:
        if server is not None:
            threading.Thread(target=server.serve_forever, daemon=True).start()
        _end_with_input(viewer)
    os.execve(viewer_command[0], viewer_command, os.environ | QUIET)


def _end_with_input(viewer: int) -> NoReturn:
    """Wait until the viewer ends, or the standard input does; then end the viewer, and this.

    `viewer`: id of the process. It is this process's parent as long as it runs.
    """
    while os.getppid() == viewer:
        ended, _, _ = select.select([sys.stdin], [], [], LOOK_SECONDS)
        if ended:
            break
    if os.getppid() == viewer:
        os.kill(viewer, signal.SIGKILL)
    os._exit(0)


if __name__ == "__main__":
    main()
