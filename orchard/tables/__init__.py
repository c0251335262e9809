"""The tables that a run leaves as Parquet files: bodies, events, messages, calls, exchanges and the summary. Nothing here changes a run."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from orchard.sim.engine import Engine
    from orchard.tables.tables import Tables


def tables_of(folder: str | Path | None, engine: "Engine") -> "Tables | None":
    """Return the tables that a run leaves in a folder, from this tick on; None without a folder."""
    if folder is None:
        return None
    from orchard.tables.tables import Tables  # not at the top: pyarrow takes some time to load

    return Tables(Path(folder), engine.layout, engine.tick)
