"""The page answers only requests to its own address that its own pages make: a page of another site could start runs otherwise.

A name of another site that suddenly means this machine (DNS rebinding) shows in `Host`, a request from another site's page in `Origin`.
"""

import socket

from nicegui import App
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ANY_ADDRESS = ("", "0.0.0.0", "::")
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


class OwnOrigin:
    """Refuses the requests of other sites' pages, to the websocket too, and lets none of them frame this page, so that a click there is
    no click here. Programs other than browsers send no `Origin`."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] in ("http", "websocket") else Headers()
        is_own = "origin" not in headers or headers["origin"].partition("://")[2] == headers.get("host")
        app = self._app if is_own else PlainTextResponse("This page takes nothing from pages of another origin", 403)

        async def unframed(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).append("Content-Security-Policy", "frame-ancestors 'none'")
            await send(message)

        await app(scope, receive, unframed)


def only_own_address(app: App, host: str) -> None:
    """Let a page that listens at `host` answer only there and at localhost; if that is any address, also at this machine's name."""
    name = socket.gethostname() if host in ANY_ADDRESS else f"[{host}]" if ":" in host else host
    app.add_middleware(OwnOrigin)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=[*LOOPBACK_NAMES, name], www_redirect=False)
