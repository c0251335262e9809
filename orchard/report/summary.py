"""The summary of a run: a table for people, and JSON."""

import json
from pathlib import Path
from typing import Any

import msgspec
from rich.table import Table

UNITS = {
    "sim_seconds": "s",
    "wall_seconds": "s",
    "bins_per_hour": "bins/h",
    "bound_bins_per_hour": "bins/h, no harvest can do more for long",
    "bound_sim_seconds": "s, no harvest of this scenario is over sooner",
    "picker_waiting_seconds": "s, mean from full bin to empty one",
    "carrier_utilisation": "of the time outside the queue",
    "distance_metres": "m",
    "state_seconds": "s",
    "stopped_seconds": "s",
}


class Outcome(msgspec.Struct):
    """What no summary lacks that is told to a person."""

    hash: str
    ticks: int
    violations: list[str]


def as_table(summary: dict[str, Any]) -> Table:
    """The figures with their units; lists of trouble come last."""
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


def write(summary: dict[str, Any], path: Path) -> None:
    """As JSON, for scripts.

    Raises OSError where the file cannot be written.
    """
    path.write_text(json.dumps(summary, indent=2) + "\n")
