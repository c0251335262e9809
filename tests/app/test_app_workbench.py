"""The page as a workbench, in headless Chromium: past runs, links, several browsers, a phone,
readers of the screen; and its study.
"""

import json
import os
import re
import shutil
import time
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from page_server import skip_without_packages
from patience import PATIENCE

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.figures import RunFigures

skip_without_packages()

PHONE = (390, 844)  # pixels


def ended(folder, name, sim_seconds, mode="local", **changes):
    """Leave the summary of a run in the folder of runs: of its first 30 s, but with another
    time.
    """
    local = Local(Scenario(**changes))
    account = RunFigures(local.engine, time.monotonic)
    while local.engine.tick < 300:
        account.update(local.tick())
    (folder / f"{name}.json").write_text(
        json.dumps(
            account.summary() | {"mode": mode, "finished": False, "sim_seconds": sim_seconds}
        )
    )


@pytest.fixture(scope="module")
def three_runs(server):
    """Runs that have ended; the second differs from the first in two settings.

    The third's mode looks like a page's code.

    A file beside them is no run.
    """
    for path in server[1].glob("*.json"):  # those of other tests
        path.unlink()
    (server[1] / "odd.json").write_text("<i>[]</i>")
    ended(server[1], "first", 624.0, rows=3, seed=1)
    ended(server[1], "second", 590.0, rows=4, seed=2)
    (keyframe := server[1] / "first.snapshots" / "tick-000000000.keyframe").parent.mkdir()
    keyframe.touch()  # enough for a time line
    ended(server[1], "third", 30.0, mode="<b id=bold>local</b>", rows=3, seed=3)
    old = [server[1] / f"old{number}.json" for number in range(8)]  # another page of the list
    for path in old:
        path.write_text(
            (server[1] / "third.json")
            .read_text()
            .replace('"sim_seconds": 30.0', '"sim_seconds": 36000.0')
        )
        os.utime(path, (0.0, 0.0))
    yield
    shutil.rmtree(keyframe.parent)
    for path in (
        *old,
        *(server[1] / f"{name}.json" for name in ("first", "second", "third", "odd")),
    ):
        path.unlink()


@pytest.fixture
def listed(browser, three_runs):
    browser.turn_to("Runs")
    browser.until(
        lambda: "3 rows, 2 pickers, 2 carriers, seed 3" in browser.view("runs").text,
        "the runs are listed",
    )
    browser.unchoose_runs()
    return browser


def choose(browser, title):
    browser.click(f"[data-view=runs] [aria-label$='{title}']")


def compare_two(browser):
    choose(browser, "3 rows, 2 pickers, 2 carriers, seed 1")
    browser.until(lambda: "seed 1" in browser.view("comparison").text, "the first one is shown")
    choose(browser, "4 rows, 2 pickers, 2 carriers, seed 2")
    browser.until(lambda: "Side by side" in browser.view("comparison").text, "both are shown")


def cells(browser, name):
    """A line of the comparison, without its name."""
    lines = (
        line.find_elements("css selector", "th, td")
        for line in browser.view("comparison").find_elements("tag name", "tr")
    )
    return next([cell.text for cell in line[1:]] for line in lines if line[0].text == name)


def test_past_runs_are_listed_and_compared_side_by_side(listed):
    compare_two(listed)
    assert [cells(listed, "Rows"), cells(listed, "Seed"), cells(listed, "Bins")] == [
        ["3", "4"],
        ["1", "2"],
        ["0 of 3", "0 of 4"],
    ]
    charts = listed.view("comparison").find_elements("css selector", "figure canvas")
    assert len(charts) == 3 and all(chart.is_displayed() for chart in charts)
    choose(listed, "3 rows, 2 pickers, 2 carriers, seed 1")
    listed.press("use-scenario")
    listed.until(
        lambda: listed.field("rows").get_attribute("value") == "4",
        "the form has the scenario of the run that is left",
    )
    simulated = next(
        cell
        for cell in listed.view("runs").find_elements("tag name", "th")
        if "Simulated" in cell.text
    )
    listed.driver.execute_script(
        "arguments[0].scrollIntoView({block: 'center'})", simulated
    )  # not under the bar on top
    simulated.click()
    times = ["0:30 min", "9:50 min", "10:24 min"]
    listed.until(
        lambda: (
            [
                one
                for one in re.findall("[0-9]+:[0-9]+ min", listed.view("runs").text)
                if one in times
            ]
            == times
        ),
        "sorted",
    )


def test_what_others_have_written_is_shown_as_text(listed):
    assert "<b id=bold>local</b>" in listed.view("runs").text
    assert not listed.driver.find_elements("css selector", "#bold")
    assert (
        listed.view("passed-over").text
        == "odd.json is passed over: JSON is malformed: invalid character (byte 0)"
    )


