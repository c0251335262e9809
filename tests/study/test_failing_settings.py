"""A study in which own code fails: its setting is left out and named, and the others go on.

The same holds of a fleet of a study with a deadline, and of a setting of a farm. In a sensitivity
all runs have the same code, so that ends. `orchard study` then exits with code 1.

`FewRuns` are workers that do the runs in this process.
"""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from called import called
from command_line import orchard
from few_runs import FewRuns
from small_studies import AMPLE, QUIET

from orchard.field.scenario import Scenario, to_yaml, with_changes
from orchard.study import finishing, replications
from orchard.study import study as module
from orchard.study.deadline import Deadline
from orchard.study.farm import farm_study
from orchard.study.farm_file import read_farm
from orchard.study.farm_words import answer
from orchard.study.findings import Findings
from orchard.study.finishing import finish_study
from orchard.study.result import StudyResult
from orchard.study.runs import RunFailed
from orchard.study.sensitivity import study as sensitivities
from orchard.study.sensitivity.factors import Factor
from orchard.study.sensitivity.study import sensitivity
from orchard.study.store import Store
from orchard.study.study import study
from orchard.study.workers import WorkerDied

ORCHARD = Scenario(rows=3, row_length=20.0, **QUIET)
# The same with rows that differ by the seed.
UNLIKE = with_changes(ORCHARD, picking_speed=0.5, picking={"spread": {"distribution": "gamma"}})
RAISING = "own_policies.Raising"
PLACE = r"LookupError: no such bin here \(.*own_policies\.py, line \d+\)"


class Dying(FewRuns):
    """Workers that die each time with a run of a policy of the user's."""

    def do(self, work, items, goes_on):
        for item in items:
            if item.scenario.own_classes:
                raise WorkerDied(item)
            yield item, work(item)


class Failing(FewRuns):
    """Workers with which some runs fail."""

    def __init__(self, fails):
        """`fails`: whether a run does."""
        super().__init__(1000)
        self.fails = fails

    def do(self, work, items, goes_on):
        for item in items:
            if self.fails(item):
                yield item, RunFailed(f"{item.name}: it fails")
            else:
                yield from super().do(work, [item], goes_on)


def studied(workers, folder, monkeypatch, *policies: str) -> StudyResult:
    """Return the result of a study of these policies by these workers."""
    monkeypatch.setattr(module, "processes", lambda count: workers)
    options = replace(AMPLE, model="fast", store=folder / "s.db")
    return study(ORCHARD, {"dispatch": policies}, options)


@pytest.mark.parametrize(
    ("workers", "why"),
    [
        (FewRuns(1000), f"dispatch policy {RAISING}, tick \\d+: {PLACE}"),
        (Dying(1000), "3 times a worker died, and did nothing: own code has ended it, or .*"),
    ],
)
def test_a_setting_whose_own_code_fails_is_left_out(workers, why, tmp_path, monkeypatch):
    """The other settings have their rows, and one of them is the answer."""
    found = studied(workers, tmp_path, monkeypatch, RAISING, "nearest")
    assert [row.setting for row in found.table] == [{"dispatch": "nearest"}]
    assert found.best == {"dispatch": "nearest"}
    assert found.failed == [{"dispatch": RAISING}]
    assert found.not_run == []
    (note,) = [note for note in found.notes if RAISING in note]
    assert re.fullmatch(
        f"dispatch={RAISING} failed, and is not in the table: seed 1, .*: {why}", note
    )
    assert f"{RAISING} failed, and is left out" in found.answer


def test_a_failed_run_is_not_kept_and_done_again(tmp_path, monkeypatch):
    """Own code may have needed a file or a package, which is there the next time."""
    studied(FewRuns(1000), tmp_path, monkeypatch, RAISING, "nearest")
    again = FewRuns(1000)
    studied(again, tmp_path, monkeypatch, RAISING, "nearest")
    assert [run.scenario.dispatch for run in again.done] == [RAISING]


def test_a_study_of_which_all_settings_fail_ends(tmp_path, monkeypatch):
    with pytest.raises(RunFailed, match=rf"seed 1, fast model, {RAISING}: .*{PLACE}"):
        studied(FewRuns(1000), tmp_path, monkeypatch, RAISING, "own_policies.Inventing")


class Asked:
    """Stands for the replications of many settings, of which none jams or fails."""

    def __init__(self):
        self.count = 0

    def failing(self, model):
        """Count how often it is asked of all settings."""
        self.count += 1
        return {}

    def has_jammed(self, i, model):
        """No setting has."""
        return False


