"""Serve the page: `python -m orchard.app [--port N] [--host 127.0.0.1]`."""

import signal

if __name__ == "__main__":  # Ctrl-C during the imports ends the process at once and without a message
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import contextlib
import socket
import sys
from pathlib import Path
from secrets import token_hex

try:
    from nicegui import app, ui
except ModuleNotFoundError as missing:
    print(f"The page needs the package {missing.name}: pip install 'orchard-sim[app]'", file=sys.stderr)
    raise SystemExit(2) from None

from orchard.app.desks import desk_of
from orchard.app.harvest_run import Harvests
from orchard.app.link import draft_of
from orchard.app.own_address import only_own_address
from orchard.app.page import PATIENCE, Page, complain
from orchard.app.study_run import Studies
from orchard.folders import runs_folder
from orchard.net.options import CommandLine

ICON = "🥝"


def main(argv: list[str] | None = None) -> int:
    """Serve the page until Ctrl-C. Return the exit code: 2 if the address cannot be used."""
    parser = CommandLine(prog="orchard app", description="Set up an orchard in the browser, run it, and watch it.")
    parser.add_argument("--port", type=int, default=8080, help="port of the page")
    parser.add_argument("--host", default="127.0.0.1", help="any client that reaches it can start runs; 0.0.0.0: under this machine's name")
    parser.add_argument("--runs", type=Path, default=runs_folder(), metavar="DIRECTORY", help="directory of recordings and summaries")
    parser.add_argument("--quiet", action="store_true", help="do not open a browser")
    arguments = parser.parse_args(argv)
    host, port = arguments.host, arguments.port
    if problem := _problem(host, port):
        print(problem, file=sys.stderr)
        return 2
    runs, studies = Harvests(arguments.runs, "harvest"), Studies(arguments.runs, "study")

    def page() -> None:
        desk, query = desk_of(app.storage.browser["id"]), ui.context.client.request.query_params.multi_items()
        desk.draft, unknown = draft_of(query) if query else (desk.draft, [])
        if query:
            ui.navigate.history.replace("/")  # or a reload would bring the link's scenario back
        Page(runs, studies, desk)
        if unknown:
            complain("Not all of the link was understood", unknown)

    only_own_address(app, host)
    app.on_shutdown(runs.close)
    app.on_shutdown(studies.close)
    print(f"The page is at http://{host}:{port}  (Ctrl-C stops the server)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ui.run(page, host=host, port=port, show=not arguments.quiet, reload=False, show_welcome_message=False, title="Kiwifruit orchard",
               language="en-US", favicon=ICON, reconnect_timeout=PATIENCE, storage_secret=token_hex())  # fmt: skip
    return 0


def _problem(host: str, port: int) -> str:
    """Why the server cannot listen at the address; '' if it can."""
    try:
        with socket.create_server((host, port)):
            return ""
    except (OSError, OverflowError) as error:
        return f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}"


if __name__ == "__main__":
    sys.exit(main())
