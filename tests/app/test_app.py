"""The page as a person fills it in, and runs from it: a real server, real runs, and headless
Chromium.
"""

import http.client
import json
import os
import re
import socket
import subprocess
import sys
import urllib.request
from urllib.parse import urlsplit
from urllib.request import urlopen

import psutil
import pytest
from local_runs import local_hash
from own_agents import Hostile
from page_server import ROOT, page, skip_without_packages, wait_for
from patience import PATIENCE
from selenium.webdriver.common.keys import Keys

from orchard.app.charts import STEPS
from orchard.app.unseen import MOST as MOST_UNSEEN
from orchard.app.unseen import UnseenPages
from orchard.field.scenario import Scenario, load
from orchard.launch.supervisor import free_port
from orchard.view.web import data_uri, free_pair, is_open, page_url, serve_web

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
            one.laddr
            for one in psutil.Process(viewer.pid).net_connections("inet")
            if one.status == psutil.CONN_LISTEN
        ]
        assert {(address.ip, address.port) for address in listening} == {("127.0.0.1", port)}
    finally:
        viewer.terminate()
        viewer.communicate(timeout=PATIENCE)


WEBSOCKET = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "b3JjaGFyZCBvcmNoYXJkIQ==",
}
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="
ASKED = {
    "the page": ("GET", "/", {}),
    "websocket": ("GET", SOCKET + "websocket", WEBSOCKET),
    "polling": ("GET", SOCKET + "polling", {}),
    "upload": ("POST", "/_nicegui/client/1/upload/1", {}),
}


def answer(address, what, **names):
    """The status with which the page answers a request whose headers Host and Origin say this."""
    order, path, headers = ASKED[what]
    own = address.removeprefix("http://")
    link = http.client.HTTPConnection(own, timeout=PATIENCE)
    link.request(
        order,
        path,
        headers={"Host": own}
        | headers
        | {name.capitalize(): value for name, value in names.items()},
    )
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
    well = answer(address, what)
    local = f"localhost:{port}"
    assert (
        well
        == answer(address, what, origin=address)
        == answer(address, what, host=local, origin=f"http://{local}")
    )
    assert well in (101, 200) or what == "upload", "this upload is unknown, but not refused"
    for host in (
        "attacker.example",
        f"attacker.example:{port}",
        f"127.0.0.1.attacker.example:{port}",
        "",
    ):
        assert answer(address, what, host=host) == 400, host
        assert answer(address, what, host=host, origin=f"http://{host}") == 400, host
    for origin in ("http://attacker.example", "null", "http://127.0.0.1:1", f"http://{local}"):
        assert answer(address, what, origin=origin) == 403, origin


OTHER = {"Sec-Fetch-Site": "cross-site"}
NAVIGATES = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Sec-Fetch-Site": "same-origin"}, 200),
        ({"Sec-Fetch-Site": "none"} | NAVIGATES, 200),
        (OTHER | NAVIGATES, 200),
        (OTHER | {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}, 403),
        (OTHER | {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "empty"}, 403),
        (OTHER | NAVIGATES | {"Sec-Fetch-Dest": "iframe"}, 403),
        (OTHER | NAVIGATES | {"Sec-Purpose": "prefetch;anonymous-client-ip"}, 403),
        (OTHER | NAVIGATES | {"Origin": "http://attacker.example"}, 403),
        ({"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "no-cors"}, 403),
    ],
)
def test_of_another_sites_requests_only_a_link_opens_the_page(server, headers, status):
    own = server[0].removeprefix("http://")
    link = http.client.HTTPConnection(own, timeout=PATIENCE)
    link.request("GET", "/?rows=7", headers=headers)
    answered = link.getresponse()
    link.close()
    assert answered.status == status
    assert (answered.headers["Set-Cookie"] is None) == (status == 403), "no id, so nothing is kept"


class Waiting:
    """A page as NiceGUI gives it, whose browser can come."""

    def __init__(self, number):
        self.id = str(number)
        self.is_deleted = False
        self._then = []

    def on_connect(self, act):
        self._then.append(act)

    def on_delete(self, act):
        pass

    def delete(self):
        self.is_deleted = True

    def come(self):
        for act in self._then:
            act(self)