def test_each_setting_is_asked_once_whether_it_failed():
    """A study may have 10,000 settings, and tells what it knows again and again."""
    runs = Asked()
    question = SimpleNamespace(settings=range(100), model="fast")
    findings = Findings(question=question, runs=runs, begun=0.0)
    assert findings.alive == list(range(100))
    assert runs.count == 1


def test_the_command_shows_the_rest_and_fails(tmp_path):
    words = ("--horizon", "harvest", "--model", "fast", "--workers", 1, "--out", tmp_path / "s.db")
    size = ("--vary", "rows=3", "--vary", f"dispatch={RAISING},nearest")
    done = orchard("study", *size, *words, code=1)
    assert "nearest *" in done.stdout
    assert "own_policies.py, line" in done.stdout.replace("\n", " ")


# -- the check by the simulator


def checked(fails, scenario, folder, monkeypatch) -> StudyResult:
    """Return the result of a study of one and two carriers that the simulator checks.

    `fails`: whether a run does.
    """
    monkeypatch.setattr(module, "processes", lambda count: Failing(fails))
    options = replace(AMPLE, model="both", store=folder / "s.db")
    return study(scenario, {"carriers": [1, 2]}, options)


def is_full(run) -> bool:
    """Whether the simulator does a run."""
    return run.model == "full"


def test_a_setting_that_fails_in_the_check_is_not_checked(tmp_path, monkeypatch):
    """It has its row by the fast model, and the answer says that it is not checked."""
    found = checked(is_full, ORCHARD, tmp_path, monkeypatch)
    assert found.best_row is not None and found.best_row.check is None
    assert found.check_failed == [{"carriers": 1}, {"carriers": 2}]
    assert found.failed == []
    assert "; in the simulator it failed, so it is not checked. The orchard:" in found.answer
    assert "the simulator says" not in found.answer
    for carriers in (1, 2):
        note = f"carriers={carriers} failed in the simulator, and is not checked: seed 1, full"
        assert sum(told.startswith(note) for told in found.notes) == 1


def test_a_check_that_fails_after_some_runs_is_no_check(tmp_path, monkeypatch):
    """The simulator does two runs of a setting here. The second one of two carriers fails."""
    monkeypatch.setattr(replications, "CHECKS", 2)

    def fails(run):
        return is_full(run) and run.scenario.carriers == 2 and run.scenario.seed == 2

    found = checked(fails, UNLIKE, tmp_path, monkeypatch)
    checks = {row.setting["carriers"]: row.check for row in found.table}
    assert checks[2] is None and checks[1].replications == 2
    assert found.check_failed == [{"carriers": 2}]


def test_the_command_fails_if_only_the_check_fails(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "processes", lambda count: Failing(is_full))
    path = tmp_path / "small.yaml"
    path.write_text(to_yaml(ORCHARD))
    words = ("--horizon", "harvest", "--vary", "carriers=1,2", "--out", tmp_path / "s.db")
    done = called("study", path, *words)
    assert done.exit_code == 1
    assert "in the simulator it failed" in done.stdout.replace("\n", " ")


# -- a deadline


def finished(fails, folder, monkeypatch, **prices: float) -> StudyResult:
    """Return the cheapest of the fleets of two or three pickers and one or two carriers that is
    done within an hour. `fails`: whether a run does.
    """
    monkeypatch.setattr(finishing, "processes", lambda count: Failing(fails))
    options = replace(AMPLE, store=folder / "s.db")
    fleets = {"pickers": [2, 3], "carriers": [1, 2]}
    scenario = with_changes(UNLIKE, prices=prices)
    return finish_study(scenario, fleets, Deadline(within_seconds=3600.0), options)


def test_the_search_goes_on_without_a_fleet_that_fails(tmp_path, monkeypatch):
    """Two pickers and one carrier are in time with the first 15 seeds. Then a run fails, and the
    answer is the next cheapest fleet. The same without the failure is that fleet.
    """
    (tmp_path / "without").mkdir()
    without = finished(lambda run: False, tmp_path / "without", monkeypatch)
    smallest = {"pickers": 2, "carriers": 1}
    assert without.best == smallest

    def fails(run):
        fleet = (run.scenario.pickers, run.scenario.carriers)
        return fleet == (2, 1) and run.scenario.seed == 16

    found = finished(fails, tmp_path, monkeypatch)
    assert found.failed == [smallest]
    assert found.best in ({"pickers": 2, "carriers": 2}, {"pickers": 3, "carriers": 1})
    assert found.best_row is not None and found.best_row.replications == 20
    assert smallest not in [row.setting for row in found.table]
    assert "2 pickers, 1 carrier) failed, and is left out. The orchard:" in found.answer
    (note,) = [note for note in found.notes if "failed" in note]
    words = "pickers=2, carriers=1 failed, and is not in the table: seed 16, fast model, "
    assert note.startswith(words)


