"""How many carriers? The page's study, as a person asks: a real server, the command `orchard study`, and headless Chromium."""

from page_server import RUN_SECONDS, skip_without_packages
from test_app_workbench import PHONE, as_phone, violations

skip_without_packages()

EMPTY = {"people.workers": 0, "people.visitors": 0, "animals.dogs": 0, "animals.cats": 0}


def state(page, words, seconds=RUN_SECONDS):
    page.until(lambda: page.view("study-state").text.lower() == words, f"the study is {words}", seconds)


def reload_keeps_what_was_entered(page):
    page.driver.refresh()
    page.press("how-many")
    page.until(lambda: page.field("study-last").get_attribute("value") == "3", "a reload keeps what was entered")
    page.until(lambda: "least cost" in page.field("study-goal").find_element("xpath", "./ancestor-or-self::label").text, "its goal")
    assert page.field("study-check").get_attribute("aria-checked") == "false"


def test_a_study_is_asked_grows_answers_and_leads_to_a_run(browser):
    page = browser
    for path, value in {"rows": 3, **EMPTY}.items():
        page.fill(path, value)
    page.until(lambda: page.tree_lines() == 4, "a plan of 3 rows")
    page.fill("duration", 60)  # now it can be cleared
    page.press("how-many")
    page.until(lambda: page.field("study-first").is_displayed(), "the study is on the stage")
    page.fill("study-last", 0)
    page.until(lambda: "Carriers to: must be a whole number from 1 to 40" in page.problem("study"), "what is wrong")
    assert not page.one("[data-action=study-start]").is_enabled()
    assert violations(page) == []
    page.fill("study-last", 3)
    page.switch("study-check", False)
    page.pick("study-goal", "least cost of a bin")
    page.until(lambda: "least cost" in page.field("study-goal").find_element("xpath", "./ancestor-or-self::label").text, "a goal")
    reload_keeps_what_was_entered(page)
    page.press("study-start")
    page.until(lambda: "needs a price" in page.problem("study"), "costs need prices")
    page.switch("prices.carrier_per_hour-automatic", False)
    page.fill("prices.carrier_per_hour", 6)
    page.until(lambda: not page.problem("prices.carrier_per_hour"), "a price")
    page.press("how-many")  # back from the bottom of the form
    page.press("study-start")
    state(page, "finished")
    page.until(lambda: len(page.view("study-table").find_elements("css selector", "tr")) == 4, "a line for each setting")
    assert page.view("study-orchard").text == "Orchard: 3 rows of 70 m, 2 pickers, one-way, predictive dispatch"
    assert "a bin" in page.view("answer").text and page.view("answer").text.split()[1].startswith("carrier")
    page.until(lambda: "cost of a bin" in page.view("study-picture").text, "the picture of the costs")
    assert violations(page) == []
    with as_phone(page):
        assert violations(page) == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
    page.press("study-use-2")
    page.until(lambda: page.field("carriers").get_attribute("value") == "3", "the form has the setting")
    assert page.one("[data-action=run]").is_enabled(), "and it can be run and watched"

    page.fill("rows", 20)
    page.fill("pickers", 10)
    page.until(lambda: page.tree_lines() == 21, "an orchard whose study takes long")
    page.press("how-many")
    page.switch("study-check", True)
    page.pick("study-dispatch", "predictive")
    page.escape()
    page.fill("study-budget", 600)
    page.press("study-start")
    page.until(lambda: "with predictive" in page.view("answer").text, "it grows", RUN_SECONDS)
    state(page, "running")
    page.press("study-stop")
    state(page, "stopped")
    page.until(lambda: page.view("study-table").find_elements("css selector", "tr"), "what is known")
    assert "with predictive" in page.view("answer").text
