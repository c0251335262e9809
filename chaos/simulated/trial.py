"""Trials: schedules that are carried out and judged, and the smallest one that still fails."""

import tempfile
from dataclasses import replace
from pathlib import Path

from chaos.simulated.drawing import draw
from chaos.simulated.plan import Plan
from chaos.simulated.schedule import Schedule
from chaos.simulated.verdict import Outcome, Verdict, judge

# Ticks: a failing plan of no more is not made shorter.
SHORT = 10


def carry_out(plan: Plan, is_traced: bool = False) -> Verdict:
    """Carry out a plan, in a folder of its own."""
    with tempfile.TemporaryDirectory(
        dir="/dev/shm" if Path("/dev/shm").is_dir() else None
    ) as folder:
        return Schedule(plan, Path(folder), is_traced).run(judge)


def outcome_of(seed: int) -> Outcome:
    """Return what came of the schedule of a seed."""
    verdict = carry_out(draw(seed))
    return Outcome(seed, verdict.complaints, verdict.occurred, verdict.is_near)


def shrink(plan: Plan) -> Plan:
    """Return a plan with fewer faults and ticks that fails in the same way."""
    what = _kind_of(carry_out(plan))
    is_smaller = True
    while is_smaller:
        is_smaller = False
        fewer = [
            replace(plan, faults=plan.faults[:at] + plan.faults[at + 1 :])
            for at in range(len(plan.faults))
        ]
        shorter = [replace(plan, ticks=plan.ticks // 2)] if plan.ticks > SHORT else []
        for smaller in [*fewer, *shorter]:
            if _kind_of(carry_out(smaller)) == what:
                plan = smaller
                is_smaller = True
                break
    return plan


def _kind_of(verdict: Verdict) -> str:
    return verdict.complaints[0].partition(":")[0] if verdict.complaints else ""
