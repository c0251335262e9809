"""Runs that are started, watched, stopped and forked on the page, in headless Chromium."""

import json
import re
import urllib.request
from urllib.parse import urlsplit

import pytest
from local_runs import local_hash
from own_agents import Hostile
from page_server import skip_without_packages
from patience import PATIENCE
from selenium.webdriver.common.keys import Keys

from orchard.app.charts import STEPS
from orchard.field.scenario import Scenario, load
from orchard.view.web import is_open

skip_without_packages()


@pytest.fixture
def small(browser):
    """Enter a small orchard, to be run in local mode at eight times real time to its end."""
    browser.fill("rows", 3)
    browser.wait_until(lambda: browser.tree_lines() == 4, "a plan of 3 rows")
    browser.choose("mode", "local")
    browser.switch("fastest", False)
    browser.fill("speed", 8)
    browser.fill("duration", "")
    browser.switch("live", False)
    return browser


def run_to_its_end(page, folder, state="finished"):
    """Press Run, and wait for a result whose state is `state`. Return the file of the scenario.

    The state "running" is not waited for: a short run is over before the page shows it.
    """
    before = {*folder.glob("harvest-*.yaml")}
    page.press("run")
    [file] = page.wait_until(lambda: {*folder.glob("harvest-*.yaml")} - before, "a run of its own")
    page.wait_until(
        lambda: f"{state}, {file.stem}" in page.view("result").text, "its result", PATIENCE
    )
    return file


def all_figures(page):
    """Unfold the figures of a summary, and return their text."""
    page.press("all-figures")
    return page.wait_until(
        lambda: page.view("summary").text if "finished" in page.view("summary").text else "",
        "all figures",
    )


def is_locked(page):
    """Whether mode and speed cannot be changed, as while a run goes on."""
    return bool(page.driver.find_elements("css selector", ".wishes[inert]"))


def shown_charts(page):
    """Return the captions of the charts that are displayed."""
    charts = page.driver.find_elements("css selector", "figure")
    return [
        chart.find_element("css selector", "figcaption").text
        for chart in charts
        if chart.is_displayed()
    ]


def test_a_small_orchard_is_run_to_its_end(small, server):
    """Its result is shown in a sentence and a few figures, and its recording in the viewer."""
    small.switch("fastest", True)
    run_to_its_end(small, server[1])
    result = small.wait_until(lambda: small.view("result").text, "the result")
    assert result.startswith("3 of 3 rows in ")
    assert "What limits it: " in result
    for name in ("Bins an hour", "Time", "Pickers wait", "Carriers at work", "Collisions"):
        assert name in result

    # Only when the figures are unfolded are all of them shown.
    summary = small.view("summary").text
    assert "collisions_of" not in summary
    assert "finished" not in summary
    figures = all_figures(small)
    assert re.search(r"bins delivered\s+3", figures)
    assert re.search(r"finished\s+True", figures)

    assert len(list(server[1].glob("*.rrd"))) == 1
    assert "bins delivered 3/3" in small.view("progress").text

    small.turn_to("Picture")
    picture = small.wait_until(
        lambda: small.view("picture").get_attribute("src"), "the recording, in Rerun's viewer"
    )
    assert urllib.request.urlopen(picture, timeout=PATIENCE).status == 200


def test_a_run_in_realtime_takes_numbers_only(small):
    """In realtime the wall clock sets the pace, so the speed "max" of other modes is refused."""
    small.switch("fastest", True)
    small.choose("mode", "realtime")
    small.wait_until(lambda: not small.field("fastest").is_displayed(), "there is no fastest")
    small.wait_until(lambda: "the wall clock sets the pace" in small.problem("speed"), "why")
    small.fill("speed", "max")
    small.wait_until(lambda: "it cannot be max" in small.problem("speed"), "explained at the field")
    small.wait_until(lambda: not small.one("[data-action=run]").is_enabled(), "it cannot be run")
    small.fill("speed", 5)
    small.press("run")
    small.wait_for_state("running")
    small.wait_until(
        lambda: "% picked" in small.view("progress").text,
        "progress of a run of processes",
        PATIENCE,
    )
    assert small.view("state").text == "running"
    small.turn_to("Picture")
    small.wait_until(
        lambda: shown_charts(small) == list(STEPS), "all charts grow while it runs", PATIENCE
    )
    small.press("stop")
    small.wait_for_state("stopped", PATIENCE)
    small.turn_to("Summary")
    summary = all_figures(small)
    assert re.search(r"mode\s+realtime", summary)


