"""When a run will be done, as the event model tells from its snapshots.

The process that shows a run asks for the forecast every few seconds. `within`: how sure it is, s; 0
if nothing in the harvest is left to chance. It has none (None) if the event model cannot go on from
the moment.
"""

from pathlib import Path

import pytest
from quiet import NOBODY

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.end_forecast import EndForecast, end_of
from orchard.local import Local
from orchard.report.summary import headline_of

SMALL = {"rows": 3, "pickers": 2, "carriers": 2, "row_length": 24.0}
# The figures of a run that physics publishes, as far as the line of progress shows them.
FIGURES = {
    "sim_seconds": 61.5,
    "times_real_time": 30.0,
    "rows_picked": 1,
    "rows": 3,
    "bins": 3,
    "row_length": 24.0,
    "metres_picked": 30.0,
    "bins_delivered": 1,
    "schedule_sim_seconds": 500.0,
    "carrier_utilisation": 0.5,
    "state_seconds": {},
}


def run_to(tick: int, **values: object) -> Local:
    """Return a run at a tick."""
    run = Local(Scenario.model_validate(SMALL | values), is_hashed=False)
    while run.engine.tick < tick:
        run.tick()
    return run


def test_the_end_of_a_quiet_run_is_told_to_the_second() -> None:
    run = run_to(400, **NOBODY)
    forecast = end_of(run.snapshot())
    while not run.ended:
        run.tick()
    assert forecast is not None
    assert forecast.within == 0.0
    assert forecast.seconds == pytest.approx(run.engine.world.seconds, abs=2.0)


def test_with_people_about_the_end_is_told_with_its_interval() -> None:
    forecast = end_of(run_to(400, people={"workers": 3, "visitors": 3}).snapshot())
    assert forecast is not None
    assert 0.0 < forecast.within < 0.2 * forecast.seconds


def test_a_run_with_an_emergency_stop_tells_no_end() -> None:
    run = run_to(200, **NOBODY)
    run.engine.world.stopped[run.engine.world.index["picker_01"]] = True
    assert end_of(run.snapshot()) is None


def test_a_run_with_agents_elsewhere_tells_no_end() -> None:
    snapshot = run_to(200, **NOBODY).snapshot()
    snapshot.elsewhere = ["carrier_01"]
    assert end_of(snapshot) is None


def test_the_end_stands_in_the_line_and_sets_the_time_left() -> None:
    # 300 s are left, which take 10 s at 30 times real time.
    headline = headline_of(FIGURES | {"done_seconds": 361.5, "done_within_seconds": 4.0})
    assert headline.line().startswith("   61.5 of 362 ± 4 s  ")
    assert headline.line().endswith("0:10 min left")
    assert headline.done_words == "done at 6:02 min ± 0:04 min"


def test_a_line_without_room_leaves_the_end_out() -> None:
    wide = FIGURES | {"rows": 100, "bins": 1000, "bins_delivered": 1000, "sim_seconds": 99999.0}
    headline = headline_of(wide | {"done_seconds": 360000.0, "done_within_seconds": 4000.0})
    assert len(headline.line()) <= 80


def test_no_code_of_the_users_own_runs_for_a_forecast(tmp_path: Path) -> None:
    """A policy of the user's own runs in the process of the dispatcher, and nowhere else."""
    scenario = Scenario.model_validate(SMALL | {"dispatch": "own_dispatch.Nearest"})
    forecast = EndForecast(lay_out(scenario), tmp_path)
    assert forecast() is None
    assert not forecast.is_wanted


def test_a_run_without_snapshots_has_no_forecast() -> None:
    assert EndForecast(lay_out(Scenario.model_validate(SMALL)), None)() is None
