"""The event model beside the simulator, in quiet orchards: bins are delivered in the same ticks, or
nearly.
"""

from collections.abc import Iterator
from random import Random
from statistics import fmean
from typing import Any

import pytest
from quiet import NOBODY, laid_out

from orchard.event_model.harvest import EventHarvest
from orchard.event_model.swing import reaches_back
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import TICKS_PER_SECOND, Scenario
from orchard.local import Local

# Ticks by which each delivery may differ.
NEAR = 5
# Where carriers turn at another rate: what a robot behind a turning one sees is computed for steps
# of 2.25 degrees only, a tick's turn at the default rate.
NEAR_IF_TURNED = 8
SPREAD = {"spread": {"distribution": "gamma", "cv": 0.3}}
# Orchards in which single ticks decide: each name says what happens there.
CELLS: dict[str, dict[str, Any]] = {
    "carriers that ask for roads in the same tick": {
        "rows": 17,
        "pickers": 6,
        "carriers": 9,
        "picking_speed": 1.0,
    },
    "carriers that give a place back in the tick in which they ask again": {
        **{"rows": 4, "pickers": 3, "carriers": 4, "row_length": 24.0, "picking_speed": 1.0},
        **{"route": "one-way", "dispatch": "nearest"},
    },
    "a line that moves up behind one that turns off": {
        "rows": 7,
        "pickers": 7,
        "carriers": 9,
        "row_length": 40.0,
        "picking_speed": 1.0,
        "route": "one-way",
        "dispatch": "longest-waiting",
        "order_in_row": "outward",
    },
    "bins that know only the mean speed of their rows": {
        "rows": 8,
        "pickers": 7,
        "carriers": 2,
        "row_length": 24.0,
        "picking_speed": 0.5,
        "dispatch": "predictive-farthest",
        "picking": SPREAD,
        "seed": 4,
    },
    "part-full bins that know the speed of the row before": {
        **{"rows": 6, "carriers": 5, "row_length": 45.0, "picking_speed": 0.2},
        **{"dispatch": "predictive-farthest", "route": "one-way", "order_in_row": "outward"},
        **{"metres_per_bin": 11.0, "picking": SPREAD, "seed": 9248},
    },
    "bins that do not report while their pickers leave the rows": {
        "rows": 4,
        "pickers": 2,
        "carriers": 2,
        "row_length": 24.0,
        "dispatch": "rolling",
        "route": "one-way",
    },
    "carriers that turn once the one beside them has passed": {
        **{"rows": 3, "carriers": 5, "row_length": 24.0, "picking_speed": 1.0},
        **{"dispatch": "predictive", "bays": 2},
    },
    "bins inside rows that report once their pickers move": {
        "rows": 8,
        "pickers": 5,
        "carriers": 10,
        "row_length": 24.0,
        "picking_speed": 1.0,
        "dispatch": "predictive",
        "route": "one-way",
        "rows_to_pickers": "balanced-ends",
        "metres_per_bin": 17.5,
    },
    "full bins whose pickers wait inside their rows": {
        **{"rows": 6, "pickers": 6, "carriers": 1, "row_length": 59.0, "picking_speed": 0.2},
        **{"dispatch": "predictive", "rows_to_pickers": "manual", "metres_per_bin": 17.5},
        "picking": {"driving_speed": 0.93, "turning": 43.3},
        "carrying": {"speed": 1.27, "turning": 47.5},
    },
}
# Bins begin to report while their pickers pick. Each name says when.
BEGIN_TO_REPORT: dict[str, dict[str, Any]] = {
    "in the tick after the one in which the time left is the horizon": {},
    "later, for their picker was away": {"picker_absences": {"picker_02": [[0.0, 0.0903]]}},
    "later, for their pickers failed within a step": {
        "picking": {"failure": {"mean_between": 60.0, "mean_repair": 60.0}}
    },
}
# Six carriers move up in a line behind one that turns.
TURNING: dict[str, Any] = {
    "rows": 6,
    "pickers": 3,
    "carriers": 6,
    "row_length": 30.0,
    "dispatch": "predictive",
    "route": "one-way",
}
FAST: dict[str, Any] = {
    "rows": 4,
    "pickers": 2,
    "carriers": 1,
    "row_length": 30.0,
    "picking_speed": 1.0,
    "dispatch": "nearest",
}
CHARGING: dict[str, Any] = {
    "rows": 14,
    "pickers": 5,
    "carriers": 6,
    # With rows of 30 m a carrier stops for one that passes on the delivery road below. The event
    # model does not know that, as docs/bounds.md says, and bins come up to 21 ticks apart.
    "row_length": 34.0,
    "picking_speed": 0.5,
    "dispatch": "nearest",
    "rows_to_pickers": "balanced",
    "order_in_row": "outward",
    "route": "one-way",
    "chargers": 3,
    "seed": 976,
    "carrying": {
        "battery": {"hours": 0.2, "standing": 0.3, "hours_to_charge": 0.1, "reserve": 0.9}
    },
}
# In each a carrier or several fail where their full bins stand in the bay.
FAILING_IN_BAY: dict[str, dict[str, Any]] = {
    "one place": {
        **{"rows": 6, "pickers": 3, "carriers": 2, "row_length": 24.0, "picking_speed": 1.0},
        **{"dispatch": "longest-waiting", "seed": 4702},
        "carrying": {"failure": {"mean_between": 60.0, "mean_repair": 400.0}},
    },
    "two places": {
        **{"rows": 7, "pickers": 3, "carriers": 4, "row_length": 24.0, "picking_speed": 1.0},
        **{"dispatch": "longest-waiting", "seed": 4862, "bays": 2},
        "carrying": {"failure": {"mean_between": 60.0, "mean_repair": 60.0}},
    },
}
# The last full bin stands in the bay, on a carrier behind one that is repaired at the queue's tail.
HELD_UP_IN_BAY: dict[str, Any] = {
    **{"rows": 6, "pickers": 2, "carriers": 5, "row_length": 24.0, "picking_speed": 1.0},
    **{"dispatch": "nearest", "route": "one-way", "seed": 856},
    "carrying": {"failure": {"mean_between": 60.0, "mean_repair": 60.0}},
}
POLICIES = (
    "nearest",
    "longest-waiting",
    "farthest-first",
    "predictive",
    "predictive-farthest",
    "rolling",
    "assignment",
)
# What is drawn: mostly None, a bin a row.
METRES_PER_BIN = [None, None, None, 11.0, 17.5, 22.0, 55.0, 100.0]
# ROWS/PICKERS/CARRIERS -> the orchard.
LARGE: dict[str, dict[str, Any]] = {
    "5/2/2": {"rows": 5, "pickers": 2, "carriers": 2, "picking_speed": 1.0},
    "10/10/10": {"rows": 10, "pickers": 10, "carriers": 10, "picking_speed": 1.0},
    "20/10/10": {"rows": 20, "pickers": 10, "carriers": 10, "picking_speed": 1.0},
    "10/5/4": {"rows": 10, "pickers": 5, "carriers": 4, "picking_speed": 1.0},
    "13/7/4": {"rows": 13, "pickers": 7, "carriers": 4, "picking_speed": 0.5},
    "10/5/2": {"rows": 10, "pickers": 5, "carriers": 2, "picking_speed": 0.03},
    "10/5/5": {"rows": 10, "pickers": 5, "carriers": 5, "picking_speed": 0.5},
    "20/20/20": {"rows": 20, "pickers": 20, "carriers": 20, "picking_speed": 1.0},
}


