"""The event model beside the simulator: the same harvests take the same time.

`fast` and `full` of examples/fast_and_full.py do a harvest in the event model and in the simulator.
Both return `seconds`, its length; `wait`, how long a picker waits for a bin on average, s; and
`busy`, the share of the time in which carriers are at work. `long_run` is a harvest that goes on
until its rate is steady.
"""

from statistics import fmean
from typing import Any

import pytest
from stage import ONE_WAY

from examples.fast_and_full import CELLS, both, error, fast, full, scenario_of
from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.plans.jobs import begin_of, timed_steps
from orchard.plans.routes import route_of
from orchard.plans.steps import FetchEmpty
from orchard.report.bounds import Bounds
from orchard.report.long_run import long_run

NOBODY: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}
# s of work from one failure to the next on average, and s of a repair.
FAILURE = {"mean_between": 300.0, "mean_repair": 60.0}
OFTEN = {"mean_between": 60.0, "mean_repair": 60.0}
SHORT = {"pickers": 2, "carriers": 2, "row_length": 40.0}
VARIED = {"spread": {"distribution": "gamma", "cv": 0.3}, "failure": FAILURE}


def orchard(**values: Any) -> Scenario:
    """Return a scenario without people and animals, with these values."""
    return Scenario(**NOBODY | {"dispatch": "nearest"} | values)


