"""What a run counts, writes and shows: its figures, frames, tables and snapshots.

Two loops use it: that with a network (orchard/server/run.py), and that of local mode
(orchard/launch/local_run.py).
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchard.contract.events import Event, Frame
from orchard.contract.messages import Written
from orchard.server.figures import RunFigures
from orchard.server.snapshots import SnapshotWriter
from orchard.sim.engine import Engine
from orchard.sim.frames import FrameBuilder
from orchard.sim.snapshot import Snapshot

if TYPE_CHECKING:
    from orchard.tables.tables import Tables


class RunAccount:
    """The figures, frames, tables and snapshots of one run."""

    def __init__(
        self,
        engine: Engine,
        before: Snapshot | None,
        snapshot_writer: SnapshotWriter,
        table: str | Path | None,
        clock: Callable[[], float],
    ) -> None:
        """`before`: the snapshot from which the engine was resumed; None: the run is new.

        `table`: the folder for tables; None: none are written. `clock`: s of wall time, without
        pauses.
        """
        self._engine = engine
        self.frame_builder = FrameBuilder(engine)
        figures_before: Mapping[str, Any] = {}
        if before is not None:
            figures_before = before.figures
        self.figures = RunFigures(engine, clock, figures_before)
        self.snapshot_writer = snapshot_writer
        self._tables: Tables | None = None
        if table is not None:
            # It is imported here, because pyarrow takes some time to load.
            from orchard.tables import tables

            self._tables = tables.Tables(Path(table), engine)

    def frame(self, events: list[Event]) -> Frame:
        """Return the frame of the step that has just been done, with its events."""
        return self.frame_builder.frame(events)

    def begin_whole(self) -> None:
        """Make the next frame a whole one, for a viewer that has just come."""
        self.frame_builder.forget()

    def is_due_to_keep(self, tick: int) -> bool:
        """Whether a snapshot is due at a tick."""
        return self.snapshot_writer.is_due(tick)

    def update(self, events: list[Event], letters: Mapping[str, Written]) -> None:
        """Count the step that has just been done. `letters`: sender -> its letters."""
        self.figures.update(events)
        if self._tables is not None:
            self._tables.update(self._engine, events, letters)

    def keep(self, snapshot: Snapshot) -> None:
        """Write a snapshot, and before it the rows of tables up to it.

        A run that goes on from the snapshot goes on with these tables.
        """
        if self._tables is not None:
            self._tables.flush()
        self.snapshot_writer.keep(snapshot)

    def close(self) -> None:
        """Wait until all is on the disk."""
        self.snapshot_writer.finish()
        if self._tables is not None:
            self._tables.close()

    def why_over(self, ticks: float) -> str:
        """Return why the run is over; '' if it is not.

        `ticks`: the tick at which its duration ends; infinity without one.
        """
        if self._engine.over:
            return "harvested"
        if self._engine.tick >= ticks:
            return "duration"
        return self.figures.fault

    def summary(
        self,
        why: str,
        mode: str,
        hosts: int,
        refused: Mapping[str, int],
        answers: Mapping[str, Any],
    ) -> dict[str, Any]:
        """Return the summary of the run.

        `hosts`: number of agent processes; `refused`: reason -> number of messages; `answers`:
        figures of the answers to ticks.
        """
        engine = self._engine
        # The order is that in which people read the figures.
        return {
            "hash": engine.hash,
            "mode": mode,
            "hosts": hosts,
            **self.figures.summary(),
            **answers,
            "messages_refused": dict(refused),
            "finished": engine.over,
            "ended": why,
            "violations": engine.violations(),
            "jam": self.figures.jam,
        }