def test_only_some_pages_wait_for_their_browsers():
    unseen = UnseenPages()
    pages = [Waiting(number) for number in range(3 * MOST_UNSEEN)]
    seen = Waiting("seen")
    unseen.add(seen)
    seen.come()
    for page_ in pages:
        unseen.add(page_)
    assert [page_.is_deleted for page_ in pages] == [True] * 2 * MOST_UNSEEN + [False] * MOST_UNSEEN
    assert not seen.is_deleted


def test_pages_without_a_browser_are_freed(tmp_path):
    """What stays of each page is its upload, because FastAPI remembers the last 4,096 functions of
    routes.
    """
    requests = 3 * MOST_UNSEEN
    script = ROOT / "tests" / "support" / "page_requests.py"
    order = [sys.executable, script, str(free_port()), str(requests), tmp_path]
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    done = subprocess.run(
        order, cwd=ROOT, env=plain, capture_output=True, text=True, timeout=5 * PATIENCE
    )
    assert done.returncode == 0, done.stderr
    in_memory = json.loads(done.stdout.splitlines()[-1])
    assert in_memory["pages"] <= MOST_UNSEEN
    assert in_memory["deleted elements"] <= requests


def test_a_new_page_says_what_to_do_first(browser):
    assert "Enter your rows" in browser.view("first").text


def test_the_plan_and_the_figures_follow_every_change(browser):
    browser.until(lambda: browser.figure("Trees") == "72", "trees")
    browser.fill("rows", 8)
    browser.until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    browser.until(lambda: browser.figure("Trees") == "108", "more trees")
    before = browser.figure("Limit")
    browser.fill("pickers", 8)
    browser.until(lambda: browser.figure("Carriers") == "6", "carriers follow the pickers")
    assert browser.figure("Bins") == "14"
    assert browser.figure("Limit") != before
    assert browser.field("carriers").get_attribute("value") == "6"
    browser.click("[data-preset=default]")
    browser.until(lambda: browser.tree_lines() == 6, "the default plan again")


def test_a_preset_can_be_undone(browser):
    """Also after a reload. What was invalid comes back as it was typed."""
    browser.fill("rows", 9)
    browser.fill("row_length", "9O")
    browser.until(lambda: browser.problem("row_length"), "an invalid value")
    browser.click("[data-preset=hand_picking]")
    browser.until(lambda: browser.tree_lines() == 27, "the preset")
    browser.reload()
    browser.press("undo")
    browser.until(lambda: browser.field("rows").get_attribute("value") == "9", "his rows")
    assert browser.field("row_length").get_attribute("value") == "9O"
    browser.press("undo")
    browser.until(lambda: browser.field("rows").get_attribute("value") == "26", "the preset again")


def test_a_slider_moves_its_field(browser):
    browser.one(".field .q-slider").click()
    rows = browser.field("rows")
    browser.until(lambda: rows.get_attribute("value") in ("51", "52"), "rows in the middle")
    browser.until(
        lambda: browser.tree_lines() == int(rows.get_attribute("value")) + 1, "a plan of as many"
    )


def test_a_plan_of_many_rows_is_shown_as_wide_as_the_page(browser):
    browser.fill("rows", 100)
    browser.until(lambda: browser.tree_lines() == 101, "a plan of 100 rows")
    browser.until(
        lambda: browser.field("full-width").get_attribute("aria-checked") == "true",
        "full width by itself",
    )
    browser.fill("rows", 5)
    browser.until(
        lambda: browser.field("full-width").get_attribute("aria-checked") == "false",
        "the whole plan again",
    )


def test_bad_values_are_explained_at_their_fields(browser):
    """Bad values are explained at their fields and cannot be run."""
    browser.fill("rows", 101)
    browser.until(lambda: "from 3 to 100" in browser.problem("rows"), "the limits at the field")
    browser.fill("people.workers", 48)
    browser.until(
        lambda: "at most 50 together" in browser.problem("people.visitors"),
        "people are too many together",
    )
    assert "48" in browser.problem("people.workers")
    assert "3 fields" in browser.view("trouble").text
    assert not browser.one("[data-action=run]").is_enabled()
    assert not browser.one("[data-action=save]").is_enabled()
    browser.fill("rows", 4)
    browser.fill("people.workers", 1)
    browser.until(
        lambda: not browser.problem("rows") and not browser.problem("people.visitors"),
        "all is well again",
    )
    browser.until(lambda: browser.tree_lines() == 5, "a plan of 4 rows")


def open_file(page, file, text):
    file.write_text(text)
    page.one("input[type=file]").send_keys(str(file))


