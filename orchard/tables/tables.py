"""Writes the tables of a run (Parquet files) into a folder while it runs, and finishes them at its
end.

The physics process, or a run in one process, updates `Tables` after each step. `bodies`, `events`
and `messages` grow; `calls` and `exchanges` follow from them at the end.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from orchard.contract.agent import Action, state_of
from orchard.contract.events import STOPPED, Event
from orchard.contract.messages import Written, as_json, type_of
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.field.problems import printable
from orchard.sim.engine import Engine
from orchard.sim.obstacles import with_names
from orchard.sim.world import World
from orchard.tables.columns import BODIES, EVENTS, MESSAGES, NUMBER, TEXT
from orchard.tables.exchanges import CALLING, calls, exchanges
from orchard.tables.folder import (
    AT_THE_END,
    GROWING,
    MOST_ROWS,
    SCENARIO,
    SUMMARY_NAME,
    GrowingTable,
    path_of,
    write_table,
)

# The columns state, doing (in words) and waits_for of a body; None: null in the table.
Status = tuple[str, str | None, str | None]
# Of a body whose agent has given no action, or that has no agent.
SILENT: Status = ("resting", None, None)
# Of a body that is stopped.
STANDING: Status = ("stopped", STOPPED, None)
# Types of the messages that a call of a bin consists of: its question, the bin's order to a
# carrier, and the carrier's agreement.
OF_A_CALL = [*CALLING, "come", "yes"]

log = logging.getLogger("orchard")


class BodyRows:
    """Collects the rows of all bodies, a tick at a time. There are n bodies, and a row for each."""

    def __init__(self, layout: Layout) -> None:
        self._index = layout.index
        # After the n names comes null: the name at index n.
        self._names = pa.array([*layout.names, None], TEXT)
        self._is_bin = np.array([kind_of(name) == "bin" for name in layout.names], dtype=bool)
        # The status of each body. It is never changed in place: many ticks share it.
        self._status = [SILENT] * len(layout.names)
        self._ticks: list[int] = []
        # For each tick: poses, velocities and wanted velocities, (n, 3); partners and fills, (n,).
        self._kept: list[tuple[np.ndarray, ...]] = []
        self._statuses: list[list[Status]] = []
        # For each tick the poses as measured, (n, 5): x and y, then x, y and yaw by odometry. Empty
        # if all sensors are exact.
        self._inexact: list[np.ndarray] = []

    def __len__(self) -> int:
        # The number of rows.
        return len(self._ticks) * len(self._status)

    def keep(self, engine: Engine) -> None:
        """Keep the rows of the step that has just been done."""
        world = engine.world
        self._hear(world, engine.answers)
        # A body that is stopped is shown so, and what its agent does is kept for afterwards.
        stopped = dict.fromkeys(np.flatnonzero(world.stopped).tolist(), STANDING)
        self._statuses.append(_replaced(self._status, stopped))
        self._ticks.append(world.tick)
        if not engine.sensors.is_exact:
            self._inexact.append(engine.sensors.inexact())
        wanted = engine.lookahead.wanted
        arrays = (world.pose, world.twist, wanted, world.coupled, world.fill)
        # The world changes its arrays in place.
        self._kept.append(tuple(array.copy() for array in arrays))

    def _hear(self, world: World, answers: Mapping[str, Action | None]) -> None:
        """Note the status of each body whose agent was asked at this tick."""
        news = {}
        for name, action in answers.items():
            index = self._index.get(name)
            if index is not None:
                status = _status_of(world, name, action)
                if status != self._status[index]:
                    news[index] = status
        self._status = _replaced(self._status, news)

    def take(self) -> pa.Table:
        """Return the rows that are kept, tick by tick and body by body, and forget them."""
        if not self._ticks:
            return BODIES.empty_table()
        count = len(self._ticks)
        n = len(self._status)
        poses, twists, wanted, coupled, fills = map(np.array, zip(*self._kept, strict=True))
        ticks = np.repeat(np.array(self._ticks, dtype=np.int32), n)
        bodies = np.tile(np.arange(n), count)
        # A body that is not coupled has a negative index. It gets index n: null.
        partners = np.where(coupled >= 0, coupled, n).ravel()
        # Three columns of words: state, doing, waits_for.
        words = zip(*chain.from_iterable(self._statuses), strict=True)
        # In the order of BODIES.
        columns = [
            ticks,
            self._names.take(pa.array(bodies)),
            *_columns(poses),
            *self._measured(),
            *_columns(twists),
            *_columns(wanted),
            self._names.take(pa.array(partners)),
            pa.array(fills.ravel(), mask=~np.tile(self._is_bin, count)),
            *(pa.array(column, TEXT) for column in words),
        ]
        self._ticks = []
        self._kept = []
        self._statuses = []
        self._inexact = []
        return pa.table(columns, BODIES)

    def _measured(self) -> list[pa.Array]:
        """Return the five columns of the poses as measured: see `_inexact`."""
        if not self._inexact:
            return [pa.nulls(len(self), NUMBER)] * 5
        poses = np.array(self._inexact)
        # NaN becomes null.
        return [pa.array(poses[:, :, i].ravel(), from_pandas=True) for i in range(poses.shape[2])]


def _columns(values: np.ndarray) -> list[np.ndarray]:
    """Return the three columns of an array, (ticks, bodies, 3): one row for each body and tick."""
    return [values[:, :, i].ravel() for i in range(3)]


def _replaced(old: list[Status], news: Mapping[int, Status]) -> list[Status]:
    """Return the statuses with news, by index of the body. Without news it is the same list."""
    if not news:
        return old
    return [news.get(index, status) for index, status in enumerate(old)]


def _status_of(world: World, name: str, action: Action | None) -> Status:
    """Return the status of a body by the action of its agent; None: the agent gave none."""
    if action is None:
        return SILENT
    waits_for = with_names(world, name, action.waits_for)
    return state_of(action), printable(action.doing) or None, printable(waits_for) or None


class Tables:
    """The tables of one run: `update` after each step, `flush` before a snapshot, `close` at its
    end.

    After a fault, such as a full disk, the run goes on without tables. The fault is logged once.
    """

    def __init__(self, folder: Path, engine: Engine) -> None:
        """Open the tables, for a run that begins or goes on at the engine's tick.

        A run that goes on from a snapshot does later steps anew, so their rows are removed.
        """
        self._folder = folder
        self._bodies = BodyRows(engine.layout)
        self._events: list[Event] = []
        self._messages: list[tuple[int, str, str, str, str]] = []
        self._metadata = {SCENARIO: engine.layout.scenario.model_dump_json()}
        self._growing: dict[str, GrowingTable] = {}
        with self._faults_logged():
            self._begin(engine.tick)

    def _begin(self, tick: int) -> None:
        """Open the tables that grow, without the rows from a tick on."""
        for name in (*AT_THE_END, SUMMARY_NAME):
            path_of(self._folder, name).unlink(missing_ok=True)
        for name, schema in GROWING.items():
            # The rows of a step have the tick of its end in `bodies`, of its begin in other tables.
            until = tick
            if name == "bodies":
                until = tick + 1
            own_schema = schema.with_metadata(self._metadata)
            self._growing[name] = GrowingTable(path_of(self._folder, name), own_schema, until)

    def update(
        self, engine: Engine, events: Sequence[Event], letters: Mapping[str, Written]
    ) -> None:
        """Keep the rows of the step that has just been done.

        `events`: of the step. `letters`: sender -> its messages in the step.
        """
        if not self._growing:
            return
        self._bodies.keep(engine)
        self._events += events
        # In lockstep messages come in the order of arrival, which differs from run to run.
        for name, written in sorted(letters.items()):
            for to, body in written.sent:
                self._messages.append((engine.tick - 1, name, to, type_of(body), as_json(body)))
        if len(self._bodies) >= MOST_ROWS:
            self.flush()

    def flush(self) -> None:
        """Write the rows that are kept."""
        with self._faults_logged():
            events = []
            for event in self._events:
                whom = event.whom or None
                detail = event.detail or None
                events.append((event.tick, event.what, event.who, whom, detail))
            rows = {
                "bodies": self._bodies.take(),
                "events": _table(events, EVENTS),
                "messages": _table(self._messages, MESSAGES),
            }
            self._events = []
            self._messages = []
            for name, table in self._growing.items():
                table.add(rows[name].replace_schema_metadata(table.schema.metadata))

    def close(self) -> None:
        """Write the rest, and finish the tables.

        `orchard.tables.folder` writes the summary.
        """
        self.flush()
        with self._faults_logged():
            for table in self._growing.values():
                table.finish()
            if not self._growing:
                return
            events = pq.read_table(path_of(self._folder, "events")).to_pylist()
            of_calls = [("type", "in", OF_A_CALL)]
            messages = pq.read_table(path_of(self._folder, "messages"), filters=of_calls)
            self._write_at_the_end("calls", calls(events, messages.to_pylist()))
            self._write_at_the_end("exchanges", exchanges(events))

    def _write_at_the_end(self, name: str, rows: list[dict[str, Any]]) -> None:
        """Write a table that follows from the others. Raises OSError or ArrowException."""
        schema = AT_THE_END[name].with_metadata(self._metadata)
        write_table(path_of(self._folder, name), pa.Table.from_pylist(rows, schema))

    @contextmanager
    def _faults_logged(self) -> Iterator[None]:
        """Log a fault in this context, and write no tables from then on."""
        try:
            yield
        except (OSError, pa.ArrowException) as error:
            why = getattr(error, "strerror", None) or error
            fault = f"the tables in {self._folder} cannot be written: {why}"
            log.error("%s; the run goes on without them", fault)
            self._growing = {}


def _table(rows: Sequence[tuple[Any, ...]], schema: pa.Schema) -> pa.Table:
    """Return a table with these rows; without any it has its columns, empty."""
    columns = list(zip(*rows, strict=True)) or [()] * len(schema)
    typed = [pa.array(column, field.type) for column, field in zip(columns, schema, strict=True)]
    return pa.table(typed, schema)
