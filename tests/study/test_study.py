"""Whole studies of small orchards: the same table whatever the workers and whatever was known;
jams, notes, costs, the check by the simulator.

A setting is a combination of the values that vary. It runs with one seed after another
(replications), and all settings have the same seeds. After some numbers of seeds (LOOKS) the study
looks whether it can decide. `horizon` is one harvest or the long run, and `within` is what counts.
"""

import math
import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import pytest
from small_studies import AMPLE, CHANCE, QUIET
from stage import empty_orchard

from orchard.field.scenario import Scenario, with_changes
from orchard.report.costs import PAYMENTS
from orchard.study import study as module
from orchard.study.comparing import LOOKS
from orchard.study.notes import StudyNotes
from orchard.study.options import StudyOptions
from orchard.study.result import StudyResult
from orchard.study.rows import row_of
from orchard.study.runs import PlannedRun
from orchard.study.settings import Setting
from orchard.study.study import study
from orchard.study.words import setting_words

VARIED = {"carriers": [1, 2, 3], "dispatch": ["nearest", "own_policies.Idle"]}


def table(result: StudyResult) -> dict:
    """Return a result as data, without the time that it took."""
    return asdict(replace(result, wall_seconds=0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("stores")


@pytest.fixture(scope="module")
def told() -> list[StudyResult]:
    """Return the list to which the study of `result` adds what it knows on its way."""
    return []


@pytest.fixture(scope="module")
def result(folder, told) -> StudyResult:
    """Return the result of a study of carriers and policies, one of which serves no bin."""
    return study(CHANCE, VARIED, replace(AMPLE, store=folder / "first.db"), told.append)


def test_the_best_is_told_with_its_interval(result):
    """One carrier is far too few for two pickers, so it is worse by 5 % and more. More carriers
    than the best are equal, or not decided.
    """
    rows = {row.setting["carriers"]: row for row in result.table if not row.jammed}
    assert result.best["dispatch"] == "nearest"
    best = rows[result.best["carriers"]]
    assert best.bins_per_hour.mean > 0.95 * max(row.bins_per_hour.mean for row in rows.values())
    assert best.bins_per_hour.low < best.bins_per_hour.mean < best.bins_per_hour.high
    assert rows[1].standing == "worse" and rows[1].lead.low > 0.05
    assert all(
        row.standing == "equal" or row.setting in result.undecided
        for n, row in rows.items()
        if n > result.best["carriers"]
    )
    assert setting_words(result.best) in result.answer


def test_all_rows_of_a_table_have_the_same_seeds(result, told):
    """That holds, too, while the study runs. At its end the number of seeds is one of LOOKS."""
    for one in (result, *told):
        assert len({row.replications for row in one.table if not row.jammed}) <= 1
    assert {row.replications for row in result.table if not row.jammed} <= set(LOOKS)


def test_a_setting_that_jams_is_told_and_counted(result):
    jammed = [row for row in result.table if row.setting["dispatch"] == "own_policies.Idle"]
    assert [(row.jammed, row.bins_per_hour) for row in jammed] == [
        (row.replications, None) for row in jammed
    ]
    # A setting that has jammed once is not run again.
    assert [row.jammed for row in jammed] == [1, 1, 1]
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
    # With two bins a row a picker drives through half of each row with a full bin.
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
    """One run brings 10 bins an hour, and the other one 20. An hour costs 2 * 30 + 10 = 70, of
    which each bin has its share, and a bin costs 2 more.
    """
    prices = {"picker_per_hour": 30.0, "carrier_per_hour": 10.0, "per_bin": 2.0}
    scenario = Scenario(rows=3, pickers=2, carriers=1, prices=prices, **QUIET)
    slow = replace(PlannedRun(scenario, "fast").do(math.inf), bins=10, bins_per_hour=10.0)
    row = row_of(Setting({}, scenario), [slow, replace(slow, bins_per_hour=20.0)], 0.95)
    assert list(row.paid) == [name for name in PAYMENTS if name in row.paid]
    assert sum(row.paid.values()) == pytest.approx(row.cost_per_bin.mean)
    assert row.cost_per_bin.mean == pytest.approx((70.0 / 10.0 + 70.0 / 20.0) / 2 + 2.0)
    assert row.bins_per_hour.mean == pytest.approx(15.0)


def test_part_full_bins_of_one_harvest_are_told(tmp_path):
    """3 rows of 70 m fill 4.2 bins of 50 m. Each of two pickers ends with a part-full one: 5 / 4.2
    is 1.19.
    """
    told = study(
        Scenario(rows=3, metres_per_bin=50.0, **QUIET), {}, replace(AMPLE, store=tmp_path / "s.db")
    )
    assert any(
        "5 bins have the fruit of 4.2, so a full one costs 19.0 % more" in note
        for note in told.notes
    ), told.notes


def test_the_long_run_says_that_it_misses_unequal_shares(tmp_path):
    """Two pickers share 3 rows unequally, and 4 equally. In the long run pickers never end, so only
    a note says what unequal shares would cost in one harvest.
    """
    options = replace(AMPLE, horizon="long", store=tmp_path / "s.db")
    shares = [
        study(Scenario(rows=rows, **QUIET), {"rows_to_pickers": ["balanced"]}, options).notes
        for rows in (3, 4)
    ]
    assert [any("some pickers get more rows" in note for note in notes) for notes in shares] == [
        True,
        False,
    ]


def test_settings_with_and_without_chance_are_compared(tmp_path):
    """A policy of the user's own may draw by the seed, so it needs several runs. The built-in one
    needs one.

    Here all seeds agree, so the two are equal. As another seed might not, no interval is told.
    """
    mixed = study(
        Scenario(rows=3, carriers=1, **QUIET),
        {"dispatch": ["nearest", "own_policies.FarthestOfMine"]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert mixed.table[0].replications == 1
    assert mixed.table[1].replications >= LOOKS[0]
    assert (mixed.table[1].lead, mixed.table[1].standing) == (None, "equal")
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
        # Two pickers at 15 and carriers at 6 an hour. The mean of the costs of runs is not quite
        # the cost at their mean rate.
        cost = (2 * 15 + row.setting["carriers"] * 6) / row.bins_per_hour.mean
        assert row.cost_per_bin.mean == pytest.approx(cost, rel=0.02)
        assert row.harvest_seconds is None and row.check is None
    assert long.best == min(long.table, key=lambda row: row.cost_per_bin.mean).setting
    assert "in the long run" in long.answer


def test_the_simulator_confirms_the_best_two_on_the_same_seeds(tmp_path):
    options = replace(AMPLE, model="both", workers=2, store=tmp_path / "s.db")
    both = study(Scenario(rows=3, row_length=60.0, **QUIET), {"carriers": [1, 2, 3]}, options)
    checks = {row.setting["carriers"]: row.check for row in both.table}
    assert sum(check is not None for check in checks.values()) == 2
    # Nothing is random, so one run is enough.
    best = next(row for row in both.table if row.setting == both.best)
    assert best.check.replications == 1 and best.check.jammed == 0
    assert best.check.difference == pytest.approx(
        best.check.bins_per_hour.mean / best.bins_per_hour.mean - 1.0
    )
    assert abs(best.check.difference) < 0.05
    assert "the simulator says" in both.answer


@pytest.mark.soak
def test_farthest_first_is_better_than_nearest(tmp_path):
    """`farthest-first` is better than `nearest`, and `longest-waiting` is as good as that."""
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


@pytest.mark.parametrize("prices", [{}, {"picker_per_hour": 20.0}])
def test_of_trailers_that_are_as_good_the_fewest_answer(tmp_path, prices):
    """With one trailer of a bin a harvest takes longer, and less than the half that counts here."""
    scenario = empty_orchard(
        rows=4,
        row_length=40.0,
        picking_rate=4.0,
        bins_per_row=1.0,
        load_out={"seconds_away": 300.0, "trailers": {"count": 1, "bins": 1}},
        prices=prices,
    )
    options = replace(
        AMPLE, horizon="harvest", model="fast", workers=1, store=tmp_path / "s.db", within=0.5
    )
    found = study(scenario, {"load_out.trailers.count": [1, 2, 3]}, options)
    one, two, _ = [row.harvest_seconds.mean for row in found.table]
    assert two < one < 1.5 * two
    assert found.best == {"load_out.trailers.count": 1}
