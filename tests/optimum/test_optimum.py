"""The proven bound on a harvest's time: no harvest beats it, another solver finds the same, and what has no bound is refused in words."""

import json
from itertools import combinations
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ortools", reason="the extra `optimum` is not installed")
from scipy.optimize import Bounds, LinearConstraint, milp
from stage import Stage, empty_orchard

from orchard.agents.steps import Unload
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, Scenario
from orchard.launch.bound import print_bound
from orchard.launch.options import BoundOptions
from orchard.optimum.jobs import Job, NoBound, jobs_of
from orchard.optimum.schedule import HEADWAY, optimum

ORCHARDS: list[dict[str, Any]] = [
    {"rows": 3, "pickers": 2, "carriers": 1},
    {"rows": 6, "pickers": 6, "carriers": 8, "route": "two-way", "row_length": 30.0},
    {"rows": 8, "pickers": 3, "carriers": 4, "rows_to_pickers": "balanced-ends", "picking_speed": 0.3},
    {"rows": 7, "pickers": 3, "carriers": 2, "route": "two-way", "rows_to_pickers": "manual", "bay": 30.0},
    {"rows": 4, "pickers": 2, "carriers": 3, "metres_per_bin": 30.0, "order_in_row": "outward", "picking_speed": 0.02},
    {"rows": 5, "pickers": 2, "carriers": 2, "bins_per_row": 0.7, "route": "two-way", "rows_to_pickers": "balanced-ends"},
    {"rows": 5, "pickers": 4, "carriers": 3, "picking_speed": 0.5, "picking": {"spread": {"distribution": "gamma", "cv": 0.3}}},
    {
        **{"rows": 8, "pickers": 4, "carriers": 3, "row_length": 30.0, "route": "two-way", "chargers": 2},
        **{"carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.75}}},
    },
]


@pytest.mark.parametrize("values", ORCHARDS)
def test_no_policy_beats_what_is_proven(values):
    scenarios = [empty_orchard(**values, dispatch=policy) for policy in DISPATCH_POLICIES]
    found = {optimum(lay_out(scenario), 0.2).proven_seconds for scenario in scenarios}
    harvests = [DiscreteHarvest(lay_out(scenario)).run().seconds for scenario in scenarios]
    (proven,) = found  # it does not depend on the policy
    assert 0.5 * min(harvests) < proven <= min(harvests)


@pytest.mark.parametrize("values", [{}, {"route": "two-way", "carriers": 2}])
def test_the_simulator_does_not_beat_it_either(values):
    scenario = empty_orchard(**{"rows": 3, "pickers": 3, "carriers": 3, "row_length": 20.0} | values)
    assert 0.7 < optimum(lay_out(scenario), 0.2).proven_seconds / Stage(scenario).run_to_the_end() <= 1.0


@pytest.mark.parametrize("values", [{"carriers": 1}, {"carriers": 2}, {"rows": 4, "pickers": 3, "carriers": 2, "route": "two-way"}])
def test_another_solver_finds_the_same_optimum(values):
    layout = lay_out(empty_orchard(**{"rows": 4, "pickers": 2} | values))
    found = optimum(layout, 5.0)
    assert found.gap == 0.0
    assert found.best_seconds == pytest.approx(0.1 * shortest(jobs_of(layout), layout.scenario.carrier_count), abs=0.05)


def shortest(jobs: list[Job], carriers: int) -> float:
    """The end of the best schedule, in ticks, as a mixed-integer program: for each job its stop, its time in the bay, and its carrier;
    for each pair which of them has the bay first, and which of them the carrier."""
    count, pairs, late = (
        len(jobs),
        list(combinations(range(len(jobs)), 2)),
        float(sum(job.ready + job.to_bay + job.approach for job in jobs)),
    )
    stop, bay, end = range(count), range(count, 2 * count), 2 * count
    carrier = np.arange(end + 1, end + 1 + count * carriers).reshape(count, carriers)
    first, ahead = (np.arange(len(pairs)) + end + 1 + count * carriers + k * len(pairs) for k in (0, 1))
    size = end + 1 + count * carriers + 2 * len(pairs)
    rows: list[np.ndarray] = []
    least: list[float] = []

    def demand(at_least: float, of: list[tuple[int, float]]) -> None:
        rows.append(np.zeros(size))
        least.append(at_least)
        for index, factor in of:
            rows[-1][index] += factor

    for i, job in enumerate(jobs):
        if i and jobs[i - 1].picker == job.picker:
            demand(jobs[i - 1].going_on + job.ready, of=[(stop[i], 1), (stop[i - 1], -1)])
        demand(max(job.approach, 0 if i and jobs[i - 1].picker == job.picker else job.ready), of=[(stop[i], 1)])
        demand(job.to_bay, of=[(bay[i], 1), (stop[i], -1)])
        demand(job.to_rest, of=[(end, 1), (bay[i], -1)])
        demand(1, of=[(x, 1) for x in carrier[i]])
    for number, (i, j) in enumerate(pairs):
        for one, other, sign, unless in ((i, j, -late, -late), (j, i, late, 0.0)):
            demand(Unload.ticks + HEADWAY + unless, of=[(bay[other], 1), (bay[one], -1), (first[number], sign)])
            took = jobs[one].to_bay + jobs[one].to_head + jobs[other].approach
            for x, y in zip(carrier[one], carrier[other], strict=True):
                terms = [(stop[other], 1), (stop[one], -1), (ahead[number], sign), (x, -late), (y, -late)]
                demand(took + unless - 2 * late, of=terms)
    whole = np.zeros(size)
    whole[end + 1 :] = 1
    upper = np.where(whole > 0, 1.0, late)
    goal = np.zeros(size)
    goal[end] = 1.0
    solved = milp(goal, constraints=LinearConstraint(np.array(rows), np.array(least)), integrality=whole, bounds=Bounds(0.0, upper))
    assert solved.success
    return float(solved.fun)


def test_the_same_question_has_the_same_answer():
    layout = lay_out(empty_orchard(rows=20, pickers=10, carriers=7, picking_speed=0.5))
    one, other = (optimum(layout, 0.2) for _ in range(2))
    assert (one.proven_seconds, one.best_seconds) == (other.proven_seconds, other.best_seconds)
    assert one.gap > 0.0


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"agents": {"picker_01": "own_agents.Eastward"}}, "built-in agents only, and not picker_01"),
        ({"route": "examples.seams.signalled_route.SignalledRoute"}, "steps of your route: Signal"),
    ],
)
def test_what_has_no_bound_is_refused_in_words(own, words):
    with pytest.raises(NoBound, match=words):
        optimum(lay_out(empty_orchard(**own)))


def test_the_command_bounds_all_rules_and_writes_it(tmp_path, capsys):
    print_bound(BoundOptions(all_rules=True, work=0.2, summary=tmp_path / "bound.json"))
    summary = json.loads((tmp_path / "bound.json").read_text())
    rules = summary["rows_to_pickers"]
    assert list(rules) == ["balanced", "balanced-ends", "manual"]
    assert summary["proven_seconds"] == min(one["proven_seconds"] for one in rules.values()) < rules["balanced"]["proven_seconds"]
    assert Scenario(**summary["scenario"]).rows == 5
    assert "With any of these rules no harvest is shorter than 14:37 min." in capsys.readouterr().out
