"""Pickers that differ, by a spread that the seed draws and by a rate of each, and bins of a row
that take unlike times; in both models.
"""

import statistics

import pytest
from stage import Driven, Stage, empty_orchard

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.geometry import Twist
from orchard.field.layout import Layout, lay_out
from orchard.field.picking import bin_speed_of, picker_speed_of
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse, with_changes
from orchard.local import Local
from orchard.report.bounds import Bounds

# Two alike pickers of two rows each.
CREW = empty_orchard(
    rows=4, pickers=2, carriers=2, row_length=20.0, picking_rate=40.0, bins_per_row=1.0
)
SPREAD = {"spread_of_pickers": {"distribution": "gamma", "cv": 0.3}}
# Two bins fill in a row, and a third one in it and the next.
ALIKE_BINS = {"spread_of_bins": {"distribution": "none"}}
UNLIKE_BINS = empty_orchard(
    rows=4,
    pickers=2,
    carriers=2,
    row_length=40.0,
    picking_speed=0.3,
    metres_per_bin=15.0,
    picking={"spread_of_bins": {"distribution": "gamma", "cv": 0.4}},
)


def speeds(layout: Layout) -> dict[str, list[float]]:
    """Return the speeds of the rows of each picker."""
    by_picker = {}
    for name, block in layout.blocks.items():
        by_picker[name] = [layout.lane(row).picking_speed for row in block.rows]
    return by_picker


def test_a_slow_picker_picks_its_rows_slowly() -> None:
    usual = speeds(lay_out(CREW))
    slow = speeds(lay_out(with_changes(CREW, picker_rates={"picker_02": 0.5})))
    assert slow["picker_01"] == usual["picker_01"]
    assert slow["picker_02"] == pytest.approx([speed / 2 for speed in usual["picker_02"]])


def test_a_crew_with_a_slow_picker_has_a_lower_limit() -> None:
    """Of two pickers one at half the rate leaves 75 % of the bins an hour; the way from row to row
    takes both as long as before, so it is not exactly that.
    """
    usual = Bounds(lay_out(CREW)).terms["pickers"]
    crew = Bounds(lay_out(with_changes(CREW, picker_rates={"picker_02": 0.5}))).terms["pickers"]
    assert 0.7 * usual < crew < 0.85 * usual


def test_a_picker_has_one_speed_in_all_of_its_rows() -> None:
    by_picker = speeds(lay_out(with_changes(CREW, picking=SPREAD)))
    for of_rows in by_picker.values():
        assert len(set(of_rows)) == 1
    assert by_picker["picker_01"] != by_picker["picker_02"]


@pytest.mark.parametrize("distribution", ["lognormal", "gamma", "uniform"])
def test_picking_times_of_pickers_have_the_mean_and_the_cv(distribution: str) -> None:
    spread = {"distribution": distribution, "cv": 0.2}
    times = []
    for seed in range(2000):
        crew = CREW.model_copy(
            update={
                "seed": seed,
                "picking": with_changes(CREW, picking={"spread_of_pickers": spread}).picking,
            }
        )
        times.append(1.0 / picker_speed_of(crew, "picker_01"))
    # Of 2,000 draws with a deviation of 0.2 the mean has a standard error of 0.45 %, and the
    # deviation one of about 2 %: four of each are allowed.
    usual = 1.0 / CREW.mean_picking_speed
    assert statistics.fmean(times) == pytest.approx(usual, rel=0.02)
    assert statistics.stdev(times) == pytest.approx(0.2 * usual, rel=0.08)


@pytest.mark.parametrize(
    "changes", [{"picker_rates": {"picker_02": 0.5}}, {"picking": SPREAD}], ids=["rate", "spread"]
)
def test_both_models_agree_on_a_crew_that_differs(changes: dict) -> None:
    crew = with_changes(CREW, **changes)
    run = Local(crew)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested"
    fast = DiscreteHarvest(lay_out(crew)).run()
    usual = DiscreteHarvest(lay_out(CREW)).run()
    assert fast.seconds == pytest.approx(run.engine.world.seconds, rel=0.002)
    assert abs(fast.seconds - usual.seconds) > 5.0, "the crew is another one"


def bin_speeds(layout: Layout, picker: str) -> dict[int, set[float]]:
    """Return the speeds at which a picker fills each of its bins, by the bin's number."""
    speeds_of_bins: dict[int, set[float]] = {}
    for current in layout.passes(layout.blocks[picker]):
        speeds_of_bins.setdefault(current.bin_number, set()).add(layout.speed_on(current))
    return speeds_of_bins