def test_a_link_holds_the_scenario(browser, server):
    browser.fill("rows", 8)
    browser.until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    browser.press("link")
    link = browser.until(lambda: browser.view("link").get_attribute("value"), "the link")
    assert link == f"{server[0]}/?rows=8"
    browser.open(f"{server[0]}/?rows=9&seed=-3&pikers=2")
    assert "did you mean pickers" in browser.until(
        lambda: browser.view("link-question").text, "a question, which says what is unknown"
    )
    browser.press("open-link")
    browser.until(lambda: browser.problem("seed"), "what is wrong is told at its field")
    browser.open(link)
    browser.press("open-link")
    browser.until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    assert not browser.problem("seed")
    browser.fill("rows", 7)
    browser.until(lambda: browser.tree_lines() == 8, "a plan of 7 rows")
    assert browser.driver.current_url == f"{server[0]}/", "a reload keeps what was entered since"
    browser.reload()
    browser.until(lambda: browser.field("rows").get_attribute("value") == "7", "as it was left")


@contextmanager
def another_site(address, folder):
    """A page on another site: a link to an orchard of 3 rows, and more images than there
    are desks.
    """
    images = "".join(f"<img src='{address}/?rows=3&seed={number}'>" for number in range(205))
    words = f"<a id=link href='{address}/?rows=3'>your orchard</a>{images}"
    (folder / "index.html").write_text(words)
    handler = partial(SimpleHTTPRequestHandler, directory=folder)
    site = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=site.serve_forever, daemon=True).start()
    try:
        yield f"http://localhost:{site.server_port}/"
    finally:
        site.shutdown()
        site.server_close()


def test_another_site_replaces_nothing_that_was_entered(browser, server, tmp_path):
    browser.fill("rows", 9)
    browser.until(lambda: browser.tree_lines() == 10, "a plan of 9 rows")
    with another_site(server[0], tmp_path) as site:
        browser.driver.get(site)
        browser.click("#link")
        browser.until(lambda: browser.view("link-question").text, "a question")
        assert "You have entered: 9 rows" in browser.view("link-question").text
        assert "The link has: 3 rows" in browser.view("link-question").text
        browser.press("keep-entries")
    browser.until(lambda: browser.tree_lines() == 10, "the plan of 9 rows")
    browser.reload()
    browser.until(lambda: browser.field("rows").get_attribute("value") == "9", "as it was entered")


def test_every_browser_has_its_own_draft(browser, server):
    browser.fill("rows", 9)
    browser.until(lambda: browser.tree_lines() == 10, "a plan of 9 rows")
    own = browser.driver.get_cookies()
    browser.driver.delete_all_cookies()  # another browser
    browser.open(server[0])
    browser.until(lambda: browser.tree_lines() == 6, "the default plan")
    browser.driver.delete_all_cookies()
    for cookie in own:
        browser.driver.add_cookie(cookie)
    browser.open(server[0])
    browser.until(lambda: browser.tree_lines() == 10, "the plan of this browser")


@contextmanager
def as_phone(browser):
    size = dict(zip(("width", "height"), PHONE, strict=True))
    browser.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", size | {"deviceScaleFactor": 1, "mobile": True}
    )
    try:
        yield
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_on_a_phone_run_is_first_and_nothing_is_too_wide(listed):
    """On a phone run is on the first screen and nothing is too wide."""
    with as_phone(listed):
        compare_two(listed)
        run = listed.one("[data-action=run]").rect
        assert run["y"] > 0 and run["y"] + run["height"] < PHONE[1]
        assert (
            listed.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
        )


def violations(browser):
    """What axe finds, once the page does not move any more. The picture's viewer is Rerun's own."""
    from axe_core_python.selenium import Axe

    browser.until(
        lambda: not browser.driver.execute_script("return document.getAnimations().length"),
        "the page is at rest",
    )
    browser.until(
        lambda: browser.driver.execute_script("return document.fonts.status") == "loaded",
        "icons are icons, not their names",
    )
    found = Axe().run(browser.driver, options={"iframes": 0, "resultTypes": ["violations"]})[
        "violations"
    ]
    return [f"{rule['id']}: {node['html']}" for rule in found for node in rule["nodes"]]


def test_axe_finds_no_violation(listed):
    assert [
        element.tag_name for element in listed.driver.find_elements("css selector", "h1, main")
    ] == ["h1", "main"]
    assert listed.one("html").get_attribute("lang") == "en-US"
    compare_two(listed)
    for _ in ("light", "dark"):
        assert violations(listed) == []
        was_dark = is_dark(listed)
        listed.press("dark")
        listed.until(lambda was_dark=was_dark: is_dark(listed) != was_dark, "the other colours")
    choose(listed, "4 rows, 2 pickers, 2 carriers, seed 2")
    listed.until(lambda: listed.view("moment").is_displayed(), "the time line of the first one")
    assert violations(listed) == []
    with as_phone(listed):
        assert violations(listed) == []
        assert (
            listed.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
        )
    for view in ("Messages", "Summary", "Plan"):
        listed.turn_to(view)
        assert violations(listed) == []
    listed.fill("rows", 999)
    listed.until(lambda: listed.problem("rows"), "a problem")
    assert violations(listed) == []
    with as_phone(listed):
        assert violations(listed) == []
    listed.fill("rows", 5)
    listed.press("link")
    listed.until(lambda: listed.view("link").is_displayed(), "the link")
    assert violations(listed) == []


