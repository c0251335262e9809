"""Serve the page.

It answers only requests to its own address that its own pages make: a page of another site could start runs otherwise. A name of another
site that suddenly means this machine (DNS rebinding) shows in `Host`, a request from another site's page in `Origin`.
"""

import contextlib
import signal
import socket
from pathlib import Path
from secrets import token_hex

from nicegui import App, app, ui
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from orchard.app.desks import desk_of
from orchard.app.draft import draft_of
from orchard.app.harvest_run import Harvests
from orchard.app.page import PATIENCE, Page, complain
from orchard.app.study_run import Studies

ICON = "🥝"
ANY_ADDRESS = ("", "0.0.0.0", "::")
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


def serve(host: str, port: int, folder: Path, shows: bool) -> None:
    """Serve the page until Ctrl-C. `folder`: of its files. `shows`: open a browser. Raises ValueError for a bad address."""
    try:
        socket.create_server((host, port)).close()
    except (OSError, OverflowError) as error:
        raise ValueError(
            f"--host {host} --port {port}: {getattr(error, 'strerror', None) or error}"
        ) from None
    runs, studies = Harvests(folder, "harvest"), Studies(folder, "study")

    def page() -> None:
        desk, query = (
            desk_of(app.storage.browser["id"]),
            ui.context.client.request.query_params.multi_items(),
        )
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


class OwnOrigin:
    """Refuses requests of other sites' pages, and lets none of them frame this page: a click there is no click here."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] in ("http", "websocket") else Headers()
        is_own = "origin" not in headers or headers["origin"].partition("://")[2] == headers.get(
            "host"
        )
        app = (
            self._app
            if is_own
            else PlainTextResponse("This page takes nothing from pages of another origin", 403)
        )

        async def unframed(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).append(
                    "Content-Security-Policy", "frame-ancestors 'none'"
                )
            await send(message)

        await app(scope, receive, unframed)


def only_own_address(app: App, host: str) -> None:
    """Let a page answer only at `host` and localhost; if `host` is any address, also by this machine's name."""
    name = socket.gethostname() if host in ANY_ADDRESS else f"[{host}]" if ":" in host else host
    app.add_middleware(OwnOrigin)
    app.add_middleware(
        TrustedHostMiddleware, allowed_hosts=[*LOOPBACK_NAMES, name], www_redirect=False
    )
