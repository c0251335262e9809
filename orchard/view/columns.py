"""What changes in a recording, gathered by entity: a row that is sent alone costs as much as a
hundred that are sent together.

Rerun's words: an entity, such as a body, has a path. An archetype, such as `rr.Points3D`, is what
it is drawn as, and has components, such as positions and colours. A row gives some components of an
entity their values at a time.
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
        """`rec`: the recording to which rows are sent."""
        self.rec = rec
        self.tick = 0
        # Entity, archetype, components -> rows: tick, and component -> value.
        self._rows: dict[tuple[Any, ...], list[tuple[int, dict[str, Any]]]] = {}

    def add(self, path: str, archetype: Any, tick: int | None = None, /, **values: Any) -> None:
        """Add a row to an entity: components of an archetype, or of `rr.AnyValues`, each a list or
        an array of its instances.

        `tick`: None is the present one. The slash leaves all names free for components.
        """
        if tick is None:
            tick = self.tick
        rows = self._rows.setdefault((path, archetype, *values), [])
        rows.append((tick, values))

    def send(self) -> None:
        """Send all rows, those of an entity and archetype together."""
        for (path, archetype, *names), rows in self._rows.items():
            columns: list[rr.ComponentColumn] = []
            for name in names:
                parts = [values[name] for _, values in rows]
                lengths = [len(part) for part in parts]
                columns += archetype.columns(**{name: _joined(parts)}).partition(lengths)
            ticks = [tick for tick, _ in rows]
            self.rec.send_columns(path, indexes=[times(ticks)], columns=columns)
        self._rows.clear()


def _joined(parts: Sequence[Any]) -> Any:
    """Return the instances of several rows as one list, or as one array if they are arrays."""
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts)
    return list(chain.from_iterable(parts))


def times(ticks: Sequence[int] | np.ndarray) -> rr.TimeColumn:
    """Return the times of some ticks on the timeline."""
    nanoseconds = np.round(np.array(ticks) * TIME_STEP * 1e9)
    return rr.TimeColumn(TIMELINE, duration=nanoseconds.astype("timedelta64[ns]"))
