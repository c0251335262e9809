"""Which settings a study has: what may vary, what each setting costs, whether chance plays a part
in it, and what a study cannot answer.

A setting is a combination of the values that vary.
"""

from pathlib import Path

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.study import settings
from orchard.study.checking import checked_settings
from orchard.study.options import StudyOptions
from orchard.study.settings import Setting, varied_of
from orchard.study.study import study


def problems(
    *words: str, scenario: Scenario | None = None, options: StudyOptions | None = None
) -> list[str]:
    """Return what is wrong with a study. `words`: what a user gives to --vary."""
    varied, faults = varied_of(words)
    return [
        *map(str, faults),
        *map(str, checked_settings(scenario or Scenario(), varied, options or StudyOptions())[1]),
    ]


def settings_of(scenario: Scenario, varied: dict) -> list[Setting]:
    found, wrong = settings.settings_of(scenario, varied)
    assert not wrong
    return found


def test_values_are_numbers_words_and_ranges() -> None:
    words = (
        "carriers=1..3,null",
        "rows=10..20..5",
        "picking_speed=0.03,1",
        "dispatch=nearest,my.Own",
        "tractor=false,true",
    )
    varied, faults = varied_of([*words, 'people={"workers": 0, "visitors": 1},{}'])
    assert not faults
    assert varied == {
        "carriers": [1, 2, 3, None],
        "rows": [10, 15, 20],
        "picking_speed": [0.03, 1],
        "dispatch": ["nearest", "my.Own"],
        "tractor": [False, True],
        "people": [{"workers": 0, "visitors": 1}, {}],
    }


def test_each_combination_is_a_setting_and_a_scenario() -> None:
    assert [setting.values for setting in settings_of(Scenario(), {})] == [{}]
    found = settings_of(Scenario(rows=10), {"people.workers": [0, 4], "carriers": [3, 4]})
    assert [setting.words for setting in found] == [
        f"people.workers={w}, carriers={c}" for w in (0, 4) for c in (3, 4)
    ]
    assert found[1].scenario == with_changes(Scenario(rows=10), carriers=4, **{"people.workers": 0})


# What a user gives to --vary, and the beginning of the answer.
MISTAKES = [
    (
        ["carriers=0..5"],
        "--vary carriers=0..5: carriers = 0: must be null or a whole number from 1 to 120",
    ),
    (["carrier=1..3"], "--vary carrier=1..3: carrier: unknown key; did you mean carriers?"),
    (["carriers=5..1"], "--vary carriers=5..1: 5..1: this range is empty"),
    (["carriers=1..9..0"], "--vary carriers=1..9..0: 1..9..0: this range is empty"),
    (["pickers"], "--vary pickers: must be KEY=VALUE"),
    (["carriers=1,,2"], "--vary carriers=1,,2: must be KEY=VALUE"),
    (["=1"], "--vary =1: must be KEY=VALUE"),
    (["carriers=1..3,2"], "--vary carriers=1..3,2: 2: given twice"),
    (["carriers=1,2", "carriers=3"], "--vary carriers=3: carriers: this key varies already"),
    (["rows=1..999999999"], "--vary rows=1..999999999: 1..999999999: more than 10,000 values"),
    (
        ["rows=3..20", "pickers=2..20", "carriers=1..40"],
        "--vary rows, pickers, carriers: 13,680 settings; at most 10,000",
    ),
    (["seed=1..5"], "--vary seed=1..5: seed: each replication has its own seed"),
    (
        ["prices.per_bin=-1,2"],
        "--vary prices.per_bin=-1,2: prices.per_bin = -1: must be null or a number from 0.0",
    ),
    (
        ["picking_speed=NaN"],
        "--vary picking_speed=nan: picking_speed = nan: must be null or a number from 0.001 to 1.0",
    ),
    (
        ["picking_rate=20", "picking_speed=0.3,0.5"],
        (
            "the setting picking_rate=20, picking_speed=0.3: picking_speed = 0.3, picking_rate ="
            " 20.0: at"
        ),
    ),
    (
        ["rows=3,4", "pickers=4", "dispatch=nearest,predictive"],
        (
            "the setting rows=3, pickers=4, dispatch=nearest: pickers = 4, rows = 3: must be at"
            " most one picker a row"
        ),
    ),
]


@pytest.mark.parametrize(("words", "told"), MISTAKES)
def test_mistakes_are_told_with_their_place(words: list[str], told: str) -> None:
    (found,) = problems(*words)
    assert found.startswith(told)


def test_all_mistakes_are_told_at_once() -> None:
    assert len(problems("carriers=0..2", "rows=2,3", "dispach=nearest")) == 3
    assert len(problems("tractor", "rows=3..2", "pickers=2", "pickers=3")) == 3
    of_each_kind = problems(
        "tractor", "rows=2,3", "dispatch=no_such.Policy", options=StudyOptions(goal="cost_per_bin")
    )
    assert [line.split(":")[0] for line in of_each_kind] == [
        "--vary tractor",
        "--vary rows=2,3",
        "--goal cost_per_bin",
        "rows=3, dispatch=no_such.Policy",
    ]


