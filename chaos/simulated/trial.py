"""Trials: schedules that are carried out and judged, and the smallest one that still fails."""

import tempfile
from dataclasses import replace
from pathlib import Path

from chaos.simulated.drawing import draw
from chaos.simulated.plan import Plan
from chaos.simulated.schedule import Schedule
from chaos.simulated.verdict import Outcome, Verdict, judge

# A failing plan of so many ticks or fewer is not made shorter.
SHORT = 10
# A folder in memory, where Linux has one: schedules write many small files.
IN_MEMORY = Path("/dev/shm")


def carry_out(plan: Plan, is_traced: bool = False) -> Verdict:
    """Carry out a plan, in a folder of its own, and judge it."""
    parent = None
    if IN_MEMORY.is_dir():
        parent = IN_MEMORY
    with tempfile.TemporaryDirectory(dir=parent) as folder:
        return Schedule(plan, Path(folder), is_traced).run(judge)


def outcome_of(seed: int) -> Outcome:
    """Return what came of the schedule of a seed."""
    verdict = carry_out(draw(seed))
    return Outcome(seed, verdict.complaints, verdict.occurred, verdict.is_near)


def shrink(plan: Plan) -> Plan:
    """Return a plan with fewer faults and ticks that fails in the same way.

    As long as leaving out one fault, or half of the ticks, makes a plan that still fails so, it
    goes on with that plan.
    """
    what = _kind_of(carry_out(plan))
    smaller: Plan | None = plan
    while smaller is not None:
        plan = smaller
        smaller = _smaller_plan(plan, what)
    return plan


def _smaller_plan(plan: Plan, what: str) -> Plan | None:
    """Return a slightly smaller plan with a complaint of this kind; None if there is none."""
    candidates = []
    for at in range(len(plan.faults)):
        candidates.append(replace(plan, faults=plan.faults[:at] + plan.faults[at + 1 :]))
    if plan.ticks > SHORT:
        candidates.append(replace(plan, ticks=plan.ticks // 2))
    for candidate in candidates:
        if _kind_of(carry_out(candidate)) == what:
            return candidate
    return None


def _kind_of(verdict: Verdict) -> str:
    """Return the words of the first complaint up to its details; '' without a complaint."""
    if not verdict.complaints:
        return ""
    return verdict.complaints[0].partition(":")[0]
