"""The course of a run in its summary: what the page's charts show."""

import time

import pytest
from stage import Stage, empty_orchard

from orchard.report import metrics
from orchard.report.metrics import shares
from orchard.report.summary import as_table
from orchard.server.figures import RunFigures


@pytest.fixture
def harvested():
    stage = Stage(empty_orchard(rows=4, pickers=2, carriers=2))
    stage.run_to_the_end()
    return stage


def test_the_course_of_a_harvest_ends_with_its_figures(harvested):
    summary = harvested.account.summary()
    course, seconds = summary["history"], summary["sim_seconds"]
    assert course["bins_delivered"][-1] == 4 and course["bins_delivered"] == sorted(course["bins_delivered"])
    assert course["seconds"] == [*(10.0 * n for n in range(1, len(course["seconds"]))), seconds]
    waited = summary["state_seconds"]["picker"]
    assert course["pickers_waited_seconds"][-1] == pytest.approx(waited["waiting"] + waited.get("calling", 0.0))
    assert course["carriers_busy_seconds"][-1] == pytest.approx(summary["carrier_utilisation"] * 2 * seconds, abs=0.1)
    assert all(0.0 <= share <= 1.01 for share in shares(course, "pickers_waited_seconds", 2))
    assert sum(shares(course, "carriers_busy_seconds", 2)) > 0
    assert summary["scenario"]["rows"] == 4
    assert not {"history", "scenario"} & set(as_table(summary).columns[0].cells)


def test_a_long_run_has_few_samples_and_a_resumed_one_continues_them(monkeypatch):
    monkeypatch.setattr(metrics, "MOST_SAMPLES", 8)
    stage = Stage(empty_orchard(rows=4, pickers=2, carriers=2))
    stage.run(100.0)
    assert stage.account.summary()["history"]["seconds"] == [20.0, 40.0, 60.0, 80.0, 100.0]
    stage.account = RunFigures(stage.local.engine, time.monotonic, stage.account.as_data())
    stage.run(25.0)
    assert stage.account.summary()["history"]["seconds"] == [20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 125.0]
