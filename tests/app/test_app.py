"""The page as a person fills it in: a real server, and headless Chromium."""

import http.client
import socket
import subprocess
from urllib.request import urlopen

import psutil
import pytest
from page_server import ROOT, page, skip_without_packages, wait_for

from orchard.field.scenario import Scenario, load
from orchard.view.web import data_uri, free_pair, page_url, serve_web

skip_without_packages()

# -- the server


def test_a_port_that_is_taken_is_named_with_exit_code_2():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run(page("--port", port), cwd=ROOT, capture_output=True, text=True, timeout=30)
    assert done.returncode == 2
    assert f"--port {port}" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_web_viewer_is_on_the_loopback_only():
    port = free_pair()
    viewer = serve_web(port, data_uri(port))
    try:
        wait_for(viewer, page_url(port, data_uri(port)))
        listening = [one.laddr for one in psutil.Process(viewer.pid).net_connections("inet") if one.status == psutil.CONN_LISTEN]
        assert {(address.ip, address.port) for address in listening} == {("127.0.0.1", port)}
    finally:
        viewer.terminate()
        viewer.communicate(timeout=10)


# -- from where it may be asked

WEBSOCKET = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
             "Sec-WebSocket-Key": "b3JjaGFyZCBvcmNoYXJkIQ=="}  # fmt: skip
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="
ASKED = {"the page": ("GET", "/", {}), "websocket": ("GET", SOCKET + "websocket", WEBSOCKET), "polling": ("GET", SOCKET + "polling", {}),
         "upload": ("POST", "/_nicegui/client/1/upload/1", {})}  # fmt: skip


def answer(address, what, **names):
    """The status with which the page answers a request whose headers Host and Origin say this."""
    order, path, headers = ASKED[what]
    own = address.removeprefix("http://")
    link = http.client.HTTPConnection(own, timeout=20)
    link.request(order, path, headers={"Host": own} | headers | {name.capitalize(): value for name, value in names.items()})
    status = link.getresponse().status
    link.close()
    return status


def test_no_other_site_may_frame_the_page(server):
    with urlopen(server[0]) as answered:
        assert answered.headers["Content-Security-Policy"] == "frame-ancestors 'none'"


@pytest.mark.parametrize("what", ASKED)
def test_the_page_answers_its_own_address_only(server, what):
    address = server[0]
    port = address.rpartition(":")[2]
    well, local = answer(address, what), f"localhost:{port}"
    assert well == answer(address, what, origin=address) == answer(address, what, host=local, origin=f"http://{local}")
    assert well in (101, 200) or what == "upload", "this upload is unknown, but not refused"
    for host in ("attacker.example", f"attacker.example:{port}", f"127.0.0.1.attacker.example:{port}", ""):
        assert answer(address, what, host=host) == 400, host
        assert answer(address, what, host=host, origin=f"http://{host}") == 400, host
    for origin in ("http://attacker.example", "null", "http://127.0.0.1:1", f"http://{local}"):
        assert answer(address, what, origin=origin) == 403, origin


# -- in the browser


def test_a_new_page_says_what_to_do_first(browser):
    assert "press Run" in browser.view("first").text


def test_the_plan_and_the_figures_follow_every_change(browser):
    assert browser.figure("Trees") == "72"
    browser.fill("rows", 8)
    browser.until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    assert browser.figure("Trees") == "108"
    before = browser.figure("Limit")
    browser.fill("pickers", 8)
    browser.until(lambda: browser.figure("Carriers") == "6", "carriers follow the pickers")
    assert browser.figure("Bins") == "14"
    assert browser.figure("Limit") != before
    assert browser.field("carriers").get_attribute("value") == "6"
    browser.click("[data-preset=default]")
    browser.until(lambda: browser.tree_lines() == 6, "the default plan again")


def test_a_slider_moves_its_field(browser):
    browser.one(".field .q-slider").click()
    rows = browser.field("rows")
    browser.until(lambda: rows.get_attribute("value") in ("11", "12"), "rows in the middle")
    browser.until(lambda: browser.tree_lines() == int(rows.get_attribute("value")) + 1, "a plan of as many")


def test_bad_values_are_explained_at_their_fields_and_cannot_be_run(browser):
    browser.fill("rows", 21)
    browser.until(lambda: "from 3 to 20" in browser.problem("rows"), "the limits at the field")
    browser.fill("people.workers", 48)
    browser.until(lambda: "at most 50 together" in browser.problem("people.visitors"), "people are too many together")
    assert "48" in browser.problem("people.workers")
    assert "3 fields" in browser.view("trouble").text
    assert not browser.one("[data-action=run]").is_enabled()
    assert not browser.one("[data-action=save]").is_enabled()
    browser.fill("rows", 4)
    browser.fill("people.workers", 1)
    browser.until(lambda: not browser.problem("rows") and not browser.problem("people.visitors"), "all is well again")
    browser.until(lambda: browser.tree_lines() == 5, "a plan of 4 rows")


def test_a_bad_file_is_explained_and_changes_nothing(browser, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("rows: 99\npikers: 3\n")
    browser.one("input[type=file]").send_keys(str(file))
    told = browser.until(lambda: browser.view("complaint").text, "a complaint")
    assert "bad.yaml:1: rows = 99" in told
    assert "did you mean pickers" in told
    assert browser.field("rows").get_attribute("value") == "5"


def test_a_file_is_opened_changed_and_saved(browser, downloads, tmp_path):
    """With picking that varies, which has limits of its own, and a number that no browser holds."""
    file = tmp_path / "mine.yaml"
    file.write_text("rows: 12\npickers: 4\ncarriers: 9\npicking_speed: 0.5\npicking: {spread: {distribution: gamma, cv: 0.4}}\n")
    browser.one("input[type=file]").send_keys(str(file))
    browser.until(lambda: browser.tree_lines() == 13, "a plan of 12 rows")
    assert browser.field("carriers").get_attribute("value") == browser.figure("Carriers") == "9"
    assert browser.field("picking.spread.cv").get_attribute("value") == "0.4"
    browser.fill("seed", 2**63 - 1)
    browser.switch("picking.failure.mean_between-automatic", False)
    browser.until(lambda: "null or a number from 60" in browser.problem("picking.failure.mean_between"), "a number is asked for")
    browser.fill("picking.failure.mean_between", 1800)
    browser.until(lambda: not browser.problem("picking.failure.mean_between"), "all is well")
    browser.fill("picking.spread.cv", 0.6)
    for path in ("picking.spread.cv", "picking.spread.distribution", "picking_speed"):
        browser.until(lambda path=path: "cv must be at most 0.5" in browser.problem(path), f"told at {path}")
    browser.fill("picking.spread.cv", 0.5)
    browser.until(lambda: not browser.problem("picking_speed"), "all is well again")
    picking = {"spread": {"distribution": "gamma", "cv": 0.5}, "failure": {"mean_between": 1800.0}}
    size = {"rows": 12, "pickers": 4, "carriers": 9, "seed": 2**63 - 1}
    assert load(browser.saved(downloads)) == Scenario(**size, picking_speed=0.5, picking=picking)
