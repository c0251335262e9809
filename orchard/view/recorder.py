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
from orchard.view.focus import FOCUS, Focus, log_focus
from orchard.view.legend import log_legend
from orchard.view.load_out import LoadOutView
from orchard.view.names import NameView
from orchard.view.reader import LEFT_OUT, LETTERS, MISSING, SCENARIO, SINCE, VELOCITIES
from orchard.view.scenery import log_scenery
from orchard.view.talk import Talk, gathered, level_of, line_of

# Ticks of a chunk, if no more frames wait: a second.
CHUNK_TICKS = 10
# Ticks of a chunk, at most, while more frames wait: a few large chunks cost less than many.
MOST_TICKS = 250
# s to wait for the end of the file, at most: a program that a user's own agent has started may keep
# the pipe to the file open.
END_SECONDS = 30.0
# Sweeps of a laser that are sent together if there is no live server: a third less to write.
SCANS = 10
# Of this many beams one is recorded.
SCAN_BEAMS = 2
# Positions are rounded to 1/32 m.
SCAN_GRID = 32.0
# m above the ground at which laser hits are drawn.
SCAN_Z = 0.25

# The plots of the blueprint: path -> name in the legend, colour, and width in screen points.
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
        self._file: RecordingFile | None = None
        name = run
        if path is not None:
            self._file = RecordingFile(Path(path))
            name = Path(path).stem
        self.uri = self._open(port)
        self.rec.send_recording_name(name)
        log_scenery(self.rec, layout)
        log_legend(self.rec)
        log_focus(self.rec)
        self.rec.log(
            SCENARIO,
            rr.TextDocument(layout.scenario.model_dump_json(), media_type="application/json"),
            static=True,
        )
        for series, (title, colour, width) in SERIES.items():
            style = rr.SeriesLines(
                names=[title], colors=[colour], widths=[width], interpolation_mode="StepAfter"
            )
            self.rec.log(series, style, static=True)
        columns = Columns(self.rec)
        self._columns = columns
        self.bodies = BodyView(columns, layout)
        self.rows = RowView(columns, layout)
        self.load_out = LoadOutView(columns, layout)
        self.talk = Talk(columns, layout)
        self.names = NameView(columns, layout)
        self.focus = Focus(layout)
        # How many frames wait to be recorded. The logger puts the length of its queue here.
        self.waiting: Callable[[], int] = lambda: 0
        self._frames = [*layout.names, FOCUS]
        self._lengths = np.array([lane.length for lane in layout.lanes])  # m, of the rows
        self._scanned = indices(layout, MOVERS)
        # Tick, and poses of the bodies and of the focus.
        self._poses: list[tuple[int, np.ndarray, list[float]]] = []
        self._scans: list[tuple[int, Sequence[np.ndarray | None]]] = []
        # Velocities of each body, as they were recorded last.
        self._velocities: dict[str, Velocities] = {}
        # The poses that were sent last. NaN is unlike any pose, so the first ones are all sent.
        self._last = np.full((len(self._frames), 3), np.nan)
        self._doing: dict[str, tuple[str, State]] = {}
        self._gauges: dict[str, float] = {}
        # The second of the newest figures.
        self._second = -1
        # Tick of the last chunk.
        self._sent = 0
        # Frames that were left out since this was recorded last.
        self._left_out = 0

    def _open(self, port: int | None) -> str:
        """Open file and server, and return the server's address; '' without one."""
        sinks: list[rr.FileSink | rr.GrpcServerSink] = []
        uri = ""
        if self._file is not None:
            sinks.append(rr.FileSink(self._file.inlet))
        if port is not None:
            server = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port)
            uri = server.uri
            sinks.append(server)
        if sinks:
            self.rec.set_sinks(*sinks, default_blueprint=blueprint(self.layout))
        if self._file is not None:
            self._file.seal()
        return uri

    def tick(self, frame: Frame) -> None:
        """Record one frame.

        Frames come in order; ticks may be left out. With the frame of tick 1 the start, tick 0, is
        recorded too, for which physics publishes no frame.
        """
        if frame.tick == 1 and self._second < 0:
            starts = np.array([start.pose for start in self.layout.starts])
            at_start = replace(
                frame,
                tick=0,
                poses=starts,
                scans=None,
                delivered=0,
                events=(),
                left_out=0,
                velocities={},
            )
            self._record(at_start)
        self._record(frame)

    def _record(self, frame: Frame) -> None:
        """Add all that a frame says, and send what has gathered once a second."""
        self._columns.tick = frame.tick
        second = frame.tick // CHUNK_TICKS
        is_due = second > self._second
        self._second = second
        self._left_out += frame.left_out
        self._poses.append((frame.tick, frame.poses, self.focus.follow(frame)))
        if frame.scans is not None and frame.tick % SCAN_TICKS == 0:
            self._scans.append((frame.tick, frame.scans))
        self._changes(frame)
        self._words(frame)
        self._figures(frame, is_due)
        self._batteries(frame)
        self._drives(frame)
        if not is_due:
            return
        if not self.waiting() or frame.tick - self._sent >= MOST_TICKS:
            self._send()
            if not self.uri:
                # Writes into the file, in 0.3 ms. So a kill loses the frames that wait, and at most
                # one second more.
                self.rec.flush()

    def gap(self, since: int, until: int, why: str) -> None:
        """Record that nothing is recorded between two ticks, and why.

        The next frame must be a whole one.
        """
        self._columns.add(MISSING, rr.AnyValues, until, **{SINCE: [since]})
        from_second = f"{since * TIME_STEP:.1f} s"
        to_second = f"{until * TIME_STEP:.1f} s"
        words = f"nothing recorded from {from_second} to {to_second}: {why}"
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
        if self._file is None:
            return None
        self._file.join(END_SECONDS)
        if self._file.is_alive() or not self._file.is_whole:
            return None
        return self._file.path

    # -- what is sent in chunks

    def _send(self) -> None:
        """Send what has gathered since the last chunk."""
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
        """Send the poses that have changed, each with its tick."""
        if not self._poses:
            return
        # Shapes (k,), (k, n, 3) and (k, 3): k ticks, n bodies.
        ticks, bodies, focus = map(np.array, zip(*self._poses, strict=True))
        poses = np.concatenate([bodies, focus[:, None]], axis=1)
        before = np.concatenate([self._last[None], poses[:-1]])
        changed = (poses != before).any(axis=2)
        # The newest tick always gets a row: it shows how far the recording reaches.
        changed[-1, 0] = True
        rows, frames = changed.nonzero()
        columns = _transforms(poses[rows, frames], [self._frames[i] for i in frames.tolist()])
        self.rec.send_columns("/tf", indexes=[times(ticks[rows])], columns=columns)
        self._last = poses[-1]
        self._poses.clear()

    def _send_scans(self) -> None:
        """Send the laser hits of each body that has a laser."""
        for i in self._scanned:
            sweeps = []
            ticks = []
            for tick, scans in self._scans:
                ranges = scans[i]
                if ranges is not None:
                    sweeps.append(ranges)
                    ticks.append(tick)
            if not sweeps:
                continue
            laser = KINDS[self.layout.starts[i].kind].laser
            points, lengths = hits(np.stack(sweeps), laser, SCAN_BEAMS)
            column = rr.Points3D.columns(positions=points).partition(lengths)
            path = f"scans/{self.layout.names[i]}"
            self.rec.send_columns(path, indexes=[times(ticks)], columns=column)
        self._scans.clear()

    # -- what changes rarely

    def _drives(self, frame: Frame) -> None:
        """Add the velocities that have changed."""
        for name, velocities in frame.velocities.items():
            if self._velocities.get(name) != velocities:
                self._velocities[name] = velocities
                body = [self.layout.index[name]]
                self._columns.add(VELOCITIES, rr.AnyValues, body=body, velocities=velocities)

    def _changes(self, frame: Frame) -> None:
        """Add what a frame says only when it has changed."""
        if frame.fill is not None:
            self.bodies.fills(frame.fill)
        if frame.coupled is not None:
            self.bodies.bars(frame.coupled)
        if frame.alive is not None:
            self.bodies.weeds(frame.alive)
        if frame.row_ends is not None:
            self.rows.show(frame.row_ends)
        self.load_out.trailers(frame.tick, frame.trailers)
        self.load_out.bins(frame.waiting_bins)

    def _words(self, frame: Frame) -> None:
        """Add what bodies do, their names on the plan, and the events with their arcs."""
        for name, text in frame.doing.items():
            state = frame.states.get(name, "resting")
            if self._doing.get(name) != (text, state):
                self._doing[name] = text, state
                self.bodies.doing(name, text, state)
        self.names.show(frame.tick, frame.poses)
        news = [event for event in frame.events if self.talk.is_news(frame.tick, event)]
        lines = dict.fromkeys(gathered(news))
        for event in lines:
            self._log_event(event, level_of(event.what))
        # Repeats, and messages that are gathered in a line, are shown only on request.
        for event in frame.events:
            if event not in lines:
                self._log_event(event, "DEBUG")
        for event in frame.events:
            self._letter(event)
        self.talk.show(frame.tick, frame.poses, news)

    def _log_event(self, event: Event, level: str) -> None:
        """Add a line of the event log."""
        self._columns.add("events", rr.TextLog, text=[line_of(event)], level=[level])

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
        """Add the charges that have changed."""
        for name, charge in frame.charges.items():
            path = f"{BATTERIES}/{name}"
            if self._gauges.get(path) != charge:
                self._gauges[path] = charge
                self._columns.add(path, rr.Scalars, scalars=[charge])

    def _figures(self, frame: Frame, is_due: bool) -> None:
        """Add the figures that have changed, and all of them once a minute."""
        if not is_due and frame.delivered == self._gauges.get("metrics/bins/delivered"):
            return
        gauges = {
            "metrics/bins/delivered": float(frame.delivered),
            **self._robots(),
            **self._rows_and_bins(frame),
        }
        is_minute = frame.tick % (60 * CHUNK_TICKS) == 0
        for path, value in gauges.items():
            if is_minute or self._gauges.get(path) != value:
                self._columns.add(path, rr.Scalars, scalars=[value])
        self._gauges.update(gauges)

    def _robots(self) -> dict[str, float]:
        """Return how many pickers wait, and how many carriers are busy: path -> value."""
        waiting = 0
        busy = 0
        for name, (_, state) in self._doing.items():
            kind = kind_of(name)
            if kind == "picker" and state in WAITING_STATES:
                waiting += 1
            elif kind == "carrier" and state not in ("waiting", "resting", "broken"):
                busy += 1
        return {
            "metrics/robots/pickers_waiting": float(waiting),
            "metrics/robots/carriers_busy": float(busy),
        }

    def _rows_and_bins(self, frame: Frame) -> dict[str, float]:
        """Return how many rows are picked, and bins full, if the frame says so: path -> value."""
        gauges = {}
        if frame.row_ends is not None:
            # From the western and from the eastern end. A row is done when these meet.
            metres_picked = frame.row_ends[:, :2].sum(axis=1)
            is_picked = metres_picked >= self._lengths - FULL_WITHIN
            gauges["metrics/bins/rows_picked"] = float(is_picked.sum())
        if frame.fill is not None:
            is_full = frame.fill >= self.layout.metres_per_bin
            gauges["metrics/bins/full"] = float(is_full.sum())
        return gauges


