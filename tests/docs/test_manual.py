"""What docs/manual.md says is what a run does.

The manual is that of the system of 2015 which the Orchard simulates. By default the Orchard differs
from it; with the options of the page a run is as in the manual. Both are looked at here.
"""

from functools import cache

import pytest
from code_blocks import ROOT, block
from local_runs import ALONE

from orchard.contract.messages import Call, Fetch, type_of
from orchard.field.kinds import KINDS
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse, with_changes
from orchard.local import Local

DEFAULT = Scenario()
MANUAL = parse(block("docs/manual.md", "manual"))
# Both without people, animals, weeds and tractor.
QUIET = {"default": with_changes(DEFAULT, **ALONE), "manual": with_changes(MANUAL, **ALONE)}
# A course ends when two bins are unloaded: then both carriers have been at the bay.
UNLOADED = 2

# Lengths, widths and heights of the manual, m.
SIZES = {
    "picker": (2.5, 1.5, 1.0),
    "carrier": (1.8, 1.5, 0.5),
    "bin": (1.0, 1.0, 1.0),
    "weed": (0.5, 0.5, 0.5),
    "worker": (0.55, 1.0, 1.7),
    "visitor": (0.55, 1.0, 1.7),
    "dog": (1.0, 0.8, 0.7),
    "cat": (1.0, 0.8, 0.7),
}


class Course:
    """What happens in a quiet harvest until some bins are unloaded."""

    def __init__(self, scenario: Scenario) -> None:
        self.local = Local(scenario)
        self.layout = self.local.engine.layout
        # (tick, sender, recipient, message).
        self.letters = []
        self.events = []
        # Carrier -> the least y at which it has been, m.
        self.southmost = dict.fromkeys(self.carriers, float("inf"))
        while self.local.engine.world.delivered < UNLOADED:
            self._tick()
            assert self.local.engine.tick < 6000

    @property
    def carriers(self) -> list[str]:
        return [name for name in self.layout.names if name.startswith("carrier")]

    def _tick(self) -> None:
        engine = self.local.engine
        self.events += self.local.tick()
        tick = engine.tick - 1
        for sender, written in self.local.post.written.get(tick, {}).items():
            self.letters += [(tick, sender, to, body) for to, body in written.sent]
        for name in self.carriers:
            y = float(engine.world.pose[self.layout.index[name], 1])
            self.southmost[name] = min(self.southmost[name], y)

    def first(self, what: str, who: str) -> int:
        """Return the tick of a body's first event of a kind."""
        return next(event.tick for event in self.events if (event.what, event.who) == (what, who))


@cache
def course(name: str) -> Course:
    """Return the quiet harvest of the default, or of the manual."""
    return Course(QUIET[name])


def test_the_options_restore_the_manual_and_nothing_else_differs():
    changed = {
        key: value
        for key, value in MANUAL.model_dump().items()
        if value != DEFAULT.model_dump()[key]
    }
    assert changed == {"route": "one-way", "dispatch": "nearest", "rows_to_pickers": "manual"}


def test_the_queue_is_at_the_top_left_or_right():
    layouts = {"default": lay_out(DEFAULT), "manual": lay_out(MANUAL)}
    for layout in layouts.values():
        assert layout.queue.place(0).y > layout.lanes[0].y
    assert layouts["default"].queue.head < layouts["default"].middle - 20.0
    assert layouts["manual"].queue.head > layouts["manual"].middle + 20.0


def test_only_by_the_manual_carriers_drive_around_the_bottom():
    """That road is more than 3 m south of the last row."""
    last = course("default").layout.lanes[-1].y
    assert min(course("default").southmost.values()) > last - 3.0
    assert max(course("manual").southmost.values()) < last - 3.0


def test_bins_report_early_or_call_carriers_when_full():
    """By default bins report to the dispatcher from the start on. By the manual they call all
    carriers once they are full, and there is no dispatcher.
    """
    tick, _, to, fetch = next(
        letter for letter in course("default").letters if isinstance(letter[3], Fetch)
    )
    assert (tick, to) == (0, "dispatch")
    assert fetch.seconds_to_full > 60.0
    manual = course("manual")
    calls = [(tick, sender, to) for tick, sender, to, body in manual.letters if type(body) is Call]
    assert {to for _, _, to in calls} == set(manual.carriers)
    assert all(tick > manual.first("bin full", sender) for tick, sender, _ in calls)
    assert "dispatch" not in manual.layout.agents


@pytest.mark.parametrize("name", QUIET)
def test_a_picker_asks_its_bin_for_a_carrier(name):
    asked = {
        (sender.partition("_")[0], to.partition("_")[0], type_of(body))
        for _, sender, to, body in course(name).letters
        if sender.startswith("picker")
    }
    assert ("picker", "bin", "emptybin") in asked
    assert ("picker", "carrier", "call") not in asked


@pytest.mark.parametrize("name", QUIET)
def test_a_picker_goes_on_before_its_full_bin_is_taken(name):
    events = course(name).events
    (took, empty) = next(
        (event.tick, event.whom)
        for event in events
        if (event.what, event.who) == ("coupled", "picker_01")
    )
    fetched = next(
        event.tick for event in events if event.what == "coupled" and event.whom == "bin_01"
    )
    assert empty != "bin_01"
    assert took < fetched


def test_every_second_picker_starts_at_the_other_end():
    """By default; by the manual all pickers start in the west."""

    def start_in_the_west(scenario: Scenario) -> list[bool]:
        layout = lay_out(scenario)
        return [start.pose.x < layout.middle for start in layout.starts if start.kind == "picker"]

    assert start_in_the_west(with_changes(DEFAULT, pickers=4)) == [True, False, True, False]
    assert start_in_the_west(with_changes(MANUAL, pickers=4)) == [True] * 4
    assert start_in_the_west(Scenario(pickers=4, rows_to_pickers="balanced")) == [True] * 4


def test_counts_have_the_limits_that_the_page_names():
    """The counts are those of rows, pickers and carriers.

    By default there are 7 carriers for every 10 pickers, rounded up.
    """
    assert lay_out(Scenario(rows=100, pickers=60, carriers=1)).scenario.rows == 100
    for wrong in ({"rows": 101}, {"rows": 2}, {"rows": 5, "pickers": 6}, {"carriers": 121}):
        with pytest.raises(ScenarioError):
            with_changes(DEFAULT, **wrong)
    counts = {pickers: Scenario(rows=10, pickers=pickers).carrier_count for pickers in (2, 5, 10)}
    assert counts == {2: 2, 5: 4, 10: 7}


def test_bodies_have_the_sizes_of_the_manual():
    sizes = {name: (KINDS[name].length, KINDS[name].width, KINDS[name].height) for name in SIZES}
    assert sizes == SIZES


@pytest.mark.parametrize(("scenario", "minutes"), [(DEFAULT, "9:02"), (MANUAL, "16:08")])
def test_a_harvest_takes_the_time_that_the_page_says(scenario, minutes):
    local = Local(scenario, is_hashed=False)
    while not local.engine.over:
        local.tick()
    whole, seconds = divmod(round(local.engine.world.seconds), 60)
    assert f"{whole}:{seconds:02d}" == minutes
    assert f"{minutes} min" in (ROOT / "docs" / "manual.md").read_text()