def test_a_bad_file_is_explained_and_changes_nothing(browser, tmp_path):
    open_file(browser, tmp_path / "bad.yaml", "rows: 999\npikers: 3\n")
    told = browser.until(lambda: browser.view("complaint").text, "a complaint")
    assert "bad.yaml:1: rows = 999" in told
    assert "did you mean pickers" in told
    assert browser.field("rows").get_attribute("value") == "5"


def test_a_file_is_opened_changed_and_saved(browser, downloads, tmp_path):
    """With picking that varies, which has limits of its own, and a number that no browser holds."""
    text = (
        "rows: 12\npickers: 4\ncarriers: 9\npicking_speed: 0.5\npicking: {spread: {distribution:"
        " gamma, cv: 0.4}}\n"
    )
    open_file(browser, tmp_path / "mine.yaml", text)
    browser.until(lambda: browser.tree_lines() == 13, "a plan of 12 rows")
    browser.until(
        lambda: (
            browser.field("carriers").get_attribute("value") == browser.figure("Carriers") == "9"
        ),
        "as many carriers",
    )
    assert browser.field("picking.spread.cv").get_attribute("value") == "0.4"
    browser.fill("seed", 2**63 - 1)
    browser.switch("picking.failure.mean_between-automatic", False)
    browser.until(
        lambda: "must be a number from 60" in browser.problem("picking.failure.mean_between"),
        "a number is asked for",
    )
    browser.fill("picking.failure.mean_between", 1800)
    browser.until(lambda: not browser.problem("picking.failure.mean_between"), "all is well")
    browser.fill("picking.spread.cv", 0.6)
    for path in ("picking.spread.cv", "picking.spread.distribution", "picking_speed"):
        browser.until(
            lambda path=path: "“Deviation of times” must be at most 0.5" in browser.problem(path),
            f"told at {path}",
        )
    browser.fill("picking.spread.cv", 0.5)
    browser.until(lambda: not browser.problem("picking_speed"), "all is well again")
    picking = {"spread": {"distribution": "gamma", "cv": 0.5}, "failure": {"mean_between": 1800.0}}
    size = {"rows": 12, "pickers": 4, "carriers": 9, "seed": 2**63 - 1}
    assert load(browser.saved(downloads)) == Scenario(**size, picking_speed=0.5, picking=picking)


def told(page):
    """What the figures of the first card come to."""
    return page.view("conversion").text


def test_the_rows_of_a_grower_are_typed_as_he_says_them(browser):
    """With a comma, and with the spacing from trees to trees. A number replaces "unknown"."""
    typed = {
        "rows": 20,
        "row_length": 90,
        "row_width": "4,5",
        "crop.tonnes_per_hectare": 40,
        "crop.kilograms_per_bin": 350,
        "pickers": 6,
        "picking_rate": "1,5",
    }
    for path, value in typed.items():
        browser.fill(path, value)
    browser.until(lambda: "4.63 bins a row, 92.6 in all" in told(browser), "what they come to")
    assert not browser.driver.find_elements("css selector", ".field.wrong")
    assert browser.field("crop.tonnes_per_hectare-automatic").get_attribute("aria-checked") == (
        "false"
    )
    browser.fill("bins_per_row", 3)
    browser.until(lambda: told(browser).startswith("3 bins a row"), "the last one counts")
    assert browser.field("crop.tonnes_per_hectare").get_attribute("value") == ""
    browser.fill("row_width", 3)
    browser.until(
        lambda: browser.problem("row_width").endswith("3.65 to 12.5 m, from tree to tree"),
        "as he measures it",
    )


def test_longer_rows_leave_a_rate_and_show_its_speed(browser):
    """Longer rows leave a rate as it was and show the speed that it comes to."""
    browser.reload()
    browser.until(lambda: browser.field("rows").is_displayed(), "the page")
    assert not browser.field("picking_speed").is_displayed()  # but folded away
    browser.switch("picking_rate-automatic", False)
    browser.fill("picking_rate", 1.5)
    browser.until(
        lambda: "2 pickers fill 3 bins an hour while they pick, and go 0.0292 m/s" in told(browser),
        "1.5 rows of 70 m an hour",
    )
    browser.fill("row_length", 110)
    browser.until(
        lambda: "and go 0.0458 m/s" in told(browser),
        "1.5 rows of 110 m an hour",
    )
    assert browser.field("picking_rate").get_attribute("value") == "1.5"
    browser.fill("picking_rate", 40)
    browser.until(
        lambda: (
            "must be 0.033 to 32.727 where 110 m of row fill a bin"
            in browser.problem("picking_rate")
        ),
        "a limit in words",
    )


