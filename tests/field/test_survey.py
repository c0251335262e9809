"""Orchards with surveyed rows: what they look like, what is refused, and that they are harvested to
the end on both routes.
"""

from statistics import fmean

import pytest
from bare_world import overlapping_starts
from hypothesis import given, settings
from made_surveys import UNEQUAL, Row, orchard_of, rows
from stage import Stage

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.queue import ONE_WAY, TWO_WAY
from orchard.field.scenario import Scenario, check, parse, to_short_yaml, to_yaml, with_changes
from orchard.report.bounds import Bounds, schedule_seconds
from orchard.report.plan import orchard_plan, present_plan


@settings(max_examples=20)
@given(rows())
def test_surveyed_rows_lie_as_surveyed_without_overlaps(drawn: list[Row]):
    layout = lay_out(orchard_of(drawn))
    assert overlapping_starts(layout) == []
    first = layout.lane(1).y
    for row, lane in zip(drawn, layout.lanes, strict=True):
        assert (first - lane.y, lane.west - ROW_WEST, lane.length) == pytest.approx(row, abs=1e-9)
        # The lines of trees next to the lane. Trees are half a metre thick.
        north = min((line for line in layout.lines if line.y > lane.y), key=lambda line: line.y)
        south = max((line for line in layout.lines if line.y < lane.y), key=lambda line: line.y)
        # 1 nm, and 1 um below, are for the last bits only.
        assert south.y + 0.25 + lane.width / 2 <= lane.y + 1e-9
        assert lane.y + lane.width / 2 + 0.25 <= north.y + 1e-9
        assert min(north.west, south.west) <= lane.west
        assert lane.east <= max(north.east, south.east)
        # The first tree stands 1 m or more from the west end, the last one 3 m from the east end.
        for line in (north, south):
            for x in line.trees_x:
                assert line.west + 1.0 - 1e-6 <= x <= line.east - 3.0 + 1e-6


def test_where_rows_are_missing_each_side_has_trees_of_its_own():
    """Two rows of six metres are missing, and no line of trees stands in the middle of the gap.

    Each line of trees is 3 m, half a row, from a row. Between two rows it begins with the one that
    begins further west. `lines`: how far each is south of the first row, and where it begins, m.
    """
    rows = [Row(0.0, 0.0, 60.0), Row(6.0, 3.0, 57.0), Row(24.0, 10.0, 50.0), Row(30.0, 12.0, 48.0)]
    layout = lay_out(orchard_of(rows))
    first = layout.lane(1).y
    lines = [(round(first - line.y, 6), line.west - ROW_WEST) for line in layout.lines]
    assert lines == [(-3.0, 0.0), (3.0, 0.0), (9.0, 3.0), (21.0, 10.0), (27.0, 10.0), (33.0, 12.0)]
    assert [lane.width for lane in layout.lanes] == pytest.approx([5.5] * 4)


def test_a_missing_close_row_leaves_two_lines_of_trees():
    """Rows are 4 m apart, and the third one is missing: two lines stand where its trees were."""
    rows = [Row(south, 0.0, 40.0) for south in (0.0, 4.0, 12.0, 16.0)]
    layout = lay_out(orchard_of(rows))
    first = layout.lane(1).y
    assert [first - line.y for line in layout.lines] == pytest.approx([-2, 2, 6, 10, 14, 18])


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
def test_a_slanted_block_with_missing_rows_is_harvested(route: str):
    """The ends are slanted by 45 degrees. The roads are straight, so robots drive on to them."""
    souths = [0.0, 4.0, 8.0, 24.0, 28.0]
    rows = [Row(south, south, 30.0) for south in souths]
    stage = Stage(orchard_of(rows, pickers=2, carriers=2, route=route, dispatch="predictive"))
    stage.run_until(lambda: stage.local.engine.over, 1500)
    stage.assert_no_collisions()
    assert stage.world.delivered == len(rows)


def test_equal_rows_by_survey_are_those_without_one():
    """By default rows are 5.5 m apart."""
    alike = Scenario(rows=4, row_length=42.5, seed=3)
    surveyed = [{"id": str(i), "south": 5.5 * i, "start": 0.0, "length": 42.5} for i in range(4)]
    plain = lay_out(alike)
    other = lay_out(check({"rows": 4, "row_length": 42.5, "seed": 3, "survey": {"rows": surveyed}}))
    assert other.lanes == plain.lanes
    assert other.lines == plain.lines
    assert other.starts == plain.starts
    assert (other.walls == plain.walls).all()


@pytest.mark.parametrize(("route", "rule"), [(ONE_WAY, "balanced"), (TWO_WAY, "balanced-ends")])
def test_surveyed_rows_are_harvested_to_the_end(route: str, rule: str):
    # With `predictive` no two choices are nearly as good here, so both models choose the same.
    stage = Stage(
        orchard_of(
            UNEQUAL, pickers=2, carriers=2, route=route, rows_to_pickers=rule, dispatch="predictive"
        )
    )
    stage.run_until(lambda: stage.local.engine.over, 900)
    stage.assert_no_collisions()
    assert stage.world.row_picked.tolist() == [row.length for row in UNEQUAL]
    assert stage.world.delivered == len(UNEQUAL)
    schedule = schedule_seconds(stage.world.layout)
    fast = DiscreteHarvest(stage.world.layout).run().seconds
    assert schedule == pytest.approx(stage.seconds, rel=0.1)
    assert fast == pytest.approx(stage.seconds, rel=0.01)


