"""Whole studies of small orchards: what may vary; the same table whatever the workers and whatever
was known; jams, budgets, the check.
"""

import math
import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from few_runs import FewRuns
from stage import empty_orchard

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.report.costs import PAYMENTS
from orchard.study import settings
from orchard.study import study as module
from orchard.study.checking import checked_settings
from orchard.study.comparing import LOOKS
from orchard.study.notes import StudyNotes
from orchard.study.options import StudyOptions
from orchard.study.picture import inline_svg
from orchard.study.result import StudyResult
from orchard.study.rows import row_of
from orchard.study.runs import PlannedRun
from orchard.study.settings import Setting, more_numbers, most_carriers, varied_of
from orchard.study.study import study
from orchard.study.table import heads_and_lines, legend
from orchard.study.words import setting_words


def problems(
    *words: str, scenario: Scenario | None = None, options: StudyOptions | None = None
) -> list[str]:
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


QUIET = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
CHANCE = Scenario(rows=3, picking_speed=0.5, picking={"spread": {"distribution": "gamma"}}, **QUIET)
VARIED = {"carriers": [1, 2, 3], "dispatch": ["nearest", "own_policies.Idle"]}
AMPLE = StudyOptions(
    model="fast", horizon="harvest", budget_seconds=10_000.0, within=0.05, workers=1
)


