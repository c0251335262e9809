"""Whole studies of small orchards: the same table whatever the workers and whatever was known before, jams, budgets, and the check."""

import time
from dataclasses import asdict, replace

import pytest

from orchard.field.scenario import Scenario, with_changes
from orchard.study import study as module
from orchard.study.replications import Replications
from orchard.study.result import StudyResult
from orchard.study.runs import PlannedRun
from orchard.study.settings import settings_of
from orchard.study.store import Store
from orchard.study.study import StudyOptions, study

QUIET = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
CHANCE = Scenario(rows=3, picking_speed=0.5, picking={"spread": {"distribution": "gamma"}}, **QUIET)
VARIED = {"carriers": [1, 2, 3], "dispatch": ["nearest", "own_policies.Idle"]}
AMPLE = StudyOptions(model="fast", budget_seconds=10_000.0, within=0.05, workers=1)


def table(result: StudyResult) -> dict:
    """All that a study says, without the time that it took."""
    return asdict(replace(result, wall_seconds=0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("stores")


@pytest.fixture(scope="module")
def told() -> list[StudyResult]:
    return []


@pytest.fixture(scope="module")
def result(folder, told) -> StudyResult:
    """A study with one worker and a new store. `told` gets the partial results."""
    return study(CHANCE, VARIED, replace(AMPLE, store=folder / "first.db"), told.append)


def test_the_best_is_told_with_its_interval_and_what_cannot_be_told_apart(result):
    rows = {row.setting["carriers"]: row for row in result.table if not row.jammed}
    assert result.best["dispatch"] == "nearest"
    best = rows[result.best["carriers"]]
    assert best.bins_per_hour.mean == max(row.bins_per_hour.mean for row in rows.values())
    assert best.bins_per_hour.low < best.bins_per_hour.mean < best.bins_per_hour.high
    assert all(row.replications >= 5 for row in rows.values())
    apart = {tuple(one.setting.values()) for one in result.comparisons if one.is_told_apart}
    assert (1, "nearest") in apart  # one carrier for two pickers is far too few
    assert apart.isdisjoint({tuple(one.values()) for one in result.indistinguishable})
    assert str(result.best["carriers"]) in result.answer


def test_rows_that_are_drawn_are_no_loss_to_the_policy_or_to_people(folder):
    """Each harvest is split with the rows of its own seed: its luck is in no part but `structure`."""
    picking = {"spread": {"distribution": "gamma"}, "failure": {"mean_between": 600.0, "mean_repair": 300.0}}
    drawn = Scenario(rows=3, picking_speed=0.2, picking=picking, tractor=False, dispatch="predictive", **QUIET)
    lost = study(drawn, {"carriers": [2]}, replace(AMPLE, store=folder / "drawn.db")).table[0].lost_seconds
    assert lost["structure"] != 0.0 and (lost["dispatch"], lost["people_and_animals"]) == (0.0, 0.0)


def test_a_setting_that_jams_is_told_and_counted(result):
    jammed = [row for row in result.table if row.setting["dispatch"] == "own_policies.Idle"]
    assert [(row.jammed, row.bins_per_hour) for row in jammed] == [(row.replications, None) for row in jammed]
    assert [row.jammed for row in jammed] == [1, 1, 1]  # one jam is enough to leave the race
    assert sum("own_policies.Idle: 1 of 1 runs jammed" in note for note in result.notes) == 3


def test_partial_results_are_told(result, told):
    assert told
    assert len(told[0].table) <= len(result.table)
    assert all(one.answer for one in told)


def test_other_workers_and_another_order_give_the_same_table(result, folder):
    assert table(study(CHANCE, VARIED, replace(AMPLE, workers=2, store=folder / "second.db"))) == table(result)


def test_what_is_known_is_not_run_again(result, folder, monkeypatch):
    path = folder / "first.db"
    changed = path.stat().st_size
    workers = Watched()
    monkeypatch.setattr(module, "processes", lambda count: workers)
    again = study(CHANCE, VARIED, replace(AMPLE, store=path))
    assert workers.runs == 0
    assert path.stat().st_size == changed
    assert [replace(row, lost_seconds={}) for row in again.table] == [replace(row, lost_seconds={}) for row in result.table]


class Watched:
    """No workers: it counts the runs that it is asked for."""

    count, runs = 2, 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def do(self, work, items, goes_on):
        self.runs += sum(isinstance(item, PlannedRun) for item in items)
        return iter(())


def test_what_a_store_knows_takes_no_time_of_the_budget(result, folder, monkeypatch):
    """The race plans its next look by the runs that are left to do: with a store that knows all of them, by none."""
    with Store(folder / "first.db") as store:
        settings, _ = settings_of(CHANCE, VARIED)
        runs = Replications(settings, "bins_per_hour", "harvest", store, Watched(), lambda: None, lambda: False)
        runs.do([0], "fast", 1, time.time())
        (known,) = runs.records
        runs.records[known] = replace(runs.records[known], wall_seconds=3600.0)
        assert runs.fits([0], "fast", 5, time.time() + 60.0)
        assert not runs.fits([0], "fast", 500, time.time() + 60.0)


def test_faults_of_a_policy_of_the_users_own_are_told(tmp_path):
    own = with_changes(CHANCE, row_length=20.0, dispatch="own_policies.Raising")
    found = study(own, {}, replace(AMPLE, model="full", within=0.5, store=tmp_path / "s.db"))
    (note,) = [note for note in found.notes if "had faults" in note]
    assert note.startswith("the scenario: 5 of 5 runs had faults; seed 1: ")


def test_without_chance_one_run_stands_for_all_seeds(tmp_path):
    settled = study(Scenario(rows=3, **QUIET), {"carriers": [1, 2]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert [row.replications for row in settled.table] == [1, 1]
    assert settled.stopped_by == "certain"
    assert any("nothing in these settings is random" in note for note in settled.notes)


def test_what_is_worse_by_little_is_told(tmp_path):
    """Rows are longer by so little that the harvest hardly changes, though for certain."""
    settled = study(Scenario(rows=3, **QUIET), {"row_length": [70.0, 70.2, 70.4]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert [one.is_told_apart for one in settled.comparisons] == [True, True]
    assert "worse for certain, but by less than 5 %: row_length=70.2; row_length=70.4" in settled.notes
    assert "the best has row_length=70.0: the end of what was tried" in settled.notes


def test_settings_with_and_without_chance_are_compared(tmp_path):
    scenario = with_changes(CHANCE, carriers=1)
    mixed = study(scenario, {"picking.spread.distribution": ["none", "gamma"]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert mixed.table[0].replications == 1 and mixed.table[1].replications >= 5
    assert mixed.best is not None


def test_a_used_budget_is_told(tmp_path):
    short = study(CHANCE, {"carriers": [1, 2, 3]}, replace(AMPLE, budget_seconds=1e-3, store=tmp_path / "s.db"))
    assert short.stopped_by == "budget" and short.best is None and short.table == []
    assert any("the budget did not allow a run of 3 settings" in note for note in short.notes)


def test_the_long_run_and_costs(tmp_path):
    scenario = with_changes(CHANCE, prices={"picker_per_hour": 15.0, "carrier_per_hour": 6.0})
    options = replace(AMPLE, goal="cost_per_bin", horizon="long", model="both", within=0.1, store=tmp_path / "s.db")
    long = study(scenario, {"carriers": [1, 2]}, options)
    for row in long.table:
        rate = (2 * 15 + row.setting["carriers"] * 6) / row.bins_per_hour.mean
        assert row.cost_per_bin.mean == pytest.approx(rate, rel=0.02)  # the mean of costs is not quite the cost of the mean
        assert row.harvest_seconds is None and row.check is None
    assert long.best == min(long.table, key=lambda row: row.cost_per_bin.mean).setting
    assert any("the simulator has no long run" in note for note in long.notes)


def test_the_simulator_confirms_the_best_two_on_the_same_seeds(tmp_path):
    options = replace(AMPLE, model="both", workers=2, store=tmp_path / "s.db")
    both = study(Scenario(rows=3, row_length=60.0, **QUIET), {"carriers": [1, 2, 3]}, options)
    checks = {row.setting["carriers"]: row.check for row in both.table}
    assert sum(check is not None for check in checks.values()) == 2
    best = next(row for row in both.table if row.setting == both.best)
    assert best.check.replications == 1 and best.check.jammed == 0  # nothing is random
    assert best.check.difference == pytest.approx(1.0 - best.bins_per_hour.mean / best.check.bins_per_hour.mean)
    assert abs(best.check.difference) < 0.05
    assert "the simulator says" in both.answer


@pytest.mark.soak
def test_farthest_first_is_better_and_longest_waiting_is_as_good_as_nearest(tmp_path):
    scenario = Scenario(rows=20, pickers=10, carriers=10, picking_speed=0.8, **QUIET)
    scenario = with_changes(scenario, picking={"spread": {"distribution": "gamma", "cv": 0.15}})
    options = replace(AMPLE, within=0.01, workers=2, store=tmp_path / "s.db")
    three = study(scenario, {"dispatch": ["nearest", "longest-waiting", "farthest-first", "own_policies.FarthestOfMine"]}, options)
    assert three.best["dispatch"] in ("farthest-first", "own_policies.FarthestOfMine")
    assert {one.setting["dispatch"] for one in three.comparisons if one.is_told_apart} >= {"nearest", "longest-waiting"}
    two = study(scenario, {"dispatch": ["nearest", "longest-waiting"]}, options)
    assert [one.is_told_apart for one in two.comparisons] == [False]
