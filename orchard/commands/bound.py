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
from orchard.report.summary import SUMMARY, clock, write_if_wanted
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
        "Work of the solver for each rule, about as many seconds; equal on every machine.",
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
    # Without OR-Tools, which is an extra, it ends here in words.
    with needs_extra("A bound", "optimum"):
        import orchard.optimum.schedule  # noqa: F401
    with own_classes_run(), exit_on_errors(ScenarioError, OSError, ValueError):
        print_bound(chosen)


def print_bound(chosen: BoundOptions) -> None:
    """Print the bound of a scenario, and write it.

    Raises ScenarioError, NoBound (a ValueError) or OSError; typer.Exit if the file cannot be
    written.
    """
    from orchard.optimum.schedule import optimum

    scenario = load_or_shipped(chosen.scenario)
    if chosen.summary is not None:
        check_writable(chosen.summary, chosen.scenario, SUMMARY)
    rules = ROW_RULES if chosen.all_rules else (scenario.rows_to_pickers,)
    optima = {}
    for rule in rules:
        layout = lay_out(with_changes(scenario, rows_to_pickers=rule))
        optima[rule] = optimum(layout, chosen.work)
    for rule, solved in optima.items():
        print_line(f"{rule} rows: {_optimum_words(solved)}")
    proven = min(solved.proven_seconds for solved in optima.values())
    best = min(solved.best_seconds for solved in optima.values())
    if chosen.all_rules:
        print_line(f"With any of these rules no harvest is shorter than {clock(proven)}.")
    limit = limit_of_question(scenario)
    print_line(_limit_words(limit))
    trouble = write_if_wanted(chosen.summary, _summary(scenario, optima, proven, best, limit))
    if trouble:
        print_error(trouble)
        raise typer.Exit(FAILED)


def _limit_words(limit: Bounds) -> str:
    """Return how many bins an hour a long harvest could have at most, in words."""
    limited_by = limit.bottleneck if limit.bottleneck == "unloading" else f"the {limit.bottleneck}"
    return (
        f"In a long harvest without traffic {limited_by} would allow "
        f"{limit.bins_per_hour:.1f} bins an hour, by the policy of the scenario."
    )


def _optimum_words(solved: "Optimum") -> str:
    """Return the bound for one rule, and how near a schedule comes to it, in words."""
    if solved.gap:
        schedule = f"and the best schedule found takes {100 * solved.gap:.1f} % longer"
    else:
        schedule = "and a schedule takes as long"
    words = (
        f"no harvest of these {solved.bins} bins is shorter than "
        f"{clock(solved.proven_seconds)}, {schedule}"
    )
    if solved.cut_after_seconds is None:
        return words
    return (
        f"{words}; the search was cut by the clock, "
        f"after {solved.cut_after_seconds:.0f} s,"
        " and a faster machine may prove more"
    )


def _summary(
    scenario: Scenario,
    optima: dict[str, "Optimum"],
    proven: float,
    best: float,
    limit: Bounds,
) -> dict[str, Any]:
    """Return the summary of a bound.

    `optima`: rule -> its optimum; `proven`, `best`: s, of all rules; `limit`: of the long run.
    """
    return {
        "proven_seconds": proven,
        "best_seconds": best,
        "gap": best / proven - 1.0,
        "limit_bins_per_hour": limit.bins_per_hour,
        "bottleneck": limit.bottleneck,
        "rows_to_pickers": {rule: asdict(solved) for rule, solved in optima.items()},
        "scenario": scenario.model_dump(),
    }
