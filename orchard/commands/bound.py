"""The command `orchard bound`: how short a harvest could be, whatever sends the carriers."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import ROW_RULES, Scenario, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question
from orchard.report.summary import SUMMARY, clock, why_unwritten
from orchard.terminal.exits import FAILED, exit_on_errors, needs_extra
from orchard.terminal.files import check_writable
from orchard.terminal.options import File, flag, option, with_options
from orchard.terminal.output import own_classes_run, print_error, print_line

if TYPE_CHECKING:
    from orchard.optimum.schedule import Optimum


@dataclass(frozen=True, kw_only=True)
class BoundOptions:
    """The options of `bound`."""

    scenario: File = None
    all_rules: bool = flag(
        None,
        "--all-rules",
        "For all built-in rules that give rows to pickers, and not only the scenario's.",
    )
    work: float = option(
        None,
        "How much the solver may do for each rule: about s.",
        default=10.0,
        min=0.01,
        max=36_000.0,
    )
    summary: Path | None = option(None, "Write the bound to this file.", "FILE.json")


@with_options(BoundOptions)
def bound(chosen: BoundOptions) -> None:
    """Prove how short a harvest could be, whatever sends the carriers: docs/bounds.md.

    People and animals are left out.
    """
    with needs_extra("A bound", "optimum"):
        import orchard.optimum.schedule  # noqa: F401
    with own_classes_run(), exit_on_errors(ScenarioError, OSError, ValueError):
        print_bound(chosen)


def print_bound(chosen: BoundOptions) -> None:
    """Print the bound of a scenario, and write it.

    Raises ScenarioError, NoBound or OSError; typer.Exit if the file cannot be written.
    """
    # OR-Tools is an extra.
    from orchard.optimum.schedule import optimum

    scenario = load_or_shipped(chosen.scenario)
    if chosen.summary is not None:
        check_writable(chosen.summary, chosen.scenario, SUMMARY)
    rules = ROW_RULES if chosen.all_rules else (scenario.rows_to_pickers,)
    bounds = {
        rule: optimum(lay_out(with_changes(scenario, rows_to_pickers=rule)), chosen.work)
        for rule in rules
    }
    for rule, bound_of_rule in bounds.items():
        print_line(f"{rule} rows: {_words(bound_of_rule)}")
    proven = min(bound_of_rule.proven_seconds for bound_of_rule in bounds.values())
    best = min(bound_of_rule.best_seconds for bound_of_rule in bounds.values())
    if chosen.all_rules:
        print_line(f"With any of these rules no harvest is shorter than {clock(proven)}.")
    limit = limit_of_question(scenario)
    print_line(_limit_words(limit))
    trouble = why_unwritten(chosen.summary, _summary(scenario, bounds, proven, best, limit))
    if trouble:
        print_error(trouble)
        raise typer.Exit(FAILED)


def _limit_words(limit: Bounds) -> str:
    """Return the limit of the long run, as the page and a study show it."""
    limited_by = limit.bottleneck if limit.bottleneck == "unloading" else f"the {limit.bottleneck}"
    return (
        f"In a long harvest without traffic {limited_by} would allow "
        f"{limit.bins_per_hour:.1f} bins an hour, by the policy of the scenario."
    )


def _words(bound_of_rule: "Optimum") -> str:
    """Return the bound for one rule, and how near a schedule comes to it."""
    if bound_of_rule.gap:
        schedule = f"and the best schedule found takes {100 * bound_of_rule.gap:.1f} % longer"
    else:
        schedule = "and a schedule takes as long"
    words = (
        f"no harvest of these {bound_of_rule.bins} bins is shorter than "
        f"{clock(bound_of_rule.proven_seconds)}, {schedule}"
    )
    if bound_of_rule.cut_after_seconds is None:
        return words
    return (
        f"{words}; the search was cut by the clock, "
        f"after {bound_of_rule.cut_after_seconds:.0f} s,"
        " and a faster machine may prove more"
    )


def _summary(
    scenario: Scenario,
    bounds: dict[str, "Optimum"],
    proven: float,
    best: float,
    limit: Bounds,
) -> dict[str, Any]:
    """Return the summary of a bound.

    `bounds`: rule -> bound; `proven`, `best`: s, of all rules; `limit`: that of the long run.
    """
    return {
        "proven_seconds": proven,
        "best_seconds": best,
        "gap": best / proven - 1.0,
        "limit_bins_per_hour": limit.bins_per_hour,
        "bottleneck": limit.bottleneck,
        "rows_to_pickers": {rule: asdict(of_rule) for rule, of_rule in bounds.items()},
        "scenario": scenario.model_dump(),
    }
