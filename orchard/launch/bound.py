"""The command `orchard bound`: how short a harvest could be, whatever sends the carriers."""

from dataclasses import asdict
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.scenario import ROW_RULES, Scenario, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.launch.options import BoundOptions
from orchard.launch.runs import check_writable
from orchard.launch.terminal import print_line
from orchard.optimum.schedule import Optimum, optimum
from orchard.report.summary import clock, write_summary


def print_bound(chosen: BoundOptions) -> None:
    """Print the bound of a scenario, and write it. Raises ScenarioError, NoBound or OSError."""
    scenario = load_or_shipped(chosen.scenario)
    if chosen.summary is not None:
        check_writable(chosen.summary)
    rules = ROW_RULES if chosen.all_rules else (scenario.rows_to_pickers,)
    found = {
        rule: optimum(lay_out(with_changes(scenario, rows_to_pickers=rule)), chosen.work)
        for rule in rules
    }
    for rule, one in found.items():
        print_line(f"{rule} rows: {_words(one)}")
    proven, best = (
        min(getattr(one, name) for one in found.values())
        for name in ("proven_seconds", "best_seconds")
    )
    if chosen.all_rules:
        print_line(f"With any of these rules no harvest is shorter than {clock(proven)}.")
    if chosen.summary is not None:
        write_summary(chosen.summary, _summary(scenario, found, proven, best))


def _words(one: Optimum) -> str:
    schedule = (
        "and a schedule takes as long"
        if not one.gap
        else f"and the best schedule found takes {100 * one.gap:.1f} % longer"
    )
    words = f"no harvest of these {one.bins} bins is shorter than {clock(one.proven_seconds)}, {schedule}"
    if one.cut_after_seconds is None:
        return words
    return (
        f"{words}; the search was cut by the clock, after {one.cut_after_seconds:.0f} s,"
        " and a faster machine may prove more"
    )


def _summary(
    scenario: Scenario, found: dict[str, Optimum], proven: float, best: float
) -> dict[str, Any]:
    bounds = {"proven_seconds": proven, "best_seconds": best, "gap": best / proven - 1.0}
    return bounds | {
        "rows_to_pickers": {rule: asdict(one) for rule, one in found.items()},
        "scenario": scenario.model_dump(),
    }