def assert_is_near(values: dict[str, Any], within: int = NEAR) -> None:
    """Compare the ticks of all deliveries in both models."""
    modelled, delivered = in_both(lay_out(Scenario(**NOBODY | values)))
    assert modelled == pytest.approx(delivered, abs=within)


def in_both(layout: Layout) -> tuple[list[int], list[int]]:
    """Return the ticks of all deliveries in the event model, and in the simulator."""
    run = Local(layout.scenario, is_hashed=False)
    delivered: list[int] = []
    while not run.ended:
        before = run.engine.world.delivered
        run.tick()
        delivered += [run.engine.tick] * (run.engine.world.delivered - before)
    harvest = EventHarvest(layout).run()
    return [round(TICKS_PER_SECOND * seconds) for seconds in harvest.deliveries], delivered


def quick_orchards(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many random quiet orchards that are picked at 0.2 m/s or faster."""
    chances = Random(seed)

    def drawn() -> dict[str, Any]:
        return NOBODY | {
            "rows": chances.randint(3, 14),
            "pickers": chances.randint(2, 7),
            "carriers": chances.randint(2, 12),
            "row_length": chances.choice([24.0, 30.0, 45.0, 70.0, 90.0]),
            "picking_speed": chances.choice([0.2, 0.5, 1.0]),
            "dispatch": chances.choice(POLICIES),
            "route": chances.choice(["one-way", "two-way"]),
            "rows_to_pickers": chances.choice(["balanced", "balanced-ends", "manual"]),
            "order_in_row": chances.choice(["onward", "outward"]),
            "metres_per_bin": chances.choice(METRES_PER_BIN),
            "seed": chances.randint(0, 999),
        }

    return laid_out(drawn, count)


def failing_orchards(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many small random orchards in which carriers often fail."""
    chances = Random(seed)

    def drawn() -> dict[str, Any]:
        return NOBODY | {
            "rows": chances.randint(3, 7),
            "pickers": chances.randint(2, 3),
            "carriers": chances.randint(2, 5),
            "row_length": 24.0,
            "picking_speed": 1.0,
            "dispatch": chances.choice(["nearest", "longest-waiting", "predictive"]),
            "route": chances.choice(["one-way", "two-way"]),
            "seed": chances.randint(1, 9999),
            "bays": chances.choice([1, 1, 2]),
            "carrying": {
                "failure": {"mean_between": 60.0, "mean_repair": chances.choice([60.0, 400.0])}
            },
        }

    return laid_out(drawn, count)


@pytest.mark.parametrize("name", CELLS)
def test_each_bin_is_delivered_when_the_simulator_does(name: str) -> None:
    assert_is_near(CELLS[name])


def test_carriers_that_charge_go_on_when_the_simulators_do() -> None:
    """They move up while they charge, and use nothing where they stand in the queue."""
    assert_is_near(CHARGING)


@pytest.mark.parametrize("name", FAILING_IN_BAY)
def test_the_bay_empties_the_bin_of_a_carrier_that_fails_there(name: str) -> None:
    """It does so while the carrier is repaired; the carrier hears that at its place."""
    assert_is_near(FAILING_IN_BAY[name])


def test_the_bay_empties_the_bin_of_a_carrier_that_is_held_up() -> None:
    """It does so before the carrier is at its place; the carrier hears that there."""
    assert_is_near(HELD_UP_IN_BAY)


@pytest.mark.parametrize("name", BEGIN_TO_REPORT)
def test_bins_begin_to_report_when_the_simulators_do(name: str) -> None:
    """The rhythm of its reports decides in which tick a bin sends for its carrier."""
    values = {"rows": 4, "pickers": 2, "carriers": 2, "row_length": 60.0, "picking_speed": 0.2}
    assert_is_near(values | {"dispatch": "predictive"} | BEGIN_TO_REPORT[name], within=1)


@pytest.mark.parametrize("seconds", [0.7, 1.2])
def test_a_picker_takes_the_bin_as_its_carrier_asks(seconds: float) -> None:
    """With these times to couple a bin the carrier asks in the tick in which the picker takes it.

    The carrier acts first in that tick. It hears yes all the same, for the picker answers later.
    """
    assert_is_near(FAST | {"handling": {"coupling": seconds}})


@pytest.mark.soak
def test_soak_forty_orchards_deliver_when_the_simulators_do() -> None:
    """All 40 that were drawn were near when this was written."""
    apart = []
    shares = []
    for layout in quick_orchards(57, 40):
        modelled, delivered = in_both(layout)
        assert len(modelled) == len(delivered)
        apart.append(max(abs(a - b) for a, b in zip(modelled, delivered, strict=True)))
        shares.append(abs(modelled[-1] / delivered[-1] - 1.0))
    near = sum(ticks <= NEAR for ticks in apart)
    print(f"{near} near; lengths differ by {fmean(shares):.5f}, at most {max(shares):.5f}")
    assert near >= 0.8 * len(apart)
    assert fmean(shares) <= 0.005
    assert max(shares) <= 0.02


@pytest.mark.soak
def test_soak_forty_with_failures_deliver_when_the_simulators_do() -> None:
    """39 of them were near when this was written, and one 11 ticks off."""
    near = 0
    for layout in failing_orchards(77, 40):
        modelled, delivered = in_both(layout)
        near += modelled == pytest.approx(delivered, abs=NEAR)
    print(f"{near} near")
    assert near >= 36


@pytest.mark.soak
@pytest.mark.parametrize("name", LARGE)
def test_soak_bins_are_delivered_when_the_simulator_does(name: str) -> None:
    assert_is_near(LARGE[name])


def test_a_carrier_that_turns_gets_out_of_the_way() -> None:
    """`reaches_back`: how far it and its bin reach back along the line at each tick of a turn, m.

    In a tick it turns by 2.25 degrees. Its bin is behind it first, 1.9 m from its middle, then
    beside it, after 40 ticks, and after a half turn before it. It is 1.8 m long and 1.5 m wide.
    """
    reaches = reaches_back()
    assert reaches[0] == pytest.approx(1.9 + 0.5)
    assert reaches[40] == pytest.approx(1.5 / 2, abs=0.02)
    assert reaches[80] == pytest.approx(1.8 / 2, abs=0.02)


@pytest.mark.parametrize("degrees", [5.0, 60.0])
def test_carriers_that_turn_slowly_or_fast_clear_their_line(degrees: float) -> None:
    assert_is_near(TURNING | {"carrying": {"turning": degrees}}, NEAR_IF_TURNED)


@pytest.mark.parametrize("speed", [2.4, 2.5])
@pytest.mark.parametrize("degrees", [55.0, 60.0])
def test_fast_carriers_that_turn_fast_deliver_in_the_same_ticks(
    speed: float, degrees: float
) -> None:
    """The bin of such a carrier is far off its place when the turn begins, and does not hold it."""
    assert_is_near(FAST | {"carrying": {"speed": speed, "turning": degrees}})


def test_a_carrier_turns_before_one_that_stands_across() -> None:
    """At the queue a carrier turns off the top road, on which the next one waits for it. That one
    stands across: it is longer to the side, and narrower behind. The bin swings clear of it.
    """
    values = NOBODY | {
        **{"rows": 12, "pickers": 5, "carriers": 6, "picking_speed": 0.5, "route": "two-way"},
        **{"dispatch": "predictive", "rows_to_pickers": "balanced", "carrying": {"speed": 1.5}},
        "load_out": {"metres": 100.0, "speed": 2.0, "seconds": 30.0},
    }
    harvest = EventHarvest(lay_out(Scenario(**values))).run()
    assert harvest.delivered == harvest.bins
