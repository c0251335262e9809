"""The cheapest fleet that finishes in time: which one it is, how sure, and what no fleet can.

A fleet is a number of pickers and one of carriers. A deadline is a time of work, or the end of a
day. A fleet is in time if as many of its harvests are as the confidence asks for. Limits, which are
never longer than a harvest, tell of most fleets that they are late, without a run.
"""

from dataclasses import replace
from math import inf
from typing import Any

import pytest
from stage import empty_orchard

from orchard.field.problems import ScenarioError
from orchard.field.scenario import with_changes
from orchard.study.deadline import Deadline, Trial, hours_words
from orchard.study.finish_words import REMEDIES, least_share
from orchard.study.finishing import finish_problems, finish_study
from orchard.study.fleets import Crew, Fleets
from orchard.study.options import StudyOptions
from orchard.study.report import command
from orchard.study.runs import PlannedRun
from orchard.study.study import study

HOUR = 3600.0
PRICES = {"picker_per_hour": 20.0, "carrier_per_hour": 10.0}
# A day of two hours.
SHIFT = {"begin": "07:00", "end": "09:00"}
# Six rows of a bin each. A picker fills 4 bins an hour. Nothing in it is random: people and
# animals, weeds and tractor are left out.
SMALL = empty_orchard(rows=6, row_length=40.0, picking_rate=4.0, bins_per_row=1.0, prices=PRICES)
# The same with rows that take unlike times, which a seed draws.
CHANCE = with_changes(SMALL, picking={"spread": {"distribution": "lognormal", "cv": 0.3}})
OPTIONS = StudyOptions(horizon="harvest", model="fast", workers=1, budget_seconds=1000.0)
# Both numbers are open: the study finds them.
BOTH: dict[str, list[int]] = {"pickers": [], "carriers": []}
# Until when a run may take on the clock, s: it never gives up.
NO_DEADLINE = inf


def within(hours: float) -> Deadline:
    """Return a deadline after so many hours of work."""
    return Deadline(within_seconds=hours * HOUR)


def test_a_confidence_asks_for_so_many_harvests_in_time() -> None:
    """At 95 % 1 of 20 harvests may be late; at 97.5 % it takes 40 harvests for 1 that may be."""
    assert Trial.of(0.95) == Trial(replications=20, late=1)
    assert Trial.of(0.9) == Trial(replications=20, late=2)
    assert Trial.of(0.975) == Trial(replications=40, late=1)


def test_a_time_is_told_in_hours_and_minutes() -> None:
    assert hours_words(7 * HOUR + 41 * 60.0, 8 * 60.0) == "7:41 ± 0:08 h"
    assert hours_words(3599.0) == "1:00 h"


def test_how_many_harvests_are_in_time_at_least() -> None:
    """If 20 of 20 harvests were in time, the least share is that with which 20 in time have a
    chance of 5 %.
    """
    assert least_share(20, 20, 0.95) == pytest.approx(0.05 ** (1 / 20))
    assert least_share(0, 20, 0.95) == 0.0


# Two trailers of two bins that are away for 600 s; a truck that takes two bins every 600 s.
AWAY = {"seconds_away": 600.0, "trailers": {"count": 2, "bins": 2}}
TRUCK = {"truck": {"every": 600.0, "bins": 2}, "empty_bins": 2}
BATTERY = {"battery": {"hours": 2.0}}


def test_each_part_of_a_limit_has_a_remedy() -> None:
    """`parts` are the s that each part of an orchard needs at least, such as pickers or the bay.

    REMEDIES has for each what a user could have more of.
    """
    parts: set[str] = set()
    for values in ({"carrying": BATTERY}, {"load_out": AWAY}, {"load_out": TRUCK}):
        parts |= Crew(with_changes(SMALL, **values), 2).parts.keys()
    assert {"chargers", "trailers", "truck"} <= parts
    assert parts == REMEDIES.keys()


@pytest.mark.parametrize(("empty_bins", "seconds"), [(2, 1200.0), (4, 600.0), (6, 0.0)])
def test_a_truck_is_waited_for_once_empty_bins_are_out(empty_bins: int, seconds: float) -> None:
    """Six bins are filled. A truck brings two empty ones every 600 s, beside those at the bay."""
    scenario = with_changes(SMALL, load_out=TRUCK | {"empty_bins": empty_bins})
    assert Crew(scenario, 2).parts["truck"] == seconds


def test_trailers_hold_up_only_the_bins_beyond_the_empty_ones() -> None:
    """With six empty bins at the bay no bin of the six waits for a trailer."""
    stocked = Crew(with_changes(SMALL, load_out=AWAY | {"empty_bins": 6}), 2)
    assert stocked.parts["trailers"] == 0.0
    # The two trailers take four bins in 610 s: 600 s away, and 10 s in which two bins are put on
    # one.
    assert Crew(with_changes(SMALL, load_out=AWAY), 2).parts["trailers"] == 6 * 610.0 / 4


