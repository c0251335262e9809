"""What changes in a recording, gathered by entity: a row that is sent alone costs as much as a
hundred that are sent together.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
import rerun as rr

from orchard.field.scenario import TIME_STEP

TIMELINE = "sim_time"


class Columns:
    """The rows that are not sent yet. `tick` is that of new rows."""

    def __init__(self, rec: rr.RecordingStream) -> None:
        self.rec, self.tick = rec, 0
        self._rows: dict[
            tuple[Any, ...], list[tuple[int, dict[str, Any]]]
        ] = {}  # entity, archetype, components -> rows

    def add(self, path: str, archetype: Any, tick: int | None = None, /, **values: Any) -> None:
        """Add a row to an entity: components of an archetype, or of `rr.AnyValues`, each a list or
        an array of its instances.
        """
        self._rows.setdefault((path, archetype, *values), []).append(
            (self.tick if tick is None else tick, values)
        )

    def send(self) -> None:
        for (path, archetype, *names), rows in self._rows.items():
            columns: list[rr.ComponentColumn] = []
            for name in names:
                parts = [values[name] for _, values in rows]
                joined = (
                    np.concatenate(parts)
                    if isinstance(parts[0], np.ndarray)
                    else [*chain.from_iterable(parts)]
                )
                columns += archetype.columns(**{name: joined}).partition([*map(len, parts)])
            self.rec.send_columns(
                path, indexes=[times([tick for tick, _ in rows])], columns=columns
            )
        self._rows.clear()


def times(ticks: Sequence[int] | np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(
        TIMELINE, duration=np.round(np.array(ticks) * TIME_STEP * 1e9).astype("timedelta64[ns]")
    )