def test_bins_of_a_row_take_unlike_times() -> None:
    """A bin that fills in two rows has one speed, because the rows are alike here."""
    filled = bin_speeds(lay_out(UNLIKE_BINS), "picker_01")
    assert all(len(of_bin) == 1 for of_bin in filled.values())
    assert len(set.union(*filled.values())) == len(filled)


def test_picking_times_of_bins_have_the_mean_and_the_cv() -> None:
    usual = UNLIKE_BINS.mean_picking_speed
    times = []
    for number in range(1, 2001):
        times.append(1.0 / bin_speed_of(UNLIKE_BINS, "picker_01", number, usual))
    assert statistics.fmean(times) == pytest.approx(1.0 / usual, rel=0.02)
    assert statistics.stdev(times) == pytest.approx(0.4 / usual, rel=0.08)


@pytest.mark.parametrize("order", ["onward", "outward"])
@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_both_models_agree_on_bins_that_differ(order: str, dispatch: str) -> None:
    orchard = with_changes(UNLIKE_BINS, order_in_row=order, dispatch=dispatch)
    run = Local(orchard)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested"
    fast = DiscreteHarvest(lay_out(orchard)).run()
    alike = DiscreteHarvest(lay_out(with_changes(orchard, picking=ALIKE_BINS))).run()
    assert fast.seconds == pytest.approx(run.engine.world.seconds, rel=0.002)
    assert abs(fast.seconds - alike.seconds) > 5.0, "unlike bins make another harvest"


@pytest.mark.parametrize("picker", ["picker_01", "picker_02"])
def test_a_picker_that_hurries_picks_no_bin_faster(picker: str) -> None:
    """Physics keeps to the speed of the part of the row in which a picker is."""
    stage = Stage(UNLIKE_BINS, **{picker: Driven(Twist(x=1.0))})
    layout = stage.world.layout
    block = layout.blocks[picker]
    first = layout.passes(block)[0]
    begin = layout.lane(first.row).west
    assert (block.start, first.begin) == ("west", begin)
    took = stage.run_until(lambda: stage.pose(picker)[0] >= begin + 10.0)
    assert took == pytest.approx(10.0 / layout.speed_on(first), abs=0.1)


# A line of a scenario, and words of the error.
MISTAKES = [
    (
        "picking: {spread_of_bins: {cv: 0.2}}",
        "has no effect: all bins of a row fill alike while the distribution is none",
    ),
    ("picker_rates: {picker_09: 0.5}", "must be pickers that there are, picker_01 to picker_02"),
    ("picker_rates: {anna: 0.5}", "picker_rates.anna: not the name of a picker"),
    ("picker_rates: {picker_01: fast}", "must be a number from 0.05 to 20: the share"),
    ("picker_rates: [0.5]", "must be a map of pickers and their rates"),
    ("picker_absences: {picker_09: [[0, 1]]}", "must be pickers that there are, picker_01"),
    ("picker_absences: {anna: [[0, 1]]}", "picker_absences.anna: not the name of a picker"),
    ("picker_absences: {picker_01: 3}", "must be pairs of hours of work, from and to"),
    ("picker_absences: {picker_01: [[0, x]]}", "must be pairs of hours of work, from and to"),
    ("picker_absences: {picker_01: [[2, 1]]}", "picker_01: must be pairs of hours that go on"),
    ("picker_absences: {picker_01: [[0, 2], [1, 3]]}", "must be pairs of hours that go on"),
    ("picker_rates: {picker_01: 2}", "a picker goes 0.001 to 1 m/s"),
    (
        "picking: {spread_of_pickers: {distribution: gamma}}",
        "the distribution must be none at this picking_speed",
    ),
    (
        "picking: {spread_of_pickers: {cv: 0.2}}",
        "has no effect: all pickers are alike while the distribution is none",
    ),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_a_crew_that_cannot_be_is_told(text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(text, "my.yaml")
    assert words in str(error.value)
    assert str(error.value).startswith("my.yaml")


def test_a_crew_that_differs_is_work_that_the_seed_draws() -> None:
    assert with_changes(CREW, picking=SPREAD).work_is_drawn
    assert not with_changes(CREW, picker_rates={"picker_01": 0.5}).work_is_drawn
    assert not Scenario().work_is_drawn


def test_an_empty_map_makes_all_pickers_alike_again() -> None:
    """A map that is not empty changes only the pickers that it names."""
    slow = with_changes(CREW, picker_rates={"picker_01": 0.5})
    assert with_changes(slow, picker_rates={}) == CREW
    assert with_changes(slow, picker_rates={"picker_02": 0.5}).picker_rates == {
        "picker_01": 0.5,
        "picker_02": 0.5,
    }
