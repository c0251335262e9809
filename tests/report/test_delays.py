"""The waits of the long-run closed form."""

from itertools import chain
from statistics import fmean

import pytest
from stage import empty_orchard

from orchard.agents.robot import Gate
from orchard.agents.routes import route_of
from orchard.agents.steps import DriveTo, Face, Free, Need
from orchard.discrete.harvest import long_run_bins_per_hour
from orchard.field.geometry import EAST, Pose
from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds
from orchard.report.delays import CROSSING, HOME, OUT, PASSES, PICKER, WORKS, Stay, TrafficDelays, Trip, stays
from orchard.report.exchange import exchanges

EVENLY = [0.25] * 4


def test_a_stay_begins_where_the_robot_must_have_the_place_and_ends_where_it_gives_it_back():
    plan = [
        DriveTo(x=10.0, needs=[Gate(["a"], 4.0), Gate(["b"], 8.0), Gate(["beyond"], 11.0)], frees=[Gate(["a"], 9.0), Gate(["b"], 12.0)]),
        Face("SOUTH"),
        Need(["c"]),
        DriveTo(y=-6.0, speed=0.5, frees=[Gate(["b"], -1.0)]),
        Free(["c"]),
    ]
    assert stays(plan, Pose(0.0, 0.0, EAST)) == [Stay("a", 4.0, 5.0, PASSES), Stay("b", 8.0, 8.0, WORKS), Stay("c", 14.0, 12.0, PASSES)]


def trips(kind: int, seconds: float, rows: int = 4) -> list[Trip]:
    """An exchange for each row: its carrier passes a place before it delivers, and then is in the bay; a picker crosses another place."""
    return [Trip(i, 50.0, [Stay("road", 10.0, seconds, kind), Stay("bay", 60.0, 9.0, WORKS)], []) for i in range(rows)]


def test_robots_wait_as_in_a_queue_with_random_arrivals_and_a_fixed_service():
    """The mean wait of M/D/1 is X S^2 / 2 (1 - X S) (Pollaczek and Khinchine); here three of four exchanges and all carriers but one."""
    rate, share = 0.05, 0.75 * 0.9
    waits = TrafficDelays(trips(WORKS, 8.0), EVENLY, carriers=10).at(rate)
    assert waits[:, OUT] == pytest.approx(4 * [rate * share * 64.0 / 2.0 / (1.0 - rate * share * 8.0)])
    assert waits[:, HOME] == pytest.approx(4 * [rate * share * 81.0 / 2.0 / (1.0 - rate * share * 9.0)])
    assert not waits[:, CROSSING].any()


def test_carriers_that_pass_do_not_wait_for_each_other_and_one_carrier_meets_none():
    assert not TrafficDelays(trips(PASSES, 8.0), EVENLY, carriers=10).at(0.05)[:, OUT].any()
    assert not TrafficDelays(trips(WORKS, 8.0), EVENLY, carriers=1).at(0.05).any()


def test_a_picker_that_crosses_waits_for_all_carriers_and_they_for_it():
    crossed = [one._replace(picker=[Stay("road", 0.0, 5.0, PICKER)]) for one in trips(PASSES, 8.0)]
    waits = TrafficDelays(crossed, EVENLY, carriers=1).at(0.04)
    assert waits[:, CROSSING] == pytest.approx(4 * [0.04 * 0.75 * 64.0 / 2.0 / (1.0 - 0.04 * 0.75 * 8.0)])
    assert waits[:, OUT] == pytest.approx(4 * [0.04 * 0.75 * 25.0 / 2.0 / (1.0 - 0.04 * 0.75 * 5.0)])


def test_an_exchange_that_is_a_larger_part_of_all_waits_less_for_the_others():
    for share in (0.1, 0.7):
        met = 0.05 * 0.9 * (1.0 - share)
        waits = TrafficDelays(trips(WORKS, 8.0), [share, *[(1.0 - share) / 3] * 3], carriers=10).at(0.05)
        assert waits[0, OUT] == pytest.approx(met * 64.0 / 2.0 / (1.0 - met * 8.0))


@pytest.mark.parametrize(
    "changes",
    [
        {"route": "one-way"},
        {"route": "two-way", "dispatch": "nearest"},
        {"picking_speed": 0.03},
        {"rows": 3, "pickers": 3, "carriers": 6, "dispatch": "nearest"},  # a picker turns back into its row, and its carrier is in the way
        {"rows": 4, "pickers": 2, "carriers": 8},  # each bin has a carrier that holds before the lane
    ],
)
def test_the_form_is_within_three_per_cent_of_the_long_run(changes):
    layout = lay_out(empty_orchard(**{"rows": 10, "pickers": 5, "carriers": 5} | changes))
    assert Bounds(layout).bins_per_hour == pytest.approx(long_run_bins_per_hour(layout, 8), rel=0.03)


def test_pickers_with_fewer_rows_count_as_much_as_the_others():
    """In the long run they deliver as many bins."""
    layout = lay_out(empty_orchard(rows=5, pickers=4, carriers=2, route="two-way"))
    cycles = [[one.cycle for one in exchanges(route_of(layout), block, 2)] for block in layout.blocks.values()]
    assert Bounds(layout).cycle_seconds == pytest.approx(fmean(map(fmean, cycles)))
    assert Bounds(layout).cycle_seconds != pytest.approx(fmean(chain(*cycles)))


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_more_carriers_never_allow_less_and_traffic_never_more(route):
    forms = [Bounds(lay_out(empty_orchard(rows=8, pickers=4, carriers=carriers, route=route))) for carriers in range(1, 9)]
    rates = [form.bins_per_hour for form in forms]
    assert rates == sorted(rates) and {type(rate) for rate in rates} == {float}
    assert all(3600.0 * min(form.terms_at(0.0).values()) >= form.bins_per_hour > 0.0 for form in forms)
