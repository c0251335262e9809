"""Several blocks, one fleet: entered and asked on the page, in headless Chromium."""

from page_checks import EMPTY, PHONE, as_phone, violations
from page_server import skip_without_packages
from patience import PATIENCE
from selenium.webdriver.common.keys import Keys

skip_without_packages()


def add_block(page, name, rows):
    """Set the form to so many rows, and add them as a block, by the keyboard."""
    page.fill("rows", rows)
    page.wait_until(lambda: page.tree_lines() == rows + 1, f"a plan of {rows} rows")
    page.fill("farm-name", name)
    page.field("farm-name").send_keys(Keys.ENTER)
    page.wait_until(lambda: f"{name}" in page.view("farm-blocks").text, f"the block {name}")


def test_a_farm_is_entered_asked_and_answered(browser):
    """It has two blocks, after one that is taken out again, and a transfer of 12,5 min."""
    page = browser
    for path, value in EMPTY.items():
        page.fill(path, value)
    page.unfold("farm")
    page.press("farm-start")
    page.wait_until(lambda: "Blocks: enter at least two" in page.problem("farm"), "what is wrong")
    for name, rows in {"Wrong": 7, "Top": 3, "Low": 4}.items():
        add_block(page, name, rows)
    page.press("farm-remove-0")
    page.wait_until(lambda: "Wrong" not in page.view("farm-blocks").text, "it is taken out")
    page.fill("farm-transfer", "12,5")
    page.press("farm-start")
    page.wait_until(
        lambda: page.view("farm-state").text.lower() == "finished", "it is finished", PATIENCE
    )
    page.wait_until(lambda: page.view("farm-table").text, "the table")
    assert "2 blocks (Top, Low) with 1 transfer of 12.5 min" in page.view("farm-answer").text
    assert "farm, s" in page.view("farm-table").text
    assert violations(page) == []
    with as_phone(page):
        assert violations(page) == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= PHONE[0]
    page.press("farm-set-0")
    page.wait_until(lambda: page.field("rows").get_attribute("value") == "3", "the rows of Top")