def test_a_deadline_before_the_truck_comes_is_refused_in_words() -> None:
    scenario = with_changes(SMALL, load_out=TRUCK)
    with pytest.raises(ScenarioError, match="because the truck would allow no more"):
        finish_study(scenario, BOTH, within(0.3), OPTIONS)


def test_the_answer_is_the_cheapest_fleet_in_time(tmp_path) -> None:
    """A run of each fleet finds the cheapest here. The answer costs as little, within 2 %."""
    found = finish_study(SMALL, BOTH, within(0.6), replace(OPTIONS, store=tmp_path / "s.db"))
    costs = {}
    for pickers in range(2, 7):
        for carriers in range(1, 4):
            scenario = with_changes(SMALL, pickers=pickers, carriers=carriers)
            record = PlannedRun(scenario, "fast").do(NO_DEADLINE)
            assert record is not None
            if record.sim_seconds <= 0.6 * HOUR:
                hours = record.sim_seconds / HOUR
                costs[pickers, carriers] = hours * (20.0 * pickers + 10.0 * carriers)
    best = found.best_row
    assert best is not None and best.harvest_seconds is not None
    fleet = best.setting["pickers"], best.setting["carriers"]
    assert costs[fleet] <= 1.02 * min(costs.values())
    assert best.harvest_seconds.mean <= 0.6 * HOUR and best.in_time == best.replications == 1
    # Most fleets need no run: their limits tell.
    assert len(found.table) < 10
    assert "would need" in found.answer and "within 0.6 h of work" in found.answer
    assert command(found).endswith("--finish-within 0.6h --confidence 0.95 --within 0.02")


def test_the_answer_is_in_time_as_often_as_is_asked(tmp_path) -> None:
    """At the default confidence of 95 % these are 19 of 20 harvests."""
    options = replace(OPTIONS, store=tmp_path / "s.db")
    found = finish_study(CHANCE, BOTH, within(0.6), options)
    best = found.best_row
    assert best is not None and best.in_time is not None
    assert best.replications == 20 and best.in_time >= 19
    assert f"{best.in_time} of 20 harvests within 0.6 h of work" in found.answer
    assert found == replace(
        finish_study(CHANCE, BOTH, within(0.6), replace(options, workers=2)),
        wall_seconds=found.wall_seconds,
    )


def test_without_prices_the_fewest_robots_answer(tmp_path) -> None:
    free = with_changes(SMALL, prices={"picker_per_hour": None, "carrier_per_hour": None})
    found = finish_study(free, BOTH, within(1.2), replace(OPTIONS, store=tmp_path / "s.db"))
    in_time = [row for row in found.table if row.in_time]
    fewest = min(sum(row.setting.values()) for row in in_time)
    assert found.best is not None and sum(found.best.values()) == fewest


def test_a_shift_says_on_which_day_the_harvest_ends(tmp_path) -> None:
    """Two hours a day: what takes longer ends on the second day, and is paid for it."""
    days = with_changes(SMALL, shift=SHIFT, prices={"carrier_per_day": 100.0})
    found = finish_study(
        days,
        {"pickers": [2], "carriers": [1]},
        Deadline(days=2),
        replace(OPTIONS, store=tmp_path / "s.db"),
    )
    assert "of work, on day 1 at 0" in found.answer or "of work, on day 2 at 0" in found.answer
    assert found.deadline == "by the end of day 2"
    row = found.best_row
    assert row is not None and row.paid["carrier_days"] > 0.0


def test_a_deadline_that_no_limit_meets_names_the_limit() -> None:
    with pytest.raises(ScenarioError) as error:
        finish_study(SMALL, BOTH, within(0.1), OPTIONS)
    told = str(error.value)
    assert told.startswith("--finish-within 0.1h: no fleet finishes within 0.1 h of work: without")
    assert "because the pickers would allow no more" in told
    assert "a deadline after that would do, or" in told and "a higher picking_rate" in told


def test_a_limit_is_not_longer_than_the_harvest() -> None:
    fleets = Fleets(SMALL, within(100.0), [2, 3, 6], [1, 2])
    for fleet in fleets.fleets:
        record = PlannedRun(fleet.setting.scenario, "fast").do(NO_DEADLINE)
        assert record is not None
        assert fleet.limit_seconds <= record.sim_seconds
        cost = fleet.setting.cost_per_bin(record.bins_per_hour, record.bins)
        assert cost is not None and fleet.least_cost <= cost * record.bins + 1e-9


@pytest.mark.parametrize("number", range(5))
def test_a_limit_of_a_seed_is_not_longer_than_its_harvest(number) -> None:
    """It is a limit of the rows of its own seed."""
    fleets = Fleets(CHANCE, within(100.0), [2, 3, 6], [1, 2])
    for fleet in fleets.fleets:
        crew = fleets.crew(fleet.pickers)
        seed = CHANCE.seed + number
        record = PlannedRun.of(fleet.setting.scenario, seed, "fast", "harvest").do(NO_DEADLINE)
        assert record is not None
        assert crew.limit_of_seed(fleet.carriers, seed) <= record.sim_seconds


