"""Local mode, where its next tick is far off."""

import signal

from orchard.config import Scenario
from processes import alone
from processes.wish import Wish


def test_ctrl_c_stops_it_at_once(tmp_path, monkeypatch):
    naps = []

    def nap(seconds):
        if seconds > 0.0:
            naps.append(seconds)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(alone.time, "sleep", nap)
    wish = Wish(Scenario(), "local", 1e-12, None, None, None, False, tmp_path)
    summary, why = alone.run(wish, None, lambda *figures: None)
    assert (why, summary["ticks"]) == ("stopped", 1)
    assert max(naps) < 1.0
