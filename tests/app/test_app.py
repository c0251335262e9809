"""The page's form as a person fills it in, with a real server and headless Chromium.

The fixture `browser` (tests/conftest.py) shows the default orchard: 5 rows, so 6 lines of trees.
"""

from page_server import skip_without_packages

from orchard.field.scenario import Scenario, load

skip_without_packages()

LAPTOP = {"width": 1366, "height": 768, "deviceScaleFactor": 1, "mobile": False}


def test_a_new_page_says_what_to_do_first(browser):
    assert "Enter your rows" in browser.view("first").text


def test_the_plan_and_the_figures_follow_every_change(browser):
    """Each line has 12 trees. For 8 pickers there are 6 carriers, 7 for every 10, and each of these
    14 robots has a bin.
    """
    browser.wait_until(lambda: browser.figure("Trees") == "72", "trees")
    browser.fill("rows", 8)
    browser.wait_until(lambda: browser.tree_lines() == 9, "a plan of 8 rows")
    browser.wait_until(lambda: browser.figure("Trees") == "108", "more trees")
    before = browser.figure("Limit")
    browser.fill("pickers", 8)
    browser.wait_until(lambda: browser.figure("Carriers") == "6", "carriers follow the pickers")
    assert browser.figure("Bins") == "14"
    assert browser.figure("Limit") != before
    assert browser.field("carriers").get_attribute("value") == "6"
    browser.click("[data-preset=default]")
    browser.wait_until(lambda: browser.tree_lines() == 6, "the default plan again")


def test_a_preset_can_be_undone(browser):
    """Undo works after a reload, too, and brings back what was invalid as it was typed."""
    browser.fill("rows", 9)
    browser.fill("row_length", "9O")
    browser.wait_until(lambda: browser.problem("row_length"), "an invalid value")
    browser.click("[data-preset=hand_picking]")
    browser.wait_until(lambda: browser.tree_lines() == 27, "the preset, of 26 rows")
    browser.wait_until(
        lambda: "set)" in browser.view("experts").text, "values of the preset that are folded away"
    )
    browser.reload()
    browser.press("undo")
    browser.wait_until(
        lambda: browser.field("rows").get_attribute("value") == "9", "the rows before the preset"
    )
    assert browser.field("row_length").get_attribute("value") == "9O"
    browser.press("redo")
    browser.wait_until(
        lambda: browser.field("rows").get_attribute("value") == "26", "the preset again"
    )


def test_no_preset_moves_when_undo_appears(browser):
    """On a laptop the presets take two lines. A second click would hit another one."""
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", LAPTOP)
    try:
        browser.click("[data-preset=hand_picking]")
        browser.wait_until(lambda: browser.tree_lines() == 27, "the preset, of 26 rows")
        preset = browser.one("[data-preset=hand_picking]")
        with_undo = preset.rect
        undo = browser.one("[data-action=undo]")
        browser.driver.execute_script("arguments[0].style.display = 'none'", undo)
        assert preset.rect == with_undo
        browser.driver.execute_script("arguments[0].style.display = ''", undo)
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_slider_moves_its_field(browser):
    """A click hits the middle of the slider of the rows, which goes from 3 to 100."""
    browser.one(".field .q-slider").click()
    rows = browser.field("rows")
    browser.wait_until(lambda: rows.get_attribute("value") in ("51", "52"), "rows in the middle")
    browser.wait_until(
        lambda: browser.tree_lines() == int(rows.get_attribute("value")) + 1, "a plan of as many"
    )


def test_a_plan_of_many_rows_is_shown_as_wide_as_the_page(browser):
    """As a whole its rows would be too thin to see. So it is as wide as the page, and scrolls."""
    browser.fill("rows", 100)
    browser.wait_until(lambda: browser.tree_lines() == 101, "a plan of 100 rows")
    browser.wait_until(
        lambda: browser.field("full-width").get_attribute("aria-checked") == "true",
        "full width by itself",
    )
    browser.fill("rows", 5)
    browser.wait_until(
        lambda: browser.field("full-width").get_attribute("aria-checked") == "false",
        "the whole plan again",
    )


def test_bad_values_are_explained_at_their_fields(browser):
    """While one of them is bad, the scenario can be neither run nor saved."""
    browser.fill("rows", 101)
    browser.wait_until(
        lambda: "from 3 to 100" in browser.problem("rows"), "the limits at the field"
    )
    browser.fill("people.workers", 48)
    browser.wait_until(
        lambda: "at most 50 together" in browser.problem("people.workers"),
        "people are too many together",
    )
    assert "48" in browser.problem("people.workers")
    assert browser.problem("people.visitors") == "See “Workers”."
    assert "3 fields" in browser.view("trouble").text
    assert not browser.one("[data-action=run]").is_enabled()
    assert not browser.one("[data-action=save]").is_enabled()
    browser.fill("rows", 4)
    browser.fill("people.workers", 1)
    browser.wait_until(
        lambda: not browser.problem("rows") and not browser.problem("people.visitors"),
        "all is well again",
    )
    browser.wait_until(lambda: browser.tree_lines() == 5, "a plan of 4 rows")


