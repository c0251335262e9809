"""Tasks of tests/app/tasks.md, walked in a real browser: by the keyboard alone, and on a phone."""

import pytest
from page_checks import press, tab_to
from page_server import skip_without_packages
from selenium.webdriver.common.keys import Keys

skip_without_packages()

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}


@pytest.fixture
def keyboard(browser):
    """Reload the page, so the focus is where a user without a mouse finds it."""
    browser.reload()
    return browser


def test_rows_are_entered_and_asked_without_a_mouse(keyboard):
    """A number that has the focus is selected, so that typing replaces it.

    A slider beside a field is no stop of its own.
    """
    tab_to(keyboard, "rows")
    press(keyboard, Keys.TAB)
    focused = keyboard.driver.switch_to.active_element
    assert focused.get_attribute("data-field") == "row_length"
    keyboard.reload()
    for path, typed in {"rows": "12", "row_width": "4,5", "pickers": "3"}.items():
        tab_to(keyboard, path)
        press(keyboard, typed)
    keyboard.wait_until(lambda: keyboard.tree_lines() == 13, "a plan of 12 rows")
    assert keyboard.field("row_width").get_attribute("value") == "4,5"
    tab_to(keyboard, "study-start")
    press(keyboard, Keys.ENTER)
    keyboard.wait_until(lambda: keyboard.view("answer").text, "the study begins")
    keyboard.wait_until(lambda: keyboard.view("study-bar").is_displayed(), "that it goes on")
    tab_to(keyboard, "study-stop")
    press(keyboard, Keys.ENTER)
    keyboard.wait_until(
        lambda: keyboard.view("study-state").text.lower() == "stopped", "it can be stopped, too"
    )
    keyboard.wait_until(lambda: not keyboard.view("study-bar").is_displayed(), "that it is over")


def test_a_preset_is_undone_without_a_mouse(keyboard):
    tab_to(keyboard, "rows")
    press(keyboard, "12")
    keyboard.wait_until(lambda: keyboard.tree_lines() == 13, "a plan of 12 rows")
    keyboard.click("[data-preset=hand_picking]")
    keyboard.wait_until(lambda: keyboard.tree_lines() == 27, "the preset, of 26 rows")
    tab_to(keyboard, "undo")
    press(keyboard, Keys.SPACE)
    keyboard.wait_until(lambda: keyboard.tree_lines() == 13, "the user's rows")


def test_rows_are_entered_on_a_phone(browser):
    """The fields stand above the button that asks, and nothing is wider than the screen."""
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    try:
        browser.fill("rows", 12)
        browser.fill("crop.tonnes_per_hectare", 40)
        browser.wait_until(
            lambda: "Fruit in a bin = unknown" in browser.problem("crop.tonnes_per_hectare"),
            "the other half is asked for",
        )
        browser.fill("crop.kilograms_per_bin", "350,5")
        browser.wait_until(
            lambda: "bins a row" in browser.view("conversion").text, "what it comes to"
        )
        tops = [
            browser.one(css).rect["y"] for css in ("[data-field=rows]", "[data-action=study-start]")
        ]
        assert tops == sorted(tops)
        wide = browser.driver.execute_script("return document.documentElement.scrollWidth")
        assert wide <= PHONE["width"]
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