def test_a_bin_costs_its_share_of_the_hour_and_its_own_price() -> None:
    prices = {
        "picker_per_hour": 15.0,
        "carrier_per_hour": 6.0,
        "overhead_per_hour": 10.0,
        "per_bin": 2.0,
    }
    (setting,) = settings_of(Scenario(pickers=4, rows=8, carriers=5, prices=prices), {})
    assert setting.cost_per_bin(50.0) == pytest.approx((4 * 15 + 5 * 6 + 10) / 50 + 2)
    assert settings_of(Scenario(), {})[0].cost_per_bin(50.0) is None


def test_what_a_study_cannot_answer_is_refused_all_at_once() -> None:
    own = Scenario(agents={"picker": "own_agents.Eastward"})
    assert problems(
        scenario=own, options=StudyOptions(goal="cost_per_bin", horizon="long", model="fast")
    ) == [
        (
            "--goal cost_per_bin: prices: needs a price: picker_per_hour, carrier_per_hour,"
            " overhead_per_hour or per_bin"
        ),
        (
            "--model fast: agents: only the full model knows agents of your own (picker); choose"
            " --model full"
        ),
    ]
    (no_errors,) = problems(scenario=Scenario(sensors={"odometry": {"distance": 0.01}}))
    assert (
        no_errors
        == "--model both: sensors: only the full model knows errors of sensors; choose --model full"
    )
    own_step = problems(scenario=Scenario(route="examples.seams.signalled_route.SignalledRoute"))
    assert own_step == [
        "--model both: route = examples.seams.signalled_route.SignalledRoute: only the full model"
        " knows steps of your own (Signal); choose --model full"
    ]
    (no_end,) = problems(options=StudyOptions(goal="harvest_seconds", horizon="long"))
    assert "a long run has no end" in no_end
    (no_long_run,) = problems(options=StudyOptions(horizon="long", model="full"))
    assert "only the fast model can tell the long run" in no_long_run


def test_a_study_with_problems_does_not_begin() -> None:
    with pytest.raises(ScenarioError, match=r"dispatch = no_such\.Policy: cannot be used"):
        study(Scenario(), {"dispatch": ["nearest", "no_such.Policy"]}, StudyOptions())


def test_chance_needs_people_animals_spread_failures_or_noise() -> None:
    quiet = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}}
    changes = [
        {},
        {"people.visitors": 1},
        {"animals.cats": 1},
        {"picking_speed": 0.5, "picking.spread.distribution": "gamma"},
        {"picking.failure.mean_between": 600.0},
        {"carrying.failure.mean_between": 600.0},
        {"laser.noise": 0.01},
    ]
    random = [
        settings_of(with_changes(Scenario(**quiet), **change), {})[0].is_random
        for change in changes
    ]
    assert random == [False, True, True, True, True, True, True]


def test_a_policy_of_the_users_own_may_draw_by_the_seed() -> None:
    undisturbed = load_or_shipped(Path("undisturbed"))
    assert [
        setting.is_random
        for setting in settings_of(undisturbed, {"dispatch": ["nearest", "my.Own"]})
    ] == [False, True]


def test_a_long_run_with_a_picker_away_is_refused():
    away = Scenario(picker_absences={"picker_01": [[0.0, 1.0]]})
    (problem,) = checked_settings(away, {}, StudyOptions())[1]
    assert "choose --horizon harvest" in problem.text
    assert checked_settings(away, {}, StudyOptions(horizon="harvest"))[1] == []


def test_impossible_settings_are_left_out_and_named() -> None:
    """A truck that takes 30 bins would never leave with the 20 that there are."""
    load_out = {"empty_bins": 20, "truck": {"every": 1200.0, "bins": 10}}
    farm = Scenario(
        rows=3,
        row_length=20.0,
        pickers=2,
        carriers=1,
        people={"workers": 0, "visitors": 0},
        animals={"dogs": 0, "cats": 0},
        tractor=False,
        dispatch="nearest",
        load_out=load_out,
    )
    varied = {"load_out.truck.bins": [10, 20, 30, 40]}
    found = study(farm, varied, StudyOptions(model="fast", horizon="harvest", workers=1))
    assert [row.setting["load_out.truck.bins"] for row in found.table] == [10, 20]
    names = "load_out.truck.bins=30; load_out.truck.bins=40"
    assert f"impossible, and not in the table: 2 settings, {names}" in found.notes
    assert (
        "the setting load_out.truck.bins=30: load_out.truck.bins = 30, load_out.empty_bins = 20:"
        " never fills: must be at most empty_bins, all bins that stand at the bay; lower it, or"
        " raise empty_bins"
    ) in found.notes


def test_a_study_without_a_possible_setting_is_refused() -> None:
    with pytest.raises(ScenarioError, match="must be at most one picker a row"):
        study(Scenario(), {"rows": [3], "pickers": [4, 5]})


def test_a_value_that_is_wrong_alone_is_refused() -> None:
    """It is a slip, and not a combination that cannot be."""
    with pytest.raises(ScenarioError, match="carriers = 0"):
        study(Scenario(), {"carriers": [0, 1, 2]})
