"""What a result hangs on: which values are moved, what they share of the variance, and in words.

A sensitivity moves several values of a scenario at once, each within its range, and runs each point
of such values. A quadratic is fitted to the results. The first-order share of a value is the part
of the variance that it brings alone, and the total share the part that it takes part in. The rest
is the luck of the seed, and what the fit does not tell.
"""

import csv
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from few_runs import FewRuns
from stage import empty_orchard

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse, with_changes
from orchard.study.command_options import StudyArguments
from orchard.study.kinds_of_files import REPORT, TABLE
from orchard.study.options import StudyOptions
from orchard.study.result import Interval
from orchard.study.sensitivity import command
from orchard.study.sensitivity import study as module
from orchard.study.sensitivity.factors import Factor, factors_of
from orchard.study.sensitivity.files import save_csv, save_report
from orchard.study.sensitivity.picture import figure, save
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.study import sensitivity, sensitivity_problems
from orchard.study.sensitivity.surrogate import design, points_for, shares_of
from orchard.study.sensitivity.words import answer, rows_of

RENT = """\
rows: 26
pickers: 8
picking_rate: 1.5
bins_per_row: 6
picking: {spread: {distribution: lognormal, cv: 0.28}}
handling: {unloading: 40}
"""
# Two values that are moved, each between two ends: m/s, and m.
A = Factor(key="carrying.speed", low=0.8, high=1.2)
B = Factor(key="bay", low=0.0, high=8.0)


