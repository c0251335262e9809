"""Writes the tables of a run into a folder while it runs, and finishes them at its end."""

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

Said = tuple[str, str | None, str | None]  # its state, the same in words, and what it waits for
SILENT: Said = ("resting", None, None)  # of a body whose agent says nothing
STANDING: Said = ("stopped", STOPPED, None)
OF_A_CALL = [*CALLING, "come", "yes"]

log = logging.getLogger("orchard")


class BodyRows:
    """Collects the rows of all bodies, a tick at a time."""

    def __init__(self, layout: Layout) -> None:
        self._index, self._names = (
            layout.index,
            pa.array([*layout.names, None], TEXT),
        )  # index -1: none
        self._is_bin = np.array([kind_of(name) == "bin" for name in layout.names], dtype=bool)
        self._said = [SILENT] * len(
            layout.names
        )  # of each body; never changed in place: many ticks share it
        self._ticks: list[int] = []
        self._kept: list[tuple[np.ndarray, ...]] = []
        self._words: list[list[Said]] = []
        self._inexact: list[
            np.ndarray
        ] = []  # of each tick the poses as measured; none if all are exact

    def __len__(self) -> int:
        return len(self._ticks) * len(self._said)

    def keep(self, engine: Engine) -> None:
        world = engine.world
        self._hear(world, engine.answers)
        self._words.append(
            _replaced(self._said, dict.fromkeys(np.flatnonzero(world.stopped).tolist(), STANDING))
        )
        self._ticks.append(world.tick)
        wanted = engine.lookahead.wanted
        if not engine.sensors.is_exact:
            self._inexact.append(engine.sensors.inexact())
        self._kept.append(
            (
                world.pose.copy(),
                world.twist.copy(),
                wanted.copy(),
                world.coupled.copy(),
                world.fill.copy(),
            )
        )

    def _hear(self, world: World, answers: Mapping[str, Action | None]) -> None:
        heard = {
            self._index[name]: _said_of(world, name, action)
            for name, action in answers.items()
            if name in self._index
        }
        self._said = _replaced(
            self._said, {index: said for index, said in heard.items() if said != self._said[index]}
        )

    def take(self) -> pa.Table:
        if not self._ticks:
            return BODIES.empty_table()
        ticks, (poses, twists, wanted, coupled, fills) = (
            self._ticks,
            map(np.array, zip(*self._kept, strict=True)),
        )
        measured, n = self._measured(), len(self._said)
        words = [
            pa.array(column, TEXT) for column in zip(*chain.from_iterable(self._words), strict=True)
        ]
        self._ticks, self._kept, self._words, self._inexact = [], [], [], []
        true, speeds, speeds_wanted = (
            [part[:, :, i].ravel() for i in range(3)] for part in (poses, twists, wanted)
        )
        fill = pa.array(fills.ravel(), mask=~np.tile(self._is_bin, len(ticks)))
        bodies, others = (
            np.tile(np.arange(n), len(ticks)),
            np.where(coupled >= 0, coupled, n).ravel(),
        )
        columns = [
            np.repeat(np.array(ticks, dtype=np.int32), n),
            self._names.take(pa.array(bodies)),
            *true,
            *measured,
        ]
        return pa.table(
            [*columns, *speeds, *speeds_wanted, self._names.take(pa.array(others)), fill, *words],
            BODIES,
        )

    def _measured(self) -> list[pa.Array]:
        if not self._inexact:
            return [pa.nulls(len(self), NUMBER)] * 5
        poses = np.array(self._inexact)
        return [
            pa.array(poses[:, :, i].ravel(), from_pandas=True) for i in range(poses.shape[2])
        ]  # NaN becomes null


def _replaced(old: list[Said], news: Mapping[int, Said]) -> list[Said]:
    return [news.get(index, said) for index, said in enumerate(old)] if news else old


def _said_of(world: World, name: str, action: Action | None) -> Said:
    if action is None:
        return SILENT
    waits_for = with_names(world, name, action.waits_for)
    return state_of(action), printable(action.doing) or None, printable(waits_for) or None


class Tables:
    """The tables of one run: `update` after a step, `flush` before a snapshot, `close`. A fault is logged once."""

    def __init__(self, folder: Path, engine: Engine) -> None:
        """The run begins or goes on at the engine's tick. Rows of later steps are removed: they come again."""
        self._folder, self._bodies = folder, BodyRows(engine.layout)
        self._events: list[Event] = []
        self._messages: list[tuple[int, str, str, str, str]] = []
        self._metadata = {SCENARIO: engine.layout.scenario.model_dump_json()}
        self._growing: dict[str, GrowingTable] = {}
        with self._faults_logged():
            self._begin(engine.tick)

    def _begin(self, tick: int) -> None:
        for name in (*AT_THE_END, SUMMARY_NAME):
            path_of(self._folder, name).unlink(missing_ok=True)
        for name, schema in GROWING.items():
            until = (
                tick + 1 if name == "bodies" else tick
            )  # bodies: of a step's end; others: of its begin
            self._growing[name] = GrowingTable(
                path_of(self._folder, name), schema.with_metadata(self._metadata), until
            )

    def update(
        self, engine: Engine, events: Sequence[Event], letters: Mapping[str, Written]
    ) -> None:
        """Keep the rows of the step that has just been done, with its events and letters, by sender."""
        if not self._growing:
            return
        self._bodies.keep(engine)
        self._events += events
        for name, written in sorted(letters.items()):  # in lockstep they come in order of arrival
            for to, body in written.sent:
                self._messages.append((engine.tick - 1, name, to, type_of(body), as_json(body)))
        if len(self._bodies) >= MOST_ROWS:
            self.flush()

    def flush(self) -> None:
        with self._faults_logged():
            events = [
                (e.tick, e.what, e.who, e.whom or None, e.detail or None) for e in self._events
            ]
            rows = {
                "bodies": self._bodies.take(),
                "events": _table(events, EVENTS),
                "messages": _table(self._messages, MESSAGES),
            }
            self._events, self._messages = [], []
            for name, table in self._growing.items():
                table.add(rows[name].replace_schema_metadata(table.schema.metadata))

    def close(self) -> None:
        """Write the rest, and finish the tables. The summary is written by `orchard.tables.folder`."""
        self.flush()
        with self._faults_logged():
            for table in self._growing.values():
                table.finish()
            if not self._growing:
                return
            events = pq.read_table(path_of(self._folder, "events")).to_pylist()
            messages = pq.read_table(
                path_of(self._folder, "messages"), filters=[("type", "in", OF_A_CALL)]
            ).to_pylist()
            for name, rows in (
                ("calls", calls(events, messages)),
                ("exchanges", exchanges(events)),
            ):
                write_table(
                    path_of(self._folder, name),
                    pa.Table.from_pylist(rows, AT_THE_END[name].with_metadata(self._metadata)),
                )

    @contextmanager
    def _faults_logged(self) -> Iterator[None]:
        try:
            yield
        except (OSError, pa.ArrowException) as error:
            why = getattr(error, "strerror", None) or error
            log.error(
                "the tables in %s cannot be written: %s; the run goes on without them",
                self._folder,
                why,
            )
            self._growing = {}


def _table(rows: Sequence[tuple[Any, ...]], schema: pa.Schema) -> pa.Table:
    columns = list(zip(*rows, strict=True)) or [()] * len(schema)
    return pa.table(
        [pa.array(column, field.type) for column, field in zip(columns, schema, strict=True)],
        schema,
    )
