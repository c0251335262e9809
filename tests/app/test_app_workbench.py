"""Past runs, links, several browsers, a phone, accessibility and a study, in headless Chromium."""

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
from page_checks import EMPTY, PHONE, as_phone, violations
from page_server import skip_without_packages
from patience import PATIENCE

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.figures import RunFigures

skip_without_packages()

# The length of a run whose summary is shown: 30 s.
SUMMARY_TICKS = 300


def write_summary(folder, name, sim_seconds, mode="local", **changes):
    """Write the summary of a run of 30 s, whose length is then said to be `sim_seconds`."""
    local = Local(Scenario(**changes))
    account = RunFigures(local.engine, time.monotonic)
    while local.engine.tick < SUMMARY_TICKS:
        account.update(local.tick())
    summary = account.summary() | {"mode": mode, "finished": False, "sim_seconds": sim_seconds}
    (folder / f"{name}.json").write_text(json.dumps(summary))


@pytest.fixture(scope="module")
def three_runs(server):
    """Leave three runs in the folder of runs, older ones, and a file that is no run.

    The second run differs from the first in two settings. The mode of the third looks like HTML.
    The older runs fill another page of the list.
    """
    folder = server[1]
    for left_by_other_tests in folder.glob("*.json"):
        left_by_other_tests.unlink()
    (folder / "odd.json").write_text("<i>[]</i>")
    write_summary(folder, "first", 624.0, rows=3, seed=1)
    write_summary(folder, "second", 590.0, rows=4, seed=2)
    write_summary(folder, "third", 30.0, mode="<b id=bold>local</b>", rows=3, seed=3)

    # An empty keyframe is enough for the time line of the first run.
    snapshots = folder / "first.snapshots"
    snapshots.mkdir()
    (snapshots / "tick-000000000.keyframe").touch()

    third = (folder / "third.json").read_text()
    for number in range(8):
        old = folder / f"old{number}.json"
        old.write_text(third.replace('"sim_seconds": 30.0', '"sim_seconds": 36000.0'))
        os.utime(old, (0.0, 0.0))
    yield
    shutil.rmtree(snapshots)
    for summary in folder.glob("*.json"):
        summary.unlink()


@pytest.fixture
def listed(browser, three_runs):
    """Show the list of runs, with none of them chosen."""
    browser.turn_to("Runs")
    browser.wait_until(
        lambda: "3 rows, 2 pickers, 2 carriers, seed 3" in browser.view("runs").text,
        "the runs are listed",
    )
    browser.unchoose_runs()
    return browser


def choose(browser, title):
    """Choose a run in the list by its title, or take that back."""
    browser.click(f"[data-view=runs] [aria-label$='{title}']")


def compare_two(browser):
    """Choose the first two runs of `three_runs`, and wait until they are shown side by side."""
    choose(browser, "3 rows, 2 pickers, 2 carriers, seed 1")
    browser.wait_until(
        lambda: "seed 1" in browser.view("comparison").text, "the first one is shown"
    )
    choose(browser, "4 rows, 2 pickers, 2 carriers, seed 2")
    browser.wait_until(lambda: "Side by side" in browser.view("comparison").text, "both are shown")


def cells(browser, name):
    """Return the texts of a line of the comparison, without its name."""
    for line in browser.view("comparison").find_elements("tag name", "tr"):
        title, *values = line.find_elements("css selector", "th, td")
        if title.text == name:
            return [value.text for value in values]
    raise AssertionError(f"no line {name}")


def test_past_runs_are_listed_and_compared_side_by_side(listed):
    compare_two(listed)
    assert cells(listed, "Rows") == ["3", "4"]
    assert cells(listed, "Seed") == ["1", "2"]
    assert cells(listed, "Bins") == ["0 of 3", "0 of 4"]
    charts = listed.view("comparison").find_elements("css selector", "figure canvas")
    assert [chart.is_displayed() for chart in charts] == [True, True, True]

    # When the first run is chosen again, it is no longer shown.
    choose(listed, "3 rows, 2 pickers, 2 carriers, seed 1")
    listed.press("use-scenario")
    listed.wait_until(
        lambda: listed.field("rows").get_attribute("value") == "4",
        "the form has the scenario of the run that is left",
    )
    # A click on the head of a column sorts the list by it. The head must not lie under the bar.
    heads = listed.view("runs").find_elements("tag name", "th")
    (simulated,) = [head for head in heads if "Simulated" in head.text]
    listed.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", simulated)
    simulated.click()
    # A page of the list has 8 runs; the older ones took 10 h.
    times = ["0:30 min", "9:50 min", "10:24 min", *["10:00:00 h"] * 5]

    def times_in_the_list():
        shown = re.findall("[0-9:]+ (?:min|h)", listed.view("runs").text)
        return [text for text in shown if text in times]

    listed.wait_until(lambda: times_in_the_list() == times, "runs sorted by their length")