def ranges(*words: str, scenario: Scenario | None = None) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest value of each key that is moved.

    `words`: what a user gives to --vary; without any, the usual values are moved.
    """
    factors, problems = factors_of(scenario or parse(RENT), words)
    assert not problems
    return {factor.key: (factor.low, factor.high) for factor in factors}


def test_values_are_moved_by_shares_of_their_own() -> None:
    """Rates are moved by 20 %, bins by 15 %, spreads and times by 30 %, speeds and the width of
    rows by 10 %.

    The scenario leaves the number of carriers open. It is six then, and is moved by one.
    """
    assert ranges() == {
        "picking_rate": (1.2, 1.8),
        "bins_per_row": (5.1, 6.9),
        "picking.spread.cv": (0.196, 0.364),
        "picking.driving_speed": (0.9, 1.1),
        "carriers": (5, 7),
        "carrying.speed": (0.9, 1.1),
        "handling.unloading": (28.0, 52.0),
        "row_width": (4.5, 5.5),
    }


def test_the_spacing_of_surveyed_rows_is_not_moved() -> None:
    """It was measured. These three rows are 5.5 m apart."""
    rows = []
    for number in range(3):
        rows.append({"id": str(number), "south": 5.5 * number, "start": 0.0, "length": 60.0})
    surveyed = Scenario(rows=3, row_length=60.0, pickers=2, survey={"rows": rows})
    assert "row_width" not in ranges(scenario=surveyed)


def test_a_scenario_with_very_many_values_moves_sixteen() -> None:
    """The width of rows is the last of them, and stays."""
    spreads = {"distribution": "lognormal", "cv": 0.2}
    failure = {"mean_between": 3600.0}
    crowded = with_changes(
        parse(RENT),
        picking={
            "spread": spreads,
            "spread_of_pickers": spreads,
            "spread_of_bins": spreads,
            "failure": failure,
        },
        carrying={"failure": failure, "battery": {"hours": 4.0}},
        handling={"coupling": 2.0, "uncoupling": 2.0, "exchange": 2.0, "unloading": 40.0},
        load_out={"empty_bins": 40, "truck": {"every": 3600.0, "bins": 20}},
    )
    moved = ranges(scenario=crowded)
    assert len(moved) == 16
    assert "row_width" not in moved


def test_a_share_or_a_range_of_a_value_can_be_named() -> None:
    assert ranges("picking_rate=1..2.5", "carriers=50%", "carrying.speed", "weeds=0..4") == {
        "picking_rate": (1.0, 2.5),
        "carriers": (3, 9),
        "carrying.speed": (0.9, 1.1),
        "weeds": (0, 4),
    }


def test_the_rate_of_one_picker_can_be_moved() -> None:
    assert ranges("picker_rates.picker_01=0.5..1", "picker_rates.picker_02=20%") == {
        "picker_rates.picker_01": (0.5, 1.0),
        "picker_rates.picker_02": (0.8, 1.2),
    }


def test_a_share_ends_at_what_a_value_can_be() -> None:
    assert ranges("handling.coupling=50%") == {"handling.coupling": (0.2, 0.3)}


def test_each_number_of_things_has_the_same_chance() -> None:
    carriers = Factor(key="carriers", low=5, high=7, is_whole=True)
    values = [carriers.value(share) for share in np.linspace(0.0, 1.0, 300)]
    assert [values.count(number) for number in (5, 6, 7)] == [100, 100, 100]


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("", "must be KEY"),
        ("picking_rat", "did you mean picking_rate?"),
        ("seed=1..9", "the luck of the seed is told in any case"),
        ("dispatch=nearest,rolling", "only a number can be moved"),
        ("tractor=0..1", "only a number can be moved"),
        ("picking", "only a number can be moved"),
        ("agents.picker_01=1..2", "only a number can be moved"),
        ("shift.breaks.0=1..2", "only a number can be moved"),
        ("survey.lanes=1..2", "only a number can be moved"),
        ("sensors.rate=1..2", "unknown key"),
        ("picking.spread.cv.more=1..2", "only a number can be moved"),
        ("picker_rates.picker_01=0..1", "must lie between 0.05 and 20"),
        ("picking.spread_of_pickers.cv=0.1..0.4", "has no effect"),
        ("picking.failure.mean_repair=60..90", "set picking.failure.mean_between"),
        ("chargers=1..3", "has no effect"),
        ("picking_rate=2..1", "this range is empty"),
        ("picking_rate=1,2", "must be KEY"),
        ("picking_rate=100%", "above 0 % and below 100 %"),
        ("picking_rate=0..1", "must lie between 0.1 and 60"),
        ("carriers=1.5..3", "must be whole numbers"),
        ("handling.exchange", "it is 0, and a share of 0 is 0"),
        ("load_out.seconds_away", "it is not set"),
    ],
)
def test_what_cannot_be_moved_is_told(word: str, text: str) -> None:
    factors, problems = factors_of(parse(RENT), [word])
    assert not factors
    assert f"--vary {word}" in str(problems[0])
    assert text in str(problems[0])


def test_one_value_is_not_moved_twice() -> None:
    _, problems = factors_of(parse(RENT), ["weeds=1..2", "weeds=1..3"])
    assert "moved already" in str(problems[0])
    _, problems = factors_of(Scenario(), ["picking_rate=2..3", "picking_speed=0.1..0.2"])
    assert "picking_rate says the same in another way" in str(problems[0])


def test_ranges_that_cannot_be_together_are_told() -> None:
    """A row fills one bin, so a picker would go faster than it can."""
    scenario = with_changes(parse(RENT), bins_per_row=None)
    factors, problems = factors_of(scenario, ["picking_rate=50..60"])
    assert not problems
    with pytest.raises(ScenarioError, match=r"picking_rate.*a picker goes"):
        sensitivity(scenario, factors)


def test_points_whose_values_cannot_be_together_are_left_out(found) -> None:
    """A picker drives at 0.9 to 1.1 m/s, and picks no faster than it drives."""
    result = found(small_orchard(), "picking_speed=0.7..0.98", "picking.driving_speed=0.9..1.1")
    left_out = result.points_asked - result.points
    assert 0 < left_out < result.points_asked / 10
    words = f"{left_out} of {result.points_asked} points are left out"
    assert any(words in note and "picking_speed" in note for note in result.notes)


def test_an_end_of_a_range_that_is_wrong_alone_is_told() -> None:
    """Few points come so near to the end, which the user has named all the same."""
    scenario = with_changes(small_orchard(), picking_speed=0.52)
    factors, problems = factors_of(scenario, ["picking.driving_speed=0.5..0.9"])
    assert not problems
    with pytest.raises(ScenarioError, match=r"picking_speed = 0\.52"):
        sensitivity(scenario, factors)


def test_a_sensitivity_is_of_the_fast_model() -> None:
    problems = sensitivity_problems(parse(RENT), [A], StudyOptions(model="full"))
    assert "by the fast model" in str(problems[0])


def test_shares_are_those_of_a_sum_with_luck() -> None:
    """The results are 100 + a + b + a b + luck, with a, b and the luck between -1 and 1.

    These parts have the variances 1/3, 1/3, 1/9 and 1/3. So the first-order share of a has 1/3 of
    their sum, and its total share 1/3 + 1/9. `ends` are the results at the ends of each range.
    """
    points = design(2, 256, seed=1)
    random = np.random.default_rng(3)
    results = []
    for a, b in 2.0 * points - 1.0:
        # Two seeds, the variance of which is 1/3.
        luck = random.uniform(-1.0, 1.0, size=2)
        results.append(list(100.0 + a + b + a * b + luck))
    shares = shares_of([A, B], points, results, 0.95, seed=1)
    assert shares is not None
    everything = 1 / 3 + 1 / 3 + 1 / 9 + 1 / 3
    for number in range(2):
        assert shares.first_order[number].mean == pytest.approx(1 / 3 / everything, abs=0.06)
        assert shares.total[number].mean == pytest.approx(4 / 9 / everything, abs=0.06)
    assert shares.luck.mean == pytest.approx(1 / 3 / everything, abs=0.06)
    assert shares.luck.low < 1 / 3 / everything < shares.luck.high
    assert shares.ends == pytest.approx(np.array([[99.0, 101.0], [99.0, 101.0]]), abs=0.3)
    assert shares.fit > 0.9


def test_what_no_quadratic_tells_is_not_fitted() -> None:
    """A sine of three periods of the first value is no quadratic. All comes from this value, so the
    interval of its share holds nearly 1.
    """
    points = design(2, 64, seed=1)
    results = [[float(np.sin(20.0 * share))] * 2 for share in points[:, 0]]
    shares = shares_of([A, B], points, results, 0.95, seed=1)
    assert shares is not None
    assert shares.fit < 0.3
    assert shares.unfitted.mean > 0.7
    assert shares.unfitted.low < shares.unfitted.mean
    assert shares.total[0].high > 0.97


def test_all_comes_from_the_only_value_that_is_moved() -> None:
    points = design(1, 64, seed=1)
    results = [[float(np.sin(20.0 * share))] * 2 for share in points[:, 0]]
    shares = shares_of([A], points, results, 0.95, seed=1)
    assert shares is not None
    assert shares.fit < 0.3
    assert shares.total[0] == shares.first_order[0] == Interval(mean=1.0, low=1.0, high=1.0)
    assert shares.unfitted.mean == shares.luck.mean == 0.0


def test_values_without_effect_may_have_none() -> None:
    """Only the seed moves these results. At 95 % confidence two of 20 samples may miss it."""
    nothing = 0
    only_luck = 0
    for seed in range(20):
        points = design(2, 32, seed)
        results = np.random.default_rng(seed).normal(100.0, 1.0, size=(32, 2))
        shares = shares_of([A, B], points, list(map(list, results)), 0.95, seed)
        assert shares is not None
        nothing += all(total.low == 0.0 for total in shares.total)
        only_luck += shares.luck.high == pytest.approx(1.0)
    assert nothing >= 18
    assert only_luck >= 18


def test_too_few_points_tell_nothing() -> None:
    """There are 32 points for each value that is moved."""
    points = design(2, 4, seed=1)
    assert shares_of([A, B], points, [[1.0, 2.0]] * 4, 0.95, seed=1) is None
    assert points_for(1) == 32
    assert points_for(8) == 256


# -- whole sensitivities, in this process


@pytest.fixture
def found(monkeypatch, tmp_path):
    """Return a function that does a sensitivity in this process, of at most `runs` runs."""

    def ask(scenario: Scenario, *words: str, runs: int = 10_000) -> SensitivityResult:
        monkeypatch.setattr(module, "processes", lambda count: nullcontext(FewRuns(runs)))
        factors, problems = factors_of(scenario, words)
        assert not problems
        options = StudyOptions(horizon="harvest", store=tmp_path / "s.db")
        return sensitivity(scenario, factors, options)

    return ask


def small_orchard(**changes: object) -> Scenario:
    return with_changes(empty_orchard(), picking_speed=0.3, **changes)


def test_nearly_all_comes_from_the_picking_speed(found, tmp_path: Path) -> None:
    """An orchard without chance has no luck, and needs one run of each of 32 points. A carrier that
    is a little slower costs little.
    """
    result = found(small_orchard(), "picking_speed=0.2..0.4", "carrying.speed=0.99..1.01")
    assert [effect.key for effect in result.effects] == ["picking_speed", "carrying.speed"]
    speed = result.effects[0]
    assert speed.at_low < result.mean < speed.at_high
    assert speed.total.mean > 0.9
    assert result.luck.mean == 0.0
    assert result.effects[1].total.mean < 0.05
    assert result.notes
    assert result.runs == result.points == 32
    assert "Nearly all of what is unsure comes from picking speed (0.2 to 0.4)" in result.answer
    save(result, tmp_path / "tornado.svg")
    drawn = (tmp_path / "tornado.svg").read_text()
    assert "picking speed" in drawn
    assert "luck of the seed" in drawn


def test_runs_that_are_known_are_not_done_again(found) -> None:
    words = ("picking_speed=0.2..0.4",)
    first = found(small_orchard(), *words)
    again = found(small_orchard(), *words, runs=0)
    assert replace(again, wall_seconds=first.wall_seconds) == first


def test_the_luck_of_the_seed_is_told(found) -> None:
    spread = {"distribution": "lognormal", "cv": 0.5}
    scenario = small_orchard(**{"picking.spread": spread, "seed": 1000})
    result = found(scenario, "carrying.speed=0.99..1.01")
    assert result.runs == 2 * result.points
    assert result.luck.mean > 0.7
    assert "of what is unsure is the luck of the seed" in result.answer


def test_a_budget_that_is_too_small_is_told(found) -> None:
    result = found(small_orchard(), "picking_speed=0.2..0.4", runs=2)
    assert not result.effects
    assert "2 points are too few" in result.answer
    assert any("the budget allowed 2 of 32 points" in note for note in result.notes)
    assert not any("narrower" in note for note in result.notes)


class EachFourthJams(FewRuns):
    """Workers of whose runs each fourth one jams."""

    def do(self, work, items, goes_on):
        for number, (item, record) in enumerate(super().do(work, items, goes_on)):
            yield item, replace(record, ended="jammed") if number % 4 == 0 else record


def test_points_that_jam_are_left_out_and_named(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(module, "processes", lambda count: nullcontext(EachFourthJams(32)))
    scenario = small_orchard()
    factors, _ = factors_of(scenario, ["picking_speed=0.2..0.4"])
    options = StudyOptions(horizon="harvest", store=tmp_path / "s.db")
    result = sensitivity(scenario, factors, options)
    assert (result.points, len(result.jammed)) == (24, 8)
    assert any("8 of 32 points jammed, and are left out" in note for note in result.notes)


# -- in words


def told(found, **changes: object) -> SensitivityResult:
    """Return what is found of two values. The larger effect comes first: carrying speed, here."""
    result = found(small_orchard(), "picking_speed=0.2..0.4", "carrying.speed=0.8..1.2")
    return replace(result, **changes)


def with_share(result: SensitivityResult, share: float) -> SensitivityResult:
    """Return a result of which the first value has this share, and the second nothing."""
    known = Interval(mean=share, low=share, high=share)
    nothing = Interval(mean=0.0, low=0.0, high=0.0)
    first = replace(result.effects[0], total=known)
    second = replace(result.effects[1], total=nothing)
    return replace(result, effects=[first, second])


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (0.95, "Nearly all"),
        (0.80, "Most"),
        (0.66, "About two thirds"),
        (0.57, "More than half"),
        (0.50, "About half"),
        (0.44, "About two fifths"),
        (0.33, "About a third"),
        (0.20, "The largest part"),
    ],
)
def test_words_of_a_share_are_near_it(found, share: float, words: str) -> None:
    assert f"{words} of what is unsure comes from carrying speed" in answer(
        with_share(told(found), share)
    )


def test_no_value_is_first_if_the_fit_tells_less(found) -> None:
    rest = Interval(mean=0.8, low=0.7, high=0.9)
    result = with_share(replace(told(found), unfitted=rest), 0.2)
    words = answer(result)
    assert "Most of what is unsure is not told by the fit, and may come from any value" in words
    assert "at least 20 ± 0 % from carrying speed" in words
    assert "largest part" not in words
    assert rows_of(result)[-1] == ["not told by the fit", "", "", "", "", "80 ± 10", "80 ± 10"]
    drawn = [label.get_text() for label in figure(result).axes[0].get_yticklabels()]
    assert drawn[-1] == "not told by the fit"


def test_a_small_part_that_no_fit_tells_is_named(found) -> None:
    rest = Interval(mean=0.1, low=0.1, high=0.1)
    words = answer(with_share(told(found, unfitted=rest), 0.9))
    assert "10 ± 0 % is not told by the fit" in words


def test_nothing_matters_if_all_results_are_alike(found) -> None:
    """A carrier that is a little slower costs less than 2 %, which is what counts."""
    result = found(small_orchard(), "carrying.speed=0.99..1.01")
    assert result.answer.startswith("Nothing that is moved matters: ")
    assert "less than 2 % apart" in result.answer


def test_no_fit_is_told_where_nothing_moves(found) -> None:
    same = Interval(mean=14.0, low=14.0, high=14.0)
    result = told(found, mean=14.0, spread=same)
    assert "whatever is moved" in answer(result)
    assert not any("the fit" in note for note in module._notes(result))


def test_a_poor_fit_tells_no_ends(found) -> None:
    """Three pickers have three to twelve rows. If the rows do not divide by three, the last round
    takes as long for one row as for three: no quadratic has such steps.
    """
    scenario = small_orchard(rows=6, pickers=3)
    result = found(scenario, "rows=3..12")
    assert result.fit < 0.9
    assert result.effects[0].total.mean == 1.0
    assert result.effects[0].at_low is result.effects[0].at_high is None
    assert rows_of(result)[0][3:5] == ["", ""]
    assert any("--vary rows=3,12" in note for note in result.notes)
    assert figure(result)


def test_the_middle_of_the_spread_is_the_mean(found) -> None:
    result = found(small_orchard(), "picking_speed=0.1..0.6")
    assert result.spread.mean == result.mean


@pytest.mark.parametrize(("stopped_by", "is_told"), [("budget", True), ("stopped", False)])
def test_only_a_short_budget_is_called_short(found, capsys, stopped_by, is_told) -> None:
    result = replace(told(found), effects=[], stopped_by=stopped_by)
    command._print(result, as_json=False)
    assert ("the budget is too short" in capsys.readouterr().err) is is_told


def test_effects_are_written_as_a_table(found, tmp_path: Path) -> None:
    result = told(found)
    path = tmp_path / "effects.csv"
    save_csv(result, path)
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [line["moved"] for line in lines[:-2]] == [effect.key for effect in result.effects]
    assert [line["moved"] for line in lines[-2:]] == ["luck of the seed", "not told by the fit"]
    assert float(lines[0]["total_mean"]) == result.effects[0].total.mean
    assert TABLE.is_kind_of(path), "else a second study could not replace the file of the first"


def test_a_report_of_a_sensitivity_has_all_of_it(found, tmp_path: Path) -> None:
    result = replace(told(found), notes=["<b>first</b>"])
    path = tmp_path / "effects.html"
    save_report(result, path)
    page = path.read_text(encoding="utf-8")
    assert result.answer in page.replace("&#39;", "'")
    assert "What is moved" in page
    assert "<svg" in page
    assert result.effects[0].key in page
    assert "&lt;b&gt;first&lt;/b&gt;" in page
    assert REPORT.is_kind_of(path)


def test_a_deadline_of_a_sensitivity_is_told_what_to_ask() -> None:
    chosen = StudyArguments(sensitivity=True, finish_within=3600.0)
    with pytest.raises(ScenarioError, match="--horizon harvest --goal harvest_seconds"):
        command._question(chosen, StudyOptions())
