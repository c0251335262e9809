"""The page as a person uses it: a real server, real runs, and headless Chromium."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import psutil
import pytest
from test_lockstep import local_hash

from orchard.app.draft import Draft
from orchard.app.entries import entries, flat, nested
from orchard.app.headline import read_headline
from orchard.app.order import Files, Pace, command
from orchard.app.runner import Runner
from orchard.config import Scenario, check, load
from orchard.progress import headline
from orchard.view.web import data_uri, free_pair, page_url, serve_web
from processes.fleet import free_port

ROOT = Path(__file__).parent.parent
PROGRAMS = [shutil.which("chromium"), shutil.which("chromedriver")]
RUN_SECONDS = 60.0  # that a small run may take on a busy machine

ON_CI = os.environ.get("CI") == "true"  # where nothing is skipped

if not ON_CI:
    for package in ("nicegui", "selenium"):
        pytest.importorskip(package, reason=f"{package} is missing: pip install 'orchard[app,dev]'")


# -- without a browser


def test_the_page_asks_for_every_value_of_a_scenario():
    assert list(entries()) == list(flat(Scenario()))
    assert check(nested(flat(Scenario(rows=7, carriers=3)))) == Scenario(rows=7, carriers=3)


def test_limits_and_steps_come_from_the_model():
    rows, noise, seed = (entries()[path] for path in ("rows", "laser.noise", "seed"))
    assert (rows.low, rows.high, rows.step, rows.limits) == (3, 20, 1, "3 to 20")
    assert (noise.step, noise.limits, noise.label) == (0.0002, "0 to 0.02 m", "Laser noise")
    assert not seed.has_slider, "a browser's numbers do not hold it"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"rows": 21.0}, {"rows": "from 3 to 20"}),
        ({"rows": 5.5}, {"rows": "a whole number"}),
        ({"rows": None}, {"rows": "a whole number"}),
        ({"pickers": 6.0}, {"pickers": "one picker a row", "rows": "one picker a row"}),
        ({"people.workers": 30.0, "people.visitors": 30.0}, {"people.workers": "at most 50 together", "people.visitors": "at most 50"}),
        ({"seed": "many"}, {"seed": "a whole number"}),
        ({"seed": "9223372036854775808"}, {"seed": "to 9223372036854775807"}),
        ({"rows": 2.0, "laser.noise": 1.0}, {"rows": "from 3", "laser.noise": "to 0.02"}),
    ],
)
def test_what_is_wrong_is_told_at_its_field(changes, told):
    draft = Draft(Scenario())
    for path, value in changes.items():
        draft.set(path, value)
    assert draft.scenario is None
    assert draft.problems.keys() == told.keys()
    assert all(words in draft.problems[path] for path, words in told.items())


def test_a_large_seed_keeps_every_digit():
    draft = Draft(Scenario())
    draft.set("seed", " 9223372036854775807 ")
    assert draft.scenario == Scenario(seed=2**63 - 1)


@pytest.mark.parametrize(("typed", "told"), [("5,5", "write a point: 5.5"), ("abc", "from 5.0 to 12"), ("", "number"), ("1e999", "to 12")])
def test_what_is_no_number_stays_and_is_told(typed, told):
    draft = Draft(Scenario())
    draft.set("row_width", typed)
    assert draft.scenario is None
    assert told in draft.problems["row_width"]


def test_the_classes_of_a_scenario_survive_changes():
    draft = Draft(Scenario(agents={"picker": "tests.own_agents.Eastward"}))
    draft.set("rows", "7")
    assert draft.scenario == Scenario(rows=7, agents={"picker": "tests.own_agents.Eastward"})
    draft.drop_classes()
    assert draft.scenario == Scenario(rows=7)


def test_a_class_for_a_robot_that_is_gone_is_told():
    draft = Draft(Scenario(pickers=3, agents={"picker_03": "tests.own_agents.Eastward"}))
    assert draft.scenario is not None
    draft.set("pickers", "2")
    assert draft.scenario is None
    assert "agents.picker_03: no such agent or kind" in draft.problems["agents"]


@pytest.mark.parametrize(
    ("pace", "told"),
    [
        (Pace("lockstep", "max"), {"speed": "from 0.1 to 1000"}),
        (Pace("realtime", "max"), {"speed": "it cannot be max"}),
        (Pace("realtime", "", as_fast_as_it_goes=True), {"speed": "it cannot be max"}),
        (Pace("local", "0,5", "-1"), {"speed": "write a point: 0.5", "duration": "from 1 to 1000000"}),
        (Pace("local", "", "soon", as_fast_as_it_goes=True), {"duration": "empty: the whole harvest"}),
    ],
)
def test_what_is_wrong_with_a_pace_is_told_at_its_field(pace, told):
    assert pace.problems.keys() == told.keys()
    assert all(words in pace.problems[name] for name, words in told.items())


def test_a_pace_is_what_run_py_is_told(tmp_path):
    def options(pace):
        line = command(pace.order(Scenario(), live=False), Files(tmp_path, "run"), 9090)
        return [line[line.index(name) + 1] if name in line else None for name in ("--mode", "--speed", "--duration")]

    assert options(Pace("realtime", "12", "0" + "90.5", as_fast_as_it_goes=True)) == ["realtime", "12", "90.5"]
    assert options(Pace("lockstep", "", " ", as_fast_as_it_goes=True)) == ["lockstep", "max", None]
    assert options(Pace("local", "0.125", "1000000")) == ["local", "0.125", "1000000"]


def test_two_runs_of_a_second_have_files_of_their_own(tmp_path):
    runner = Runner(tmp_path)
    assert len({runner._fresh_files().scenario for _ in range(5)}) == 5


def test_progress_is_read_from_what_run_py_prints():
    figures = {"sim_seconds": 1234.5, "times_real_time": 8.0, "rows_picked": 4, "bins_delivered": 2, "rows": 6}
    read = read_headline(headline(figures))
    assert (read.sim_seconds, read.times_real_time, read.rows_picked, read.bins_delivered, read.rows) == (1234.5, 8.0, 4, 2, 6)
    assert read.fraction == 0.5
    assert read_headline("agents 1: started again") is None


# -- the server


def page(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "orchard.app", "--quiet", *map(str, arguments)]


def test_a_port_that_is_taken_is_named_with_exit_code_2():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run(page("--port", port), cwd=ROOT, capture_output=True, text=True, timeout=30)
    assert done.returncode == 2
    assert f"--port {port}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The page's address, and where its runs go."""
    runs, port = tmp_path_factory.mktemp("runs"), free_port()
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}  # or NiceGUI thinks it is the test
    process = subprocess.Popen(page("--port", port, "--runs", runs), cwd=ROOT, stdout=subprocess.DEVNULL, env=plain)
    address = f"http://127.0.0.1:{port}"
    try:
        wait_for(process, address)
        yield address, runs
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def wait_for(process: subprocess.Popen, address: str, seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and process.poll() is None:
        try:
            urllib.request.urlopen(address, timeout=5).close()
            return
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"{address} does not answer")


