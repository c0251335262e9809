"""Rerun's viewer in a browser: a web server on the loopback that serves the viewer and tells it what to show.

`python -m orchard.view.web rerun+http://127.0.0.1:9091/proxy --port 9090` runs this server until its standard input ends: until the
program that started it lets go, or is gone. `serve_web` starts it so. `rr.serve_web_viewer` is not used: it listens on all interfaces.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn
from urllib.parse import urlencode

from orchard.view.files import viewer_program

LOOPBACK = "127.0.0.1"
ROOT = Path(__file__).parents[2]
QUIET = {"RUST_LOG": "error"}  # environment of the server
IDLE = 19  # its niceness: Rerun 0.41 keeps a core busy while it serves a file, even if no viewer asks (rerun-io/rerun#10944)


def data_uri(port: int) -> str:
    """Return the address of the data for a viewer that is served on a port: on the next port."""
    return f"rerun+http://{LOOPBACK}:{port + 1}/proxy"


def page_url(port: int, *others: int) -> str:
    """Return the address to open in a browser, or in a frame of a page. `others`: ports of other servers with data to show."""
    options = {"url": [data_uri(each) for each in (port, *others)], "hide_welcome_screen": "1", "persist": "0", "theme": "dark"}
    return f"http://{LOOPBACK}:{port}/?{urlencode(options, doseq=True)}"


def command(port: int, *what: str) -> list[str]:
    """Return the server's command line. `what`: the address of live data, or a recording's parts, which it then serves on the next port."""
    return [viewer_program(), "--serve-web", "--bind", LOOPBACK, "--web-viewer-port", str(port), "--port", str(port + 1), *what]


def live_lines(port: int, what: str = "Live") -> list[str]:
    """Return what to tell a user of a viewer on a port: its address and, over ssh, how to reach it and its data from the own machine."""
    there = os.environ.get("SSH_CONNECTION", "").split()[2:3]
    forward = f"-L {port}:{LOOPBACK}:{port} -L {port + 1}:{LOOPBACK}:{port + 1}"
    return [f"{what}: {page_url(port)}", *(f"Over ssh, first on your own machine: ssh -N {forward} {address}" for address in there)]


def serve_web(port: int, *what: str) -> subprocess.Popen[bytes]:
    """Serve the viewer at `page_url(port)`. The caller ends the returned process with `terminate()`."""
    shown = [each if "://" in each else str(Path(each).resolve()) for each in what]  # the server has another working directory
    line, null = [sys.executable, "-m", "orchard.view.web", *shown, "--port", str(port)], subprocess.DEVNULL
    return subprocess.Popen(line, cwd=ROOT, start_new_session=True, stdin=subprocess.PIPE, stdout=null, stderr=null)


def free_pair() -> int:
    """Return a port of the loopback that was free a moment ago, as was the next port: for the viewer, and for its data."""
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
    """Return whether a server listens on a port of the loopback."""
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((LOOPBACK, port)) == 0


def main() -> None:
    """Replace this process by the server, so that a signal to the process reaches the server. A child ends it when standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m orchard.view.web", description="Serve Rerun's viewer on the loopback.")
    parser.add_argument("what", nargs="+", help="the address of live data, or the parts of a recording")
    parser.add_argument("--port", type=int, default=9090, help="port of the viewer; its data are expected on the next port")
    arguments = parser.parse_args()
    line, server = command(arguments.port, *arguments.what), os.getpid()
    _take_what_is_left()
    if os.fork() == 0:
        _end_with_input(server)
    os.execve(line[0], line, os.environ | QUIET)


def _take_what_is_left() -> None:
    """Let this process, and the session that it leads, have only the processor time that no other wants."""
    os.nice(IDLE)
    with suppress(OSError):  # a kernel without groups of sessions has no such file
        Path("/proc/self/autogroup").write_text(str(IDLE))


def _end_with_input(server: int) -> NoReturn:
    sys.stdin.buffer.read()
    if os.getppid() == server:
        os.kill(server, signal.SIGKILL)
    os._exit(0)


if __name__ == "__main__":
    main()
