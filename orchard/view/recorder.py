"""Writes frames into a Rerun recording: moving things in chunks of a second, what changes rarely
when it changes.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr

from orchard.contract.agent import WAITING_STATES, State
from orchard.contract.events import SCAN_TICKS, Event, Frame, LetterEvent, Velocities
from orchard.field.kinds import KINDS, LASER_RANGE, MOVERS, Laser, kind_of
from orchard.field.layout import Layout
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.blueprint import BATTERIES, blueprint
from orchard.view.bodies import BodyView, RowView, indices
from orchard.view.columns import Columns, times
from orchard.view.files import RecordingFile
from orchard.view.legend import log_legend
from orchard.view.names import FOCUS, Focus, NameView, log_focus
from orchard.view.reader import LEFT_OUT, LETTERS, MISSING, SCENARIO, SINCE, VELOCITIES
from orchard.view.scenery import log_scenery
from orchard.view.talk import Talk, gathered, level_of, line_of

CHUNK_TICKS, MOST_TICKS = (
    10,
    250,
)  # a second; in a chunk at most, while more frames wait: a few large chunks cost less than many
# To wait for the end of the file: a program that an own agent has started may hold the pipe.
END_SECONDS = 30.0
SCANS = 10  # sweeps that are sent together without a live server: a third less to write
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
    """Writes one run, or a further part of one.

    Call `tick` for each frame in order, then `close`.
    """

    def __init__(
        self, layout: Layout, run: str, path: str | Path | None = None, port: int | None = None
    ) -> None:
        """`run`: its id, by which viewers tell recordings apart. `port`: of a server for viewers on
        the loopback.

        Raises OSError if the file cannot be opened.
        """
        self.layout = layout
        self.rec = rr.RecordingStream("orchard", recording_id=run)
        self.rec.set_log_time_enabled(False)
        self.rec.set_log_tick_enabled(False)
        self._file = None if path is None else RecordingFile(Path(path))
        self.uri = self._open(port)
        self.rec.send_recording_name(run if path is None else Path(path).stem)
        log_scenery(self.rec, layout)
        log_legend(self.rec)
        log_focus(self.rec)
        self.rec.log(
            SCENARIO,
            rr.TextDocument(layout.scenario.model_dump_json(), media_type="application/json"),
            static=True,
        )
        for series, (name, colour, width) in SERIES.items():
            style = rr.SeriesLines(
                names=[name], colors=[colour], widths=[width], interpolation_mode="StepAfter"
            )
            self.rec.log(series, style, static=True)
        self._columns = columns = Columns(self.rec)
        self.bodies, self.rows, self.talk = (
            BodyView(columns, layout),
            RowView(columns, layout),
            Talk(columns, layout),
        )
        self.names, self.focus = NameView(columns, layout), Focus(layout)
        self.waiting: Callable[[], int] = lambda: 0  # the number of frames that come at once
        self._frames = [*layout.names, FOCUS]
        self._lengths = np.array([lane.length for lane in layout.lanes])  # m, of the rows
        self._scanned = indices(layout, MOVERS)
        self._poses: list[
            tuple[int, np.ndarray, list[float]]
        ] = []  # tick, of the bodies, of the focus
        self._scans: list[tuple[int, Sequence[np.ndarray | None]]] = []
        self._drove: dict[str, Velocities] = {}  # of each body, as they were recorded last
        self._last = np.full((len(self._frames), 3), np.nan)  # the poses that were last sent
        self._doing: dict[str, tuple[str, State]] = {}
        self._gauges: dict[str, float] = {}
        self._second, self._sent = -1, 0  # of the newest figures; tick of the last chunk
        self._left_out = 0  # frames that were left out since this was last recorded

    def _open(self, port: int | None) -> str:
        server = None if port is None else rr.GrpcServerSink(bind_ip="127.0.0.1", port=port)
        sinks = [
            sink
            for sink in (rr.FileSink(self._file.inlet) if self._file is not None else None, server)
            if sink is not None
        ]
        if sinks:
            self.rec.set_sinks(*sinks, default_blueprint=blueprint(self.layout))
        if self._file is not None:
            self._file.seal()
        return server.uri if server is not None else ""

    def tick(self, frame: Frame) -> None:
        """Record one frame.

        Frames come in order; ticks may be left out. With one of tick 1 the start is recorded too.
        """
        if frame.tick == 1 and self._second < 0:
            starts = np.array([start.pose for start in self.layout.starts])
            self._record(
                replace(
                    frame,
                    tick=0,
                    poses=starts,
                    scans=None,
                    delivered=0,
                    events=(),
                    left_out=0,
                    velocities={},
                )
            )
        self._record(frame)

    def _record(self, frame: Frame) -> None:
        self._columns.tick = frame.tick
        is_due = frame.tick // CHUNK_TICKS > self._second
        self._second = frame.tick // CHUNK_TICKS
        self._left_out += frame.left_out
        self._poses.append((frame.tick, frame.poses, self.focus.follow(frame)))
        if frame.scans is not None and frame.tick % SCAN_TICKS == 0:
            self._scans.append((frame.tick, frame.scans))
        self._changes(frame)
        self._words(frame)
        self._figures(frame, is_due)
        self._batteries(frame)
        self._drives(frame)
        if is_due and (not self.waiting() or frame.tick - self._sent >= MOST_TICKS):
            self._send()
            if not self.uri:
                # Into the file, 0.3 ms: a kill loses what waits, and at most one second more.
                self.rec.flush()

    def gap(self, since: int, until: int, why: str) -> None:
        """Record that nothing is recorded between two ticks, and why.

        The next frame must be a whole one.
        """
        self._columns.add(MISSING, rr.AnyValues, until, **{SINCE: [since]})
        words = (
            f"nothing recorded from {since * TIME_STEP:.1f} s to {until * TIME_STEP:.1f} s: {why}"
        )
        self.tell(Event(until, "nothing recorded", "logger", "", words))
        self.talk.forget()

    def tell(self, event: Event) -> None:
        """Add an event of a tick that has no frame."""
        self._columns.add(
            "events", rr.TextLog, event.tick, text=[line_of(event)], level=[level_of(event.what)]
        )
        self._letter(event)

    def close(self) -> Path | None:
        """Write the rest, wait, and end the file and the server.

        Return the file if all is in it.
        """
        self._send()
        self._send_scans()
        self.rec.flush()
        self.rec.disconnect()
        if self._file is not None:
            self._file.join(END_SECONDS)
        return (
            self._file.path
            if self._file is not None and self._file.is_whole and not self._file.is_alive()
            else None
        )

    # -- what is sent in chunks

    def _send(self) -> None:
        self._sent = self._columns.tick
        self._send_poses()
        if self.uri or len(self._scans) >= SCANS:
            self._send_scans()
        if self._left_out:
            self._columns.add(MISSING, rr.AnyValues, **{LEFT_OUT: [self._left_out]})
            words = f"left out {self._left_out} frames, which came faster than they can be recorded"
            self.tell(Event(self._columns.tick, "left out", "logger", "", words))
            self._left_out = 0
        self._columns.send()

    def _send_poses(self) -> None:
        if self._poses:
            ticks, bodies, focus = map(np.array, zip(*self._poses, strict=True))
            poses = np.concatenate([bodies, focus[:, None]], axis=1)
            changed = (poses != np.concatenate([self._last[None], poses[:-1]])).any(axis=2)
            changed[-1, 0] = (
                True  # the newest tick always gets a row: it shows how far the recording reaches
            )
            when, which = changed.nonzero()
            columns = _transforms(poses[when, which], [self._frames[i] for i in which.tolist()])
            self.rec.send_columns("/tf", indexes=[times(ticks[when])], columns=columns)
            self._last = poses[-1]
            self._poses.clear()

    def _send_scans(self) -> None:
        for i in self._scanned:
            name, laser = self.layout.names[i], KINDS[self.layout.starts[i].kind].laser
            kept = [
                (tick, ranges) for tick, scans in self._scans if (ranges := scans[i]) is not None
            ]
            if kept:
                points, lengths = hits(np.stack([ranges for _, ranges in kept]), laser, SCAN_BEAMS)
                column = rr.Points3D.columns(positions=points).partition(lengths)
                self.rec.send_columns(
                    f"scans/{name}", indexes=[times([tick for tick, _ in kept])], columns=column
                )
        self._scans.clear()

    # -- what changes rarely

    def _drives(self, frame: Frame) -> None:
        news = {
            name: velocities
            for name, velocities in frame.velocities.items()
            if self._drove.get(name) != velocities
        }
        self._drove |= news
        for name, velocities in news.items():
            self._columns.add(
                VELOCITIES, rr.AnyValues, body=[self.layout.index[name]], velocities=velocities
            )

    def _changes(self, frame: Frame) -> None:
        shows = {
            "fill": self.bodies.fills,
            "coupled": self.bodies.bars,
            "alive": self.bodies.weeds,
            "row_ends": self.rows.show,
        }
        for name, show in shows.items():
            if (news := getattr(frame, name)) is not None:
                show(news)

    def _words(self, frame: Frame) -> None:
        for name, text in frame.doing.items():
            state = frame.states.get(name, "resting")
            if self._doing.get(name) != (text, state):
                self._doing[name] = text, state
                self.bodies.doing(name, text, state)
        self.names.show(frame.tick, frame.poses)
        news = [event for event in frame.events if self.talk.is_news(frame.tick, event)]
        lines = dict.fromkeys(gathered(news))
        for event in [*lines, *(event for event in frame.events if event not in lines)]:
            level = level_of(event.what) if event in lines else "DEBUG"
            self._columns.add("events", rr.TextLog, text=[line_of(event)], level=[level])
        for event in frame.events:
            self._letter(event)
        self.talk.show(frame.tick, frame.poses, news)

    def _letter(self, event: Event) -> None:
        """Record a message between agents with its fields, at the tick at which it is sent."""
        if isinstance(event, LetterEvent):
            self._columns.add(
                LETTERS,
                rr.AnyValues,
                event.tick,
                sender=[event.who],
                recipient=[event.whom],
                type=[event.what],
                content=[event.content],
            )

    def _batteries(self, frame: Frame) -> None:
        for name, charge in frame.charges.items():
            path = f"{BATTERIES}/{name}"
            if self._gauges.get(path) != charge:
                self._gauges[path] = charge
                self._columns.add(path, rr.Scalars, scalars=[charge])

    def _figures(self, frame: Frame, is_due: bool) -> None:
        if not is_due and frame.delivered == self._gauges.get("metrics/bins/delivered"):
            return
        gauges = {
            "metrics/bins/delivered": float(frame.delivered),
            **self._robots(),
            **self._rows_and_bins(frame),
        }
        for path, value in gauges.items():
            if self._gauges.get(path) != value or frame.tick % (60 * CHUNK_TICKS) == 0:
                self._columns.add(path, rr.Scalars, scalars=[value])
        self._gauges.update(gauges)

    def _robots(self) -> dict[str, float]:
        states = [(kind_of(name), state) for name, (_, state) in self._doing.items()]
        waiting = sum(kind == "picker" and state in WAITING_STATES for kind, state in states)
        busy = sum(
            kind == "carrier" and state not in ("waiting", "resting", "broken")
            for kind, state in states
        )
        return {
            "metrics/robots/pickers_waiting": float(waiting),
            "metrics/robots/carriers_busy": float(busy),
        }

    def _rows_and_bins(self, frame: Frame) -> dict[str, float]:
        ends = frame.row_ends
        rows = (
            {}
            if ends is None
            else {
                "metrics/bins/rows_picked": float(
                    (ends[:, :2].sum(axis=1) >= self._lengths - FULL_WITHIN).sum()
                )
            }
        )
        return (
            rows
            if frame.fill is None
            else rows
            | {"metrics/bins/full": float((frame.fill >= self.layout.metres_per_bin).sum())}
        )


def hits(sweeps: np.ndarray, laser: Laser, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that a laser hit, (m, 3) float32, in the body's frame, and the number of
    points of each sweep, (n,).

    `sweeps`: (n, beams) ranges, m; of these, every `every`-th beam counts. x and y are rounded to
    1/32 m.
    """
    ranges = sweeps[:, ::every]
    seen = ranges < LASER_RANGE
    angles = laser.first + laser.increment * every * np.nonzero(seen)[1]
    x, y = laser.ahead + ranges[seen] * np.cos(angles), ranges[seen] * np.sin(angles)
    flat = np.round(np.stack([x, y], axis=1) * SCAN_GRID) / SCAN_GRID
    return np.concatenate([flat, np.full((len(flat), 1), 0.25)], axis=1).astype(
        np.float32
    ), seen.sum(axis=1)


def _transforms(places: np.ndarray, frames: list[str]) -> rr.ComponentColumnList:
    half, zero = places[:, 2] / 2, np.zeros(len(places))
    return rr.Transform3D.columns(
        translation=np.stack([places[:, 0], places[:, 1], zero], axis=1).astype(np.float32),
        quaternion=np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1).astype(np.float32),
        child_frame=frames,
    )