@pytest.fixture
def small(browser):
    """The page with a small orchard, in one process, eight times as fast as life, to its end,
    without a live picture.

    The page keeps what the test before has set.
    """
    browser.fill("rows", 3)
    browser.until(lambda: browser.tree_lines() == 4, "a plan of 3 rows")
    browser.choose("mode", "local")
    browser.switch("fastest", False)
    browser.fill("speed", 8)
    browser.fill("duration", "")
    browser.switch("live", False)
    return browser


def run_to_its_end(page, folder, state="finished"):
    """Press Run, and wait for the result: a short run is over before it is seen running.

    `state`: in which it ends. Return the file of the scenario that ran.
    """
    before = {*folder.glob("harvest-*.yaml")}
    page.press("run")
    [file] = page.until(lambda: {*folder.glob("harvest-*.yaml")} - before, "a run of its own")
    page.until(lambda: f"{state}, {file.stem}" in page.view("result").text, "its result", PATIENCE)
    return file


def all_figures(page):
    """Unfold the figures of a summary, and return their text."""
    page.press("all-figures")
    return page.until(
        lambda: page.view("summary").text if "finished" in page.view("summary").text else "",
        "all figures",
    )


def is_locked(page):
    return bool(page.driver.find_elements("css selector", ".wishes[inert]"))


def shown_charts(page):
    charts = page.driver.find_elements("css selector", "figure")
    return [
        chart.find_element("css selector", "figcaption").text
        for chart in charts
        if chart.is_displayed()
    ]


def test_a_small_orchard_is_run_to_its_end(small, server):
    small.switch("fastest", True)
    run_to_its_end(small, server[1])
    result = small.until(lambda: small.view("result").text, "the result")
    assert result.startswith("3 of 3 rows in ") and "What limits it: " in result
    assert all(
        name in result
        for name in ("Bins an hour", "Time", "Pickers wait", "Carriers at work", "Collisions")
    ), result
    assert (
        "collisions_of" not in small.view("summary").text
        and "finished" not in small.view("summary").text
    )
    figures = all_figures(small)
    assert re.search(r"bins delivered\s+3", figures) and re.search(r"finished\s+True", figures)
    assert len(list(server[1].glob("*.rrd"))) == 1
    assert "bins delivered 3/3" in small.view("progress").text
    small.turn_to("Picture")
    picture = small.until(
        lambda: small.view("picture").get_attribute("src"), "the recording, in Rerun's viewer"
    )
    assert urllib.request.urlopen(picture, timeout=PATIENCE).status == 200


def test_a_run_in_realtime_takes_numbers_only(small):
    small.switch("fastest", True)
    small.choose("mode", "realtime")
    small.until(lambda: not small.field("fastest").is_displayed(), "there is no fastest")
    small.until(lambda: "the wall clock sets the pace" in small.problem("speed"), "why")
    small.fill("speed", "max")
    small.until(lambda: "it cannot be max" in small.problem("speed"), "explained at the field")
    small.until(lambda: not small.one("[data-action=run]").is_enabled(), "it cannot be run")
    small.fill("speed", 5)
    small.press("run")
    small.tell_state("running")
    small.until(
        lambda: "% picked" in small.view("progress").text,
        "progress of a run of processes",
        PATIENCE,
    )
    assert small.view("state").text == "running"
    small.turn_to("Picture")
    small.until(
        lambda: shown_charts(small) == list(STEPS), "all charts grow while it runs", PATIENCE
    )
    small.press("stop")
    small.tell_state("stopped", PATIENCE)
    small.turn_to("Summary")
    summary = all_figures(small)
    assert re.search(r"mode\s+realtime", summary)


