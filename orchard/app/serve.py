"""The web server of the page, by default on the loopback interface."""

import contextlib
import signal
import socket
import sys
from pathlib import Path

from nicegui import app, ui

from orchard.app.page import Page
from orchard.app.runner import Runner
from orchard.field.scenario import Scenario

ICON = "🥝"
PATIENCE = 30.0  # s that a browser may be too busy to answer, for example while it loads the Rerun viewer


def serve(host: str, port: int, runs: Path, show: bool) -> int:
    """Serve the page until Ctrl-C.

    `runs`: directory of recordings and summaries. `show`: whether to open a browser.
    Return the exit code: 0 after Ctrl-C, 2 if the address cannot be used.
    """
    if problem := _problem(host, port):
        print(problem, file=sys.stderr)
        return 2
    runner = Runner(runs)
    last: list[Page] = []  # the newest page; the next page begins with its scenario

    def page() -> None:
        begin = last[-1].draft.scenario if last else None
        last[:] = [Page(runner, begin or Scenario())]

    app.on_shutdown(runner.close)
    print(f"The page is at http://{host}:{port}  (Ctrl-C stops the server)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ui.run(page, host=host, port=port, show=show, reload=False, show_welcome_message=False, title="Kiwifruit orchard", favicon=ICON,
               reconnect_timeout=PATIENCE)  # fmt: skip
    return 0


def _problem(host: str, port: int) -> str:
    """Why the server cannot listen at the address; '' if it can."""
    try:
        with socket.create_server((host, port)):
            return ""
    except (OSError, OverflowError) as error:
        return f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}"
