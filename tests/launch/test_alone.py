"""Local mode, where its next tick is far off."""

import signal

from orchard.field.scenario import Scenario
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
