"""Serve the page."""

import contextlib
import signal
import socket
from pathlib import Path
from secrets import token_hex

from nicegui import app, ui

from orchard.app.desks import desk_of
from orchard.app.harvest_run import Harvests
from orchard.app.link import draft_of
from orchard.app.own_address import only_own_address
from orchard.app.page import PATIENCE, Page, complain
from orchard.app.study_run import Studies

ICON = "🥝"


def serve(host: str, port: int, folder: Path, shows: bool) -> None:
    """Serve the page until Ctrl-C. `folder`: of recordings and summaries. `shows`: open a browser. Raises ValueError for a bad address."""
    _check(host, port)
    runs, studies = Harvests(folder, "harvest"), Studies(folder, "study")

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
        ui.run(page, host=host, port=port, show=shows, reload=False, show_welcome_message=False, title="Kiwifruit orchard",
               language="en-US", favicon=ICON, reconnect_timeout=PATIENCE, storage_secret=token_hex())  # fmt: skip


def _check(host: str, port: int) -> None:
    try:
        socket.create_server((host, port)).close()
    except (OSError, OverflowError) as error:
        raise ValueError(f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}") from None
