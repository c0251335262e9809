"""What tests of the page look at in any part of it: a phone, axe, and the keyboard.

Packages of the browser are imported in the functions, because they may be missing.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from browser import Browser

# Width and height of the screen, pixels.
PHONE = (390, 844)
# The most presses of Tab from one field to another: the whole page has fewer stops.
MOST_TABS = 150
# An orchard without people and animals.
EMPTY = {"people.workers": 0, "people.visitors": 0, "animals.dogs": 0, "animals.cats": 0}


@contextmanager
def as_phone(browser: "Browser") -> Iterator[None]:
    """Within this the page has the screen of a phone."""
    width, height = PHONE
    browser.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True},
    )
    try:
        yield
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def violations(browser: "Browser") -> list[str]:
    """Return a line for each thing that axe finds wrong with the page, once the page is at rest.

    Frames are left out, for Rerun's viewer is in one.
    """
    from axe_core_python.selenium import Axe

    browser.wait_until(
        lambda: not browser.driver.execute_script("return document.getAnimations().length"),
        "the page is at rest",
    )
    browser.wait_until(
        lambda: browser.driver.execute_script("return document.fonts.status") == "loaded",
        "icons are icons, not their names",
    )
    results = Axe().run(browser.driver, options={"iframes": 0, "resultTypes": ["violations"]})
    lines = []
    for rule in results["violations"]:
        lines += [f"{rule['id']}: {node['html']}" for node in rule["nodes"]]
    return lines


def press(page: "Browser", *keys: str) -> None:
    """Press keys, wherever the focus is."""
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(page.driver).send_keys(*keys).perform()


def tab_to(page: "Browser", name: str) -> None:
    """Press Tab until the focus is on the field or button with this name."""
    from selenium.webdriver.common.keys import Keys

    look = "const it = document.activeElement; return it.dataset.field || it.dataset.action"
    for _ in range(MOST_TABS):
        press(page, Keys.TAB)
        if page.driver.execute_script(look) == name:
            return
    raise AssertionError(f"{name} is not reached by Tab")