def test_a_short_row_fills_its_bin_and_takes_its_own_time():
    """At 0.5 m/s each metre takes 2 s."""
    layout = lay_out(orchard_of(UNEQUAL, picking_speed=0.5))
    assert [
        layout.picking_seconds(lane.number, lane.length) for lane in layout.lanes
    ] == pytest.approx([2 * row.length for row in UNEQUAL])
    pickers = 4
    assert Bounds(layout).picking_seconds == pytest.approx(
        2 * sum(row.length for row in UNEQUAL) / pickers
    )


def test_a_rate_with_a_bin_a_row_is_that_of_the_mean_row():
    """60 bins an hour are one in 60 s."""
    layout = lay_out(orchard_of(UNEQUAL, picking_rate=60.0))
    assert fmean(
        layout.picking_seconds(lane.number, lane.length) for lane in layout.lanes
    ) == pytest.approx(60.0)
    assert orchard_of(UNEQUAL, bins_per_row=2.0).bin_metres == pytest.approx(
        layout.mean_length / 2.0
    )


def test_the_plan_shows_each_row_at_its_place():
    """The drawing has 12 units a metre; a row is a strip of its length, 24 units high. The four
    rows are 104.5 m long in all.
    """
    stage = Stage(orchard_of(UNEQUAL))
    for lane in stage.world.layout.lanes:
        assert f'width="{round(12 * lane.length, 2)}" height="24.0"' in orchard_plan(
            stage.world.layout
        )
    assert "of 104 m picked" in present_plan(stage.world)


def problem(change: dict) -> str:
    """Return the error of a scenario with this change."""
    scenario = orchard_of(UNEQUAL).model_dump()
    with pytest.raises(ScenarioError) as raised:
        check(scenario | change)
    return str(raised.value)


def changed(number: int, **values: float | str) -> dict:
    """Return a survey in which a row has other values."""
    listed = orchard_of(UNEQUAL).model_dump()["survey"]["rows"]
    return {
        "survey": {
            "rows": [row | values if i == number else row for i, row in enumerate(listed, start=1)]
        }
    }


def far_apart() -> dict:
    """Return rows of which no two are neighbours."""
    listed = orchard_of(UNEQUAL).model_dump()["survey"]["rows"]
    return {"survey": {"rows": [row | {"south": 20.0 * i} for i, row in enumerate(listed)]}}


# What differs from the survey of UNEQUAL, and words of the error.
NO_SURVEYS = [
    ({"rows": 5}, "rows = 5: must be 4"),
    (
        {"row_length": 70.0, "row_width": 6.0},
        "row_length = 70.0, row_width = 6.0: must be 31.2 and 5",
    ),
    (changed(2, south=3.6), "r2: lies 3.60 m south of row r1; must be 3.65 to 60 m"),
    (changed(3, south=65.4), "r3: lies 60.10 m south of row r2; must be 3.65 to 60 m"),
    (
        far_apart(),
        "r1: has no neighbour, and neither has any other row: two neighbours must be at most 12.5",
    ),
    (changed(3, south=18.0), "r4: lies 0.60 m south of row r3"),
    (changed(1, south=1.0), "r1: is the first, and lies 1 m south of it; its south must be 0"),
    (changed(1, start=0.5), "r1: is the westernmost, and starts at 0.5 m; its start must be 0"),
    (changed(3, length=399.5), "r3: ends 400.50 m east of the westernmost end; must be at most"),
    (changed(2, id="r1"), "r1: the name of two rows; each needs its own"),
    (changed(2, length=19.9), "survey.rows.1.length = 19.9: must be a number from 20.0 to 400.0"),
    (changed(2, start=401.0), "survey.rows.1.start = 401.0: must be a number from 0.0 to 400.0"),
    (changed(2, lenght=25.0), "survey.rows.1.lenght = 25.0: unknown key; did you mean length?"),
    ({"survey": {}}, "survey.rows: is missing: a list of 3 to 100 maps"),
    (
        {"survey": {"rows": [1, 2, 3]}},
        "survey.rows.0 = 1: must be a map with some of the keys id, south, start, length",
    ),
]


@pytest.mark.parametrize(("change", "words"), NO_SURVEYS)
def test_an_impossible_survey_is_refused_with_row_and_limit(change: dict, words: str):
    assert words in problem(change)


def test_all_faults_are_told_at_once_with_their_lines():
    """A row is too short, one has no `south`, a key is unknown, and there are no pickers."""
    text = (
        to_short_yaml(orchard_of(UNEQUAL))
        .replace("length: 29.0", "length: 2")
        .replace("south: 13.1, ", "")
        + "seeed: 3\npickers: 0\n"
    )
    with pytest.raises(ScenarioError) as raised:
        parse(text, "mine.yaml")
    lines = text.splitlines()
    for word, path in (
        ("r1,", "survey.rows.0.length"),
        ("r3,", "survey.rows.2.south"),
        ("seeed", "seeed"),
        ("pickers: 0", "pickers"),
    ):
        line = next(number for number, line in enumerate(lines, start=1) if word in line)
        assert f"mine.yaml:{line}: {path}" in str(raised.value)


def test_a_change_that_the_survey_contradicts_is_refused():
    with pytest.raises(ScenarioError, match="rows = 7: must be 4"):
        with_changes(orchard_of(UNEQUAL), rows=7)


@pytest.mark.parametrize("write", [to_yaml, to_short_yaml])
def test_a_surveyed_scenario_is_read_as_it_was_written(write):
    scenario = orchard_of(UNEQUAL, pickers=3)
    assert parse(write(scenario)) == scenario