def table(result: StudyResult) -> dict:
    return asdict(replace(result, wall_seconds=0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("stores")


@pytest.fixture(scope="module")
def told() -> list[StudyResult]:
    return []


@pytest.fixture(scope="module")
def result(folder, told) -> StudyResult:
    return study(CHANCE, VARIED, replace(AMPLE, store=folder / "first.db"), told.append)


def test_the_best_is_told_with_its_interval(result):
    """The best is told with its interval and how the others stand."""
    rows = {row.setting["carriers"]: row for row in result.table if not row.jammed}
    assert result.best["dispatch"] == "nearest"
    best = rows[result.best["carriers"]]
    assert best.bins_per_hour.mean > 0.95 * max(row.bins_per_hour.mean for row in rows.values())
    assert best.bins_per_hour.low < best.bins_per_hour.mean < best.bins_per_hour.high
    assert (
        rows[1].standing == "worse" and rows[1].lead.low > 0.05
    )  # one carrier for two pickers is far too few
    assert all(
        row.standing == "equal" or row.setting in result.undecided
        for n, row in rows.items()
        if n > result.best["carriers"]
    )
    assert setting_words(result.best) in result.answer


def test_all_rows_of_a_table_have_the_same_seeds(result, told):
    """Also while it runs, and if the budget ends between two seeds."""
    for one in (result, *told):
        assert len({row.replications for row in one.table if not row.jammed}) <= 1
    assert {row.replications for row in result.table if not row.jammed} <= set(LOOKS)


def test_a_setting_that_jams_is_told_and_counted(result):
    jammed = [row for row in result.table if row.setting["dispatch"] == "own_policies.Idle"]
    assert [(row.jammed, row.bins_per_hour) for row in jammed] == [
        (row.replications, None) for row in jammed
    ]
    assert [row.jammed for row in jammed] == [1, 1, 1]  # one jam is enough to leave the race
    assert sum("own_policies.Idle jams" in note for note in result.notes) == 3


def test_partial_results_are_told(result, told):
    assert told
    assert len(told[0].table) <= len(result.table)
    assert all(one.answer for one in told)


def test_other_workers_and_another_order_give_the_same_table(result, folder):
    assert table(
        study(CHANCE, VARIED, replace(AMPLE, workers=2, store=folder / "second.db"))
    ) == table(result)


def test_what_is_known_is_not_run_again(result, folder, monkeypatch):
    path = folder / "first.db"
    changed = path.stat().st_size
    workers = Watched()
    monkeypatch.setattr(module, "processes", lambda count: workers)
    again = study(CHANCE, VARIED, replace(AMPLE, store=path))
    assert workers.runs == 0
    assert path.stat().st_size == changed
    assert again.table == result.table


class Watched:
    """No workers: it counts the runs that it is asked for."""

    count = 2
    runs = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def do(self, work, items, goes_on):
        self.runs += sum(isinstance(item, PlannedRun) for item in items)
        return iter(())


def test_faults_of_a_policy_of_the_users_own_are_told(tmp_path):
    own = with_changes(CHANCE, row_length=20.0, pickers=3, dispatch="own_policies.Raising")
    options = replace(AMPLE, model="full", within=0.5, store=tmp_path / "s.db")
    found = study(own, {"dispatch_errors": ["nearest", "end"]}, options)
    ends, goes_on = [note for note in found.notes if "dispatch_errors" in note]
    assert re.match(r"dispatch_errors=nearest: \d+ of \d+ runs had faults; seed 1: ", goes_on)
    assert ends == "dispatch_errors=end jams: refused decisions of the dispatch policy: 1"


def test_without_chance_one_run_stands_for_all_seeds(tmp_path):
    settled = study(
        Scenario(rows=3, metres_per_bin=35.0, **QUIET),
        {"carriers": [1, 2]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert [row.replications for row in settled.table] == [1, 1]
    assert settled.stopped_by == "certain"
    assert any("nothing in these settings is random" in note for note in settled.notes)
    assert all(
        0.5 * row.harvest_seconds.mean < row.proven_seconds <= row.harvest_seconds.mean
        for row in settled.table
    )
    assert settled.orchard == (
        "3 rows of 70 m, a bin every 35 m, 2 pickers, two-way, rolling dispatch, 5.5 m from row to"
        " row, carriers at 1 m/s, pickers that drive at 1 m/s, 5 s at the bay, 0.2 s to couple a"
        " bin, 0.4 s to uncouple it"
    )
    assert any(note.startswith("drives to the ends of rows take 44.2 %") for note in settled.notes)


def test_a_setting_that_jams_once_has_no_figures():
    once = PlannedRun(Scenario(rows=3, **QUIET), "fast").do(math.inf)
    row = row_of(Setting({}, Scenario()), [once, replace(once, ended="jammed")], 0.95)
    assert (row.bins_per_hour, row.harvest_seconds, row.jammed, row.standing) == (
        None,
        None,
        1,
        "jammed",
    )


def test_what_is_paid_is_the_mean_of_the_runs():
    """One run brings 10 bins an hour, and the other one 20: each bin costs its share of an hour."""
    prices = {"picker_per_hour": 30.0, "carrier_per_hour": 10.0, "per_bin": 2.0}
    scenario = Scenario(rows=3, pickers=2, carriers=1, prices=prices, **QUIET)
    slow = replace(PlannedRun(scenario, "fast").do(math.inf), bins=10, bins_per_hour=10.0)
    row = row_of(Setting({}, scenario), [slow, replace(slow, bins_per_hour=20.0)], 0.95)
    assert list(row.paid) == [name for name in PAYMENTS if name in row.paid]
    assert sum(row.paid.values()) == pytest.approx(row.cost_per_bin.mean)
    assert row.cost_per_bin.mean == pytest.approx((70.0 / 10.0 + 70.0 / 20.0) / 2 + 2.0)
    assert row.bins_per_hour.mean == pytest.approx(15.0)


def test_part_full_bins_of_one_harvest_are_told(tmp_path):
    told = study(
        Scenario(rows=3, metres_per_bin=50.0, **QUIET), {}, replace(AMPLE, store=tmp_path / "s.db")
    )
    assert any(
        "5 bins have the fruit of 4.2, so a full one costs 19.0 % more" in note
        for note in told.notes
    ), told.notes


def test_the_long_run_says_that_it_misses_unequal_shares(tmp_path):
    """The long run says that it does not see unequal shares of the rows."""
    options = replace(AMPLE, horizon="long", store=tmp_path / "s.db")
    shares = [
        study(Scenario(rows=rows, **QUIET), {"rows_to_pickers": ["balanced"]}, options).notes
        for rows in (3, 4)
    ]
    assert [any("some pickers get more rows" in note for note in notes) for notes in shares] == [
        True,
        False,
    ]


def test_a_little_worse_is_as_good_and_an_end_is_told(tmp_path):
    """What is worse by little is as good and an end of the range is told.

    The bay is farther by so little that the harvest hardly changes; nearer ones were not
    tried.
    """
    settled = study(
        Scenario(rows=3, **QUIET),
        {"bay": [10.0, 10.4, 10.8]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert [row.standing for row in settled.table] == ["best", "equal", "equal"]
    assert settled.beyond == {"bay": pytest.approx(9.6)}
    assert settled.answer.startswith("At most bay 10: ")
    assert "the range is too small, as bay 9.6 may be better" in settled.answer


def test_an_answer_with_fewer_robots_is_behind_the_best_mean(tmp_path):
    options = replace(AMPLE, within=0.9, store=tmp_path / "s.db")
    settled = study(Scenario(rows=3, **QUIET), {"carriers": [1, 2]}, options)
    one, two = settled.table
    assert settled.best == one.setting == {"carriers": 1}
    assert one.behind > 0.0
    assert two.behind is None


RATES = {"picking_rate": [5.0, 50.0]}
PRICES = {"picker_per_hour": 25.0, "carrier_per_hour": 8.0}


@pytest.mark.parametrize(
    ("varied", "words"),
    [
        (RATES, "picking rate"),
        ({"prices.picker_per_hour": [20.0, 25.0]}, "prices picker per hour"),
        ({"crop": [{"tonnes_per_hectare": 30.0}, {"tonnes_per_hectare": 60.0}]}, "crop"),
    ],
)
def test_what_nobody_chooses_has_a_table_and_no_best(varied, words, tmp_path):
    crop = {"tonnes_per_hectare": 30.0, "kilograms_per_bin": 350.0}
    told = study(
        Scenario(rows=3, carriers=2, crop=crop, prices=PRICES, **QUIET),
        varied,
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    assert (told.best, told.given, told.beyond) == (None, list(varied), {})
    assert [row.standing for row in told.table] == ["alone", "alone"]
    assert f"; {words} is given and not chosen, so there is no best. The orchard: " in told.answer
    heads, lines = heads_and_lines(told)
    assert "behind, %" not in heads and "*" not in "".join(cell for line in lines for cell in line)
    assert "the answer" not in legend(told) and inline_svg(told)


def test_what_can_be_chosen_has_a_best_for_each_of_what_cannot(tmp_path):
    """Fast pickers need more carriers."""
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [1, 2, 3, 4], **RATES},
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    best = [row.setting for row in told.table if row.standing == "best"]
    assert told.best is None
    slow, fast = sorted(best, key=lambda setting: setting["picking_rate"])
    assert slow["carriers"] < fast["carriers"]
    for row in told.table:
        alike = [
            other.bins_per_hour.mean
            for other in told.table
            if other.setting["picking_rate"] == row.setting["picking_rate"]
        ]
        behind = max(alike) / row.bins_per_hour.mean - 1.0
        assert (row.behind or 0.0) == pytest.approx(behind)
    assert told.answer.startswith("picking rate 5: 1 carrier, ")
    assert "picking rate is given and not chosen, so each has a best of its own" in told.answer
    assert legend(told).startswith("* the best for each picking rate; ")
    assert (
        "behind: how far behind the best mean for the same picking rate, which has -. "
        in legend(told)
    )


def test_open_carriers_are_tried_for_each_circumstance(tmp_path):
    """An open number of carriers is tried for each of what cannot be chosen."""
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [], **RATES},
        replace(AMPLE, horizon="long", within=0.02, store=tmp_path / "s.db"),
    )
    best = [row.setting["carriers"] for row in told.table if row.standing == "best"]
    tried = set(told.varied["carriers"])
    assert len(best) == 2 and max(tried) >= 1.5 * max(best)
    assert all({number - 1, number + 1} - {0} <= tried for number in best)


def test_a_policy_that_leaves_pickers_out_is_not_the_best(tmp_path):
    """In the long run a policy that leaves pickers out is named and not the best."""
    varied: dict[str, list] = {
        "dispatch": ["assignment", "predictive"],
        "people": [{"workers": 0}, {"visitors": 0}],
    }
    told = study(
        Scenario(rows=12, pickers=6, carriers=2, **QUIET),
        varied,
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    best = [row.setting for row in told.table if row.standing == "best"]
    assert best == [{"dispatch": "predictive", "people": people} for people in varied["people"]]
    assert (
        sum(
            bool(
                re.match(
                    "dispatch=assignment, .* jams: picker_.*: too few carriers come to it", note
                )
            )
            for note in told.notes
        )
        == 2
    )
    assert inline_svg(told)


def test_the_last_number_of_carriers_is_never_called_the_best(tmp_path):
    """Of three pickers with one or two carriers; but the last number for which there is room has no
    one beyond it.
    """
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [1, 2]},
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    assert (told.best, told.beyond) == ({"carriers": 2}, {"carriers": 3})
    assert told.answer.startswith("At least 2 carriers: ")
    full = Scenario(rows=3, row_length=20.0, route="two-way", **QUIET)
    most = most_carriers(full)
    last = study(
        full, {"carriers": [1, most]}, replace(AMPLE, horizon="long", store=tmp_path / "s.db")
    )
    assert last.beyond == {}


@pytest.mark.parametrize(
    "changes", [{}, {"prices": {"picker_per_hour": 15.0, "carrier_per_hour": 6.0}}]
)
def test_a_study_without_values_tries_carriers_until_enough(changes, tmp_path):
    """A study that is told nothing tries as many carriers as it takes.

    The answer lies inside what was tried, with its neighbours, and is the same wherever the
    numbers begin.
    """
    scenario = Scenario(rows=6, pickers=3, picking_speed=0.3, **QUIET, **changes)
    found = study(
        scenario, options=replace(AMPLE, horizon="long", within=0.02, store=tmp_path / "s.db")
    )
    tried = found.varied["carriers"]
    best = found.best["carriers"]
    assert (
        {best - 1, best + 1} - {0} <= set(tried) and max(tried) >= 1.5 * best and found.beyond == {}
    )
    assert found.goal == ("cost_per_bin" if changes else "bins_per_hour")
    rows = {row.setting["carriers"]: row for row in found.table}
    assert list(rows) == tried
    behind = {
        number: (
            max(row.bins_per_hour.mean for row in found.table) / rows[number].bins_per_hour.mean
            - 1.0
        )
        for number in tried
    }
    assert changes or behind[best] < 0.02 <= behind[best - 1]


def test_an_orchard_without_room_for_more_carriers_says_so(tmp_path):
    scenario = Scenario(rows=10, row_length=20.0, pickers=8, carriers=3, picking_rate=60.0, **QUIET)
    found = study(scenario, options=replace(AMPLE, horizon="long", store=tmp_path / "s.db"))
    most = most_carriers(scenario)
    assert (
        found.best == {"carriers": most}
        and f"the orchard has room for {most} carriers, no more" in found.notes
    )


NUMBERS = [
    (3, [1, 2, 3], [4, 5]),
    (8, [4, 5, 6, 7, 8], [9, 10, 12]),
    (3, [3, 4, 5], [1]),
    (8, [4, 8, 12], [6]),
]


@pytest.mark.parametrize(("answer", "tried", "more"), NUMBERS)
def test_a_range_widens_until_the_answer_is_inside(answer, tried, more):
    assert more_numbers(tried, answer, 40) == more
    assert more_numbers(tried, answer, 4) == [number for number in more if number <= 4]


def test_settings_with_and_without_chance_are_compared(tmp_path):
    """A policy of the user's own may draw by the seed."""
    mixed = study(
        Scenario(rows=3, carriers=1, **QUIET),
        {"dispatch": ["nearest", "own_policies.FarthestOfMine"]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert (
        mixed.table[0].replications == 1
        and mixed.table[1].replications >= 5
        and mixed.table[1].lead is not None
    )
    assert mixed.best is not None


def test_what_costs_nothing_is_compared(tmp_path):
    free = study(
        with_changes(CHANCE, **{"prices.carrier_per_hour": 0.0}),
        {"carriers": [1, 2]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert free.best == {"carriers": 1} and [row.cost_per_bin.mean for row in free.table] == [
        0.0,
        0.0,
    ]


def test_a_used_budget_is_told(tmp_path):
    short = study(
        CHANCE,
        {"carriers": [1, 2, 3]},
        replace(AMPLE, budget_seconds=1e-3, store=tmp_path / "s.db"),
    )
    assert short.stopped_by == "budget" and short.best is None and short.table == []
    assert any("there was no time for a run of 3 settings" in note for note in short.notes)


def short(
    monkeypatch: pytest.MonkeyPatch, runs: int, scenario: Scenario, varied: dict, **options: object
) -> tuple[StudyResult, FewRuns]:
    """A study whose budget ends after so many runs."""
    workers = FewRuns(runs)
    monkeypatch.setattr(module, "processes", lambda count: workers)
    return study(scenario, varied, replace(AMPLE, **options)), workers


GANG = Scenario(
    rows=8,
    pickers=6,
    row_length=40.0,
    picking_rate=20.0,
    bins_per_row=3,
    picking={"spread": {"distribution": "lognormal", "cv": 0.28}},
    **QUIET,
)
FLEETS = [1, 2, 3, 4, 6]


def test_a_setting_that_is_alone_runs_until_its_rate_is_known(monkeypatch, tmp_path):
    """After the runs of the first look the interval is wider than what counts: more are done."""
    runs = LOOKS[0] + 3
    told, _ = short(
        monkeypatch, runs, GANG, {"carriers": [3]}, within=1e-6, store=tmp_path / "s.db"
    )
    assert (told.stopped_by, told.table[0].replications) == ("budget", runs)


@pytest.mark.parametrize(("runs", "tried"), [(1, [1]), (2, [1, 6]), (3, [1, 3, 6])])
def test_a_budget_that_ends_early_has_seen_the_whole_range(runs, tried, monkeypatch, tmp_path):
    """It says what has not run, and nothing of what lies beyond the range."""
    cut, _ = short(
        monkeypatch,
        runs,
        GANG,
        {"carriers": FLEETS},
        horizon="long",
        store=tmp_path / "s.db",
    )
    assert [row.setting["carriers"] for row in cut.table] == tried
    missing = [number for number in FLEETS if number not in tried]
    best = cut.best["carriers"]
    assert cut.not_run == [{"carriers": number} for number in missing]
    assert cut.answer.startswith("So far ")
    nearest = min(missing, key=lambda number: abs(FLEETS.index(number) - FLEETS.index(best)))
    assert f"; {len(missing)} of 5 settings have not run, such as {nearest} carriers" in cut.answer
    assert not re.search("at (least|most)|range is too small|gain", cut.answer, re.IGNORECASE)
    assert cut.beyond == {} and cut.seconds_needed > 0.0


def test_a_budget_that_ends_early_names_what_is_unseen(monkeypatch, tmp_path):
    """A budget that ends early names what it has not seen of two ranges.

    Of pickers and carriers with prices the corners are known first.
    """
    prices = {"picker_per_hour": 28.0, "carrier_per_hour": 12.0, "overhead_per_hour": 35.0}
    cut, workers = short(
        monkeypatch,
        4,
        with_changes(GANG, prices=prices),
        {"pickers": [2, 4, 6, 8], "carriers": [1, 2, 3]},
        horizon="long",
        store=tmp_path / "s.db",
    )
    corners = [(2, 1), (2, 3), (8, 1), (8, 3)]
    assert [(run.scenario.pickers, run.scenario.carriers) for run in workers.done] == corners
    pickers = cut.best["pickers"]
    named = f"such as ({pickers} pickers, 2 carriers), and may be better"
    assert f"; 8 of 12 settings have not run, {named}" in cut.answer


def test_every_setting_has_a_run_before_one_has_two(monkeypatch, tmp_path):
    _, workers = short(
        monkeypatch, 7, GANG, {"carriers": FLEETS}, horizon="long", store=tmp_path / "s.db"
    )
    runs = [(run.scenario.seed, run.scenario.carriers) for run in workers.done]
    # Limits alone tell the best here, but one run is no answer.
    assert runs == [(1, 1), (1, 6), (1, 3), (1, 2), (1, 4), (2, 1), (2, 6)]


def test_one_run_tells_that_a_lower_limit_is_worse(monkeypatch, tmp_path):
    """One run tells that a setting with a lower limit is worse.

    Its runs cannot exceed the limit, so no more are asked for. How far behind is shown.
    """
    cut, _ = short(
        monkeypatch, 2, GANG, {"carriers": [1, 6]}, horizon="long", store=tmp_path / "s.db"
    )
    one, six = cut.table
    assert one.bound_bins_per_hour < 0.98 * six.bins_per_hour.mean
    assert (one.standing, one.lead, six.standing, six.behind) == ("worse", None, "best", None)
    assert one.behind == pytest.approx(six.bins_per_hour.mean / one.bins_per_hour.mean - 1.0)
    assert cut.undecided == [] and "not enough runs" not in cut.answer


@pytest.mark.parametrize("varied", [{"carriers": [1, 2]}, {"pickers": [2, 3], "carriers": [1, 2]}])
def test_a_best_setting_at_the_end_of_a_range_is_at_least_that(varied, monkeypatch, tmp_path):
    """Though one run of each does not tell it from the others."""
    told, _ = short(
        monkeypatch,
        math.prod(map(len, varied.values())),
        GANG,
        varied,
        horizon="long",
        store=tmp_path / "s.db",
    )
    assert told.best == {key: values[-1] for key, values in varied.items()}
    assert told.beyond == {key: values[-1] + 1 for key, values in varied.items()}
    words = ["at least 3 pickers", "at least 2 carriers"][-len(varied) :]
    assert told.answer.startswith(f"{', '.join(words).capitalize()}: ")


def test_the_long_run_and_costs(tmp_path):
    scenario = with_changes(CHANCE, prices={"picker_per_hour": 15.0, "carrier_per_hour": 6.0})
    options = replace(
        AMPLE,
        goal="cost_per_bin",
        horizon="long",
        model="both",
        within=0.1,
        store=tmp_path / "s.db",
    )
    long = study(scenario, {"carriers": [1, 2]}, options)
    for row in long.table:
        rate = (2 * 15 + row.setting["carriers"] * 6) / row.bins_per_hour.mean
        assert row.cost_per_bin.mean == pytest.approx(
            rate, rel=0.02
        )  # the mean of costs is not quite the cost of the mean
        assert row.harvest_seconds is None and row.check is None
    assert long.best == min(long.table, key=lambda row: row.cost_per_bin.mean).setting
    assert "in the long run" in long.answer


def test_a_budget_for_one_run_says_how_little_it_knows(tmp_path, monkeypatch):
    """A budget for one run of each gives an answer that says how little it knows."""
    monkeypatch.setattr(module, "LOOKS", ())
    one = study(CHANCE, {"carriers": [1, 2, 3]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert {row.replications for row in one.table} == {1}
    assert next(row.standing for row in one.table if row.setting != one.best) != "equal"
    assert "not enough runs to tell" in one.answer and one.seconds_needed > 0.0


def test_the_simulator_confirms_the_best_two_on_the_same_seeds(tmp_path):
    options = replace(AMPLE, model="both", workers=2, store=tmp_path / "s.db")
    both = study(Scenario(rows=3, row_length=60.0, **QUIET), {"carriers": [1, 2, 3]}, options)
    checks = {row.setting["carriers"]: row.check for row in both.table}
    assert sum(check is not None for check in checks.values()) == 2
    best = next(row for row in both.table if row.setting == both.best)
    assert best.check.replications == 1 and best.check.jammed == 0  # nothing is random
    assert best.check.difference == pytest.approx(
        best.check.bins_per_hour.mean / best.bins_per_hour.mean - 1.0
    )
    assert abs(best.check.difference) < 0.05
    assert "the simulator says" in both.answer


@pytest.mark.soak
def test_farthest_first_is_better_than_nearest(tmp_path):
    """Farthest first is better and longest waiting is as good as nearest."""
    scenario = Scenario(rows=20, pickers=10, carriers=10, picking_speed=0.8, **QUIET)
    scenario = with_changes(scenario, picking={"spread": {"distribution": "gamma", "cv": 0.15}})
    options = replace(AMPLE, within=0.02, workers=2, store=tmp_path / "s.db")
    three = study(
        scenario,
        {
            "dispatch": [
                "nearest",
                "longest-waiting",
                "farthest-first",
                "own_policies.FarthestOfMine",
            ]
        },
        options,
    )
    assert three.best["dispatch"] in ("farthest-first", "own_policies.FarthestOfMine")
    assert {row.setting["dispatch"] for row in three.table if row.standing == "worse"} >= {
        "nearest",
        "longest-waiting",
    }
    two = study(scenario, {"dispatch": ["nearest", "longest-waiting"]}, options)
    assert "worse" not in [row.standing for row in two.table]


@pytest.fixture
def slow_runs(monkeypatch):
    """Workers, each run of which takes 30 s of a clock that stands still else."""
    now = [1000.0]
    monkeypatch.setattr("orchard.study.replications.time.time", lambda: now[0])

    class SlowRuns(FewRuns):
        def do(self, work, items, goes_on):
            for item, record in super().do(work, items, goes_on):
                now[0] += 30.0
                yield item, record

    return SlowRuns


def test_the_estimate_knows_how_long_runs_took(tmp_path, monkeypatch, slow_runs):
    """The estimate of what is missing knows how long the runs of this study took.

    Workers start, and wait for a busy machine: a run that took no time by itself took 30 s.
    """
    monkeypatch.setattr("orchard.study.study.processes", lambda count: slow_runs(2))
    options = StudyOptions(budget_seconds=3600.0, store=tmp_path / "s.db")
    found = study(empty_orchard(rows=4, pickers=2), {"carriers": [1, 2, 3, 4, 5]}, options)
    assert len(found.not_run) == 3
    assert found.seconds_needed == pytest.approx(3 * 30.0)


def test_the_estimate_counts_the_runs_that_were_done(tmp_path, monkeypatch, slow_runs):
    """Two settings have five runs each, of 30 s, and more are needed to tell them apart."""
    monkeypatch.setattr(module, "processes", lambda count: slow_runs(2 * LOOKS[0]))
    options = StudyOptions(
        model="fast", budget_seconds=3600.0, within=1e-4, store=tmp_path / "s.db"
    )
    told = study(GANG, {"carriers": [5, 6]}, options)
    assert told.undecided
    more_runs = [look - LOOKS[0] for look in LOOKS[1:]]
    assert told.seconds_needed in [pytest.approx(2 * 30.0 * more) for more in more_runs]


def test_settings_without_a_run_are_named():
    names = [Setting({"carriers": count}, Scenario()) for count in range(1, 8)]
    notes = StudyNotes(SimpleNamespace(settings=names), "fast", StudyOptions(), {})
    assert notes.missing([], was_stopped=False) == []
    assert notes.missing([1], was_stopped=True) == [
        "the study was stopped before a run of 1 setting, carriers=2: not in the table"
    ]
    (note,) = notes.missing(range(1, 7), was_stopped=False)
    assert note.startswith("there was no time for a run of 6 settings, carriers=2; carriers=3;")
    assert note.endswith("; carriers=6 and others: not in the table")


def test_heavier_bins_at_the_same_rate_are_told():
    scenario = Scenario(
        crop={"tonnes_per_hectare": 40.0, "kilograms_per_bin": 400.0}, picking_rate=1.0
    )
    heavier = {"crop.kilograms_per_bin": [400.0, 480.0]}
    runs = SimpleNamespace(settings=[])
    (note,) = StudyNotes(runs, "fast", StudyOptions(), heavier).heavier_bins(scenario)
    speed = float(re.search(r"picking_speed: ([\d.]+)`", note)[1])
    assert speed == pytest.approx(scenario.mean_picking_speed, rel=1e-3)
    with_rates = heavier | {"picking_rate": [1.0, 0.83]}
    for varied, asked in (
        (with_rates, scenario),
        ({"carriers": [1, 2]}, scenario),
        (heavier, with_changes(scenario, picking_rate=None, picking_speed=0.005)),
    ):
        assert StudyNotes(runs, "fast", StudyOptions(), varied).heavier_bins(asked) == []


def test_a_long_run_of_who_is_away_is_refused():
    away = Scenario(picker_absences={"picker_01": [[0.0, 1.0]]})
    (problem,) = checked_settings(away, {}, StudyOptions())[1]
    assert "choose --horizon harvest" in problem.text
    assert checked_settings(away, {}, StudyOptions(horizon="harvest"))[1] == []
