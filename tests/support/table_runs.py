"""Tables (Parquet files) of runs in this process, and what stands in them."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from orchard.local import Local
from orchard.tables.columns import BODIES, CALLS, EVENTS, EXCHANGES, MESSAGES
from orchard.tables.tables import Tables

# File name without its ending -> columns, of each table that a run writes.
ALL = {
    "bodies": BODIES,
    "events": EVENTS,
    "messages": MESSAGES,
    "calls": CALLS,
    "exchanges": EXCHANGES,
}


def tick(local: Local, tables: Tables) -> None:
    """Let a run do a tick, and write its rows."""
    events = local.tick()
    # The tick is over, and the engine counts the next one: the letters are of the one before.
    tables.update(local.engine, events, local.post.written.get(local.engine.tick - 1, {}))


def run(local: Local, folder: Path, ticks: int) -> Tables:
    """Let a run go on until a tick. Return its tables: the caller closes them."""
    tables = Tables(folder, local.engine)
    while local.engine.tick < ticks:
        tick(local, tables)
    return tables


def read(folder: Path) -> dict[str, pa.Table]:
    """Return all tables in a folder, by their names."""
    return {name: pq.read_table(folder / f"{name}.parquet") for name in ALL}


def rows_of(folder: Path, name: str, body: str = "") -> list[dict[str, Any]]:
    """Return the rows of a table, of one body; '': of all bodies."""
    rows = pq.read_table(folder / f"{name}.parquet").to_pylist()
    return [row for row in rows if not body or row["name"] == body]
