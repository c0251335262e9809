"""The crew in a browser: who is away, and how many people are best while somebody is."""

from page_server import skip_without_packages

skip_without_packages()

# An orchard that is soon harvested: nobody stands in the way.
SMALL = {"rows": 4, "people.workers": 0, "people.visitors": 0, "animals.dogs": 0, "animals.cats": 0}


def choose_setting(page, label):
    """Choose what is compared, too, by typing its label."""
    page.fill("study-compared", label)
    page.pick("study-compared", label)


def test_who_is_away_is_typed_and_told_where_it_is_wrong(browser):
    """After a reload the part is folded away. A problem in it opens it."""
    browser.fill("picker_absences", "picker 2 is ill")
    browser.wait_until(
        lambda: browser.problem("picker_absences").startswith("Who is away: must be pickers and"),
        "what is wrong",
    )
    browser.reload()
    browser.wait_until(
        lambda: browser.field("picker_absences").is_displayed(), "the field, which is wrong"
    )
    browser.fill("picker_absences", "picker 2: 0-0,05")
    browser.wait_until(lambda: browser.problem("picker_absences") == "", "who is away")
    browser.reload()
    browser.unfold("crew")
    browser.wait_until(
        lambda: browser.field("picker_absences").get_attribute("value") == "picker 2: 0-0.05 h",
        "as it is shown",
    )


def test_people_are_compared_while_one_of_them_is_away(browser):
    page = browser
    for path, value in SMALL.items():
        page.fill(path, value)
    page.fill("picker_absences", "picker 2: 0-0.05 h")
    page.unfold("study-more")
    choose_setting(page, "Pickers")
    page.wait_until(
        lambda: "Compare, too: enter the values" in page.problem("study"), "values are wanted"
    )
    page.fill("study-compared-values", "2-4")
    page.wait_until(lambda: page.problem("study") == "", "values")
    page.press("study-start")
    page.wait_until(
        lambda: "Horizon: nobody is away in the long run" in page.problem("study"),
        "the long run has no first hour",
    )
    page.choose("horizon", "one harvest")
    page.press("study-start")
    page.wait_until(lambda: page.view("study-state").text.lower() == "finished", "an answer")
    page.wait_until(
        lambda: "4 pickers" in page.view("study-picture").text, "a curve for each number of people"
    )
    page.fill("study-compared-values", "")
    choose_setting(page, "nothing")
    page.choose("horizon", "the long run")
    page.wait_until(lambda: page.problem("study") == "", "as it was")
