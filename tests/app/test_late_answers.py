"""What a person types before the answer to a click has come: the fields show what will be run.

Messages of the server are held back in the browser, as by a server that is busy.
"""

from contextlib import contextmanager

import pytest
from page_server import skip_without_packages

skip_without_packages()

HOLD = """
window.heldMessages = [];
window.takeMessage = window.socket.onevent;
window.socket.onevent = (message) => window.heldMessages.push(message);
"""
RELEASE = """
window.socket.onevent = window.takeMessage;
window.heldMessages.forEach((message) => window.socket.onevent(message));
"""
COUNT = "return window.heldMessages.length"
TYPED = {"row_length": "90", "row_width": "4,5"}


@contextmanager
def late_answers(browser):
    """Within this the browser gets no message of the server. At the end it gets all of them."""
    browser.driver.execute_script(HOLD)
    try:
        yield
    finally:
        browser.driver.execute_script(RELEASE)


def wait_for_answer(browser):
    """Wait until the server has answered, though the browser does not get it."""
    browser.wait_until(lambda: browser.driver.execute_script(COUNT), "an answer is held back")


def fill(browser, typed=TYPED):
    for path, text in typed.items():
        browser.fill(path, text)


def shown(browser):
    """Return what the fields show."""
    return {path: browser.field(path).get_attribute("value") for path in TYPED}


def query_of_link(browser):
    """Return the query of the link to what the server has, and close its dialog."""
    browser.press("link")
    link = browser.wait_until(lambda: browser.view("link").get_attribute("value"), "the link")
    browser.escape()
    browser.wait_until(
        lambda: not browser.driver.find_elements("css selector", "[data-view=link]"),
        "the link is closed",
    )
    return link.partition("?")[2]


@pytest.mark.parametrize("is_reloaded", [False, True])
def test_what_is_typed_before_a_late_answer_stays(browser, is_reloaded):
    """The same numbers are typed, the default orchard is loaded, and they are typed again."""
    fill(browser)
    browser.wait_until(lambda: "row_length=90" in query_of_link(browser), "the numbers are heard")
    if is_reloaded:
        browser.reload()
    with late_answers(browser):
        browser.click("[data-preset=default]")
        wait_for_answer(browser)
        fill(browser)
    assert query_of_link(browser) == "row_length=90&row_width=4"
    assert shown(browser) == TYPED


def test_two_late_answers_leave_what_the_server_has(browser):
    """The default orchard is loaded, and taken back, before either is seen."""
    fill(browser)
    browser.wait_until(lambda: "row_length=90" in query_of_link(browser), "the numbers are heard")
    with late_answers(browser):
        browser.click("[data-preset=default]")
        wait_for_answer(browser)
        browser.press("undo")
        # The second answer comes as some messages more.
        before = browser.driver.execute_script(COUNT)
        browser.wait_until(
            lambda: browser.driver.execute_script(COUNT) > before, "the second answer is held back"
        )
    assert query_of_link(browser) == "row_length=90&row_width=4"
    assert shown(browser) == {"row_length": "90", "row_width": "4.5"}


def test_a_chosen_number_that_comes_late_is_not_shown(browser):
    """More pickers change the number of carriers that the program chooses.

    The user types another one meanwhile.
    """
    with late_answers(browser):
        browser.fill("pickers", 4)
        wait_for_answer(browser)
        browser.fill("carriers", 5)
    assert query_of_link(browser) == "pickers=4&carriers=5"
    assert browser.field("carriers").get_attribute("value") == "5"
