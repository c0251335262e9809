"""Links to the page, and desks.

A link has the values of a scenario that differ from the default, as `/?rows=7`. A desk keeps on the
server what one browser has entered; `MOST` desks are kept.
"""

import sys
from copy import copy

import pytest

from orchard.app.desks import MOST, Desks
from orchard.app.link import draft_of, query_of
from orchard.field.scenario import Scenario, with_changes


def test_a_link_chooses_a_built_in_rule_and_runs_no_class():
    """No code of a link runs: Python's module `this` is not imported."""
    built_in, _ = draft_of([("dispatch", "nearest")])
    assert built_in.scenario == Scenario(dispatch="nearest")

    draft, _ = draft_of([("dispatch", "this.Zen")])
    assert "a class of your own must be named in a scenario file" in draft.problems["dispatch"]
    assert "this" not in sys.modules

    assert query_of(Scenario(rows=7, dispatch="this.Zen")) == "rows=7"
    assert query_of(Scenario(dispatch="nearest")) == "dispatch=nearest"


def test_a_link_is_checked_once_however_long_it_is(monkeypatch):
    """A check of a scenario takes time, so a long link must not have one for each value."""
    checks = []

    def counted_check(base, **values):
        checks.append(values)
        return with_changes(base, **values)

    monkeypatch.setattr("orchard.app.draft.with_changes", counted_check)
    draft, _ = draft_of([("rows", "3"), ("tractor", "maybe")] * 1000)
    assert len(checks) == 2, "one check of the default, and one of the link"
    assert [*draft.problems] == ["tractor"]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"rows": 7, "people.workers": 0},
        {"seed": 2**63 - 1, "laser.noise": 0.0125, "tractor": False},
    ],
)
def test_a_link_brings_back_its_scenario(changes):
    scenario = with_changes(Scenario(), **changes)
    query = query_of(scenario)
    assert len(query.split("&")) == max(1, len(changes)), "only what differs from the default"
    draft, unknown = draft_of(pair.split("=") for pair in query.split("&") if pair)
    assert unknown == []
    assert (draft.scenario if draft else Scenario()) == scenario


def test_what_is_wrong_in_a_link_is_told():
    draft, unknown = draft_of(
        [("rows", "999"), ("pikers", "3"), ("agents", "os.system"), ("tractor", "perhaps")]
    )
    assert unknown == ["pikers: no such setting; did you mean pickers?", "agents: no such setting"]
    assert draft.problems.keys() == {"rows", "tractor"}


def test_a_link_without_settings_holds_no_draft():
    """Of 2,000 unknown names, each of 200 characters or more, the page shows five, cut short."""
    draft, unknown = draft_of([(f"x{number}" * 100, "1") for number in range(2000)])
    assert draft is None
    assert len(unknown) == 6
    assert unknown[-1] == "and 1995 more"
    assert all(len(line) < 100 for line in unknown)


def test_each_browser_has_its_desk():
    """A desk keeps what one browser has entered. Two pages of a browser do not change each other.

    So a page works on a copy of the draft.
    """
    desks = Desks()
    desk = desks.of("one")
    desks.keep("one", desk)
    desk.draft.enter({"rows": "9"})
    assert desks.of("one").draft.scenario == Scenario(rows=9)
    assert desks.of("other").draft.scenario == Scenario()
    page = copy(desks.of("one").draft)
    page.enter({"rows": "x"})
    assert desks.of("one").draft.scenario == Scenario(rows=9)


def test_a_desk_is_kept_once_its_browser_shows_the_page():
    desks = Desks()
    entered = desks.of("user")
    entered.draft.enter({"rows": "9"})
    desks.keep("user", entered)
    for number in range(2 * MOST):
        desks.of(f"request {number}").draft.enter({"rows": "7"})
    assert desks.of("user") is entered
    assert desks.of("request 0").draft.scenario == Scenario(), "a request leaves nothing"
    # With that of the user there are now as many desks as are kept; a new one drops another.
    for number in range(MOST - 1):
        desks.keep(str(number), desks.of(str(number)))
    desks.keep("user", desks.of("user"))
    desks.keep("new", desks.of("new"))
    assert desks.of("user") is entered, "this browser showed the page last but one"
    assert desks.of("0") is not desks.of("0"), "the desk that was not used for longest is dropped"