def test_a_bad_file_is_explained_and_changes_nothing(browser, tmp_path):
    browser.open_file(tmp_path / "bad.yaml", "rows: 999\npikers: 3\n")
    complaint = browser.wait_until(lambda: browser.view("complaint").text, "a complaint")
    assert "bad.yaml:1: rows = 999" in complaint
    assert "did you mean pickers" in complaint
    assert browser.field("rows").get_attribute("value") == "5"


def test_a_file_is_opened_changed_and_saved(browser, downloads, tmp_path):
    """The file varies its picking times, a field with limits of its own.

    The seed 2**63 - 1 is larger than any integer that a browser's numbers hold exactly.
    """
    text = (
        "rows: 12\n"
        "pickers: 4\n"
        "carriers: 9\n"
        "picking_speed: 0.5\n"
        "picking: {spread: {distribution: gamma, cv: 0.4}}\n"
    )
    browser.open_file(tmp_path / "mine.yaml", text)
    browser.wait_until(lambda: browser.tree_lines() == 13, "a plan of 12 rows")
    browser.wait_until(
        lambda: (
            browser.field("carriers").get_attribute("value") == browser.figure("Carriers") == "9"
        ),
        "as many carriers",
    )
    assert browser.field("picking.spread.cv").get_attribute("value") == "0.4"
    browser.fill("seed", 2**63 - 1)
    browser.switch("picking.failure.mean_between-automatic", False)
    browser.wait_until(
        lambda: "must be a number from 60" in browser.problem("picking.failure.mean_between"),
        "a number is asked for",
    )
    browser.fill("picking.failure.mean_between", 1800)
    browser.wait_until(lambda: not browser.problem("picking.failure.mean_between"), "all is well")
    browser.fill("picking.spread.cv", 0.6)
    told = {
        "picking_speed": "“Deviation of times” must be at most 0.5",
        "picking.spread.distribution": "See “Picking speed”.",
        "picking.spread.cv": "See “Picking speed”.",
    }
    for path, words in told.items():
        browser.wait_until(
            lambda path=path, words=words: words in browser.problem(path), f"told at {path}"
        )
    browser.fill("picking.spread.cv", 0.5)
    browser.wait_until(lambda: not browser.problem("picking_speed"), "all is well again")
    picking = {"spread": {"distribution": "gamma", "cv": 0.5}, "failure": {"mean_between": 1800.0}}
    size = {"rows": 12, "pickers": 4, "carriers": 9, "seed": 2**63 - 1}
    assert load(browser.saved(downloads)) == Scenario(**size, picking_speed=0.5, picking=picking)


def conversion(page):
    """Return the sentence that says what the figures of the first card come to."""
    return page.view("conversion").text


def test_the_rows_of_a_grower_are_typed_as_he_says_them(browser):
    """A comma may be the decimal sign, and the spacing is measured from tree to tree.

    A number that is typed replaces "unknown".
    """
    typed = {
        "rows": 20,
        "row_length": 90,
        "row_width": "4,5",
        "crop.tonnes_per_hectare": 40,
        "crop.kilograms_per_bin": 350,
        "pickers": 6,
        "picking_rate": "1,5",
    }
    for path, value in typed.items():
        browser.fill(path, value)
    browser.wait_until(
        lambda: "4.63 bins a row, 92.6 in all" in conversion(browser), "the bins of a row"
    )
    assert not browser.driver.find_elements("css selector", ".field.wrong")
    assert browser.field("crop.tonnes_per_hectare-automatic").get_attribute("aria-checked") == (
        "false"
    )
    browser.fill("bins_per_row", 3)
    browser.wait_until(
        lambda: conversion(browser).startswith("3 bins a row"), "the last one counts"
    )
    assert browser.field("crop.tonnes_per_hectare").get_attribute("value") == ""
    browser.fill("row_width", 3)
    browser.wait_until(
        lambda: browser.problem("row_width").endswith("3.65 to 12.5 m, from tree to tree"),
        "as he measures it",
    )


def test_longer_rows_leave_a_rate_and_show_its_speed(browser):
    """A picking rate is in rows an hour, so in longer rows it means a higher speed in m/s."""
    browser.reload()
    browser.wait_until(lambda: browser.field("rows").is_displayed(), "the page")
    assert not browser.field("picking_speed").is_displayed(), "it is folded away"
    browser.switch("picking_rate-automatic", False)
    browser.fill("picking_rate", 1.5)
    browser.wait_until(
        lambda: (
            "2 pickers fill 3 bins an hour while they pick, and go 0.0292 m/s"
            in conversion(browser)
        ),
        "1.5 rows of 70 m an hour",
    )
    browser.fill("row_length", 110)
    browser.wait_until(
        lambda: "and go 0.0458 m/s" in conversion(browser),
        "1.5 rows of 110 m an hour",
    )
    assert browser.field("picking_rate").get_attribute("value") == "1.5"
    browser.fill("picking_rate", 40)
    browser.wait_until(
        lambda: (
            "must be 0.033 to 32.727 where 110 m of row fill a bin"
            in browser.problem("picking_rate")
        ),
        "a limit in words",
    )
