"""Pickers that are away for a time: they come late, or are ill, and their rows wait for them."""

import pytest
from stage import Stage, empty_orchard

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import with_changes
from orchard.local import Local

CREW = empty_orchard(
    rows=4, pickers=2, carriers=2, row_length=20.0, picking_rate=40.0, bins_per_row=1.0
)
LATE = {"picker_absences": {"picker_02": [[0.0, 0.05]]}}
ILL = {"picker_absences": {"picker_01": [[0.01, 0.04], [0.06, 0.07]]}}
FAILING = {"picking": {"failure": {"mean_between": 60.0, "mean_repair": 20.0}}}


def test_a_picker_comes_when_it_is_said_and_picks_then() -> None:
    stage = Stage(with_changes(CREW, **LATE))
    stage.run(179.0)
    assert stage.doing("picker_02") == "away"
    assert stage.world.row_picked[2] == 0.0
    stage.run(2.0)
    assert stage.doing("picker_02") == "picking row 3"
    assert stage.doing("picker_01") != "away"


def test_a_picker_that_is_ill_goes_on_where_it_stopped() -> None:
    """It has picked for 36 s by then, and stands for 108 s."""
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
def test_both_models_know_who_is_away(changes: dict[str, object]) -> None:
    crew = with_changes(CREW, **changes)
    run = Local(crew, is_hashed=False)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested"
    fast = DiscreteHarvest(lay_out(crew)).run()
    assert fast.seconds == pytest.approx(run.engine.world.seconds, rel=0.002)
    present = with_changes(crew, picker_absences={})
    assert fast.seconds > DiscreteHarvest(lay_out(present)).run().seconds + 30.0


@pytest.mark.parametrize("begin", [0.0, 0.076, 0.102, 0.29, 0.323, 0.388, 0.427])
def test_who_is_away_bars_no_road(begin: float) -> None:
    """The other two are done while it is away, also if it was to leave where it turns in."""
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


def test_nobody_is_away_by_default() -> None:
    assert Scenario().picker_absences == {}