def test_a_file_with_own_classes_is_changed_saved_and_run(small, server, downloads, tmp_path):
    file = tmp_path / "own.yaml"
    open_file(small, file, "agents: {picker_01: subprocess.Popen}\n")
    assert "subprocess.Popen is not in" in small.until(
        lambda: small.view("complaint").text, "a complaint"
    )
    small.click("[data-view=complaint] button")
    for decision in ("refuse-classes", "trust-classes"):
        assert not small.view("classes").is_displayed(), "not before the user trusts the file"
        open_file(
            small,
            file,
            "rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Eastward}\n",
        )
        question = small.until(lambda: small.view("question").text, "a question")
        assert (
            "own.yaml runs code" in question
            and "picker_01: tests.support.own_agents.Eastward" in question
        )
        small.press(decision)
        small.until(
            lambda: not small.driver.find_elements("css selector", "[data-view=question]"),
            "the question is answered",
        )
    small.until(
        lambda: small.view("classes").text == "picker_01: tests.support.own_agents.Eastward",
        "the class is shown",
    )
    small.fill("weeds", 7)
    small.fill("duration", 30)
    small.switch("fastest", True)
    wanted = Scenario(
        rows=3, pickers=3, weeds=7, agents={"picker_01": "tests.support.own_agents.Eastward"}
    )
    assert load(small.saved(downloads)) == wanted
    assert load(run_to_its_end(small, server[1], "cut short")) == wanted
    summary = all_figures(small)
    assert local_hash(wanted, 300) in summary, "Eastward drove"
    small.press("drop-classes")
    small.until(lambda: not small.view("classes").is_displayed(), "ours drive again")


def test_an_agents_hostile_words_are_only_words(small, tmp_path):
    open_file(
        small,
        tmp_path / "hostile.yaml",
        "rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Hostile}\n",
    )
    small.press("trust-classes")
    small.until(lambda: small.view("classes").is_displayed(), "the class is taken")
    small.fill("duration", 5)
    small.switch("fastest", True)
    small.press("run")

    def said() -> str:
        small.turn_to("Messages")  # the page turns to another view when the run begins
        return text if Hostile.words in (text := small.view("messages").text) else ""

    text = small.until(said, "the error is shown as it is", PATIENCE)
    small.until(
        lambda: not small.driver.find_elements("css selector", ".wishes[inert]"),
        "the run is over",
        PATIENCE,
    )
    assert "\x1b" not in text
    assert not small.view("messages").find_elements("css selector", "img")
    assert small.driver.title != "mine"
    small.press("drop-classes")


def test_a_run_is_seen_live(small):
    small.driver.set_window_size(700, 500)  # few pixels: there is no graphics card to draw them
    small.switch("live", True)
    small.press("run")
    small.until(lambda: small.view("picture").is_displayed(), "the live picture", PATIENCE)
    small.tell_state("running")
    small.driver.switch_to.frame(small.view("picture"))
    small.one("canvas")
    small.driver.switch_to.default_content()
    small.press("stop")
    small.tell_state("stopped")


def test_a_run_that_is_stopped_at_once_is_no_mistake(small):
    small.press("run")
    small.press("stop")
    small.tell_state("stopped")
    for view in ("Summary", "Messages"):
        small.turn_to(view)
        assert "Traceback" not in small.until(lambda view=view: small.view(view.lower()), view).text
    small.turn_to("Picture")
    small.until(
        lambda: (
            "No recording was made." in small.one(".stage").text
            or small.view("picture").get_attribute("src")
        ),
        "no picture, or one of a run that had begun",
    )
    small.fill("duration", 5)
    small.press("run")
    small.tell_state("cut short", PATIENCE)
    small.turn_to("Picture")
    assert small.until(lambda: small.view("picture").get_attribute("src"), "the next run has one")


@pytest.mark.soak
def test_a_busy_browser_sees_the_end_of_a_run(small, server):
    """A browser that was busy at the end of a run sees the end."""
    small.fill("duration", 100)
    small.press("run")
    small.tell_state("running")
    small.until(lambda: "simulated" in small.view("progress").text, "the first progress", PATIENCE)
    small.driver.execute_script("window.mark = 'the same page'")
    summaries = set(server[1].glob("*.json"))
    with small.frozen():  # for 10 s or more, as while it loads the picture's viewer
        small.until(lambda: set(server[1].glob("*.json")) - summaries, "the run is over", PATIENCE)
    small.tell_state("cut short")
    assert "simulated 1:40 min" in small.view("progress").text
    assert small.driver.execute_script("return window.mark") == "the same page"


