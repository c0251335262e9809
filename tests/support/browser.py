"""Headless Chromium for tests of the page: find, fill in, wait. Every wait is bounded."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import Any

import psutil
from patience import PATIENCE
from selenium import webdriver
from selenium.common.exceptions import (
    ElementClickInterceptedException,
    ElementNotInteractableException,
    NoSuchElementException,
    StaleElementReferenceException,
)
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

# s after which a click that had no effect is made again.
CLICK_AGAIN = 60.0
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-prefers-reduced-motion",
)


def open_browser(
    chromium: str, driver: str, profile: str, downloads: str, *flags: str
) -> webdriver.Chrome:
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.add_experimental_option("prefs", {"download.default_directory": downloads})
    opened = webdriver.Chrome(options=options, service=Service(driver))
    # axe looks at all elements of a page: on a busy machine that takes longer than the usual 30 s.
    opened.set_script_timeout(PATIENCE)
    return opened


def fresh(look: Callable[..., Any]) -> Callable[..., Any]:
    """Look again when the page has drawn itself anew between finding a thing and reading it.

    After 20 looks in vain the error of the next one is raised.
    """

    @wraps(look)
    def again(*arguments: Any) -> Any:
        for _ in range(20):
            try:
                return look(*arguments)
            except StaleElementReferenceException:
                continue
        return look(*arguments)

    return again


class Browser:
    """The page in a browser, with what a user does there.

    The page marks its elements for tests: a field of the form by its path in the scenario
    (data-field), a part of the page by its name (data-view), a button by its action (data-action).
    """

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def wait_until(self, holds: Callable[[], Any], what: str, seconds: float = PATIENCE) -> Any:
        """Wait until `holds` returns something true, and return that. `what` names it in a failure.

        Each look costs the browser a layout, so the pauses grow with the wait.
        """
        begun = time.monotonic()
        while True:
            with suppress(StaleElementReferenceException, NoSuchElementException):
                if found := holds():
                    return found
            waited = time.monotonic() - begun
            assert waited < seconds, f"not within {seconds} s: {what}"
            time.sleep(min(0.5, 0.05 + waited / 5))

    def begin(self, address: str) -> None:
        """Set the default orchard as a user does, on the page that is open or on a new one.

        A new one is opened where a dialog is open, or another page is.
        """
        is_open = self.driver.current_url == f"{address}/"
        if is_open and not self.driver.find_elements(By.CSS_SELECTOR, ".q-dialog"):
            self.driver.execute_script(
                "scrollTo(0, 0); document.querySelectorAll('iframe').forEach(it =>"
                " it.removeAttribute('src'))"
            )
            self.turn_to("Plan")
        else:
            self.open(f"{address}/")
        # Whatever the test before has left in the form. While the page still lays itself out, a
        # click may miss: a person would click again.
        begun = time.monotonic()
        while not self._has_default_soon():
            assert time.monotonic() - begun < PATIENCE, "the default orchard is not shown"
        for view in ("crew", "experts", "how"):
            self.unfold(view)

    def _has_default_soon(self) -> bool:
        """Click on the default orchard. Return whether it is shown before long."""
        self.click("[data-preset=default]")
        with suppress(AssertionError):
            self.wait_until(self._is_default, "the default orchard", CLICK_AGAIN)
            return True
        return False

    def open(self, address: str) -> None:
        self.driver.get(address)
        self._connect()

    def reload(self) -> None:
        self.driver.refresh()
        self._connect()

    def _connect(self) -> None:
        """Wait until the server knows the page.

        Before, NiceGUI may load the page again, and what was clicked is lost.
        """
        self.wait_until(
            lambda: self.driver.execute_script("return window.did_handshake"),
            "the page is connected",
        )

    def _is_default(self) -> bool:
        """Whether the form has the values of the default orchard."""
        fields = {"rows": "5", "pickers": "2", "seed": "1", "weeds": "10"}
        look = "return arguments[0].map(it => document.querySelector(`[data-field=${it}]`)?.value)"
        is_right = not self.driver.find_elements(By.CSS_SELECTOR, ".field.wrong")
        # Of the 5 rows of the default orchard each has a line of trees on either side.
        return (
            is_right
            and self.tree_lines() == 6
            and self.driver.execute_script(look, [*fields]) == [*fields.values()]
        )

    def one(self, css: str) -> WebElement:
        """Return the first element of a CSS selector, as soon as there is one."""
        return self.wait_until(
            lambda: next(iter(self.driver.find_elements(By.CSS_SELECTOR, css)), None),
            f"{css} is on the page",
        )

    def unfold(self, view: str) -> None:
        """Open a part of the page that may be folded away."""
        button = f"[data-view={view}] [role=button][aria-expanded]"
        # To the middle: at the top edge the bar of the page would cover the button.
        look = "arguments[0].scrollIntoView({block: 'center'})"
        if self.one(button).get_attribute("aria-expanded") == "false":
            self.driver.execute_script(look, self.one(button))
            self.click(button)

    def view(self, name: str) -> WebElement:
        """Return a part of the page by its name for tests."""
        return self.one(f"[data-view={name}]")

    def field(self, path: str) -> WebElement:
        """Return a field by its path in the scenario."""
        return self.one(f"[data-field='{path}']")

    @fresh
    def click(self, css: str) -> None:
        """Click on an element as soon as that is possible."""
        self.wait_until(lambda: self._clicked(css), f"{css} can be clicked")

    def _clicked(self, css: str) -> bool:
        return self._pressed(self.one(css))

    @staticmethod
    def _pressed(element: WebElement) -> bool:
        """Click on an element. Return whether it could be clicked: not while the page moves.

        Where the header is in the way, which stays on top, it scrolls as a person does.
        """
        if not element.is_displayed() or not element.is_enabled():
            return False
        try:
            element.click()
        except ElementClickInterceptedException:
            element.parent.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
            return False
        except ElementNotInteractableException:
            return False
        return True

    @fresh
    def switch(self, path: str, on: bool) -> None:
        """Turn a switch or a check box on or off, whatever it was before."""
        if self.field(path).get_attribute("aria-checked") != str(on).lower():
            self.click(f"[data-field='{path}']")

    @fresh
    def choose(self, path: str, words: str) -> None:
        """Press the button with these words in a group."""
        self.wait_until(lambda: self._pressed(self._button(path, words)), f"{words} can be chosen")

    def _button(self, path: str, words: str) -> WebElement:
        return next(
            button
            for button in self.driver.find_elements(By.CSS_SELECTOR, f"[data-field={path}] button")
            if button.text == words
        )

    @fresh
    def pick(self, path: str, words: str) -> None:
        """Pick an entry of a menu."""
        self.wait_until(lambda: self._picked(path, words), f"{words} can be picked")

    def _picked(self, path: str, words: str) -> bool:
        """Pick an entry. Return whether it could be picked.

        While no menu is open, the field is clicked: the page may have moved under the click before.
        """
        offered = self.driver.find_elements(By.CSS_SELECTOR, ".q-menu .q-item")
        if not offered:
            self._pressed(self.field(path).find_element(By.XPATH, "./ancestor-or-self::label"))
        return any(self._pressed(name) for name in offered if name.text == words)

    def escape(self) -> None:
        """Close a menu by its key."""
        self.one("body").send_keys(Keys.ESCAPE)

    def turn_to(self, view: str) -> None:
        """Show a view of the stage, such as Plan or Runs."""
        self.choose("stage", view)

    def unchoose_runs(self) -> None:
        """Take the choice of all runs back."""
        self.wait_until(lambda: not self._unchoose(), "no run is chosen")

    def _unchoose(self) -> list[WebElement]:
        """Take the choice of one run back. Return the runs that were chosen before."""
        chosen = self.driver.find_elements(By.CSS_SELECTOR, "[data-view=runs] [aria-checked=true]")
        for run in chosen[:1]:
            # To the middle: at the top edge the bar of the page would cover it.
            self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", run)
            self._pressed(run)
        return chosen

    def press(self, action: str) -> None:
        """Click on the button of an action."""
        self.click(f"[data-action={action}]")

    def open_file(self, file: Path, text: str) -> None:
        """Write a scenario file, and open it on the page."""
        file.write_text(text)
        self.one("input[type=file]").send_keys(str(file))

    def saved(self, downloads: Path) -> Path:
        """Save the scenario, and return the file that the browser has downloaded."""
        before = set(downloads.iterdir())
        self.press("save")
        return self.wait_until(
            lambda: next((path for path in downloads.glob("*.yaml") if path not in before), None),
            "a file is saved",
        )

    @fresh
    def fill(self, path: str, value: object) -> None:
        """Replace the text of a field, as soon as it can be filled in; '' leaves it empty."""
        self.wait_until(
            lambda: self.field(path).is_displayed() and self.field(path).is_enabled(),
            f"{path} can be filled in",
        )
        self.field(path).send_keys(Keys.CONTROL, "a")
        self.field(path).send_keys(str(value) or Keys.DELETE)

    @fresh
    def problem(self, path: str) -> str:
        """Return what the page says is wrong with a field, '' if nothing is."""
        return self.one(f"[data-problem='{path}']").text

    @fresh
    def figure(self, name: str) -> str:
        """Return the value of a figure."""
        return self.one(f"[data-figure='{name}'] .tile-value").text

    def tree_lines(self) -> int:
        """Return the number of lines of trees in the plan.

        In the default orchard a line of trees is drawn as green rectangles of this size. It counts
        the heights at which they stand.
        """
        trees = "[data-view=plan] rect[width='66.0'][height='12.0'][style^='fill:#7fae5d']"
        look = (
            "return new Set([...document.querySelectorAll(arguments[0])].map(it =>"
            " it.getAttribute('y'))).size"
        )
        return self.driver.execute_script(look, trees)

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Keep the page too busy to hear or say anything within this context."""
        # Chromium draws pages in processes of their own, its renderers.
        processes = psutil.Process(self.driver.service.process.pid).children(recursive=True)
        pages = [process for process in processes if "--type=renderer" in process.cmdline()]
        for page in pages:
            page.suspend()
        try:
            yield
        finally:
            for page in pages:
                page.resume()

    def wait_for_state(self, state: str, seconds: float = PATIENCE) -> None:
        self.wait_until(
            lambda: self.view("state").text.lower() == state, f"the run is {state}", seconds
        )