def test_a_fleet_of_which_the_slow_rows_are_late_needs_no_run(tmp_path) -> None:
    """Three pickers have two rows each. If rows took equal times they would be in time. With the
    drawn times they are late in more than the one of 20 harvests that may be.
    """
    deadline = within(0.55)
    fleets = Fleets(CHANCE, deadline, [3], [2])
    (three,) = fleets.fleets
    late = fleets.least_late(three, 20)
    assert fleets.is_possible(three) and late > 1
    found = finish_study(CHANCE, BOTH, deadline, replace(OPTIONS, store=tmp_path / "s.db"))
    assert {row.setting["pickers"] for row in found.table} == {6}


def test_where_slow_rows_forbid_it_the_fastest_fleet_tells(tmp_path) -> None:
    """If rows took equal times, some fleet would be in time. One fleet is run, the fastest, and
    shows by how much they are late.
    """
    options = replace(OPTIONS, store=tmp_path / "s.db")
    found = finish_study(CHANCE, BOTH, within(0.28), options)
    assert found.best is None
    assert found.answer.startswith("No fleet finishes 19 of 20 harvests within 0.28 h of work: the")
    assert "the fastest one is 6 pickers and" in found.answer
    assert f"; a later deadline would do, or {REMEDIES['pickers']}" in found.answer


def test_a_smaller_fleet_in_time_says_why_it_is_not_the_answer(tmp_path) -> None:
    """Two pickers are done in 49 min with the first seeds. With two of 20 seeds they need more than
    an hour, which their rows alone take.
    """
    options = replace(OPTIONS, store=tmp_path / "s.db")
    found = finish_study(CHANCE, BOTH, within(1.0), options)
    (two,) = [row for row in found.table if row.setting["pickers"] == 2]
    assert two.in_time == two.replications
    assert two.standing == "worse"
    assert (
        "2 pickers and 1 carrier would need 0:49 h on average, but 2 of 20 harvests would be late"
        " even without traffic" in found.answer
    )


def test_a_smaller_fleet_in_time_that_is_dearer_tells_its_cost(tmp_path) -> None:
    """An hour of all else is so dear that the second carrier pays."""
    prices = PRICES | {"overhead_per_hour": 3000.0}
    found = finish_study(
        with_changes(SMALL, prices=prices),
        {"pickers": [6], "carriers": [1, 2]},
        within(1.0),
        replace(OPTIONS, store=tmp_path / "s.db"),
    )
    one, two = found.table
    assert found.best == two.setting and one.cost_per_bin is not None
    assert one.cost_per_bin.mean > two.cost_per_bin.mean
    assert "6 pickers and 1 carrier would need" in found.answer
    assert f" h, for {one.cost_per_bin.mean:.0f} a bin" in found.answer


MISTAKES: list[tuple[dict[str, list[Any]], Deadline, dict[str, Any], str]] = [
    (BOTH, Deadline(days=2), {}, "--finish-by 2d: shift: days need a shift"),
    (
        {"dispatch": ["nearest"]},
        within(1.0),
        {},
        "--finish-within 1h: with a deadline only pickers and carriers vary, and not dispatch",
    ),
    (BOTH, within(1.0), {"goal": "bins_per_hour"}, "--goal bins_per_hour: with a deadline"),
]


@pytest.mark.parametrize(("varied", "deadline", "changes", "told"), MISTAKES)
def test_a_question_that_cannot_be_is_told(varied, deadline, changes, told) -> None:
    (problem,) = finish_problems(SMALL, varied, deadline, replace(OPTIONS, **changes))
    assert str(problem).startswith(told)


@pytest.mark.parametrize(
    ("prices", "told"),
    [
        ({"carrier_per_hour": 8.0}, "--vary pickers: prices: pickers vary and cost nothing"),
        ({"picker_per_hour": 8.0}, "--vary carriers: prices: carriers vary and cost nothing"),
    ],
)
def test_robots_that_vary_need_a_price_if_others_have_one(prices, told) -> None:
    nothing = {"picker_per_hour": None, "carrier_per_hour": None}
    scenario = with_changes(SMALL, prices=nothing | prices)
    (problem,) = finish_problems(scenario, BOTH, within(1.0), OPTIONS)
    assert str(problem).startswith(told)


def test_a_study_without_a_deadline_tells_no_deadline(tmp_path) -> None:
    found = study(SMALL, {"carriers": [1]}, replace(OPTIONS, store=tmp_path / "s.db"))
    assert found.deadline == "" and found.table[0].in_time is None


@pytest.mark.parametrize(
    "differing",
    [
        {"picker_rates": {"picker_01": 0.3}},
        {"picking": {"spread_of_pickers": {"distribution": "gamma", "cv": 0.5}}},
    ],
)
def test_where_pickers_differ_each_number_of_them_is_tried(differing) -> None:
    """Else some numbers of pickers are left out, as no faster than fewer. Here one more picker may
    take the longest share from a slow one.
    """
    fleets = Fleets(with_changes(SMALL, **differing), within(10.0), [], [1])
    assert {fleet.pickers for fleet in fleets.fleets} == {2, 3, 4, 5, 6}
