"""Ctrl-C in local mode, where its next tick is far off, or an agent never ends the present one."""

import signal

from command_line import orchard
from fleet import ROOT
from local_runs import SMALL, local_hash

from orchard.field.scenario import Scenario, to_yaml
from orchard.launch import local_run
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest


def test_ctrl_c_stops_it_at_once(tmp_path, monkeypatch):
    naps = []

    def nap(seconds):
        if seconds > 0.0:
            naps.append(seconds)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(local_run.time, "sleep", nap)
    wish = RunRequest(HarvestOptions(mode="local", speed=1e-12), Scenario(), None, tmp_path)
    summary, why = local_run.run(wish, None, lambda *figures: None)
    assert (why, summary["ticks"]) == ("stopped", 1)
    assert max(naps) < 1.0


def test_ctrl_c_ends_the_endless_tick_of_an_agent_and_the_result_is_that_of_the_ticks_before(tmp_path, capsys):
    scenario = SMALL.model_copy(update={"agents": {"picker_01": "own_agents.Endless"}})
    wish = RunRequest(HarvestOptions(mode="local"), scenario, None, tmp_path)
    summary, why = local_run.run(wish, None, lambda *figures: None)
    assert (why, summary["ticks"]) == ("stopped", 3)
    assert summary["hash"] == local_hash(scenario, 3)
    said = capsys.readouterr().err.replace("\n", "")
    assert "picker_01 still thinks about tick 3, in" in said
    assert "own_agents.py, line" in said
    assert [path.name for path in tmp_path.glob("tick-*")] == ["tick-000000000.snapshot"], "none of the tick that was broken off"


def test_ctrl_c_ends_an_agent_that_catches_everything_by_force(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{ROOT / 'tests' / 'support'}")
    path = tmp_path / "scenario.yaml"
    path.write_text(to_yaml(SMALL.model_copy(update={"agents": {"picker_01": "own_agents.Stubborn"}})))
    done = orchard(path, "--mode", "local", "--record", "none", seconds=60.0)
    assert done.returncode == 1
    assert "picker_01 still thinks about tick 3, in" in done.stderr
    assert "ended by force" in done.stderr