def hits(sweeps: np.ndarray, laser: Laser, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that a laser hit, (m, 3) float32, in the body's frame, and the number of
    points of each sweep, (n,).

    `sweeps`: (n, beams) ranges, m; of these, every `every`-th beam counts. x and y are rounded to
    1/32 m.
    """
    ranges = sweeps[:, ::every]
    seen = ranges < LASER_RANGE
    angles = laser.first + laser.increment * every * np.nonzero(seen)[1]
    x = laser.ahead + ranges[seen] * np.cos(angles)
    y = ranges[seen] * np.sin(angles)
    flat = np.round(np.stack([x, y], axis=1) * SCAN_GRID) / SCAN_GRID
    z = np.full((len(flat), 1), SCAN_Z)
    return np.concatenate([flat, z], axis=1).astype(np.float32), seen.sum(axis=1)


def _transforms(poses: np.ndarray, frames: list[str]) -> rr.ComponentColumnList:
    """Return poses, (m, 3), as transforms from the frames of bodies, m names, to the map.

    A pose is x, y (metres) and yaw (rad). `child_frame`: what ROS calls the frame of a body.
    """
    # The quaternion of a turn about z has the half angle.
    half = poses[:, 2] / 2
    zero = np.zeros(len(poses))
    return rr.Transform3D.columns(
        translation=np.stack([poses[:, 0], poses[:, 1], zero], axis=1).astype(np.float32),
        quaternion=np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1).astype(np.float32),
        child_frame=frames,
    )
