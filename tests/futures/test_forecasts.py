"""Forecasts: `orchard fork --futures` asks the event model first, and then the simulator.

A future is a run that goes on from a moment, (number of its draws, snapshot). `live` simulates it;
`forecast` lets the event model do it, or returns None where that cannot. The search for a decision
expects an answer from forecasts, and simulates only the moments that confirm it.
"""

import pytest
from quiet import NOBODY

from orchard.field.scenario import Scenario
from orchard.fork.forked import forked
from orchard.futures.bisection import NEAR, Bisection, badly, confirmed_search, expected_search
from orchard.futures.comparison import fault_notes
from orchard.futures.forecasts import forecast
from orchard.futures.moments import live
from orchard.local import Local

SMALL = {"rows": 4, "pickers": 2, "carriers": 2, "row_length": 24.0, "queue_room": 3}
# Ticks for which a future may go on: until it ends.
FOREVER = 10**9
# The ticks at which futures begin first.
MOMENTS = [0, 600, 1200]
# Harvests of 600 s end well.
ENDS_BADLY = badly("sim_seconds>700", ["sim_seconds"])


def moment_at(tick, **values):
    """Return a snapshot of a run at a tick."""
    run = Local(Scenario.model_validate(SMALL | NOBODY | values), is_hashed=False)
    while run.engine.tick < tick:
        run.tick()
    return run.snapshot()


@pytest.mark.parametrize("changes", [{}, {"carriers": 3}, {"dispatch": "nearest"}])
@pytest.mark.parametrize("tick", [0, 437])
def test_a_forecast_is_what_the_simulator_lives(changes, tick):
    first_moment = forked(moment_at(tick), changes)
    lived = live(FOREVER, (0, first_moment))
    expected = forecast((0, first_moment))
    assert expected is not None
    assert expected["ended"] == lived["ended"] == "harvested"
    assert expected["sim_seconds"] == pytest.approx(lived["sim_seconds"], abs=2.0)
    assert expected["bins_per_hour"] == pytest.approx(lived["bins_per_hour"], rel=0.005)


def test_bins_that_had_called_report_to_the_dispatcher_of_a_fork():
    """With one carrier the run has no dispatcher, and its fork has one, which knows nothing of the
    calls before. A bin that waits is fetched all the same.
    """
    first_moment = forked(moment_at(1000, carriers=1), {"carriers": 2})
    lived = live(FOREVER, (0, first_moment))
    expected = forecast((0, first_moment))
    assert expected is not None
    assert expected["ended"] == lived["ended"] == "harvested"
    assert expected["sim_seconds"] == pytest.approx(lived["sim_seconds"], abs=0.5)


def test_part_full_bins_count_in_a_forecast_as_in_a_run():
    first_moment = moment_at(300, metres_per_bin=17.0)
    lived = live(FOREVER, (0, first_moment))
    expected = forecast((0, first_moment))
    assert expected is not None
    assert expected["bins_per_hour"] == pytest.approx(lived["bins_per_hour"], rel=0.005)


def test_futures_tell_of_a_policy_that_failed_in_them():
    """Without that, a future in which another policy decided would be taken for one of the own."""
    well = {"orders_refused": 0, "broken_agents": []}
    badly_decided = {"orders_refused": 3, "broken_agents": ["dispatch, since tick 3003"]}
    notes = fault_notes({"as it was": [well, well], "carriers=3": [well, badly_decided]})
    assert notes == [
        "carriers=3: 1 of 2 futures had faults: refused decisions of the dispatch policy: 3"
    ]


def test_of_robots_that_were_stopped_there_is_no_forecast():
    assert forecast((0, forked(moment_at(200), {}, ["picker_02"]))) is None


class OnPaper:
    """Futures that are not simulated. Each ends well if it begins up to the tick `decided`.

    By its forecast it does so up to the tick `expected`; None: there is no forecast.
    """

    def __init__(self, decided, expected):
        self.decided = decided
        self.expected = expected
        self.lived_ticks = []

    def live(self, begun):
        self.lived_ticks += begun
        return [self._future(tick, self.decided) for tick in begun]

    def forecast(self, begun):
        return [None if self.expected is None else self._future(begun[0], self.expected)]

    def _future(self, tick, decided):
        return {"ended": "harvested", "sim_seconds": 600.0 if tick <= decided else 800.0}


def searched(monkeypatch, futures):
    """Search for the decision of `OnPaper` futures, by forecasts and then by lives."""
    # Nothing is compiled, and there is no scenario to check: a moment here is only its tick.
    monkeypatch.setattr("orchard.futures.bisection.get_ready", list)
    monkeypatch.setattr("orchard.futures.bisection.check", lambda scenario: scenario)

    class Tick(int):
        """A tick in place of a snapshot."""

        scenario = None

    def begun_at(tick):
        return [Tick(tick)]

    expected = expected_search(MOMENTS, begun_at, futures, ENDS_BADLY)
    return confirmed_search(expected, MOMENTS, begun_at, futures)


@pytest.mark.parametrize(("decided", "count"), [(-1, 2), (0, 2), (777, 2), (9999, 1)])
def test_what_is_expected_is_confirmed_at_one_or_two_moments(monkeypatch, decided, count):
    """`count`: the moments that are simulated: the last good one and the first bad one."""
    futures = OnPaper(decided, expected=decided)
    assert_is_found(searched(monkeypatch, futures), decided)
    assert len(futures.lived_ticks) == count


@pytest.mark.parametrize("decided", [-1, 0, 777, 9999])
@pytest.mark.parametrize("expected", [-1, 0, 300, 776, 790, 1300, None])
def test_a_wrong_expectation_changes_no_answer(monkeypatch, decided, expected):
    assert_is_found(searched(monkeypatch, OnPaper(decided, expected)), decided)


def assert_is_found(bisection: Bisection, decided: int) -> None:
    """Assert that the answer is that of a search by the simulator alone."""
    well, bad = bisection.answer
    if decided < MOMENTS[0]:
        assert well is None
    elif decided > MOMENTS[-1]:
        assert well == MOMENTS[-1]
        assert bad is None
    else:
        assert well <= decided < bad <= well + NEAR
