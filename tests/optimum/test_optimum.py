"""The proven bound on a harvest's time: no harvest beats it, another solver finds the same, and
what has no bound is refused in words.

`optimum(layout, work)` lets a solver search for the shortest schedule of all jobs, and prove how
short one can be at most. `work` ends the search, not the clock; `gap` is what lies between the best
schedule and the proof, as a share.
"""

import json
from itertools import combinations
from random import Random
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ortools", reason="the extra `optimum` is not installed")
from drawn_machines import drawn_values
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize
from stage import Stage, empty_orchard

from orchard.commands.bound import BoundOptions, print_bound
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.queue import QUEUES
from orchard.field.scenario import DISPATCH_POLICIES, ROW_RULES, TIME_STEP, Scenario, load
from orchard.optimum import NoBound
from orchard.optimum.schedule import Schedule, optimum
from orchard.plans.jobs import TimedJob, jobs_of, ticks
from orchard.plans.steps import Unload
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question

ORCHARDS: list[dict[str, Any]] = [
    {"rows": 3, "pickers": 2, "carriers": 1},
    {"rows": 6, "pickers": 6, "carriers": 8, "route": "two-way", "row_length": 30.0},
    {
        "rows": 8,
        "pickers": 3,
        "carriers": 4,
        "rows_to_pickers": "balanced-ends",
        "picking_speed": 0.3,
    },
    {
        "rows": 7,
        "pickers": 3,
        "carriers": 2,
        "route": "two-way",
        "rows_to_pickers": "manual",
        "bay": 30.0,
    },
    {
        "rows": 4,
        "pickers": 2,
        "carriers": 3,
        "metres_per_bin": 30.0,
        "order_in_row": "outward",
        "picking_speed": 0.02,
    },
    {
        "rows": 5,
        "pickers": 2,
        "carriers": 2,
        "bins_per_row": 0.7,
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    {
        "rows": 5,
        "pickers": 4,
        "carriers": 3,
        "picking_speed": 0.5,
        "picking": {"spread": {"distribution": "gamma", "cv": 0.3}},
    },
    {
        "rows": 8,
        "pickers": 4,
        "carriers": 3,
        "row_length": 30.0,
        "route": "two-way",
        "chargers": 2,
        "carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.75}},
    },
]


@pytest.mark.parametrize("values", ORCHARDS)
def test_no_policy_beats_what_is_proven(values):
    """A proof of under 0.6 of the best harvest would say little: the search has time for more."""
    layouts = [lay_out(empty_orchard(**values, dispatch=policy)) for policy in DISPATCH_POLICIES]
    best = min(DiscreteHarvest(layout).run().seconds for layout in layouts)
    proven = optimum(layouts[0], 0.3).proven_seconds
    assert 0.6 * best < proven <= best


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    rows=st.integers(3, 9),
    # Pickers, carriers, and what their machines are drawn by.
    fleet=st.tuples(st.integers(2, 6), st.integers(1, 6), st.integers(0, 2**16)),
    speed=st.sampled_from([0.05, 0.4, 1.0]),
    route=st.sampled_from([*QUEUES]),
    rule=st.sampled_from(ROW_RULES),
    bin_metres=st.sampled_from([None, None, 30.0]),
    policy=st.sampled_from(DISPATCH_POLICIES),
)
def test_no_random_harvest_beats_what_is_proven(
    rows, fleet, speed, route, rule, bin_metres, policy
):
    work = {"picking_speed": speed, "metres_per_bin": bin_metres, "row_length": 40.0, "rows": rows}
    values = {
        "pickers": min(rows, fleet[0]),
        "carriers": fleet[1],
        "route": route,
        "rows_to_pickers": rule,
        "dispatch": policy,
    }
    # A third of them have the machines of the default.
    drawn: dict[str, Any] = {}
    if fleet[2] % 3 != 0:
        drawn = drawn_values(Random(fleet[2]))
    layout = lay_out(empty_orchard(**work, **values, **drawn))
    assert optimum(layout, 0.05).proven_seconds <= DiscreteHarvest(layout).run().seconds


def test_roads_that_robots_share_make_the_bound_longer():
    """Both searches end with a proof. With roads that robots have alone, one after another, the
    bound is more than 2 % longer.
    """
    layout = lay_out(empty_orchard(rows=5, pickers=5, carriers=5, route="two-way"))
    free = optimum(layout, 1.0, free_roads=True)
    shared = optimum(layout, 1.0)
    assert free.gap == 0.0
    assert shared.gap == 0.0
    assert shared.proven_seconds > 1.02 * free.proven_seconds
    assert shared.proven_seconds <= DiscreteHarvest(layout).run().seconds


