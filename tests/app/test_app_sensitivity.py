"""What does it hang on? Asked on the page, in headless Chromium."""

import pytest
from page_checks import EMPTY, PHONE, as_phone, press, tab_to, violations
from page_server import skip_without_packages
from patience import PATIENCE

skip_without_packages()


@pytest.fixture
def small(browser):
    """Enter an orchard of 3 rows, and unfold what can be moved."""
    for path, value in {"rows": 3, **EMPTY}.items():
        browser.fill(path, value)
    browser.wait_until(lambda: browser.tree_lines() == 4, "a plan of 3 rows")
    browser.unfold("hangs-more")
    return browser


def wait_for(page, state):
    """Wait until the sensitivity has this state, such as "finished"."""
    page.wait_until(
        lambda: page.view("hangs-state").text.lower() == state, f"it is {state}", PATIENCE
    )


def test_the_page_tells_what_the_result_hangs_on(small):
    """The values of the small orchard are moved, after a share that nobody can read."""
    page = small
    page.fill("hangs-far", "a lot")
    page.wait_until(lambda: "How far: must be a share" in page.problem("hangs"), "what is wrong")
    assert not page.one("[data-action=hangs-start]").is_enabled()
    page.fill("hangs-far", "")
    page.wait_until(lambda: not page.problem("hangs"), "the usual shares")
    page.driver.execute_script("arguments[0].focus()", page.field("study-deadline"))
    tab_to(page, "hangs-start")
    press(page, " ")
    wait_for(page, "finished")
    page.wait_until(
        lambda: page.view("hangs-picture").find_elements("css selector", "svg"), "the tornado"
    )
    assert "in 19 of 20 runs" in page.view("hangs-answer").text
    assert "luck of the seed" in page.view("hangs-table").text
    assert violations(page) == []
    with as_phone(page):
        assert violations(page) == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