def test_a_run_is_still_there_after_a_reload_and_can_be_stopped(small):
    small.press("run")
    small.tell_state("running")
    small.until(lambda: "simulated" in small.view("progress").text, "the first progress", PATIENCE)
    small.reload()
    small.tell_state("running")
    assert small.field("rows").get_attribute("value") == "3"
    assert not small.one("[data-action=run]").is_displayed()
    small.fill("rows", 4)
    small.until(
        lambda: small.one("[data-mark=rows]").text == "the harvest that runs has 3",
        "the field is marked",
    )
    assert is_locked(small), "mode and speed are those of the run"
    small.press("stop")
    small.tell_state("stopped", PATIENCE)
    assert re.search(r"finished\s+False", all_figures(small))
    assert "3 rows, 2 pickers, 2 carriers, seed 1" in small.view("result").text, (
        "whatever the form says now"
    )
    small.until(lambda: not small.one("[data-mark=rows]").is_displayed(), "nothing runs")
    assert not is_locked(small)


@pytest.fixture
def parent(small, server):
    """A run of the small orchard, chosen in the list of runs, where it is the newest.

    A fork of it ends after 4 min.
    """
    small.switch("fastest", True)
    file = run_to_its_end(small, server[1])
    small.fill("duration", 240)
    small.turn_to("Runs")
    small.unchoose_runs()
    small.click("[data-view=runs] tbody .q-checkbox")
    small.until(
        lambda: small.view("moment").text == "3:00",
        "its time line: the keyframe in the middle of 7 min",
    )
    return file.stem


def test_a_run_goes_on_from_a_moment_with_a_change(small, parent, server):
    """A run goes on from a moment with something changed beside the first one."""
    small.one("[data-field=moment] [tabindex='0']").send_keys(Keys.ARROW_LEFT)
    small.until(lambda: small.view("moment").text == "2:59", "an earlier moment")
    small.switch("fork-carriers-automatic", False)
    small.fill("fork-carriers", 121)
    small.press("fork")
    small.until(
        lambda: "from 1 to 120" in small.problem("fork-carriers"), "what is wrong, at its field"
    )
    small.fill("fork-carriers", 3)
    small.pick("fork-stop", "picker_02")
    small.escape()
    small.press("fork")
    compared = small.until(
        lambda: text if "Side by side" in (text := small.view("comparison").text) else "",
        "both",
        PATIENCE,
    )
    assert compared.count(", from 2:59") == 2, "in the legend and in the table"
    assert small.view("compared-at").text == (
        "All are compared at 4:00 min, when the first of them ended."
    )
    assert "harvest done at 7:" in compared and "cut short at 4:00 min" in compared
    assert small.view("state").text.lower() == "cut short"
    above, below, *_ = [
        row.text for row in small.view("runs").find_elements("css selector", "tbody tr")
    ]
    assert "from" not in above and "from 2:59" in below and "3 carriers" in below, (
        "it stands under its parent"
    )
    (fork,) = [
        known
        for path in server[1].glob("*.json")
        if "forked_from" in (known := json.loads(path.read_text()))
    ]
    assert fork["forked_from"] == {"run": parent, "seconds": 179.0}
    assert (
        fork["scenario"]["carriers"],
        fork["sim_seconds"],
        fork["stopped_seconds"]["picker_02"],
    ) == (3, 240.0, 61.0)
    small.press("pictures")
    shown = small.until(lambda: two_pictures(small), "both pictures")
    assert [
        name in url
        for name, url in zip(
            (parent, small.view("result").text.split(", ")[-1]), shown, strict=True
        )
    ] == [True, True]
    assert [urllib.request.urlopen(url, timeout=PATIENCE).status for url in shown] == [200, 200]
    small.unchoose_runs()
    small.until(
        lambda: not any(is_open(urlsplit(url).port) for url in shown),
        "their servers end when they are not seen any more",
    )


def two_pictures(page):
    urls = [
        frame.get_attribute("src")
        for frame in page.view("comparison").find_elements("tag name", "iframe")
    ]
    return urls if len(urls) == 2 and all(urls) else None


def test_why_a_run_cannot_go_on_is_told_as_the_command_does(small, parent):
    """Why a run cannot go on so is told in the words of the command."""
    small.turn_to("Summary")  # the run itself asks, too
    small.fill("this-fork-carriers", 1)
    small.press("this-fork")
    small.tell_state("failed", PATIENCE)
    small.until(
        lambda: (
            "1 cannot be taken away: only 0 of them wait in the queue" in small.view("summary").text
        ),
        "why",
    )