def test_a_file_with_own_classes_is_changed_saved_and_run(small, server, downloads, tmp_path):
    """A class that the user trusts drives its robot; before he trusts the file, none is used."""
    file = tmp_path / "own.yaml"
    small.open_file(file, "agents: {picker_01: subprocess.Popen}\n")
    assert "subprocess.Popen is not in" in small.wait_until(
        lambda: small.view("complaint").text, "a complaint"
    )
    small.click("[data-view=complaint] button")
    for decision in ("refuse-classes", "trust-classes"):
        assert not small.view("classes").is_displayed(), "not before the user trusts the file"
        small.open_file(
            file,
            "rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Eastward}\n",
        )
        question = small.wait_until(lambda: small.view("question").text, "a question")
        assert "own.yaml runs code" in question
        assert "picker_01: tests.support.own_agents.Eastward" in question
        small.press(decision)
        small.wait_until(
            lambda: not small.driver.find_elements("css selector", "[data-view=question]"),
            "the question is answered",
        )
    small.wait_until(
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
    # 30 s are 300 ticks.
    assert local_hash(wanted, 300) in summary, "Eastward drove"
    small.press("drop-classes")
    small.wait_until(lambda: not small.view("classes").is_displayed(), "ours drive again")


def test_an_agents_hostile_words_are_only_words(small, tmp_path):
    """Escape sequences, HTML and a script in an agent's error are shown as text."""
    small.open_file(
        tmp_path / "hostile.yaml",
        "rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Hostile}\n",
    )
    small.press("trust-classes")
    small.wait_until(lambda: small.view("classes").is_displayed(), "the class is taken")
    small.fill("duration", 5)
    small.switch("fastest", True)
    small.press("run")

    def messages_with_the_error() -> str:
        # The page turns to another view when the run begins.
        small.turn_to("Messages")
        messages = small.view("messages").text
        return messages if Hostile.words in messages else ""

    text = small.wait_until(messages_with_the_error, "the error is shown as it is", PATIENCE)
    small.wait_until(lambda: not is_locked(small), "the run is over", PATIENCE)
    assert "\x1b" not in text
    assert not small.view("messages").find_elements("css selector", "img")
    assert small.driver.title != "mine"
    small.press("drop-classes")


def test_a_run_is_seen_live(small):
    # A small window, because the processor draws it without a graphics card.
    small.driver.set_window_size(700, 500)
    small.switch("live", True)
    small.press("run")
    small.wait_until(lambda: small.view("picture").is_displayed(), "the live picture", PATIENCE)
    small.wait_for_state("running")
    small.driver.switch_to.frame(small.view("picture"))
    small.one("canvas")
    small.driver.switch_to.default_content()
    small.press("stop")
    small.wait_for_state("stopped")


def test_a_run_that_is_stopped_at_once_is_no_mistake(small):
    """Its process may be stopped before it has made any file. The next run is as any other."""
    small.press("run")
    small.press("stop")
    small.wait_for_state("stopped")
    for view in ("Summary", "Messages"):
        small.turn_to(view)
        assert (
            "Traceback"
            not in small.wait_until(lambda view=view: small.view(view.lower()), view).text
        )
    small.turn_to("Picture")
    small.wait_until(
        lambda: (
            "No recording was made." in small.one(".stage").text
            or small.view("picture").get_attribute("src")
        ),
        "no picture, or one of a run that had begun",
    )
    small.fill("duration", 5)
    small.press("run")
    small.wait_for_state("cut short", PATIENCE)
    small.turn_to("Picture")
    assert small.wait_until(
        lambda: small.view("picture").get_attribute("src"), "the next run has one"
    )


@pytest.mark.soak
def test_a_busy_browser_sees_the_end_of_a_run(small, server):
    """The page shows the end without being loaded anew, though it could hear nothing for 10 s."""
    small.fill("duration", 100)
    small.press("run")
    small.wait_for_state("running")
    small.wait_until(
        lambda: "simulated" in small.view("progress").text, "the first progress", PATIENCE
    )
    small.driver.execute_script("window.mark = 'the same page'")
    summaries = set(server[1].glob("*.json"))
    # A browser is as busy while it loads the picture's viewer.
    with small.frozen():
        small.wait_until(
            lambda: set(server[1].glob("*.json")) - summaries, "the run is over", PATIENCE
        )
    small.wait_for_state("cut short")
    assert "simulated 1:40 min" in small.view("progress").text
    assert small.driver.execute_script("return window.mark") == "the same page"


def test_a_run_is_still_there_after_a_reload_and_can_be_stopped(small):
    """A field whose value is not that of the run is marked while that goes on."""
    small.press("run")
    small.wait_for_state("running")
    small.wait_until(
        lambda: "simulated" in small.view("progress").text, "the first progress", PATIENCE
    )
    small.reload()
    small.wait_for_state("running")
    assert small.field("rows").get_attribute("value") == "3"
    assert not small.one("[data-action=run]").is_displayed()
    small.fill("rows", 4)
    small.wait_until(
        lambda: small.one("[data-mark=rows]").text == "the harvest that runs has 3",
        "the field is marked",
    )
    assert is_locked(small), "mode and speed are those of the run"
    small.press("stop")
    small.wait_for_state("stopped", PATIENCE)
    assert re.search(r"finished\s+False", all_figures(small))
    assert "3 rows, 2 pickers, 2 carriers, seed 1" in small.view("result").text, (
        "whatever the form says now"
    )
    small.wait_until(lambda: not small.one("[data-mark=rows]").is_displayed(), "nothing runs")
    assert not is_locked(small)


@pytest.fixture
def parent(small, server):
    """Run the small orchard, and choose that run in the list. Return its name.

    The field for the duration then holds 240 s, so a fork of this run ends after 4 min.
    """
    small.switch("fastest", True)
    file = run_to_its_end(small, server[1])
    small.fill("duration", 240)
    small.turn_to("Runs")
    small.unchoose_runs()
    small.click("[data-view=runs] tbody .q-checkbox")
    small.wait_until(
        lambda: small.view("moment").text == "3:00",
        "its time line: the keyframe in the middle of 7 min",
    )
    return file.stem


def test_a_run_goes_on_from_a_moment_with_a_change(small, parent, server):
    """The fork has one carrier more and a stopped picker, and is compared with its parent."""
    small.one("[data-field=moment] [tabindex='0']").send_keys(Keys.ARROW_LEFT)
    small.wait_until(lambda: small.view("moment").text == "2:59", "an earlier moment")
    small.switch("fork-carriers-automatic", False)
    small.fill("fork-carriers", 121)
    small.press("fork")
    small.wait_until(
        lambda: "from 1 to 120" in small.problem("fork-carriers"), "what is wrong, at its field"
    )
    small.fill("fork-carriers", 3)
    small.pick("fork-stop", "picker_02")
    small.escape()
    small.press("fork")

    def comparison():
        text = small.view("comparison").text
        return text if "Side by side" in text else ""

    compared = small.wait_until(comparison, "run and fork are compared", PATIENCE)
    assert compared.count(", from 2:59") == 2, "in the legend and in the table"
    assert small.view("compared-at").text == (
        "All are compared at 4:00 min, when the first of them ended."
    )
    assert "harvest done at 7:" in compared
    assert "cut short at 4:00 min" in compared
    assert small.view("state").text.lower() == "cut short"

    # In the list of runs the fork stands under its parent.
    above, below, *_ = [
        row.text for row in small.view("runs").find_elements("css selector", "tbody tr")
    ]
    assert "from" not in above
    assert "from 2:59" in below
    assert "3 carriers" in below

    # The fork ran from 179 s to 240 s, and picker_02 was stopped for all of that time.
    summaries = [json.loads(path.read_text()) for path in server[1].glob("*.json")]
    (fork,) = [summary for summary in summaries if "forked_from" in summary]
    assert fork["forked_from"] == {"run": parent, "seconds": 179.0}
    assert fork["scenario"]["carriers"] == 3
    assert fork["sim_seconds"] == 240.0
    assert fork["stopped_seconds"]["picker_02"] == 61.0

    # Each recording is served to a viewer until it is not shown any more.
    small.press("pictures")
    of_parent, of_fork = small.wait_until(lambda: two_pictures(small), "both pictures")
    fork_name = small.view("result").text.split(", ")[-1]
    assert parent in of_parent
    assert fork_name in of_fork
    for url in (of_parent, of_fork):
        assert urllib.request.urlopen(url, timeout=PATIENCE).status == 200
    small.unchoose_runs()
    ports = [urlsplit(url).port for url in (of_parent, of_fork)]
    small.wait_until(
        lambda: not any(is_open(port) for port in ports), "the servers of the recordings end"
    )


def two_pictures(page):
    """Return the addresses of both pictures of a comparison; None until both are there."""
    urls = [
        frame.get_attribute("src")
        for frame in page.view("comparison").find_elements("tag name", "iframe")
    ]
    return urls if len(urls) == 2 and all(urls) else None


def test_why_a_run_cannot_go_on_is_told_as_the_command_does(small, parent):
    """The reason appears in the summary, in the words that `orchard fork` would print."""
    # A run that has ended can be forked from its summary, too.
    small.turn_to("Summary")
    small.fill("this-fork-carriers", 1)
    small.press("this-fork")
    small.wait_for_state("failed", PATIENCE)
    small.wait_until(
        lambda: (
            "1 cannot be taken away: only 0 of them wait in the queue" in small.view("summary").text
        ),
        "why",
    )
