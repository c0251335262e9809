"""A study in which own code fails: its setting is left out and named, and the others go on.

`FewRuns` are workers that do the runs in this process.
"""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from command_line import orchard
from few_runs import FewRuns
from small_studies import AMPLE, QUIET

from orchard.field.scenario import Scenario
from orchard.study import study as module
from orchard.study.findings import Findings
from orchard.study.result import StudyResult
from orchard.study.runs import RunFailed
from orchard.study.study import study
from orchard.study.workers import WorkerDied

ORCHARD = Scenario(rows=3, row_length=20.0, **QUIET)
RAISING = "own_policies.Raising"
PLACE = r"LookupError: no such bin here \(.*own_policies\.py, line \d+\)"


class Dying(FewRuns):
    """Workers that die each time with a run of a policy of the user's."""

    def do(self, work, items, goes_on):
        for item in items:
            if item.scenario.own_classes:
                raise WorkerDied(item)
            yield item, work(item)


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

    def failure(self, i, model):
        """Count how often it is asked."""
        self.count += 1

    def has_jammed(self, i, model):
        """No setting has."""
        return False


def test_each_setting_is_asked_once_whether_it_failed():
    """A study may have 10,000 settings, and tells what it knows again and again."""
    runs = Asked()
    question = SimpleNamespace(settings=range(100), model="fast")
    findings = Findings(question=question, runs=runs, begun=0.0)
    assert findings.alive == list(range(100))
    assert runs.count == 100


def test_the_command_shows_the_rest_and_fails(tmp_path):
    words = ("--horizon", "harvest", "--model", "fast", "--workers", 1, "--out", tmp_path / "s.db")
    size = ("--vary", "rows=3", "--vary", f"dispatch={RAISING},nearest")
    done = orchard("study", *size, *words, code=1)
    assert "nearest *" in done.stdout
    assert "own_policies.py, line" in done.stdout.replace("\n", " ")
