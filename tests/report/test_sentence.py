"""The first sentence of a summary is right for every end of a run."""

import pytest
from run_endings import harvested

from orchard.report.summary import clock, sentence

WELL = "5 of 5 rows in 16:10 min, simulated: 18.6 bins an hour, 74 % of the 24.9 that the carriers would allow without traffic"
HALF = {"finished": False, "sim_seconds": 300.0, "rows_picked": 2, "metres_picked": 209.9, "bins_delivered": 0, "bins_per_hour": 0.0}
HALVED = "after 5:00 min, simulated, before the harvest was finished: 2 of 5 rows and 59 % of their metres picked, 0 of 5 bins delivered"


@pytest.mark.parametrize(
    ("figures", "told"),
    [
        ({}, f"{WELL}."),
        ({"bottleneck": "unloading"}, f"{WELL.replace('the carriers', 'unloading')}."),
        ({"ended": "stopped"}, f"{WELL}."),  # Ctrl-C came when all was done
        ({"violations": ["a", "b"], "broken_agents": ["cat_01, since tick 9"]}, f"{WELL}; 2 violations; 1 broken agent."),
        (HALF | {"ended": "duration"}, f"Ended by --duration {HALVED}."),
        (HALF | {"ended": "stopped"}, f"Stopped {HALVED}."),
        (HALF | {"ended": "jammed"}, f"Jammed {HALVED}."),
        (HALF | {"ended": "stopped", "broken_agents": ["carrier_01, since tick 1"]}, f"Stopped {HALVED}; 1 broken agent."),
        (HALF | {"ended": "of its router"}, f"Ended (of its router) {HALVED}."),
    ],
)
def test_the_first_sentence_tells_how_the_run_ended(figures, told):
    assert sentence(harvested(**figures)) == told


def test_a_run_that_is_stopped_before_its_first_tick_has_a_sentence():
    nothing = harvested(**HALF | {"ended": "stopped", "sim_seconds": 0.0, "metres_picked": 0.0})
    assert sentence(nothing).startswith("Stopped after 0:00 min, simulated, before the harvest was finished: 2 of 5 rows and 0 %")


@pytest.mark.parametrize(("seconds", "told"), [(0.4, "0:00 min"), (3599.4, "59:59 min"), (3599.6, "1:00:00 h"), (9219.0, "2:33:39 h")])
def test_a_time_is_told_in_minutes_or_hours(seconds, told):
    assert clock(seconds) == told
