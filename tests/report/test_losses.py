"""What a harvest was lost to: trailers, a truck, empty bins or pickers that were not there.

The length of a harvest is split into parts, s: the proven optimum, and what was lost to the
dispatch policy, to traffic, to waits at the load-out, to charging, to absences.
"""

from typing import Any

import pytest
from quiet import NOBODY

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.report.bounds import schedule_seconds
from orchard.report.late_absences import notes_on_absences
from orchard.report.losses import lost_seconds
from orchard.report.rare_truck import notes_on_truck

# A truck that brings two empty bins every 300 s; two trailers of two bins that are away for 150 s;
# and one that is away for 800 s.
TRUCK = {"truck": {"every": 300.0, "bins": 2}, "empty_bins": 2}
TRAILERS = {"seconds_away": 150.0, "trailers": {"count": 2, "bins": 2}, "empty_bins": 3}
FAR = {"seconds_away": 800.0, "trailers": {"count": 1, "bins": 2}}


def small(load_out: dict[str, Any], **values: Any) -> Layout:
    """Return a layout of a small orchard with this load-out."""
    size = {"rows": 6, "pickers": 2, "carriers": 3, "row_length": 24.0}
    return lay_out(Scenario.model_validate(NOBODY | size | values | {"load_out": load_out}))


def lost(layout: Layout) -> dict[str, float]:
    """Return the parts of the time that a harvest lost, s."""
    seconds = DiscreteHarvest(layout).run().seconds
    parts = lost_seconds(layout, seconds)
    assert sum(parts.values()) == pytest.approx(seconds, abs=0.4)
    return parts


@pytest.mark.parametrize("load_out", [TRUCK, TRAILERS, FAR], ids=["truck", "trailers", "far"])
@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_waits_in_the_bay_are_no_loss_to_others(load_out: dict[str, Any], dispatch: str) -> None:
    """All other parts are those of the harvest that waits for nothing in the bay."""
    parts = lost(small(load_out, dispatch=dispatch))
    assert parts.pop("load_out") > 150.0
    assert parts == pytest.approx(lost(small({}, dispatch=dispatch)), abs=0.2)


def test_batteries_and_the_bay_have_parts_of_their_own() -> None:
    """In this orchard both cost some minutes, and little is left for traffic and policy."""
    battery = {"battery": {"hours": 0.3, "standing": 0.0}}
    near = {"seconds_away": 300.0, "trailers": {"count": 1, "bins": 2}}
    layout = small(near, rows=8, carriers=1, carrying=battery, chargers=1)
    parts = lost(layout)
    assert DiscreteHarvest(layout).run().is_over
    assert parts["load_out"] > 500.0
    assert parts["charging"] > 300.0
    assert 0.0 <= parts["traffic"] < 60.0
    assert parts["dispatch"] < 60.0


def test_carriers_that_are_away_themselves_are_no_wait() -> None:
    """Without trailers a carrier takes its bin to the load-out: that is its work."""
    assert "load_out" not in lost(small({"seconds_away": 100.0}))


def test_the_schedule_lasts_until_the_last_trailer_is_back() -> None:
    layout = small(FAR, dispatch="nearest")
    harvest = DiscreteHarvest(layout).run()
    assert harvest.seconds - 40.0 < schedule_seconds(layout) <= harvest.seconds


# A truck that comes after the harvest of six bins.
RARE = {"every": 3600.0, "bins": 2}


@pytest.mark.parametrize(
    ("truck", "empty_bins", "words"),
    [
        (RARE, 8, ("8 empty bins suffice for its 6, so none is needed",)),
        (RARE, 6, ("6 empty bins suffice for its 6, so none is needed",)),
        (RARE, 5, ("5 empty bins do not suffice for its 6", "or 6 empty_bins")),
        (TRUCK["truck"], 2, ()),
    ],
)
def test_a_truck_that_comes_too_rarely_is_told(
    truck: dict[str, Any], empty_bins: int, words: tuple[str, ...]
) -> None:
    layout = small({"truck": truck, "empty_bins": empty_bins})
    notes = notes_on_truck(layout)
    assert len(notes) == (1 if words else 0)
    for word in words:
        assert word in notes[0]
    if empty_bins >= layout.bins:
        assert DiscreteHarvest(layout).run().seconds < 3600.0


@pytest.mark.parametrize("load_out", [{}, TRAILERS], ids=["bay", "trailers"])
def test_an_absence_is_no_loss_to_the_policy(load_out: dict[str, Any]) -> None:
    """The policy's part is that of a harvest in which nobody is away: the policy is not the cause.

    picker_01 is away from 0.01 h to 0.2 h.
    """
    parts = lost(small(load_out, picker_absences={"picker_01": [[0.01, 0.2]]}))
    present = lost(small(load_out))
    # These are 684 s, and the harvest takes some 430 s without that.
    assert parts["absences"] > 300.0
    assert parts["dispatch"] == pytest.approx(present["dispatch"], abs=0.2)


def test_an_absence_after_the_harvest_is_told() -> None:
    layout = small({})
    scenario = with_changes(
        layout.scenario, picker_absences={"picker_01": [[0.01, 1.0], [3.0, 4.0]]}
    )
    (note,) = notes_on_absences(lay_out(scenario))
    assert "picker_absences.picker_01: it leaves after 3 h of work" in note
    assert notes_on_absences(layout) == ()