def test_the_web_viewer_is_on_the_loopback_only():
    port = free_pair()
    viewer = serve_web(port, data_uri(port))
    try:
        wait_for(viewer, page_url(port))
        listening = [one.laddr for one in psutil.Process(viewer.pid).net_connections("inet") if one.status == psutil.CONN_LISTEN]
        assert {(address.ip, address.port) for address in listening} == {("127.0.0.1", port)}
    finally:
        viewer.terminate()
        viewer.wait(10)


# -- in the browser


@pytest.fixture(scope="module")
def downloads(tmp_path_factory):
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory, downloads):
    if None in PROGRAMS:
        (pytest.fail if ON_CI else pytest.skip)("chromium and chromedriver are missing (.ci/apt-packages.txt)")
    from browser import Browser, open_browser

    driver = open_browser(*PROGRAMS, str(tmp_path_factory.mktemp("profile")), str(downloads))
    yield Browser(driver)
    driver.quit()


@pytest.fixture
def browser(chromium, server):
    """The page, freshly opened, with the default orchard."""
    chromium.driver.get(server[0])
    chromium.click("[data-preset=default]")
    chromium.until(lambda: chromium.tree_lines() == 6, "the default plan is drawn")
    return chromium


def test_the_plan_and_the_figures_follow_every_change(browser):
    assert browser.figure("Trees") == "72"
    browser.fill("rows", 8)
    browser.until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    assert browser.figure("Trees") == "108"
    before = browser.figure("Bound")
    browser.fill("pickers", 8)
    browser.until(lambda: browser.figure("Carriers") == "6", "carriers follow the pickers")
    assert browser.figure("Bins") == "14"
    assert browser.figure("Bound") != before
    assert browser.field("carriers").get_attribute("value") == "6"


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


def test_more_pickers_than_rows_is_explained_at_both(browser):
    browser.fill("pickers", 6)
    for path in ("pickers", "rows"):
        browser.until(lambda path=path: "must be at most one picker a row" in browser.problem(path), f"told at {path}")


def test_what_is_saved_can_be_loaded(browser, downloads):
    browser.fill("rows", 9)
    browser.fill("seed", 2**63 - 1)
    browser.until(lambda: browser.tree_lines() == 10, "a plan of 9 rows")
    browser.press("save")
    saved = downloads / "orchard.yaml"
    browser.until(saved.exists, "the file is saved")
    assert load(saved) == Scenario(rows=9, seed=2**63 - 1)