def test_what_others_have_written_is_shown_as_text(listed):
    assert "<b id=bold>local</b>" in listed.view("runs").text
    assert not listed.driver.find_elements("css selector", "#bold")
    assert (
        listed.view("passed-over").text
        == "odd.json is passed over: JSON is malformed: invalid character (byte 0)"
    )


def test_a_link_holds_the_scenario(browser, server):
    """A link replaces the scenario only after the user has agreed. Then it leaves the address, so
    that a reload keeps what was entered since.
    """
    browser.fill("rows", 8)
    browser.wait_until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    browser.press("link")
    link = browser.wait_until(lambda: browser.view("link").get_attribute("value"), "the link")
    assert link == f"{server[0]}/?rows=8"
    browser.open(f"{server[0]}/?rows=9&seed=-3&pikers=2")
    assert "did you mean pickers" in browser.wait_until(
        lambda: browser.view("link-question").text, "a question, which says what is unknown"
    )
    browser.press("open-link")
    browser.wait_until(lambda: browser.problem("seed"), "what is wrong is told at its field")
    browser.open(link)
    browser.press("open-link")
    browser.wait_until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    assert not browser.problem("seed")
    browser.fill("rows", 7)
    browser.wait_until(lambda: browser.tree_lines() == 8, "a plan of 7 rows")
    assert browser.driver.current_url == f"{server[0]}/", "a reload keeps what was entered since"
    browser.reload()
    browser.wait_until(
        lambda: browser.field("rows").get_attribute("value") == "7", "as it was left"
    )


