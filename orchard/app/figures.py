"""What follows from a scenario before it is run."""

import math
from dataclasses import dataclass

from orchard.app.entries import entries
from orchard.field.layout import TOP, TREES_X, X_MAX, Layout
from orchard.report.bounds import bounds_of


@dataclass(frozen=True)
class Figure:
    """A value with its name, and a word on what it means."""

    name: str
    value: str
    note: str = ""


def figures(layout: Layout) -> list[Figure]:
    """The derived figures of an orchard, for people."""
    scenario, bounds = layout.scenario, bounds_of(layout)
    bins = sum(start.kind == "bin" for start in layout.starts)
    trees = len(layout.tree_lines) * len(TREES_X)
    enough = math.ceil(round(bounds.enough_carriers, 6))
    return [
        Figure("Bound", f"{bounds.bins_per_hour:.1f} bins/h", "no harvest of this orchard can do more for long"),
        Figure("Bottleneck", bounds.bottleneck, "the part that allows least"),
        Figure("Carriers", str(scenario.carrier_count), "as set" if scenario.carriers else "7 for every 10 pickers"),
        Figure("Enough carriers", str(enough), _enough_note(enough)),
        Figure("Bins", str(bins), f"one for each robot; {scenario.rows} are to be filled"),
        Figure("Trees", str(trees), f"{len(layout.tree_lines)} lines of {len(TREES_X)}"),
        Figure("Harvest field", f"{2 * X_MAX:.0f} x {TOP - layout.bottom:.1f} m", "from fence to fence"),
    ]


def _enough_note(enough: int) -> str:
    most = entries()["carriers"].high
    return "more would not speed up the harvest" if enough <= most else f"more would not help; at most {most:g} can be set"


def terms(layout: Layout) -> dict[str, float]:
    """Bins per hour that each part of the harvest allows."""
    return {name: 3600.0 * rate for name, rate in bounds_of(layout).terms.items()}