def test_a_file_can_be_opened(browser, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("rows: 12\npickers: 4\ncarriers: 9\n")
    browser.one("input[type=file]").send_keys(str(file))
    browser.until(lambda: browser.tree_lines() == 13, "a plan of 12 rows")
    assert browser.field("carriers").get_attribute("value") == "9"
    assert browser.figure("Carriers") == "9"


def test_a_bad_file_is_explained_and_changes_nothing(browser, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("rows: 99\npikers: 3\n")
    browser.one("input[type=file]").send_keys(str(file))
    told = browser.until(lambda: browser.view("complaint").text, "a complaint")
    assert "bad.yaml:1: rows = 99" in told
    assert "did you mean pickers" in told
    assert browser.field("rows").get_attribute("value") == "5"


# -- runs


@pytest.fixture
def small(browser):
    """The page with a small orchard, in one process, eight times as fast as life, and nobody watches."""
    browser.fill("rows", 3)
    browser.until(lambda: browser.tree_lines() == 4, "a plan of 3 rows")
    browser.choose("mode", "local")
    browser.switch("fastest", False)
    browser.switch("live", False)
    return browser


def test_a_small_orchard_is_run_to_its_end(small, server):
    small.switch("fastest", True)
    small.press("run")
    small.tell_state("running")
    small.tell_state("finished", RUN_SECONDS)
    summary = small.until(lambda: small.view("summary").text, "the summary")
    assert re.search(r"bins delivered\s+3", summary)
    assert re.search(r"finished\s+True", summary)
    assert len(list(server[1].glob("*.rrd"))) == 1
    assert "bins delivered 3/3" in small.view("progress").text
    small.turn_to("Picture")
    picture = small.until(lambda: small.view("picture").get_attribute("src"), "the recording, in Rerun's viewer")
    assert urllib.request.urlopen(picture, timeout=10).status == 200


def test_a_run_in_realtime_takes_numbers_only(small):
    small.switch("fastest", True)
    small.choose("mode", "realtime")
    small.until(lambda: not small.field("fastest").is_displayed(), "there is no fastest")
    small.until(lambda: "the wall clock sets the pace" in small.problem("speed"), "why")
    small.fill("speed", "max")
    small.until(lambda: "it cannot be max" in small.problem("speed"), "explained at the field")
    small.until(lambda: not small.one("[data-action=run]").is_enabled(), "it cannot be run")
    small.fill("speed", 50)
    small.fill("duration", 20)
    small.press("run")
    small.tell_state("running")
    small.tell_state("finished", RUN_SECONDS)
    summary = small.until(lambda: small.view("summary").text, "the summary")
    assert re.search(r"mode\s+realtime", summary)
    assert "simulated 0:20 min" in small.view("progress").text


def test_a_file_with_own_classes_is_changed_saved_and_run(small, server, downloads, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("rows: 3\npickers: 3\nagents: {picker_01: tests.own_agents.Eastward}\n")
    small.one("input[type=file]").send_keys(str(file))
    small.until(lambda: small.view("classes").text == "picker_01: tests.own_agents.Eastward", "the class is shown")
    small.fill("weeds", 7)
    small.fill("duration", 30)
    small.switch("fastest", True)
    wanted = Scenario(rows=3, pickers=3, weeds=7, agents={"picker_01": "tests.own_agents.Eastward"})
    before = set(downloads.iterdir())
    small.press("save")
    saved = small.until(lambda: {path for path in set(downloads.iterdir()) - before if path.suffix == ".yaml"}, "the file is saved")
    assert load(saved.pop()) == wanted
    small.press("run")
    small.tell_state("running")
    small.tell_state("finished", RUN_SECONDS)
    assert load(max(server[1].glob("*.yaml"))) == wanted
    summary = small.until(lambda: small.view("summary").text, "the summary")
    assert local_hash(wanted, 300) in summary, "Eastward drove"
    small.press("drop-classes")
    small.until(lambda: not small.view("classes").is_displayed(), "ours drive again")


def test_a_run_is_seen_live(small):
    small.fill("duration", 3000)  # whatever it was before: the run shall not end by itself
    small.switch("live", True)
    small.press("run")
    small.until(lambda: small.view("picture").is_displayed(), "the live picture", RUN_SECONDS)
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


def test_a_browser_that_was_busy_at_the_end_of_a_run_sees_the_end(small, server):
    small.fill("duration", 100)
    small.press("run")
    small.tell_state("running")
    small.until(lambda: "simulated" in small.view("progress").text, "the first progress", RUN_SECONDS)
    small.driver.execute_script("window.mark = 'the same page'")
    summaries = set(server[1].glob("*.json"))
    with small.frozen():  # for 10 s or more, as while it loads the picture's viewer
        small.until(lambda: set(server[1].glob("*.json")) - summaries, "the run is over", RUN_SECONDS)
    small.tell_state("finished")
    assert "simulated 1:40 min" in small.view("progress").text
    assert small.driver.execute_script("return window.mark") == "the same page"


def test_a_run_is_still_there_after_a_reload_and_can_be_stopped(small):
    small.press("run")
    small.tell_state("running")
    small.until(lambda: "simulated" in small.view("progress").text, "the first progress", RUN_SECONDS)
    small.driver.refresh()
    small.tell_state("running")
    assert small.field("rows").get_attribute("value") == "3"
    assert not small.one("[data-action=run]").is_displayed()
    begun = time.monotonic()
    small.press("stop")
    small.tell_state("stopped")
    assert time.monotonic() - begun < 3.5
    assert re.search(r"finished\s+False", small.until(lambda: small.view("summary").text, "the summary"))
