"""Writes frames into a Rerun recording: moving things in chunks of a second, what changes rarely when it changes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr

from orchard.contract.agent import WAITING_STATES, State
from orchard.contract.events import SCAN_TICKS, Event, Frame, Velocities
from orchard.field.kinds import KINDS, LASER_RANGE, MOVERS, Laser, kind_of
from orchard.field.layout import Layout
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.blueprint import TIMELINE, blueprint
from orchard.view.bodies import BodyView, RowView, indices
from orchard.view.files import RecordingFile
from orchard.view.legend import log_legend
from orchard.view.names import FOCUS, Focus, NameView, log_focus
from orchard.view.reader import LEFT_OUT, MISSING, SCENARIO, SINCE, VELOCITIES
from orchard.view.scenery import log_scenery
from orchard.view.talk import Talk, gathered, level_of, line_of

CHUNK_TICKS = 10  # a second
END_SECONDS = 30.0  # to wait for the end of the file: a program that an own agent has started may hold the pipe
SCAN_CHUNK_TICKS = 50  # without a live server, scans are sent in larger chunks: a third less to write
SCAN_BEAMS = 2  # every second beam
SCAN_GRID = 32.0  # positions are rounded to 1/32 m

# Path -> (name in the legend, colour, width): the plots of the blueprint
SERIES: dict[str, tuple[str, palette.Colour, float]] = {
    "metrics/bins/delivered": ("delivered", (76, 175, 80), 2.5),
    "metrics/bins/full": ("full, not yet unloaded", (235, 120, 40), 4.5),
    "metrics/bins/rows_picked": ("rows picked", (255, 240, 190), 1.5),
    "metrics/robots/pickers_waiting": ("pickers waiting", (255, 160, 20), 2.0),
    "metrics/robots/carriers_busy": ("carriers busy", (45, 140, 240), 2.0),
}


class Recorder:
    """Writes one run, or a further part of one. Call `tick` for each frame in order, then `close`."""

    def __init__(self, layout: Layout, run_name: str, path: str | Path | None = None, serve: bool = False, port: int = 9876) -> None:
        """`serve`: open a server for viewers on the loopback. Raises OSError if the file cannot be opened."""
        self.layout = layout
        self.rec = rr.RecordingStream("orchard", recording_id=run_name)
        self.rec.set_log_time_enabled(False)
        self.rec.set_log_tick_enabled(False)
        self._file = None if path is None else RecordingFile(Path(path))
        self.uri = self._open(serve, port)
        self.rec.send_recording_name(run_name)
        self.rec.set_time(TIMELINE, duration=0.0)
        log_scenery(self.rec, layout)
        log_legend(self.rec)
        log_focus(self.rec)
        self.rec.log(SCENARIO, rr.TextDocument(layout.scenario.model_dump_json(), media_type="application/json"), static=True)
        for series, (name, colour, width) in SERIES.items():
            style = rr.SeriesLines(names=[name], colors=[colour], widths=[width], interpolation_mode="StepAfter")
            self.rec.log(series, style, static=True)
        self.bodies, self.rows, self.talk = BodyView(self.rec, layout), RowView(self.rec, layout), Talk(self.rec, layout)
        self.names, self.focus = NameView(self.rec, layout), Focus(layout)
        self._frames = [*layout.names, FOCUS]
        self._lengths = np.array([lane.length for lane in layout.lanes])  # m, of the rows
        self._scan_chunk = CHUNK_TICKS if serve else SCAN_CHUNK_TICKS
        self._scanned = indices(layout, MOVERS)
        self._poses: list[tuple[int, np.ndarray]] = []
        self._scans: list[tuple[int, Sequence[np.ndarray | None]]] = []
        self._events: list[tuple[int, str, str]] = []  # tick, line, level
        self._velocities: list[tuple[int, str, Velocities]] = []
        self._drove: dict[str, Velocities] = {}  # of each body, as they were recorded last
        self._last = np.full((len(self._frames), 3), np.nan)  # the poses that were last sent
        self._newest = 0  # tick
        self._doing: dict[str, tuple[str, State]] = {}
        self._gauges: dict[str, float] = {}
        self._second, self._sweep = -1, -1  # the last chunks that were sent: of poses, of scans
        self._left_out = 0  # frames that were left out since this was last recorded

    def _open(self, serve: bool, port: int) -> str:
        server = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port) if serve else None
        sinks = [sink for sink in (rr.FileSink(self._file.inlet) if self._file is not None else None, server) if sink is not None]
        if sinks:
            self.rec.set_sinks(*sinks, default_blueprint=blueprint(self.layout))
        if self._file is not None:
            self._file.seal()
        return server.uri if server is not None else ""

    def tick(self, frame: Frame) -> None:
        """Record one frame. Frames come in order; ticks may be left out. With one of tick 1 the start is recorded too."""
        if frame.tick == 1 and self._second < 0:
            self._record(self._start_of(frame))
        self._record(frame)

    def _start_of(self, first: Frame) -> Frame:
        starts = np.array([start.pose for start in self.layout.starts])
        return replace(first, tick=0, poses=starts, scans=None, delivered=0, events=(), left_out=0, velocities={})

    def _record(self, frame: Frame) -> None:
        self.rec.set_time(TIMELINE, duration=frame.tick * TIME_STEP)
        is_due = frame.tick // CHUNK_TICKS > self._second
        self._newest = frame.tick
        self._left_out += frame.left_out
        self._poses.append((frame.tick, np.vstack([frame.poses, self.focus.follow(frame)])))
        if frame.scans is not None and frame.tick % SCAN_TICKS == 0:
            self._scans.append((frame.tick, frame.scans))
        self._changes(frame)
        self._words(frame)
        self._figures(frame, is_due)
        self._drives(frame)
        if is_due:
            self._send_chunk(frame.tick)

    def gap(self, since: int, until: int, why: str) -> None:
        """Record that nothing is recorded between two ticks, and why. The next frame must be a whole one."""
        self.rec.set_time(TIMELINE, duration=until * TIME_STEP)
        self.rec.log(MISSING, rr.AnyValues(True, **{SINCE: since}))
        words = f"nothing recorded from {since * TIME_STEP:.1f} s to {until * TIME_STEP:.1f} s: {why}"
        self.tell(Event(until, "nothing recorded", "logger", "", words))
        self.talk.forget()

    def tell(self, event: Event) -> None:
        """Log an event of a tick that has no frame."""
        self._events.append((event.tick, line_of(event), level_of(event.what)))

    def close(self) -> bool:
        """Write the rest, wait, and end the file and the server. Return whether all is in the file."""
        self._send(scans=True)
        self.rec.flush()
        self.rec.disconnect()
        if self._file is not None:
            self._file.join(END_SECONDS)
        return self._file is not None and self._file.is_whole and not self._file.is_alive()

    # -- what is sent in chunks

    def _send_chunk(self, tick: int) -> None:
        self._second, before, self._sweep = tick // CHUNK_TICKS, self._sweep, tick // self._scan_chunk
        self._send(scans=self._sweep > before)
        if not self.uri:
            self.rec.flush()  # into the file, 0.3 ms: a kill loses at most one second, and five of the scans

    def _send(self, scans: bool) -> None:
        self._send_poses()
        if self._left_out:
            self.rec.log(MISSING, rr.AnyValues(True, **{LEFT_OUT: self._left_out}))
            words = f"left out {self._left_out} frames, which came faster than they can be recorded"
            self.tell(Event(self._newest, "left out", "logger", "", words))
            self._left_out = 0
        self._send_events()
        self._send_velocities()
        if scans:
            self._send_scans()

    def _send_poses(self) -> None:
        if self._poses:
            ticks, poses = zip(*self._poses, strict=True)
            changed = (np.array(poses) != np.array([self._last, *poses[:-1]])).any(axis=2)
            changed[-1, 0] = True  # the newest tick always gets a row: it shows how far the recording reaches
            when, which = changed.nonzero()
            columns = _transforms(np.array(poses)[when, which], [self._frames[i] for i in which])
            self.rec.send_columns("/tf", indexes=[_times(np.array(ticks)[when])], columns=columns)
            self._last = poses[-1]
            self._poses.clear()

    def _send_scans(self) -> None:
        for i in self._scanned:
            name, laser = self.layout.names[i], KINDS[self.layout.starts[i].kind].laser
            kept = [(tick, ranges) for tick, scans in self._scans if (ranges := scans[i]) is not None]
            if kept:
                points, lengths = hits(np.stack([ranges for _, ranges in kept]), laser, SCAN_BEAMS)
                column = rr.Points3D.columns(positions=points).partition(lengths)
                self.rec.send_columns(f"scans/{name}", indexes=[_times([tick for tick, _ in kept])], columns=column)
        self._scans.clear()

    def _send_events(self) -> None:
        if self._events:
            ticks, texts, levels = zip(*self._events, strict=True)
            self.rec.send_columns("events", indexes=[_times(ticks)], columns=rr.TextLog.columns(text=texts, level=levels))
            self._events.clear()

    def _send_velocities(self) -> None:
        if self._velocities:
            ticks, names, velocities = zip(*self._velocities, strict=True)
            bodies = rr.AnyValues.columns(body=[self.layout.index[name] for name in names])
            numbers = rr.AnyValues.columns(velocities=np.array(velocities).ravel()).partition([6] * len(names))
            self.rec.send_columns(VELOCITIES, indexes=[_times(ticks)], columns=[*bodies, *numbers])
            self._velocities.clear()

    # -- what changes rarely

    def _drives(self, frame: Frame) -> None:
        news = {name: velocities for name, velocities in frame.velocities.items() if self._drove.get(name) != velocities}
        self._drove |= news
        self._velocities += [(frame.tick, name, velocities) for name, velocities in news.items()]

    def _changes(self, frame: Frame) -> None:
        if frame.fill is not None:
            self.bodies.fills(frame.fill)
        if frame.coupled is not None:
            self.bodies.bars(frame.coupled)
        if frame.alive is not None:
            self.bodies.weeds(frame.alive)
        if frame.row_ends is not None:
            self.rows.show(frame.row_ends)

    def _words(self, frame: Frame) -> None:
        for name, text in frame.doing.items():
            state = frame.states.get(name, "resting")
            if self._doing.get(name) != (text, state):
                self._doing[name] = text, state
                self.bodies.doing(name, text, state)
        self.names.show(frame.tick, frame.poses)
        news = [event for event in frame.events if self.talk.is_news(frame.tick, event)]
        lines = gathered(news)
        self._events += [(frame.tick, line_of(event), level_of(event.what)) for event in lines]
        self._events += [(frame.tick, line_of(event), "DEBUG") for event in frame.events if event not in lines]
        self.talk.show(frame.tick, frame.poses, news)

    def _figures(self, frame: Frame, is_due: bool) -> None:
        if not is_due and frame.delivered == self._gauges.get("metrics/bins/delivered"):
            return
        gauges = {"metrics/bins/delivered": float(frame.delivered), **self._robots(), **self._rows_and_bins(frame)}
        for path, value in gauges.items():
            if self._gauges.get(path) != value or frame.tick % (60 * CHUNK_TICKS) == 0:
                self.rec.log(path, rr.Scalars(value))
        self._gauges.update(gauges)

    def _robots(self) -> dict[str, float]:
        states = [(kind_of(name), state) for name, (_, state) in self._doing.items()]
        waiting = sum(kind == "picker" and state in WAITING_STATES for kind, state in states)
        busy = sum(kind == "carrier" and state not in ("waiting", "resting", "broken") for kind, state in states)
        return {"metrics/robots/pickers_waiting": float(waiting), "metrics/robots/carriers_busy": float(busy)}

    def _rows_and_bins(self, frame: Frame) -> dict[str, float]:
        ends = frame.row_ends
        rows = {} if ends is None else {"metrics/bins/rows_picked": float((ends[:, :2].sum(axis=1) >= self._lengths - FULL_WITHIN).sum())}
        return rows if frame.fill is None else rows | {"metrics/bins/full": float((frame.fill >= self.layout.metres_per_bin).sum())}


def hits(sweeps: np.ndarray, laser: Laser, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that a laser hit, (m, 3) float32, in the body's frame, and the number of points of each sweep, (n,).

    `sweeps`: (n, beams) ranges, m; of these, every `every`-th beam counts. x and y are rounded to 1/32 m.
    """
    ranges = sweeps[:, ::every]
    seen = ranges < LASER_RANGE
    angles = laser.first + laser.increment * every * np.nonzero(seen)[1]
    x, y = laser.ahead + ranges[seen] * np.cos(angles), ranges[seen] * np.sin(angles)
    flat = np.round(np.stack([x, y], axis=1) * SCAN_GRID) / SCAN_GRID
    return np.concatenate([flat, np.full((len(flat), 1), 0.25)], axis=1).astype(np.float32), seen.sum(axis=1)


def _transforms(places: np.ndarray, frames: list[str]) -> rr.ComponentColumnList:
    half = places[:, 2] / 2
    zero = np.zeros(len(places))
    return rr.Transform3D.columns(
        translation=np.stack([places[:, 0], places[:, 1], zero], axis=1).astype(np.float32),
        quaternion=np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1).astype(np.float32),
        child_frame=frames,
    )


def _times(ticks: Sequence[int] | np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=np.round(np.array(ticks) * TIME_STEP * 1e9).astype("timedelta64[ns]"))