def is_dark(browser):
    return "body--dark" in browser.one("body").get_attribute("class").split()


def test_dark_stays_after_a_reload(browser):
    was_dark = is_dark(browser)
    browser.press("dark")
    browser.until(lambda: is_dark(browser) != was_dark, "the other colours")
    browser.reload()
    browser.until(lambda: is_dark(browser) != was_dark, "still")
    browser.press("dark")
    browser.until(lambda: is_dark(browser) == was_dark, "as before")


EMPTY = {"people.workers": 0, "people.visitors": 0, "animals.dogs": 0, "animals.cats": 0}


def state(page, words, seconds=PATIENCE):
    page.until(
        lambda: page.view("study-state").text.lower() == words, f"the study is {words}", seconds
    )


def reload_keeps_what_was_entered(page):
    page.reload()
    page.unfold("study-more")
    page.until(
        lambda: page.field("study-budget").get_attribute("value") == "90",
        "a reload keeps what was entered",
    )


def test_a_study_is_asked_grows_answers_and_leads_to_a_run(browser):
    page = browser
    for path, value in {"rows": 3, **EMPTY}.items():
        page.fill(path, value)
    page.until(lambda: page.tree_lines() == 4, "a plan of 3 rows")
    page.fill("duration", 60)  # now it can be cleared
    page.unfold("study-more")
    page.until(lambda: page.field("study-budget").is_displayed(), "what to compare")
    page.fill("study-budget", 0)
    page.until(lambda: "Time to take, s: must be" in page.problem("study"), "what is wrong")
    assert not page.one("[data-action=study-start]").is_enabled()
    assert violations(page) == []
    page.fill("study-budget", 90)
    reload_keeps_what_was_entered(page)
    page.switch("prices.carrier_per_hour-automatic", False)
    page.fill("prices.carrier_per_hour", 6)
    page.until(lambda: not page.problem("prices.carrier_per_hour"), "a price")
    page.press("study-start")
    state(page, "finished")
    page.until(
        lambda: len(page.view("study-table").find_elements("css selector", "tr")) > 2,
        "a line for each setting",
    )
    assert (
        "The orchard: 3 rows of 70 m, one bin a row, 2 pickers, two-way, rolling dispatch"
        in page.view("answer").text
    )
    assert "a bin" in page.view("answer").text and page.view("answer").text.split()[1].startswith(
        "carrier"
    )
    page.until(
        lambda: "cost of a bin" in page.view("study-picture").text, "the picture of the costs"
    )
    assert violations(page) == []
    with as_phone(page):
        assert violations(page) == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
    second = (
        page.view("study-table")
        .find_elements("css selector", "tbody tr, tr")[2]
        .find_element("css selector", "th")
        .text.split()[0]
    )
    page.press("study-use-1")
    page.until(
        lambda: page.field("carriers").get_attribute("value") == second, "the form has the setting"
    )
    assert page.one("[data-action=run]").is_enabled(), "and it can be run and watched"

    page.fill("rows", 20)
    page.fill("pickers", 10)
    page.until(lambda: page.tree_lines() == 21, "an orchard whose study takes long")
    page.pick("study-dispatch", "predictive")
    page.escape()
    page.choose("horizon", "one harvest")
    page.fill("study-budget", 600)
    page.press("study-start")
    page.until(lambda: "with predictive" in page.view("answer").text, "it grows", PATIENCE)
    state(page, "running")
    page.press("study-stop")
    state(page, "stopped")
    page.until(
        lambda: page.view("study-table").find_elements("css selector", "tr"), "what is known"
    )
    assert (
        "with predictive" in page.view("answer").text and "long run" not in page.view("answer").text
    )
    page.pick("study-dispatch", "predictive")  # no more, for the tests that come
    page.escape()


def test_a_deadline_is_entered_and_the_fleet_is_told(browser):
    page = browser
    for path, value in {"rows": 3, **EMPTY}.items():
        page.fill(path, value)
    page.until(lambda: page.tree_lines() == 4, "a plan of 3 rows")
    page.fill("study-deadline", "soon")
    page.until(lambda: "Done within: must be" in page.problem("study"), "what is wrong")
    assert not page.one("[data-action=study-start]").is_enabled()
    page.fill("study-deadline", "1")
    page.until(lambda: page.problem("study") == "", "a deadline")
    assert page.one("[data-action=study-start]").text.endswith("Which fleet?")
    assert violations(page) == []
    page.press("study-start")
    state(page, "finished")
    answer = page.view("answer").text
    assert "finish in 0:" in answer and "within 1 h of work" in answer
    assert violations(page) == []
    page.fill("study-deadline", "")
