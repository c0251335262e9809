"""Who may ask the page for something, and how much a page without a browser keeps."""

import http.client
import json
import os
import socket
import subprocess
import sys
from urllib.request import urlopen

import psutil
import pytest
from page_server import ROOT, page, skip_without_packages, wait_for
from patience import PATIENCE

from orchard.app.unseen import MOST as MOST_UNSEEN
from orchard.app.unseen import UnseenPages
from orchard.launch.supervisor import free_port
from orchard.view.web import data_uri, free_pair, page_url, serve_web

skip_without_packages()


def test_a_port_that_is_taken_is_named_with_exit_code_2():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run(
            page("--port", port), cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE
        )
    assert done.returncode == 2
    assert f"--port {port}" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_web_viewer_is_on_the_loopback_only():
    port = free_pair()
    viewer = serve_web(port, data_uri(port))
    try:
        wait_for(viewer, page_url(port, data_uri(port)))
        listening = [
            connection.laddr
            for connection in psutil.Process(viewer.pid).net_connections("inet")
            if connection.status == psutil.CONN_LISTEN
        ]
        assert {(address.ip, address.port) for address in listening} == {("127.0.0.1", port)}
    finally:
        viewer.terminate()
        viewer.communicate(timeout=PATIENCE)


# Headers that ask for a WebSocket.
WEBSOCKET = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "b3JjaGFyZCBvcmNoYXJkIQ==",
}
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="
# Each way to reach the page: method, path and headers.
REQUESTS = {
    "the page": ("GET", "/", {}),
    "websocket": ("GET", SOCKET + "websocket", WEBSOCKET),
    "polling": ("GET", SOCKET + "polling", {}),
    "upload": ("POST", "/_nicegui/client/1/upload/1", {}),
}


def status_of(address, request, host=None, origin=None):
    """Send a request of REQUESTS to the page, and return the status of the answer.

    `host` and `origin` replace the headers of these names; without `origin` there is none.
    """
    method, path, headers = REQUESTS[request]
    own_host = address.removeprefix("http://")
    headers = {"Host": own_host} | headers
    if host is not None:
        headers["Host"] = host
    if origin is not None:
        headers["Origin"] = origin
    link = http.client.HTTPConnection(own_host, timeout=PATIENCE)
    link.request(method, path, headers=headers)
    status = link.getresponse().status
    link.close()
    return status


def test_no_other_site_may_frame_the_page(server):
    with urlopen(server[0]) as answered:
        assert answered.headers["Content-Security-Policy"] == "frame-ancestors 'none'"


@pytest.mark.parametrize("request_name", REQUESTS)
def test_the_page_answers_its_own_address_only(server, request_name):
    """A site that an attacker names so that it leads to this computer gets no answer."""
    address = server[0]
    port = address.rpartition(":")[2]

    # Both names of this computer are the page's own address.
    local = f"localhost:{port}"
    accepted = status_of(address, request_name)
    assert status_of(address, request_name, origin=address) == accepted
    assert status_of(address, request_name, host=local, origin=f"http://{local}") == accepted
    # The page knows no upload of this number, but does not refuse the request for its address.
    if request_name != "upload":
        assert accepted in (101, 200)

    other_hosts = [
        "attacker.example",
        f"attacker.example:{port}",
        f"127.0.0.1.attacker.example:{port}",
        "",
    ]
    for host in other_hosts:
        assert status_of(address, request_name, host=host) == 400, host
        assert status_of(address, request_name, host=host, origin=f"http://{host}") == 400, host

    other_origins = ["http://attacker.example", "null", "http://127.0.0.1:1", f"http://{local}"]
    for origin in other_origins:
        assert status_of(address, request_name, origin=origin) == 403, origin


# What a browser says of a request: it comes from another site, and it opens a page in a tab.
OTHER = {"Sec-Fetch-Site": "cross-site"}
NAVIGATES = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        pytest.param({"Sec-Fetch-Site": "same-origin"}, 200, id="the page itself"),
        pytest.param({"Sec-Fetch-Site": "none"} | NAVIGATES, 200, id="typed address"),
        pytest.param(OTHER | NAVIGATES, 200, id="link"),
        pytest.param(
            OTHER | {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}, 403, id="image"
        ),
        pytest.param(
            OTHER | {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "empty"}, 403, id="fetch"
        ),
        pytest.param(OTHER | NAVIGATES | {"Sec-Fetch-Dest": "iframe"}, 403, id="frame"),
        pytest.param(
            OTHER | NAVIGATES | {"Sec-Purpose": "prefetch;anonymous-client-ip"}, 403, id="prefetch"
        ),
        pytest.param(
            OTHER | NAVIGATES | {"Origin": "http://attacker.example"}, 403, id="form that is sent"
        ),
        pytest.param(
            {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "no-cors"}, 403, id="sibling site"
        ),
    ],
)
def test_of_another_sites_requests_only_a_link_opens_the_page(server, headers, status):
    """A refused request gets no cookie, so the page keeps nothing for it."""
    host = server[0].removeprefix("http://")
    link = http.client.HTTPConnection(host, timeout=PATIENCE)
    link.request("GET", "/?rows=7", headers=headers)
    response = link.getresponse()
    link.close()
    assert response.status == status
    assert (response.headers["Set-Cookie"] is None) == (status == 403)


class PageWithoutBrowser:
    """A page as NiceGUI makes it, before its browser connects."""

    def __init__(self, number):
        self.id = str(number)
        self.is_deleted = False
        self._handlers = []

    def on_connect(self, handler):
        self._handlers.append(handler)

    def on_delete(self, handler):
        pass

    def delete(self):
        self.is_deleted = True

    def connect(self):
        for handler in self._handlers:
            handler(self)


def test_only_some_pages_wait_for_their_browsers():
    """Of pages without a browser only the newest stay; one that a browser shows always stays."""
    unseen = UnseenPages()
    seen = PageWithoutBrowser("seen")
    unseen.add(seen)
    seen.connect()

    pages = [PageWithoutBrowser(number) for number in range(3 * MOST_UNSEEN)]
    for waiting in pages:
        unseen.add(waiting)

    oldest = pages[:-MOST_UNSEEN]
    newest = pages[-MOST_UNSEEN:]
    assert all(waiting.is_deleted for waiting in oldest)
    assert not any(waiting.is_deleted for waiting in newest)
    assert not seen.is_deleted


def test_pages_without_a_browser_are_freed(tmp_path):
    """Of each page only one element stays, its upload.

    FastAPI remembers the last 4,096 functions of routes, and the upload has one.
    """
    requests = 3 * MOST_UNSEEN
    script = ROOT / "tests" / "support" / "page_requests.py"
    command = [sys.executable, script, str(free_port()), str(requests), tmp_path]
    # With this variable NiceGUI would think that it is in a test of its own.
    environment = dict(os.environ)
    environment.pop("PYTEST_CURRENT_TEST", None)
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=5 * PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    in_memory = json.loads(done.stdout.splitlines()[-1])
    assert in_memory["pages"] <= MOST_UNSEEN
    assert in_memory["deleted elements"] <= requests