def test_a_fleet_that_fails_says_nothing_of_smaller_ones(tmp_path, monkeypatch):
    """If a fleet is late in all harvests, those with fewer carriers are not tried. Two carriers
    are tried first here, because an hour costs much, and a carrier next to nothing.
    """
    prices = {"overhead_per_hour": 1000.0, "picker_per_hour": 1000.0, "carrier_per_hour": 0.01}
    found = finished(lambda run: run.scenario.carriers == 2, tmp_path, monkeypatch, **prices)
    assert {"pickers": 2, "carriers": 2} in found.failed
    assert found.best == {"pickers": 2, "carriers": 1}


def test_a_search_of_which_all_fleets_fail_ends(tmp_path, monkeypatch):
    with pytest.raises(RunFailed, match="seed 1, fast model, rolling: it fails"):
        finished(lambda run: True, tmp_path, monkeypatch)


def test_the_command_with_a_deadline_goes_on_and_fails(tmp_path, monkeypatch):
    monkeypatch.setattr(
        finishing, "processes", lambda count: Failing(lambda run: run.scenario.carriers == 1)
    )
    path = tmp_path / "small.yaml"
    path.write_text(to_yaml(ORCHARD))
    words = ("--finish-within", "1h", "--model", "fast", "--out", tmp_path / "s.db")
    done = called("study", path, "--vary", "carriers=1,2", *words)
    assert done.exit_code == 1
    assert done.stdout.startswith("2 pickers and 2 carriers finish in ")


# -- a farm, and a sensitivity


def farm_of_two(folder) -> Path:
    """Return the file of a farm that has the small orchard as its first block and as its second."""
    for name in ("top", "low"):
        (folder / f"{name}.yaml").write_text(to_yaml(ORCHARD))
    path = folder / "farm.yaml"
    path.write_text("blocks: [{file: top.yaml}, {file: low.yaml}]\ntransfer_minutes: 20\n")
    return path


def test_a_farm_leaves_out_what_fails_in_one_block(tmp_path, monkeypatch):
    """Here a fleet of two carriers fails in the second block, and the budget is not blamed."""
    path = farm_of_two(tmp_path)

    def fails(run):
        return run.scenario.carriers == 2 and run.scenario.seed > 1000

    monkeypatch.setattr(module, "processes", lambda count: Failing(fails))
    farm = read_farm(path, ["carriers"])
    found = farm_study(farm, {"carriers": [1, 2]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert found.failed == [{"carriers": 2}]
    assert [row.setting for row in found.table] == [{"carriers": 1}]
    assert answer(found).endswith("bins an hour; 2 carriers failed, and is left out.")
    assert not [note for note in found.notes if "budget" in note]
    done = called("study", path, "--vary", "carriers=1,2", "--out", tmp_path / "again.db")
    assert done.exit_code == 1


def test_a_farm_names_the_block_in_which_all_settings_fail(tmp_path, monkeypatch):
    path = farm_of_two(tmp_path)
    monkeypatch.setattr(
        module, "processes", lambda count: Failing(lambda run: run.scenario.seed > 9)
    )
    farm = read_farm(path, ["carriers"])
    with pytest.raises(RunFailed, match=r"^block low: seed 1000001, fast model, rolling: it fails"):
        farm_study(farm, {"carriers": [1, 2]}, replace(AMPLE, store=tmp_path / "s.db"))


def test_a_sensitivity_names_the_values_with_which_a_run_fails(tmp_path, monkeypatch):
    """All its runs have the same code, so the first failure ends it. What was run is kept."""
    workers = Failing(lambda run: run.scenario.seed == 9)
    monkeypatch.setattr(sensitivities, "processes", lambda count: workers)
    options = replace(AMPLE, store=tmp_path / "s.db")
    speed = Factor(key="carrying.speed", low=0.8, high=1.2)
    words = r"^carrying\.speed=(0\.[89]|1\.[012])\d*: seed 9, fast model, rolling: it fails$"
    with pytest.raises(RunFailed, match=words):
        sensitivity(UNLIKE, [speed], options)
    done = [run.key for run in workers.done]
    assert len(done) == 8
    with Store(options.store_file, anew=False) as store:
        assert set(store.known(done)) == set(done)
