"""Decide which requests the page answers: those of its own pages, and those by which it is opened.

A name of another site that suddenly means this machine (DNS rebinding) shows in `Host`. A request
of another site's page shows in `Origin` or in `Sec-Fetch-Site`, by which a browser says which page
asks.
"""

import socket

from nicegui import App
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.sessions import SessionMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ANY_ADDRESS = ("", "0.0.0.0", "::")
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")
# What `Sec-Fetch-Site` says of a request of the page itself, and of one that a user types.
OWN_SITE = ("same-origin", "none")


def guard(app: App, host: str, secret: str) -> None:
    """Let a page answer at `host` and localhost only, and give browsers an id by a signed cookie.

    If `host` is any address, this machine's name is answered, too. Refused requests get no id:
    the middleware that is added last looks at a request first.
    """
    names = [*LOOPBACK_NAMES, _name_of(host)]
    app.add_middleware(SessionMiddleware, secret_key=secret)
    app.add_middleware(OwnOrigin)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=names, www_redirect=False)


def _name_of(host: str) -> str:
    """Return the name by which a browser asks for a host. IPv6 addresses have brackets there."""
    if host in ANY_ADDRESS:
        return socket.gethostname()
    if ":" in host:
        return f"[{host}]"
    return host


class OwnOrigin:
    """Refuses requests of other sites' pages, and lets none of them frame this page.

    In a frame, a click on another site would be a click here. A link on another site may open the
    page in a tab: that request is let through.
    """

    def __init__(self, app: ASGIApp) -> None:
        """`app`: answers the requests that are let through."""
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it with status 403."""
        is_request = scope["type"] in ("http", "websocket")
        headers = Headers(scope=scope) if is_request else Headers()
        app = self._app
        if not is_own(headers) and not opens_a_tab(headers):
            app = PlainTextResponse("This page takes nothing from pages of another origin", 403)

        async def unframed(message: Message) -> None:
            """Send a message, with a header that forbids frames."""
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).append(
                    "Content-Security-Policy", "frame-ancestors 'none'"
                )
            await send(message)

        await app(scope, receive, unframed)


def has_own_origin(headers: Headers) -> bool:
    """Whether a request names no origin, or the page's own."""
    origin = headers.get("origin")
    return origin is None or origin.partition("://")[2] == headers.get("host")


def is_own(headers: Headers) -> bool:
    """Whether nothing in a request tells that another site's page has made it."""
    return has_own_origin(headers) and headers.get("sec-fetch-site", "none") in OWN_SITE


def opens_a_tab(headers: Headers) -> bool:
    """Whether a request shows the page in a tab.

    A frame is no tab. A request in advance (prefetch) shows nothing yet.
    """
    is_in_advance = "prefetch" in headers.get("sec-purpose", "").lower()
    goes_there = headers.get("sec-fetch-mode") == "navigate"
    is_whole_page = headers.get("sec-fetch-dest") == "document"
    return has_own_origin(headers) and goes_there and is_whole_page and not is_in_advance
