"""Pickers that are away for a time: they come late, or are ill, and their rows wait for them."""

import pytest
from stage import Stage, empty_orchard

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import with_changes
from orchard.local import Local
from orchard.plans.driving import DriveTo
from orchard.plans.robot import Gate
from orchard.plans.steps import MayFail

# Four rows of 20 m for two pickers, which take 90 s for a row: 40 bins an hour, one in each row.
# Absences are [from, to] in hours since the harvest began: 0.01 h are 36 s.
CREW = empty_orchard(
    rows=4, pickers=2, carriers=2, row_length=20.0, picking_rate=40.0, bins_per_row=1.0
)
LATE = {"picker_absences": {"picker_02": [[0.0, 0.05]]}}
ILL = {"picker_absences": {"picker_01": [[0.01, 0.04], [0.06, 0.07]]}}
FAILING = {"picking": {"failure": {"mean_between": 60.0, "mean_repair": 20.0}}}


def test_a_picker_comes_when_it_is_said_and_picks_then() -> None:
    """Until 0.05 h, 180 s, it is away. Its rows are 3 and 4."""
    stage = Stage(with_changes(CREW, **LATE))
    stage.run(179.0)
    assert stage.doing("picker_02") == "away"
    assert stage.world.row_picked[2] == 0.0
    stage.run(2.0)
    assert stage.doing("picker_02") == "picking row 3"
    assert stage.doing("picker_01") != "away"


def test_a_picker_that_is_ill_goes_on_where_it_stopped() -> None:
    """It stops after 0.01 h, 36 s of picking, and goes on at 0.04 h, 144 s."""
    stage = Stage(with_changes(CREW, **ILL))
    stage.run(37.0)
    picked = stage.world.row_picked[0]
    assert picked == pytest.approx(36.0 * CREW.mean_picking_speed, rel=0.01)
    stage.run(106.0)
    assert (stage.doing("picker_01"), stage.world.row_picked[0]) == ("away", picked)
    stage.run(3.0)
    assert stage.world.row_picked[0] > picked


@pytest.mark.parametrize(
    "changes",
    [LATE, ILL, ILL | FAILING, ILL | {"route": "one-way"}],
    ids=["late", "ill", "ill and failing", "one-way"],
)
def test_both_models_know_which_pickers_are_away(changes: dict[str, object]) -> None:
    crew = with_changes(CREW, **changes)
    run = Local(crew, is_hashed=False)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested"
    fast = DiscreteHarvest(lay_out(crew)).run()
    # 0.2 %: both models do the same, but for what robots do within a tick.
    assert fast.seconds == pytest.approx(run.engine.world.seconds, rel=0.002)
    # And the absence costs time: half a minute at least.
    present = with_changes(crew, picker_absences={})
    assert fast.seconds > DiscreteHarvest(lay_out(present)).run().seconds + 30.0


@pytest.mark.parametrize("begin", [0.0, 0.076, 0.102, 0.29, 0.323, 0.388, 0.427])
def test_a_picker_that_is_away_bars_no_road(begin: float) -> None:
    """The other two are done while it is away for two hours, wherever it was at that moment.

    Among these moments, in hours, are some at which it turns into a row: it must not stay there.
    """
    crew = empty_orchard(
        rows=6, pickers=3, carriers=3, row_length=60.0, picking_rate=15.0, bins_per_row=3.0
    )
    ill = with_changes(crew, picker_absences={"picker_02": [[begin, begin + 2.0]]})
    deliveries = EventHarvest(lay_out(ill)).run().deliveries
    # Each picker has two rows of three bins.
    of_all = 18
    of_others = 12
    assert sum(seconds < 3600.0 * (begin + 2.0) for seconds in deliveries) >= of_others
    assert len(deliveries) == of_all


# An absence (from, to), s since the harvest began, that is longer than each drive of these tests.
ALWAYS = (0.0, 100.0)
# m/s
SPEED = 0.5


def on_a_drive(absence: tuple[float, float], **gates: list[Gate]) -> Stage:
    """Return a stage after 60 s, in which a carrier may leave on a drive of 20 m, from x = -35.

    `gates`: `needs` and `frees` of the drive: where it asks for places, and where it gives them
    back. At SPEED it drives for 40 s.
    """
    stage = Stage(empty_orchard())
    stage.put("carrier_01", -35.0, 29.0)
    drive = DriveTo(x=-15.0, speed=SPEED, **gates)
    stage.give("carrier_01", [MayFail(0, 0.0, 0.0, (absence,)), drive])
    stage.run(60.0)
    return stage


@pytest.mark.parametrize(("gate", "x"), [(-40.0, -35.0), (-33.0, -29.9)])
def test_it_leaves_only_once_it_is_off_the_road(gate: float, x: float) -> None:
    """It is clear of a place 3.1 m past the gate at which it gives that back.

    A gate at x = -40 is 5 m behind its start: it leaves there. Past one at -33 it leaves at -29.9.
    """
    stage = on_a_drive(ALWAYS, frees=[Gate(["east/D/1"], gate)])
    assert stage.doing("carrier_01") == "away"
    assert stage.pose("carrier_01")[0] == pytest.approx(x, abs=0.01)


def test_it_does_not_leave_where_it_needs_the_road() -> None:
    """It passes the gate after 10 s, and would leave after 15 s: it drives to the end, -15 m.

    Without the gate it leaves where it is after 15 s at SPEED.
    """
    stage = on_a_drive((15.0, 100.0), needs=[Gate(["east/D/1"], -30.0)])
    assert stage.pose("carrier_01")[0] == pytest.approx(-15.0)
    stage = on_a_drive((15.0, 100.0))
    assert stage.pose("carrier_01")[0] == pytest.approx(-27.5, abs=0.1)


def test_no_picker_is_away_by_default() -> None:
    assert Scenario().picker_absences == {}