@contextmanager
def another_site(address, folder):
    """Serve a page of another site: a link to an orchard of 3 rows, and 205 images of the page.

    The page keeps 200 desks, so that many images could push out that of the user.
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
    browser.wait_until(lambda: browser.tree_lines() == 10, "a plan of 9 rows")
    with another_site(server[0], tmp_path) as site:
        browser.driver.get(site)
        browser.click("#link")
        browser.wait_until(lambda: browser.view("link-question").text, "a question")
        assert "You have entered: 9 rows" in browser.view("link-question").text
        assert "The link has: 3 rows" in browser.view("link-question").text
        browser.press("keep-entries")
    browser.wait_until(lambda: browser.tree_lines() == 10, "the plan of 9 rows")
    browser.reload()
    browser.wait_until(
        lambda: browser.field("rows").get_attribute("value") == "9", "as it was entered"
    )


def test_every_browser_has_its_own_draft(browser, server):
    browser.fill("rows", 9)
    browser.wait_until(lambda: browser.tree_lines() == 10, "a plan of 9 rows")
    own = browser.driver.get_cookies()
    # Without cookies it is another browser for the page.
    browser.driver.delete_all_cookies()
    browser.open(server[0])
    browser.wait_until(lambda: browser.tree_lines() == 6, "the default plan")
    browser.driver.delete_all_cookies()
    for cookie in own:
        browser.driver.add_cookie(cookie)
    browser.open(server[0])
    browser.wait_until(lambda: browser.tree_lines() == 10, "the plan of this browser")


def test_on_a_phone_run_is_first_and_nothing_is_too_wide(listed):
    """The button Run is on the first screen, and the page is not wider than the phone."""
    with as_phone(listed):
        compare_two(listed)
        run = listed.one("[data-action=run]").rect
        assert run["y"] > 0
        assert run["y"] + run["height"] < PHONE[1]
        assert (
            listed.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
        )


def test_axe_finds_no_violation(listed):
    """axe-core looks for what people lack who use a keyboard or a screen reader."""
    landmarks = listed.driver.find_elements("css selector", "h1, main")
    assert [element.tag_name for element in landmarks] == ["h1", "main"]
    assert listed.one("html").get_attribute("lang") == "en-US"

    compare_two(listed)
    for _ in ("light", "dark"):
        assert violations(listed) == []
        was_dark = is_dark(listed)
        listed.press("dark")
        listed.wait_until(
            lambda was_dark=was_dark: is_dark(listed) != was_dark, "the other colours"
        )
    choose(listed, "4 rows, 2 pickers, 2 carriers, seed 2")
    listed.wait_until(
        lambda: listed.view("moment").is_displayed(), "the time line of the first one"
    )
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
    listed.wait_until(lambda: listed.problem("rows"), "a problem")
    assert violations(listed) == []
    with as_phone(listed):
        assert violations(listed) == []

    listed.fill("rows", 5)
    listed.press("link")
    listed.wait_until(lambda: listed.view("link").is_displayed(), "the link")
    assert violations(listed) == []


def is_dark(browser):
    return "body--dark" in browser.one("body").get_attribute("class").split()


def test_dark_stays_after_a_reload(browser):
    was_dark = is_dark(browser)
    browser.press("dark")
    browser.wait_until(lambda: is_dark(browser) != was_dark, "the other colours")
    browser.reload()
    browser.wait_until(lambda: is_dark(browser) != was_dark, "still")
    browser.press("dark")
    browser.wait_until(lambda: is_dark(browser) == was_dark, "as before")


def wait_for_study(page, state, seconds=PATIENCE):
    """Wait until the study has this state, such as "finished"."""
    page.wait_until(
        lambda: page.view("study-state").text.lower() == state, f"the study is {state}", seconds
    )


def reload_keeps_what_was_entered(page):
    page.reload()
    page.unfold("study-more")
    page.wait_until(
        lambda: page.field("study-budget").get_attribute("value") == "90",
        "a reload keeps what was entered",
    )


def test_a_study_is_asked_grows_answers_and_leads_to_a_run(browser):
    """A small orchard is studied with a price, after a wrong budget; then a study takes long."""
    page = browser
    for path, value in {"rows": 3, **EMPTY}.items():
        page.fill(path, value)
    page.wait_until(lambda: page.tree_lines() == 4, "a plan of 3 rows")
    page.fill("duration", 60)
    page.unfold("study-more")
    page.wait_until(lambda: page.field("study-budget").is_displayed(), "what to compare")
    page.fill("study-budget", 0)
    page.wait_until(lambda: "Time to take, s: must be" in page.problem("study"), "what is wrong")
    assert not page.one("[data-action=study-start]").is_enabled()
    assert violations(page) == []
    page.fill("study-budget", 90)
    reload_keeps_what_was_entered(page)
    page.switch("prices.carrier_per_hour-automatic", False)
    page.fill("prices.carrier_per_hour", 6)
    page.wait_until(lambda: not page.problem("prices.carrier_per_hour"), "a price")
    page.press("study-start")
    wait_for_study(page, "finished")
    page.wait_until(
        lambda: len(page.view("study-table").find_elements("css selector", "tr")) > 2,
        "a line for each setting",
    )
    answer = page.view("answer").text
    assert "The orchard: 3 rows of 70 m, one bin a row, 2 pickers, two-way, rolling dispatch" in (
        answer
    )
    # The answer begins with a number of carriers, and says what a bin costs.
    assert answer.split()[1].startswith("carrier")
    assert "a bin" in answer
    page.wait_until(
        lambda: "cost of a bin" in page.view("study-picture").text, "the picture of the costs"
    )
    assert violations(page) == []
    with as_phone(page):
        assert violations(page) == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
    # The second setting of the table, below the line of its heads, is taken over into the form.
    _, _, second, *_ = page.view("study-table").find_elements("css selector", "tbody tr, tr")
    carriers = second.find_element("css selector", "th").text.split()[0]
    page.press("study-use-1")
    page.wait_until(
        lambda: page.field("carriers").get_attribute("value") == carriers,
        "the form has the setting",
    )
    assert page.one("[data-action=run]").is_enabled()

    stop_a_long_study(page)


def stop_a_long_study(page):
    """Start a study that takes long, stop it, and see that its answer so far stays."""
    page.fill("rows", 20)
    page.fill("pickers", 10)
    page.wait_until(lambda: page.tree_lines() == 21, "an orchard whose study takes long")
    page.pick("study-dispatch", "predictive")
    page.escape()
    page.choose("horizon", "one harvest")
    page.fill("study-budget", 600)
    page.press("study-start")
    page.wait_until(
        lambda: "with predictive" in page.view("answer").text, "an answer so far", PATIENCE
    )
    wait_for_study(page, "running")
    page.press("study-stop")
    wait_for_study(page, "stopped")
    page.wait_until(
        lambda: page.view("study-table").find_elements("css selector", "tr"), "a table so far"
    )
    answer = page.view("answer").text
    assert "with predictive" in answer
    assert "long run" not in answer
    # The tests that follow find the policy not chosen, as it was.
    page.pick("study-dispatch", "predictive")
    page.escape()


def test_a_deadline_is_entered_and_the_fleet_is_told(browser):
    """The answer has the time that the fleet takes, and the deadline of 1 h."""
    page = browser
    for path, value in {"rows": 3, **EMPTY}.items():
        page.fill(path, value)
    page.wait_until(lambda: page.tree_lines() == 4, "a plan of 3 rows")
    page.fill("study-deadline", "soon")
    page.wait_until(lambda: "Done within: must be" in page.problem("study"), "what is wrong")
    assert not page.one("[data-action=study-start]").is_enabled()
    page.fill("study-deadline", "1")
    page.wait_until(lambda: page.problem("study") == "", "a deadline")
    page.fill("prices.picker_per_hour", "28")
    page.press("study-start")
    page.wait_until(lambda: "Price of a carrier: is" in page.problem("study"), "what is missing")
    page.fill("prices.carrier_per_hour", "14")
    page.wait_until(lambda: page.problem("study") == "", "it is there")
    assert page.one("[data-action=study-start]").text.endswith("Which fleet?")
    page.unfold("study-more")
    assert violations(page) == []
    page.press("study-start")
    wait_for_study(page, "finished")
    answer = page.view("answer").text
    assert "finish in 0:" in answer
    assert "within 1 h of work" in answer
    assert violations(page) == []
    page.fill("row_length", "71")
    page.wait_until(
        lambda: "Changed since this was asked: Row length." in page.view("study-changed").text,
        "that the answer is of another question",
    )
    page.fill("study-deadline", "")
