"""The page's server, on the loopback unless asked otherwise."""

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
PATIENCE = 30.0  # s for which a browser may be too busy to answer, as it is while it loads the picture's viewer


def serve(host: str, port: int, runs: Path, show: bool) -> int:
    """Until Ctrl-C; the exit code."""
    if problem := _problem(host, port):
        print(problem, file=sys.stderr)
        return 2
    runner = Runner(runs)
    last: list[Page] = []  # the newest page, whose scenario the next one begins with

    def page() -> None:
        begin = last[-1].draft.scenario if last else None
        last[:] = [Page(runner, begin or Scenario())]

    app.on_shutdown(runner.close)
    print(f"The page: http://{host}:{port}  (Ctrl-C ends it)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ui.run(page, host=host, port=port, show=show, reload=False, show_welcome_message=False, title="Kiwifruit orchard", favicon=ICON,
               reconnect_timeout=PATIENCE)  # fmt: skip
    return 0


def _problem(host: str, port: int) -> str:
    """Why one cannot listen there; '' if one can."""
    try:
        with socket.create_server((host, port)):
            return ""
    except (OSError, OverflowError) as error:
        return f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}"