# The values of each harvest, which the simulator does, too.
HARVESTS: dict[str, dict[str, Any]] = {
    "nearest": {"rows": 4, "pickers": 2, "carriers": 1},
    "farthest-first": {
        "rows": 5,
        "pickers": 3,
        "carriers": 2,
        "dispatch": "farthest-first",
        "rows_to_pickers": "manual",
    },
    "predictive, two-way": {
        "rows": 6,
        "pickers": 6,
        "carriers": 3,
        "dispatch": "predictive",
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    "rolling": {
        "rows": 6,
        "pickers": 3,
        "carriers": 2,
        "dispatch": "rolling",
        "row_length": 40.0,
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    "rolling, and bins that fill where their picker drives out": {
        "rows": 4,
        "pickers": 4,
        "carriers": 4,
        "row_length": 40.0,
        "metres_per_bin": 22.0,
        "picking_speed": 0.5,
        "order_in_row": "outward",
        "dispatch": "rolling",
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    "a user's policy that asks what all carriers do": {
        **SHORT,
        "rows": 4,
        "carriers": 3,
        "dispatch": "own_policies.OneAtATime",
    },
    "picking that varies": {**SHORT, "rows": 4, "picking_speed": 0.5, "picking": VARIED, "seed": 3},
    "an early policy, and failures": {
        **SHORT,
        **ONE_WAY,
        "rows": 5,
        "dispatch": "predictive",
        "picking": {"failure": OFTEN},
    },
    "carriers that fail": {
        **SHORT,
        "rows": 4,
        "dispatch": "predictive",
        "carrying": {"failure": FAILURE},
        "seed": 2,
    },
    "carriers that charge": {
        "rows": 8,
        "pickers": 4,
        "carriers": 3,
        "row_length": 30.0,
        "dispatch": "predictive",
        "route": "two-way",
        "carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.75}},
        "chargers": 2,
    },
    "bins that go on with the next row": {**SHORT, "rows": 4, "metres_per_bin": 15.0},
    "bins that fill inside rows that are picked slowly": {
        "rows": 4,
        "pickers": 4,
        "carriers": 3,
        "row_length": 40.0,
        "metres_per_bin": 16.0,
        "picking_speed": 0.3,
        "dispatch": "predictive",
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    "nearest, two-way": {
        "rows": 5,
        "pickers": 5,
        "carriers": 5,
        "route": "two-way",
        "row_length": 30.0,
    },
    "pickers that drive into their rows": {
        "rows": 3,
        "pickers": 3,
        "carriers": 1,
        "row_length": 40.0,
        "dispatch": "predictive",
        "rows_to_pickers": "balanced-ends",
    },
    "bins of rows that are picked slowly, and one of them much faster than the mean": {
        "rows": 4,
        "carriers": 2,
        "pickers": 2,
        "row_length": 30.0,
        "picking_speed": 0.1,
        "seed": 10,
        "dispatch": "predictive",
        "picking": {"spread": {"distribution": "lognormal", "cv": 0.6}},
    },
    "bins that see how fast their row is picked only in it": {
        "rows": 4,
        "pickers": 3,
        "carriers": 1,
        "row_length": 30.0,
        "picking_speed": 0.5,
        "seed": 9,
        "dispatch": "predictive",
        "rows_to_pickers": "balanced-ends",
        "picking": {"spread": {"distribution": "gamma", "cv": 0.5}},
    },
}


@pytest.mark.parametrize("name", HARVESTS)
def test_a_harvest_takes_as_long_as_in_the_simulator(name: str) -> None:
    scenario = orchard(**HARVESTS[name])
    seconds = fast(scenario)
    expected = full(scenario)
    assert seconds["seconds"] == pytest.approx(expected["seconds"], rel=0.005)
    # Carriers hear in other ticks that they are wanted, so a wait may differ by a tick and a half.
    assert seconds["wait"] == pytest.approx(expected["wait"], rel=0.01, abs=0.15)
    assert seconds["busy"] == pytest.approx(expected["busy"], abs=0.01)


@pytest.mark.soak
def test_no_cell_is_far_from_the_simulator() -> None:
    """A cell is a size of an orchard with a route and a policy: ROWS/PICKERS/CARRIERS:route:policy.

    `error`: by which share the event model is longer.
    """
    cells = {cell: [both(scenario_of(cell, **NOBODY))] for cell in CELLS}
    errors = [abs(error(pairs)) for pairs in cells.values()]
    assert len(cells) >= 40
    assert fmean(errors) <= 0.01
    assert max(errors) <= 0.04


@pytest.mark.soak
@pytest.mark.parametrize(
    "cell",
    ["10/5/5:one-way:predictive", "10/10/10:one-way:predictive", "10/5/5:two-way:predictive"],
)
def test_with_people_the_mean_is_that_of_the_simulator(cell: str) -> None:
    """The mean is taken over seeds, because single harvests differ."""
    assert abs(error([both(scenario_of(cell, seed)) for seed in range(1, 9)])) <= 0.02


def seconds_with(workers: int, seed: int) -> float:
    """Return how long a harvest with some workers takes, s."""
    values = {"people": {"workers": workers, "visitors": 0}, "seed": seed}
    return DiscreteHarvest(lay_out(orchard(rows=4, pickers=2, carriers=2, **values))).run().seconds


def test_more_people_lengthen_a_harvest() -> None:
    """Without people no time is lost to them."""
    seeds = range(1, 5)
    means = [fmean(seconds_with(workers, seed) for seed in seeds) for workers in (0, 5, 50)]
    assert means == sorted(means)
    # s: five workers cost some seconds, fifty some more.
    assert means[0] + 2.0 < means[1] < means[2] - 10.0
    assert {seconds_with(0, seed) for seed in seeds} == {means[0]}
    assert len({seconds_with(5, seed) for seed in seeds}) == len(seeds)
    assert seconds_with(5, 1) == seconds_with(5, 1)


def test_the_long_run_is_slower_with_people() -> None:
    """Thirty workers cost more than 1 %."""

    def rate(workers: int) -> float:
        people = {"workers": workers, "visitors": 0}
        layout = lay_out(orchard(rows=4, pickers=2, carriers=1, people=people))
        return long_run(layout).bins_per_hour

    assert rate(workers=30) < 0.99 * rate(workers=0)


def test_in_the_long_run_pickers_with_fewer_rows_keep_up() -> None:
    """If they were done while others go on, the long run would have too few pickers."""
    layout = lay_out(orchard(rows=5, pickers=4, carriers=8, **ONE_WAY))
    assert sorted(len(block.rows) for block in layout.blocks.values()) == [1, 1, 1, 2]
    # In a run of six rows for each picker, all have six.
    for block in DiscreteHarvest(layout, rows_each=6).layout.blocks.values():
        assert len(block.rows) == 6
    longer = long_run(layout, 48).bins_per_hour
    assert long_run(layout).bins_per_hour == pytest.approx(longer, rel=0.01)


def test_the_long_run_of_slow_pickers_is_no_jam() -> None:
    """A row of 200 m takes almost three hours. Two pickers fill a bin in that time each."""
    layout = lay_out(orchard(rows=4, pickers=2, carriers=2, row_length=200.0, picking_speed=0.02))
    assert long_run(layout).bins_per_hour == pytest.approx(3600.0 * 2 / (200.0 / 0.02), rel=0.03)


def test_waits_and_shares_are_of_the_same_time_as_the_rate() -> None:
    """Little's law: the mean number of waiting pickers is the rate times their mean wait.

    The same holds for carriers that are out.
    """
    layout = lay_out(orchard(rows=4, pickers=2, carriers=1))
    result = long_run(layout)
    bounds = Bounds(layout)
    # Of each of the two pickers, s from one bin to the next. What is not work is waiting.
    seconds_per_bin = 3600.0 * 2 / result.bins_per_hour
    work = bounds.picking_seconds + bounds.crossing_seconds + _own_drive(layout)
    assert result.picker_waiting_seconds == pytest.approx(seconds_per_bin - work, rel=0.05)
    utilisation = result.bins_per_hour * _trip_seconds(layout) / 3600.0
    assert result.carrier_utilisation == pytest.approx(utilisation, rel=0.03)


def _own_drive(layout: Layout) -> float:
    """Return how long a picker drives from a full bin to where it waits for an empty one, s."""
    route = route_of(layout)
    block = layout.blocks["picker_01"]
    first, second = layout.passes(block)[:2]
    lane = layout.lane(first.row)
    if route.sides[first.end] is route.east:
        start = Pose(lane.west, lane.y, HEADINGS["EAST"])
    else:
        start = Pose(lane.east, lane.y, HEADINGS["WEST"])
    steps = route.pick(first, came_over=False) + route.go_on(first, second)
    way = [*timed_steps(steps, start, layout.machines["picker"])]
    return begin_of(FetchEmpty, way) - first.metres / lane.picking_speed


def test_a_pickers_own_drive_to_the_rows_end_is_no_wait() -> None:
    layout = lay_out(orchard(rows=4, pickers=2, carriers=1))
    harvest = DiscreteHarvest(layout).run()
    without_a_bin = harvest.waited_seconds / harvest.delivered
    drive = without_a_bin - harvest.picker_waiting_seconds()
    assert drive == pytest.approx(_own_drive(layout), abs=1.0)


def _trip_seconds(layout: Layout) -> float:
    """Return the mean time of a trip of the only carrier outside the queue, s."""
    harvest = DiscreteHarvest(layout, rows_each=16).run()
    return harvest.carrier_utilisation() * harvest.seconds / harvest.delivered


def test_a_harvest_that_waits_for_ever_ends_soon() -> None:
    layout = lay_out(orchard(rows=4, pickers=2, carriers=1, dispatch="own_policies.Idle"))
    harvest = DiscreteHarvest(layout).run()
    assert not harvest.is_over
    assert harvest.delivered == 0
    # Ticks of the event model.
    assert harvest.model.now < 20_000
    with pytest.raises(RuntimeError, match="only 0 bins were delivered: some robots wait for ever"):
        long_run(layout)


BATTERY = {"battery": {"hours": 2.0, "hours_to_charge": 1.0}}
# Short rows that are picked fast; and slow pickers, with batteries that last for many rounds.
LASTING: list[dict[str, Any]] = [
    {"rows": 4, "pickers": 2, "carriers": 3, "row_length": 20.0},
    {
        "rows": 4,
        "pickers": 4,
        "carriers": 2,
        "row_length": 40.0,
        "picking_speed": 0.05,
        "carrying": BATTERY,
    },
]


@pytest.mark.parametrize("changes", LASTING)
def test_a_long_run_has_the_rate_of_a_far_longer_one(changes: dict[str, Any]) -> None:
    layout = lay_out(orchard(**{"dispatch": "predictive"} | changes))
    assert long_run(layout).bins_per_hour == pytest.approx(
        long_run(layout, 200).bins_per_hour, rel=0.025
    )


@pytest.mark.parametrize("dispatch", ["farthest-first", "assignment"])
def test_a_policy_that_leaves_a_picker_out_has_no_long_run(dispatch: str) -> None:
    """With two carriers for six pickers these policies serve some pickers again and again."""
    with pytest.raises(
        Jam,
        match=(
            r"^picker_0\d has done \d+ % of its rows when another picker has done all: too few"
            r" carriers come to it$"
        ),
    ):
        long_run(lay_out(orchard(rows=12, pickers=6, carriers=2, dispatch=dispatch)))


def test_a_harvest_with_a_carrier_flat_before_home_is_not_over() -> None:
    """The battery, found by trial, lasts until the last bin is at the bay, and not to the queue."""
    layout = lay_out(
        orchard(
            rows=3,
            pickers=3,
            carriers=1,
            seed=27,
            route="one-way",
            carrying={"battery": {"hours": 0.205, "reserve": 0.3}},
        )
    )
    harvest = DiscreteHarvest(layout).run()
    assert harvest.delivered == 3
    assert not harvest.is_over
    assert str(harvest.jam()).endswith("the battery of carrier_01 is flat")


def test_agents_of_the_users_own_need_the_simulator() -> None:
    with pytest.raises(
        ValueError, match=r"built-in agents only, and not picker_01; run the simulator"
    ):
        DiscreteHarvest(lay_out(orchard(agents={"picker_01": "tests.support.own_agents.Eastward"})))
