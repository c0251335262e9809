"""Runs side by side: at which moment they are compared, and how each of them ended."""

import json
from threading import Thread
from types import SimpleNamespace

import pytest

from orchard.app.command import RunState
from orchard.app.harvest_run import HarvestCommand
from orchard.app.past_runs import compared, past_runs

# Summaries of runs: of a whole harvest of 400 s by 2 pickers and 1 carrier, and what differs in one
# that was cut at 240 s. A history has a sample at each of its `seconds`.
HISTORY = {
    "seconds": [100.0, 200.0, 400.0],
    "bins_delivered": [1, 2, 6],
    "pickers_waited_seconds": [20.0, 40.0, 160.0],
    "carriers_busy_seconds": [50.0, 150.0, 350.0],
}
WHOLE = {
    "mode": "local",
    "finished": True,
    "ended": "harvested",
    "rows": 3,
    "sim_seconds": 400.0,
    "bins_delivered": 6,
    "bins_per_hour": 54.0,
    "picker_waiting_seconds": 1.0,
    "carrier_utilisation": 0.5,
    "scenario": {"rows": 3, "pickers": 2, "carriers": 1},
    "times_real_time": 8.0,
    "rows_picked": 3,
    "bins": 6,
    "row_length": 70.0,
    "metres_picked": 210.0,
    "schedule_sim_seconds": 50.0,
    "state_seconds": {},
    "history": HISTORY,
}
CUT = {
    "finished": False,
    "ended": "duration",
    "sim_seconds": 240.0,
    "bins_delivered": 2,
    "history": {name: values[:2] for name, values in HISTORY.items()},
}


@pytest.fixture
def runs(tmp_path):
    """Leave the summaries of some runs, and read them as the page does."""

    def read(**changes):
        for name, change in changes.items():
            (tmp_path / f"{name}.json").write_text(json.dumps(WHOLE | change))
        found, faults = past_runs(tmp_path)
        assert faults == []
        return sorted(found, key=lambda past: past.name)

    return read


def test_a_whole_run_and_a_cut_one_are_compared_at_one_moment(runs):
    """The whole run is compared at the 240 s of the other one; at its end it has more of all.

    Both then have 2 bins: 30 an hour. By their last sample before, 2 pickers have waited for 40 s,
    8 % of 2 x 240 s, and the carrier was busy for 150 s, 62 % of 240 s.
    """
    comparison = compared(runs(a_whole={}, b_cut=CUT))
    assert comparison.words == "All are compared at 4:00 min, when the first of them ended."
    whole, cut = comparison.figures
    assert whole == cut
    assert whole == {
        "Bins": "2 of 6",
        "Bins per hour": "30.0",
        "Pickers wait": "8 % of the time",
        "Carriers at work": "62 %",
    }


def test_two_whole_runs_are_compared_at_their_ends(runs):
    comparison = compared(runs(a={}, b={"sim_seconds": 390.0}))
    assert comparison.words == "Each is shown at the end of its harvest."
    assert [figures["Simulated"] for figures in comparison.figures] == ["6:40 min", "6:30 min"]


def test_how_each_run_ended_is_said(runs):
    long = {"sim_seconds": 26_631.0}
    past = runs(a={}, b=CUT, c=CUT | {"ended": "jammed"}, d=long)
    assert [run.end for run in past] == [
        "harvest done at 6:40 min",
        "cut short at 4:00 min",
        "jammed at 4:00 min",
        "harvest done at 7:23:51 h",
    ]


def test_a_run_that_was_cut_is_not_finished():
    """Its process ends with exit code 0 in both cases: the summary decides."""
    # A command without its process: `__init__` would start one.
    run = HarvestCommand.__new__(HarvestCommand)
    run._listener = Thread()
    run._process = SimpleNamespace(returncode=0)
    run.asked_to_stop = False
    states = []
    for is_whole in (True, False):
        run.summary = {"finished": is_whole}
        states.append(run.state)
    assert states == [RunState.finished, RunState.cut]
    assert states[1].is_over
