"""What is in a recording, read back with Rerun's own reader."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from orchard.contract.events import Frame, talk_of
from orchard.field.layout import Layout
from orchard.local import Local
from orchard.sim.frames import FrameBuilder
from orchard.view.files import parts_of
from orchard.view.recorder import Recorder

# The length of the recording that tests share, s of the harvest. From 80 s on its pickers wait for
# empty bins, so the recording has all states of a picker.
SECONDS = 90.0
# (entity, component) -> (simulated s, value) in the order of time.
History = dict[tuple[str, str], list[tuple[float, object]]]


def starts(layout: Layout) -> np.ndarray:
    """Return the pose of each body at the start, (bodies, 3): x, y, m, and yaw, rad."""
    return np.array([start.pose for start in layout.starts])


def frames(layout: Layout, seconds: float) -> Iterator[Frame]:
    """Yield what a recorder gets of each tick of a run, for so many simulated seconds."""
    local = Local(layout.scenario)
    builder = FrameBuilder(local.engine)
    engine = local.engine
    while engine.tick < round(seconds * 10):
        events = local.tick()
        # The engine counts the next tick already: the letters are of the one before.
        events += talk_of(engine.tick - 1, local.post.written.get(engine.tick - 1, {}))
        yield builder.frame(events)


def recording_of(path: Path, layout: Layout, frames: Iterable[Frame], run: str = "a run") -> Path:
    """Record frames into a file, and return it."""
    recorder = Recorder(layout, run, path)
    for frame in frames:
        recorder.tick(frame)
    recorder.close()
    return path


class Rows:
    """All rows of one entity in the order of time: (seconds, component -> value)."""

    def __init__(self, path: Path, entity: str) -> None:
        self.rows: list[tuple[float, dict]] = []
        self.static: dict = {}
        for chunk in RrdReader(path).stream():
            if chunk.entity_path == entity:
                self._take(chunk)
        self.rows.sort(key=lambda row: row[0])

    def _take(self, chunk: Any) -> None:
        """Take the rows of a chunk. A static one has no time, and the last value counts."""
        batch = chunk.to_record_batch()
        if chunk.is_static:
            for row in batch.to_pylist():
                for key, value in row.items():
                    if key != "sim_time" and value is not None:
                        self.static[key] = value
            return
        seconds = [time.value / 1e9 for time in batch["sim_time"]]
        names = [name for name in batch.schema.names if ":" in name]
        lists = {name: batch[name].to_pylist() for name in names}
        for i, time in enumerate(seconds):
            self.rows.append((time, {name: lists[name][i] for name in names}))

    def values(self, component: str) -> list[tuple[float, object]]:
        """Return (seconds, value) wherever the entity has a value of a component."""
        return [(t, row[component]) for t, row in self.rows if row.get(component) is not None]


def chunks(path: Path) -> list:
    return list(RrdReader(path).stream())


def entities_with(path: Path, component: str) -> set[str]:
    """Return the paths of the entities that have a component."""
    return {
        chunk.entity_path
        for chunk in chunks(path)
        if component in chunk.to_record_batch().schema.names
    }


def poses_at(path: Path, seconds: float) -> dict[str, tuple[float, float, float]]:
    """Return where the viewer draws each body at a time: x and y, m, and yaw, rad.

    It draws the newest pose of the body's frame. All frames are transforms of the entity /tf.
    """
    seen = {}
    for t, row in Rows(path, "/tf").rows:
        # Times are whole nanoseconds, so the last bits of `seconds` must not decide.
        if t <= seconds + 1e-9:
            (x, y, _) = row["Transform3D:translation"][0]
            # A turn about the vertical by yaw has z = sin(yaw / 2) and w = cos(yaw / 2).
            (_, _, z, w) = row["Transform3D:quaternion"][0]
            seen[row["Transform3D:child_frame"][0]] = (x, y, 2 * np.arctan2(z, w))
    return seen


def rows_of(file: Path) -> History:
    """Return the values of each component of each entity, in all parts, in the order of time."""
    history: History = {}
    for path in parts_of(file):
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            if chunk.is_static or "sim_time" not in batch.schema.names:
                continue
            times = [time.value / 1e9 for time in batch["sim_time"]]
            for name in batch.schema.names:
                if ":" not in name:
                    continue
                rows = history.setdefault((chunk.entity_path, name), [])
                for time, value in zip(times, batch[name].to_pylist(), strict=True):
                    if value is not None:
                        rows.append((time, value))
    return {key: sorted(rows, key=lambda row: row[0]) for key, rows in history.items()}


def lines_of(rows: History) -> list[tuple[float, str]]:
    """Return the lines of the log of events, each with its time, s."""
    return [(t, text[0]) for t, text in rows.get(("/events", "TextLog:text"), [])]


def seen_at(rows: History, seconds: float) -> dict[tuple[str, str], object]:
    """Return what a viewer shows at a time of bodies, canopy and pins: (entity, component) ->
    value.

    A value stands until the next one of its component, or until its entity is cleared.
    """
    newest = {}
    for (entity, component), history in rows.items():
        if entity.startswith(("/world", "/canopy", "/pins")):
            past = [row for row in history if row[0] <= seconds]
            if past:
                newest[entity, component] = past[-1]

    cleared = {}
    for (entity, component), (time, _) in newest.items():
        if component == "Clear:is_recursive":
            cleared[entity] = time

    shown = {}
    for (entity, component), (time, value) in newest.items():
        if time > cleared.get(entity, -1.0) and value != []:
            shown[entity, component] = value
    return shown


def seconds_of(recording: Path) -> float:
    """Return the simulated time of the last row, s."""
    latest = 0.0
    for chunk in RrdReader(str(recording)).stream():
        batch = chunk.to_record_batch()
        if "sim_time" in batch.schema.names and batch.num_rows:
            latest = max(latest, max(batch.column("sim_time").cast("int64").to_pylist()) / 1e9)
    return latest


def texts_in(path: Path) -> list[str]:
    """Return all texts of the log and of states."""
    texts: list[str] = []
    for chunk in chunks(path):
        for row in chunk.to_record_batch().to_pylist():
            for name, values in row.items():
                if name.startswith(("TextLog:", "State")):
                    texts += [text for text in values or () if isinstance(text, str)]
    return texts
