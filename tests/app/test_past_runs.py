"""Summaries of past runs and studies, as the page lists, compares and draws them."""

import json
import os
import sys

import pytest
from patience import PATIENCE

from orchard.app.charts import BINS, BUSY, WAITING, course_of
from orchard.app.command import Files, PrintedLines
from orchard.app.harvest_run import HarvestCommand
from orchard.app.past_runs import differences, lineages, past_runs
from orchard.app.study_run import StudyRun, StudySettings
from orchard.field.scenario import Scenario, with_changes

# What a run of the page has written, with a class that this machine does not have.
SUMMARY = {
    "mode": "local",
    "finished": True,
    "rows": 3,
    "sim_seconds": 60.0,
    "bins_delivered": 3,
    "bins_per_hour": 180.0,
    "picker_waiting_seconds": 1.0,
    "carrier_utilisation": 0.5,
    "scenario": {"rows": 3, "agents": {"picker": "no.such.Class"}},
    "times_real_time": 8.0,
    "rows_picked": 3,
    "bins": 3,
    "row_length": 70.0,
    "metres_picked": 210.0,
    "schedule_sim_seconds": 50.0,
    "state_seconds": {},
    "history": {
        "seconds": [10.0, 20.0],
        "bins_delivered": [0, 1],
        "pickers_waited_seconds": [0, 10.0],
        "carriers_busy_seconds": [20.0, 30.0],
    },
}


def test_only_what_differs_between_scenarios_is_compared():
    """Each value that differs is a line, with a column for each scenario."""
    changed = with_changes(
        Scenario(rows=7, agents={"picker": "a.B"}), tractor=False, **{"laser.noise": 0.01}
    )
    assert differences([Scenario(), changed, changed])["Rows"] == ["5", "7", "7"]
    assert differences([Scenario(), changed])["picker"] == ["built-in", "a.B"]
    assert list(differences([Scenario(seed=1), Scenario(seed=2)])) == ["Seed"]


# What is wrong in a summary, and why it is passed over.
WRONG_SUMMARIES = {
    "broken": ({"scenario": {"rows": 999}}, "rows = 999: must be a whole number from 3 to 100"),
    "empty": ({"history": {"seconds": []}}, "history: each sample needs all its values"),
    "uneven": (
        {"history": SUMMARY["history"] | {"seconds": [1.0]}},
        "history: each sample needs all its values",
    ),
    "text": ({"sim_seconds": "many"}, "Expected `float`, got `str` - at `$.sim_seconds`"),
    "nan": ({"bins_per_hour": float("nan")}, "JSON is malformed"),
}


def test_past_runs_are_the_summaries_and_any_other_file_is_named(tmp_path):
    """The file of a study, `study-1.json`, is no run, and is not named."""
    files = {
        "good": json.dumps(SUMMARY),
        "list": "[]",
        "half": "{",
        "nothing": "",
        "deep": "[" * 100_000,
        "study-1": "{}",
    }
    for name, (change, _) in WRONG_SUMMARIES.items():
        files[name] = json.dumps(SUMMARY | change)
    for name, text in files.items():
        (tmp_path / f"{name}.json").write_text(text)
    # The time of a file may be far beyond any date.
    os.utime(tmp_path / "half.json", (1e12, 1e12))

    (past,), passed_over = past_runs(tmp_path)
    assert past.name == "good"
    assert past.figures["Simulated"] == "1:00 min"
    assert past.scenario.agents == {"picker": "no.such.Class"}, "the class is not looked for"

    names = [line.partition(".json is passed over: ")[0] for line in passed_over]
    assert names == sorted([*WRONG_SUMMARIES, "list", "half", "nothing", "deep"])
    for _, reason in WRONG_SUMMARIES.values():
        assert any(reason in line for line in passed_over)


def test_forks_stand_under_their_parent_whatever_summaries_say(tmp_path):
    """The newest run stands first.

    Two runs that name each other as parent stay in the list, and so does a run that names itself.
    """
    # Each run, the oldest first, and the run of which its summary says that it is a fork.
    parents = {
        "old": None,
        "first": "old",
        "other": "gone",
        "of_first": "first",
        "second": "old",
        "own": "own",
        "a": "b",
        "b": "a",
    }
    for number, (name, parent) in enumerate(parents.items()):
        since = {} if parent is None else {"forked_from": {"run": parent, "seconds": 59.9}}
        (tmp_path / f"{name}.json").write_text(json.dumps(SUMMARY | since))
        os.utime(tmp_path / f"{name}.json", (number, number))
    runs, _ = past_runs(tmp_path)
    by_name = {past.name: past for past in runs}
    shown = [[past.name for past in lineage] for lineage in lineages(by_name)]
    assert shown[-4:] == [
        ["old"],
        ["old", "second"],
        ["old", "first"],
        ["old", "first", "of_first"],
    ]
    assert sorted(lineage[-1] for lineage in shown) == sorted(parents)


def test_output_of_a_command_that_is_no_result_is_named(tmp_path, monkeypatch):
    """The command prints JSON that is nested too deep, and leaves a file that is no JSON."""
    files = Files(tmp_path, "odd")
    deep = '{"study": {"none": ' + "[" * 100_000
    code = f"print({deep!r}); open({str(files.summary)!r}, 'w').write('{{\"answer\": NaN}}')"
    monkeypatch.setattr(
        "orchard.app.study_run.study_command",
        lambda scenario, settings, files: [sys.executable, "-c", code],
    )
    study = StudyRun(Scenario(), StudySettings(), files)
    study._listener.join(PATIENCE)
    assert study.is_over
    assert study.result is None
    assert study.state == "failed"
    # The line that was printed, and the one about the file.
    assert study.output.line_count == 2
    assert "odd.json is passed over: JSON is malformed" in study.output.lines[-1]


@pytest.mark.parametrize(
    "change", [{"sim_seconds": "many"}, {"history": 3}, {"rows": float("nan")}]
)
def test_a_summary_that_no_run_can_have_written_is_no_summary(tmp_path, change):
    # A command without its process: `__init__` would start one.
    run = HarvestCommand.__new__(HarvestCommand)
    run.files = Files(tmp_path, "odd")
    run.output = PrintedLines(0, ())
    run.summary = None
    run.files.summary.write_text(json.dumps(SUMMARY | change))
    run.finish()
    assert run.summary is None
    assert "odd.json is passed over" in run.output.lines[0]


def test_the_charts_show_the_history_in_minutes_and_per_cent():
    """Points are [minutes, value]: 10 s are 0.17 min.

    In the first 10 s the two pickers wait for 0 s, in the next 10 s for 10 s of 20 s: 50 %. The two
    carriers are busy for 20 s of 20 s, and then for 10 s.
    """
    course = course_of(SUMMARY["history"], Scenario(rows=3, pickers=2, carriers=2))
    assert course == {
        BINS: [[0.17, 0], [0.33, 1]],
        WAITING: [[0.17, 0.0], [0.33, 50.0]],
        BUSY: [[0.17, 100.0], [0.33, 50.0]],
    }
