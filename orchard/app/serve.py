"""The page's server, on the loopback unless asked otherwise."""

import contextlib
import socket
import sys
from pathlib import Path

from nicegui import app, ui

from orchard.app.page import Page
from orchard.app.runner import Runner
from orchard.config import Scenario

ICON = "🥝"


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
    options = {"reload": False, "show_welcome_message": False, "title": "Kiwifruit orchard", "favicon": ICON}
    print(f"The page: http://{host}:{port}  (Ctrl-C ends it)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        ui.run(page, host=host, port=port, show=show, **options)
    return 0


def _problem(host: str, port: int) -> str:
    """Why one cannot listen there; '' if one can."""
    try:
        with socket.create_server((host, port)):
            return ""
    except (OSError, OverflowError) as error:
        return f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}"
