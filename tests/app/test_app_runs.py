"""Runs from the page, as a person starts, watches and stops them: a real server, real runs, and headless Chromium."""

import re
import urllib.request

import pytest
from local_runs import local_hash
from own_agents import Hostile
from page_server import RUN_SECONDS, skip_without_packages

from orchard.app.charts import STEPS
from orchard.field.scenario import Scenario, load

skip_without_packages()


@pytest.fixture
def small(browser):
    """The page with a small orchard, in one process, eight times as fast as life, to its end, without a live picture.

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


def is_locked(page):
    return bool(page.driver.find_elements("css selector", ".wishes[inert]"))


def shown_charts(page):
    charts = page.driver.find_elements("css selector", "figure")
    return [chart.find_element("css selector", "figcaption").text for chart in charts if chart.is_displayed()]


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
    small.fill("speed", 5)
    small.press("run")
    small.tell_state("running")
    small.until(lambda: "% picked" in small.view("progress").text, "progress of a run of processes", RUN_SECONDS)
    assert small.view("state").text == "running"
    small.turn_to("Picture")
    small.until(lambda: shown_charts(small) == list(STEPS), "all charts grow while it runs", RUN_SECONDS)
    small.press("stop")
    small.tell_state("stopped", RUN_SECONDS)
    small.turn_to("Summary")
    summary = small.until(lambda: small.view("summary").text, "the summary")
    assert re.search(r"mode\s+realtime", summary)


def test_a_file_with_own_classes_is_changed_saved_and_run(small, server, downloads, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("agents: {picker_01: subprocess.Popen}\n")
    small.one("input[type=file]").send_keys(str(file))
    assert "subprocess.Popen is not in" in small.until(lambda: small.view("complaint").text, "a complaint")
    small.click("[data-view=complaint] button")
    file.write_text("rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Eastward}\n")
    for decision in ("refuse-classes", "trust-classes"):
        assert not small.view("classes").is_displayed(), "not before the user trusts the file"
        small.one("input[type=file]").send_keys(str(file))
        question = small.until(lambda: small.view("question").text, "a question")
        assert "own.yaml runs code" in question and "picker_01: tests.support.own_agents.Eastward" in question
        small.press(decision)
        small.until(lambda: not small.driver.find_elements("css selector", "[data-view=question]"), "the question is answered")
    small.until(lambda: small.view("classes").text == "picker_01: tests.support.own_agents.Eastward", "the class is shown")
    small.fill("weeds", 7)
    small.fill("duration", 30)
    small.switch("fastest", True)
    wanted = Scenario(rows=3, pickers=3, weeds=7, agents={"picker_01": "tests.support.own_agents.Eastward"})
    assert load(small.saved(downloads)) == wanted
    small.press("run")
    small.tell_state("running")
    small.tell_state("finished", RUN_SECONDS)
    assert load(max(server[1].glob("harvest-*.yaml"))) == wanted
    summary = small.until(lambda: small.view("summary").text, "the summary")
    assert local_hash(wanted, 300) in summary, "Eastward drove"
    small.press("drop-classes")
    small.until(lambda: not small.view("classes").is_displayed(), "ours drive again")


def test_an_agents_hostile_words_are_only_words(small, tmp_path):
    file = tmp_path / "hostile.yaml"
    file.write_text("rows: 3\npickers: 3\nagents: {picker_01: tests.support.own_agents.Hostile}\n")
    small.one("input[type=file]").send_keys(str(file))
    small.press("trust-classes")
    small.until(lambda: small.view("classes").is_displayed(), "the class is taken")
    small.fill("duration", 5)
    small.switch("fastest", True)
    small.press("run")

    def said() -> str:
        small.turn_to("Messages")  # the page turns to another view when the run begins
        return text if Hostile.words in (text := small.view("messages").text) else ""

    text = small.until(said, "the error is shown as it is", RUN_SECONDS)
    small.until(lambda: not small.driver.find_elements("css selector", ".wishes[inert]"), "the run is over", RUN_SECONDS)
    assert "\x1b" not in text
    assert not small.view("messages").find_elements("css selector", "img")
    assert small.driver.title != "mine"
    small.press("drop-classes")


def test_a_run_is_seen_live(small):
    small.driver.set_window_size(700, 500)  # few pixels: there is no graphics card to draw them
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
    small.turn_to("Picture")
    small.until(
        lambda: "No recording was made." in small.one(".stage").text or small.view("picture").get_attribute("src"),
        "no picture, or one of a run that had begun",
    )
    small.fill("duration", 5)
    small.press("run")
    small.tell_state("finished", RUN_SECONDS)
    small.turn_to("Picture")
    assert small.until(lambda: small.view("picture").get_attribute("src"), "the next run has one")


@pytest.mark.soak
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
    small.fill("rows", 4)
    small.until(lambda: small.one("[data-mark=rows]").text == "the harvest that runs has 3", "the field is marked")
    assert is_locked(small), "mode and speed are those of the run"
    small.press("stop")
    small.tell_state("stopped", RUN_SECONDS)
    assert re.search(r"finished\s+False", small.until(lambda: small.view("summary").text, "the summary"))
    assert small.view("result").text.startswith("3 rows, 2 pickers, 2 carriers, seed 1"), "whatever the form says now"
    small.until(lambda: not small.one("[data-mark=rows]").is_displayed(), "nothing runs")
    assert not is_locked(small)