@pytest.mark.parametrize("values", [{}, {"route": "two-way", "carriers": 2}])
def test_the_simulator_does_not_beat_it_either(values):
    scenario = empty_orchard(
        **{"rows": 3, "pickers": 3, "carriers": 3, "row_length": 20.0} | values
    )
    proven = optimum(lay_out(scenario), 0.5).proven_seconds
    took = Stage(scenario).run_to_the_end()
    assert 0.8 * took < proven <= took


@pytest.mark.parametrize(
    "values",
    [
        {"carriers": 1},
        {"carriers": 2},
        {"rows": 4, "pickers": 3, "carriers": 2, "route": "two-way"},
    ],
)
def test_another_solver_finds_the_same_optimum(values):
    layout = lay_out(empty_orchard(**{"rows": 4, "pickers": 2} | values))
    result = optimum(layout, 5.0, free_roads=True)
    assert result.gap == 0.0
    ticks_of_other = shortest(jobs_of(layout), layout.scenario.carrier_count)
    assert result.best_seconds == pytest.approx(TIME_STEP * ticks_of_other, abs=TIME_STEP / 2)


def shortest(jobs: list[TimedJob], carriers: int) -> float:
    """Return when the best schedule on free roads ends, ticks, by a mixed-integer program.

    The unknowns are, in this order: the tick at which each job's carrier stops, the end of the
    schedule, whether a carrier does a job, and for each pair of jobs whether the first one of them
    comes first. `late` is longer than any schedule: times it, a choice that is not made lifts a
    demand.
    """
    count = len(jobs)
    pairs = list(combinations(range(count), 2))
    late = float(sum(job.ready + job.approach + job.to_bay + job.to_head for job in jobs))
    end = count
    does_job = np.arange(end + 1, end + 1 + count * carriers).reshape(count, carriers)
    is_first = range(does_job.max() + 1, does_job.max() + 1 + len(pairs))
    rows: list[np.ndarray] = []
    least: list[float] = []

    def demand(at_least: float, *terms: tuple[int, float]) -> None:
        """Demand that a sum of terms, (index of the unknown, factor), has at least this value."""
        rows.append(np.zeros(is_first.stop))
        least.append(at_least)
        for index, factor in terms:
            rows[-1][index] += factor

    for i, job in enumerate(jobs):
        if i > 0 and jobs[i - 1].picker == job.picker:
            demand(job.ready + jobs[i - 1].going_on, (i, 1), (i - 1, -1))
        else:
            demand(job.ready, (i, 1))
        demand(job.approach, (i, 1))
        demand(job.to_bay + job.to_rest, (end, 1), (i, -1))
        demand(1, *((choice, 1) for choice in does_job[i]))

    def demand_order(earlier: int, later: int, number: int, sign: float) -> None:
        """Demand the time between two jobs, if one carrier does both, in this order.

        `sign`: the factor of the choice of the pair, -late or late, by which the order counts.
        """
        between = jobs[earlier].to_bay + jobs[earlier].to_head + jobs[later].approach
        at_least = between - 2 * late + min(sign, 0.0)
        order = (is_first[number], sign)
        for does_earlier, does_later in zip(does_job[earlier], does_job[later], strict=True):
            both = ((does_earlier, -late), (does_later, -late))
            demand(at_least, (later, 1), (earlier, -1), order, *both)

    for number, (one, other) in enumerate(pairs):
        demand_order(one, other, number, -late)
        demand_order(other, one, number, late)
    unknowns = np.arange(is_first.stop)
    is_choice = unknowns > end
    limits = optimize.Bounds(0.0, np.where(is_choice, 1.0, late))
    goal = (unknowns == end).astype(float)
    solved = optimize.milp(
        goal,
        constraints=optimize.LinearConstraint(np.array(rows), np.array(least)),
        integrality=is_choice,
        bounds=limits,
    )
    assert solved.success
    return float(solved.fun)


def test_without_a_schedule_jobs_come_one_after_the_other():
    """The solver finds no schedule in no time, so the best known one does one job after another."""
    result = optimum(lay_out(empty_orchard(rows=20, pickers=10, carriers=10)), work=1e-6)
    assert 0.0 < result.proven_seconds < result.best_seconds


def test_the_same_question_has_the_same_answer():
    """Also where the search ends before it is done: by work, which is the same each time."""
    layout = lay_out(empty_orchard(rows=12, pickers=6, carriers=4, picking_speed=0.5))
    first = optimum(layout, 0.1)
    second = optimum(layout, 0.1)
    assert first.proven_seconds == second.proven_seconds
    assert first.best_seconds == second.best_seconds
    assert first.gap > 0.0, "the limit of work ended the search"


