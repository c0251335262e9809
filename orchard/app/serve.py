"""Serve the page.

It answers only requests to its own address that its own pages make: a page of another site could
start runs otherwise. Such a page can open this one by a link; then what the user entered stays
until the user agrees, and nothing of the request is kept before the browser shows the page.
"""

import contextlib
import signal
import socket
from functools import partial
from pathlib import Path
from secrets import token_hex

from nicegui import app, run, ui

from orchard.app.desks import Desks
from orchard.app.harvest_run import Harvests
from orchard.app.link import draft_of
from orchard.app.own_origin import guard
from orchard.app.page import PATIENCE, Page
from orchard.app.questions import Questions
from orchard.app.unseen import UnseenPages

ICON = "🥝"


def serve(host: str, port: int, folder: Path, shows: bool) -> None:
    """Serve the page until Ctrl-C.

    `folder`: of its files. `shows`: open a browser. Raises ValueError for a bad address.
    """
    _check_address(host, port)
    runs = Harvests(folder, "harvest")
    questions = Questions(folder)
    desks = Desks()
    unseen = UnseenPages()

    def page() -> None:
        """Build the page for a request."""
        client = ui.context.client
        unseen.add(client)
        browser = app.storage.browser["id"]
        desk = desks.of(browser)
        client.on_connect(partial(desks.keep, browser, desk))
        shown = Page(runs, questions, desk)
        query = client.request.query_params.multi_items()
        if query:
            # A reload shows what was entered since, and not the link again.
            ui.navigate.history.replace("/")
            shown.open_link(*draft_of(query))

    # A fork of a process with threads may find a lock that no thread opens any more.
    run.process_pool_start_method = "spawn"
    secret = token_hex()
    guard(app, host, secret)
    app.on_shutdown(runs.close)
    app.on_shutdown(questions.close)
    print(f"The page is at http://{host}:{port}  (Ctrl-C stops the server)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ui.run(
            page,
            host=host,
            port=port,
            show=shows,
            reload=False,
            show_welcome_message=False,
            title="Kiwifruit orchard",
            language="en-US",
            favicon=ICON,
            reconnect_timeout=PATIENCE,
            storage_secret=secret,
        )


def _check_address(host: str, port: int) -> None:
    """Raise ValueError if nothing can be served at an address."""
    try:
        socket.create_server((host, port)).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"--host {host} --port {port}: {reason}") from None
