"""The summary of a run as a table of one row, so that the summaries of many runs can stand below each other."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from orchard.report.summary import UNITS
from orchard.tables.folder import SCENARIO, last_tick, path_of
from orchard.tables.parts import write_table


def complete(folder: Path, summary: Mapping[str, Any]) -> list[str]:
    """Write the summary of a run beside its other tables. Return what is wrong with the tables, such as rows that are missing."""
    try:
        write_table(path_of(folder, "summary"), as_table(summary))
        last = last_tick(folder)
    except (OSError, pa.ArrowException) as error:
        return [f"{folder}: the tables cannot be written or read: {getattr(error, 'strerror', None) or error}"]
    return [] if last == summary["ticks"] else [f"{folder}: the tables end at tick {last}, and the run at tick {summary['ticks']}"]


def as_table(summary: Mapping[str, Any]) -> pa.Table:
    """Return a summary as a table of one row.

    A map becomes a column for each of its values, such as `lost_seconds.traffic`. `history` has columns of lists. The scenario and all
    other lists are JSON.
    """
    columns = dict(_columns(summary))
    fields = [pa.field(name, array.type, metadata={"unit": UNITS.get(name.split(".")[0], "")}) for name, array in columns.items()]
    metadata = {SCENARIO: msgspec.json.encode(summary["scenario"]).decode()}
    return pa.table(list(columns.values()), pa.schema(fields, metadata))


def _columns(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, pa.Array]]:
    for key, value in values.items():
        name = before + key
        if isinstance(value, Mapping) and name != "scenario":
            yield from _columns(value, f"{name}.")
        elif before == "history.":
            yield name, pa.array([value], pa.list_(pa.float64()))
        else:
            is_plain = isinstance(value, bool | int | float | str)
            yield name, pa.array([value if is_plain else msgspec.json.encode(value).decode()])
