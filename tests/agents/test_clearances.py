"""The traffic plan's figures: the areas that turns sweep, and the room between two turns that may happen at once."""

import numpy as np
import pytest
from swept_areas import outline, swept, train

from orchard.agents.route import OneWay
from orchard.field.geometry import EAST, SOUTH, WEST

COUPLING, D_ROAD, F_ROAD, FULL_BIN, STOP, WAITING = (
    OneWay.COUPLING, OneWay.D_ROAD, OneWay.F_ROAD, OneWay.FULL_BIN, OneWay.STOP, OneWay.WAITING
)  # fmt: skip
PITCH = 5.5  # m, at the narrowest rows
QUARTER = np.pi / 2


def gap(one: np.ndarray, other: np.ndarray) -> float:
    """Return the least distance between two sets of points, m."""
    most = least(one[::20], other[::20])
    return least(facing(one, other, most), facing(other, one, most))


def facing(points: np.ndarray, others: np.ndarray, most: float) -> np.ndarray:
    """Return those that may be as near as `most` to others, which are all in a circle."""
    centre = (others.min(axis=0) + others.max(axis=0)) / 2
    radius = np.hypot(*(others - centre).T).max()
    return points[np.hypot(*(points - centre).T) <= radius + most]


def least(one: np.ndarray, other: np.ndarray) -> float:
    return float(min(np.hypot(*(other - point).T).min() for point in one))


def test_what_turns_sweep_is_what_the_plan_says():
    for shape, radius in ((outline("carrier"), 1.17), (train("carrier"), 2.45), (train("picker"), 2.80)):
        assert np.hypot(*shape.T).max() == pytest.approx(radius, abs=0.005)


def test_a_carriers_turn_at_its_stop_stays_clear_of_the_next_pickers_exit_turn():
    carrier = swept(outline("carrier"), D_ROAD, -STOP, SOUTH, -QUARTER)
    picker = swept(train("picker"), WAITING, -PITCH, EAST, -QUARTER)
    assert gap(carrier, picker) == pytest.approx(0.28, abs=0.01)


@pytest.mark.parametrize(
    ("x", "y", "start", "least"),
    [(D_ROAD, -STOP, SOUTH, 0.22), (COUPLING, -STOP, WEST, 0.22), (COUPLING, 0.0, QUARTER, 0.22)],
)
def test_a_carriers_turns_on_its_loop_stay_clear_of_both_bins(x, y, start, least):
    turn = swept(outline("carrier"), x, y, start, -QUARTER)
    bins = [outline("bin", at) for at in (FULL_BIN, D_ROAD)]
    assert min(gap(turn, fruit) for fruit in bins) >= least


def test_a_carrier_that_leaves_with_the_full_bin_stays_off_the_road_of_deliveries_but_for_its_own_place():
    turn = swept(train("carrier"), F_ROAD, 0.0, EAST, -QUARTER)
    assert turn[:, 1].max() < 2.8, "no robot waits nearer than that"
    assert turn[:, 0].max() < D_ROAD - 0.75 - 0.1