def test_the_command_tells_that_the_clock_has_cut_the_search(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("orchard.optimum.schedule.LEAST_PATIENCE", 0.01)
    monkeypatch.setattr("orchard.optimum.schedule.PATIENCE_FOR_WORK", 0.0)
    (tmp_path / "my.yaml").write_text("{rows: 12, pickers: 6, carriers: 4, picking_speed: 0.5}")
    summary = tmp_path / "found.json"
    print_bound(BoundOptions(scenario=str(tmp_path / "my.yaml"), work=10.0, summary=summary))
    assert "cut by the clock, after 0 s" in capsys.readouterr().out.replace("\n", " ")
    assert json.loads(summary.read_text())["rows_to_pickers"]["balanced-ends"]["cut_after_seconds"]


def test_the_command_tells_the_limit_of_study_and_page(tmp_path, capsys):
    """The limit is the same though each seed draws other rows."""
    (tmp_path / "my.yaml").write_text(
        "{rows: 4, pickers: 2, carriers: 1, picking_speed: 0.05, seed: 3, picking: {spread:"
        " {distribution: lognormal}}}"
    )
    summary = tmp_path / "found.json"
    print_bound(BoundOptions(scenario=tmp_path / "my.yaml", work=0.1, summary=summary))
    limit = limit_of_question(load(tmp_path / "my.yaml"))
    words = f"the {limit.bottleneck} would allow {limit.bins_per_hour:.1f} bins an hour"
    assert words in capsys.readouterr().out.replace("\n", " ")
    assert json.loads(summary.read_text())["limit_bins_per_hour"] == limit.bins_per_hour


def test_a_search_that_its_work_ends_was_not_cut():
    layout = lay_out(empty_orchard(rows=12, pickers=6, carriers=4, picking_speed=0.5))
    assert optimum(layout, 0.1).cut_after_seconds is None


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (
            {"agents": {"picker_01": "own_agents.Eastward"}},
            "built-in agents only, and not picker_01",
        ),
        ({"route": "examples.seams.signalled_route.SignalledRoute"}, "steps of your route: Signal"),
    ],
)
def test_what_has_no_bound_is_refused_in_words(own, words):
    with pytest.raises(NoBound, match=words):
        optimum(lay_out(empty_orchard(**own)))


def test_the_command_bounds_all_rules_and_writes_it(tmp_path, capsys):
    """For each rule by which rows go to pickers there is a bound. The least holds for all: 4:06 min
    in this orchard, as the command found when this test was written.
    """
    (tmp_path / "my.yaml").write_text("{rows: 4, pickers: 4, carriers: 4}")
    print_bound(
        BoundOptions(
            scenario=str(tmp_path / "my.yaml"),
            all_rules=True,
            work=1.0,
            summary=tmp_path / "bound.json",
        )
    )
    summary = json.loads((tmp_path / "bound.json").read_text())
    rules = summary["rows_to_pickers"]
    assert list(rules) == ["balanced", "balanced-ends", "manual", "balanced-times"]
    least = min(rule["proven_seconds"] for rule in rules.values())
    assert summary["proven_seconds"] == least
    assert least < rules["balanced"]["proven_seconds"]
    assert Scenario(**summary["scenario"]).rows == 4
    assert "With any of these rules no harvest is shorter than 4:06 min." in capsys.readouterr().out


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.5])
def test_limit_and_proof_keep_one_distance_in_the_bay(speed, monkeypatch):
    """Limit (`bay_seconds`) and proof (`share_bay`) take one distance between carriers in the bay.

    A carrier that drives in long steps stops nearer to the one ahead.
    """
    layout = lay_out(Scenario(rows=3, pickers=2, carriers=2, carrying={"speed": speed}))
    kept = []
    monkeypatch.setattr(Schedule, "share_bay", lambda self, headway, bays: kept.append(headway))
    optimum(layout, work=0.1)
    carrier = layout.machines["carrier"]
    moving_up = Bounds(layout).bay_seconds - Unload().ticks(carrier) * TIME_STEP
    # m from centre to centre: a carrier with its bin is 3.3 m long, the next front stays 0.8 m
    # behind (`STOP_DISTANCE`), less one step.
    nearest = 3.3 + 0.8 - speed * TIME_STEP
    assert moving_up == pytest.approx(nearest / speed)
    assert kept == [ticks(nearest / speed)]
