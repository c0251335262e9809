"""What the page keeps and reads, without a browser: links, the desks of browsers, the runs that have ended."""

import json
import os
import sys

import pytest

from orchard.app.charts import BINS, BUSY, WAITING, course_of
from orchard.app.command import Files
from orchard.app.desks import MOST, desk_of
from orchard.app.draft import Draft, draft_of, query_of, title_of
from orchard.app.harvest_run import Run
from orchard.app.runs_view import differences, past_runs
from orchard.app.study_run import StudyRun, StudySettings
from orchard.field.scenario import Scenario, with_changes

SUMMARY = {"mode": "local", "finished": True, "rows": 3, "sim_seconds": 60.0, "bins_delivered": 3, "bins_per_hour": 180.0,
           "picker_waiting_seconds": 1.0, "carrier_utilisation": 0.5, "scenario": {"rows": 3, "agents": {"picker": "no.such.Class"}},
           "times_real_time": 8.0, "rows_picked": 3, "row_length": 70.0, "metres_picked": 210.0, "schedule_sim_seconds": 50.0,
           "state_seconds": {},
           "history": {"seconds": [10.0, 20.0], "bins_delivered": [0, 1], "pickers_waited_seconds": [0, 10.0],
                       "carriers_busy_seconds": [20.0, 30.0]}}  # fmt: skip


@pytest.mark.parametrize("changes", [{}, {"rows": 7, "people.workers": 0}, {"seed": 2**63 - 1, "laser.noise": 0.0125, "tractor": False}])
def test_a_link_brings_back_its_scenario(changes):
    scenario = with_changes(Scenario(), **changes)
    query = query_of(scenario)
    assert len(query.split("&")) == max(1, len(changes)), "only what differs from the default"
    draft, unknown = draft_of(pair.split("=") for pair in query.split("&") if pair)
    assert (draft.scenario, unknown) == (scenario, [])


def test_what_is_wrong_in_a_link_is_told():
    draft, unknown = draft_of([("rows", "99"), ("pikers", "3"), ("agents", "os.system"), ("tractor", "perhaps")])
    assert unknown == ["pikers: no such setting; did you mean pickers?", "agents: no such setting"]
    assert draft.problems.keys() == {"rows", "tractor"}


def test_each_browser_has_its_desk_and_two_pages_of_one_do_not_change_each_other():
    desk_of.cache_clear()
    desk_of("one").draft.enter({"rows": "9"})
    assert desk_of("one").draft.scenario == Scenario(rows=9)
    assert desk_of("other").draft.scenario == Scenario()
    page = desk_of("one").draft.copy()
    page.enter({"rows": "x"})
    assert desk_of("one").draft.scenario == Scenario(rows=9)
    for n in range(MOST - 1):
        desk_of(str(n))
    assert desk_of("one").draft.scenario == Scenario(rows=9), "it was there last"
    assert desk_of("other").draft.scenario == Scenario() and desk_of.cache_info().currsize == MOST


def test_a_scenario_has_a_title_and_a_draft_its_own_values():
    assert title_of(Scenario()) == "5 rows, 2 pickers, 2 carriers, seed 1"
    other = with_changes(Scenario(rows=7, agents={"picker": "a.B"}), tractor=False, **{"laser.noise": 0.01})
    assert title_of(other) == "7 rows, 2 pickers, 2 carriers, seed 1, tractor off, laser noise 0.01, own classes"
    assert differences([Scenario(), other, other])["Rows"] == ["5", "7", "7"]
    assert differences([Scenario(), other])["picker"] == ["built-in", "a.B"]
    assert list(differences([Scenario(seed=1), Scenario(seed=2)])) == ["Seed"]
    assert Draft(other).copy().values == Draft(other).values


STRANGE = {
    "broken": ({"scenario": {"rows": 99}}, "rows = 99: must be a whole number from 3 to 20"),
    "empty": ({"history": {"seconds": []}}, "history: each sample needs all its values"),
    "uneven": ({"history": SUMMARY["history"] | {"seconds": [1.0]}}, "history: each sample needs all its values"),
    "text": ({"sim_seconds": "many"}, "Expected `float`, got `str` - at `$.sim_seconds`"),
    "nan": ({"bins_per_hour": float("nan")}, "JSON is malformed"),
}


def test_past_runs_are_the_summaries_and_any_other_file_is_named(tmp_path):
    files = {"good": json.dumps(SUMMARY), "list": "[]", "half": "{", "nothing": "", "deep": "[" * 100_000, "study-1": "{}"}
    for name, text in (files | {name: json.dumps(SUMMARY | change) for name, (change, _) in STRANGE.items()}).items():
        (tmp_path / f"{name}.json").write_text(text)
    os.utime(tmp_path / "half.json", (1e12, 1e12))
    (past,), others = past_runs(tmp_path)
    assert past.name == "good" and past.figures["Simulated"] == "1:00 min"
    assert past.scenario.agents == {"picker": "no.such.Class"}, "it is read, and no class is looked for"
    assert [words.partition(".json is passed over: ")[0] for words in others] == sorted([*STRANGE, "list", "half", "nothing", "deep"])
    assert all(any(why in words for words in others) for _, why in STRANGE.values())


def test_what_a_command_prints_and_leaves_that_is_no_result_is_named(tmp_path, monkeypatch):
    files = Files(tmp_path, "odd")
    deep = '{"study": {"none": ' + "[" * 100_000
    code = f"print({deep!r}); open({str(files.summary)!r}, 'w').write('{{\"answer\": NaN}}')"
    monkeypatch.setattr("orchard.app.study_run.study_command", lambda settings, files: [sys.executable, "-c", code])
    study = StudyRun(Scenario(), StudySettings(), files)
    study._listener.join(20.0)
    assert (study.is_over, study.result, study.state) == (True, None, "failed")
    assert study.said[0] == 2 and "odd.json is passed over: JSON is malformed" in study.said[1][-1]


@pytest.mark.parametrize("change", [{"sim_seconds": "many"}, {"history": 3}, {"rows": float("nan")}])
def test_a_summary_that_no_run_can_have_written_is_no_summary(tmp_path, change):
    run = Run.__new__(Run)
    run.files, run.said, run.summary = Files(tmp_path, "odd"), (0, ()), None
    run.files.summary.write_text(json.dumps(SUMMARY | change))
    run.finish()
    assert run.summary is None and "odd.json is passed over" in run.said[1][0]


def test_the_course_is_what_the_charts_show():
    course = course_of(SUMMARY["history"], Scenario(rows=3, pickers=2, carriers=2))
    assert course == {BINS: [[0.17, 0], [0.33, 1]], WAITING: [[0.17, 0.0], [0.33, 50.0]], BUSY: [[0.17, 100.0], [0.33, 50.0]]}
