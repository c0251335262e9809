"""The summary of a run as a table."""

from typing import Any

import msgspec
from rich.table import Table

UNITS = {
    "sim_seconds": "s",
    "wall_seconds": "s",
    "bins_per_hour": "bins/h",
    "bound_bins_per_hour": "bins/h, upper bound in a long harvest",
    "bound_sim_seconds": "s, lower bound for this scenario",
    "picker_waiting_seconds": "s, mean from a full bin to the next empty bin",
    "carrier_utilisation": "(share of time outside the queue)",
    "distance_metres": "m",
    "state_seconds": "s",
    "stopped_seconds": "s",
}


class Outcome(msgspec.Struct):
    """The figures that each summary must have, because the terminal reports them."""

    hash: str
    ticks: int
    violations: list[str]
    broken_agents: list[str]
    jam: list[str]


def as_table(summary: dict[str, Any]) -> Table:
    """Return a table of the figures, with their units, in the order of the summary: the violations come last."""
    table = Table(title="The harvest", show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for key, value in summary.items():
        table.add_row(key.replace("_", " "), _words(key, value))
    return table


def _words(key: str, value: Any) -> str:
    unit = f" {UNITS[key]}" if key in UNITS else ""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words('', part)}" for name, part in value.items()) + unit if value else "none"
    if isinstance(value, list):
        return "\n".join(map(str, value)) or "none"
    if isinstance(value, float):
        return f"{value:,.2f}{unit}"
    return f"{value}{unit}"
