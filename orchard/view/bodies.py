"""Bodies and rows in the recording: frames, shapes, pins, names, bars, fruit, and how far each row
is picked.
"""

from collections.abc import Container, Mapping
from itertools import pairwise

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.field.kinds import ANIMALS, HAULERS, KINDS, PEOPLE, VEHICLES
from orchard.field.layout import Lane, Layout
from orchard.field.placement import Start
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.columns import TIMELINE, Columns
from orchard.view.scenery import ROW_Z, model

BRANCHES = dict.fromkeys(PEOPLE, "people") | dict.fromkeys(
    ANIMALS, "animals"
)  # kinds that share a branch of world/
HIT_RADIUS = -1.8  # of a laser hit; a negative number is in screen points
PIN_Z = 4.4  # m: well above the pergola

BIN_FLOOR, BIN_RIM = 0.2, 0.94  # z of the fruit in an empty and in a full bin, m
FILL_STEPS = 14
WHOLE, UNSEEN = (
    (1.0, 1.0, 1.0),
    (0.01, 0.01, 0.01),
)  # scales of a mesh that is shown, and of one that is hidden


class BodyView:
    """The entities of all bodies. Methods add only what has changed."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        self.rec, self.columns, self.layout = columns.rec, columns, layout
        self.path = {
            s.name: f"world/{BRANCHES.get(s.kind, s.kind + 's')}/{s.name}" for s in layout.starts
        }  # world/pickers/picker_01
        self._said: dict[str, dict[str, palette.Colour]] = {
            s.name: {} for s in layout.starts if s.kind != "weed"
        }
        self._bins, self._weeds, self._towing = (
            indices(layout, kinds) for kinds in ({"bin"}, {"weed"}, HAULERS)
        )
        self._shown: dict[
            str, np.ndarray
        ] = {}  # fruit levels of bins, whether bars or weeds are there
        for start in layout.starts:
            self._log_static(start)

    def remember(self, said: Mapping[str, Mapping[str, palette.Colour]]) -> None:
        """Keep the colours of the state texts in earlier parts.

        `said`: entity path -> text -> colour.
        """
        for name in self._said:
            self._said[name] = dict(said.get(f"/{self.path[name]}", {}))

    def _log_static(self, start: Start) -> None:
        path, frame = self.path[start.name], rr.CoordinateFrame(start.name)
        self.rec.log(path, frame, static=True)
        if start.kind != "weed":
            self.rec.log(path, model(start.kind), static=True)
        if start.kind in VEHICLES:
            self._pin(start)
        if start.kind == "bin":
            self.rec.log(f"{path}/fruit", frame, model("fruit"), static=True)
            self.rec.log(f"{path}/full", frame, model("flag"), static=True)
        colour = palette.SCANS.get(start.kind, palette.OTHER_SCANS)
        self.rec.log(
            f"scans/{start.name}",
            frame,
            rr.Points3D.from_fields(colors=[colour], radii=[HIT_RADIUS]),
            static=True,
        )

    def _pin(self, robot: Start) -> None:
        path, top = f"pins/{robot.name}", max(PIN_Z, KINDS[robot.kind].height + 2.0)
        ball = rr.Points3D([(0.0, 0.0, top)], labels=[robot.name])
        stalk = rr.LineStrips3D(
            [[(0.0, 0.0, KINDS[robot.kind].height), (0.0, 0.0, top)]],
            colors=[palette.WIRE],
            radii=[0.04],
        )
        self.rec.log(path, rr.CoordinateFrame(robot.name), ball, stalk, static=True)

    def doing(self, name: str, text: str, state: State) -> None:
        """Add what a body does now: its state, and the colour of its pin.

        Weeds and unknown names are ignored.
        """
        path, colour, known = self.path.get(name), palette.STATES[state], self._said.get(name)
        if path is None or known is None:
            return
        if known.get(text, colour) != colour:
            text = f"{text} ({state})"
        if text not in known:
            known[text] = colour
            self.rec.log(
                path,
                rr.StateConfiguration(values=list(known), colors=list(known.values())),
                static=True,
            )
        self.columns.add(path, rr.StateChange, state=[text])
        if self.layout.starts[self.layout.index[name]].kind in VEHICLES:
            self.columns.add(f"pins/{name}", rr.Points3D, colors=[colour])

    def fills(self, fill: np.ndarray) -> None:
        """Add the fruit level of the bins in which it changed.

        `fill`: (n,) metres of row, one per body.
        """
        levels = np.ceil(FILL_STEPS * fill[self._bins] / self.layout.metres_per_bin - 1e-9).astype(
            int
        )
        for i, level in self._changed("levels", levels):
            path = self.path[self.layout.names[self._bins[i]]]
            z = BIN_FLOOR + (BIN_RIM - BIN_FLOOR) * level / FILL_STEPS
            scale = (1.0, 1.0, z - 0.17) if level else UNSEEN
            self.columns.add(
                f"{path}/fruit", rr.InstancePoses3D, translations=[(0.0, 0.0, z)], scales=[scale]
            )
            self.columns.add(
                f"{path}/full",
                rr.InstancePoses3D,
                scales=[WHOLE if level >= FILL_STEPS else UNSEEN],
            )

    def bars(self, coupled: np.ndarray) -> None:
        """Add the bars between robots and bins that have changed.

        `coupled`: (n,) index of the other body, or -1.
        """
        for i, there in self._changed("bars", coupled[self._towing] >= 0):
            robot = self.layout.starts[self._towing[i]]
            path, kind = f"{self.path[robot.name]}/bar", KINDS[robot.kind]
            ends = [(-kind.length / 2 + 0.1, 0.0, 0.42), (-kind.tows + 0.45, 0.0, 0.42)]
            self.rec.log(path, rr.CoordinateFrame(robot.name), static=True)
            self.columns.add(
                path,
                rr.LineStrips3D,
                strips=[ends] if there else [],
                colors=[palette.BAR],
                radii=[0.09],
            )

    def weeds(self, alive: np.ndarray) -> None:
        """Log the weeds that have grown, and clear those that are flattened. `alive`: (n,) bool."""
        for i, grown in self._changed("weeds", alive[self._weeds]):
            self.rec.set_time(TIMELINE, duration=self.columns.tick * TIME_STEP)
            self.rec.log(
                self.path[self.layout.names[self._weeds[i]]],
                model("weed") if grown else rr.Clear(recursive=False),
            )

    def _changed(self, what: str, now: np.ndarray) -> list[tuple[int, int]]:
        before, self._shown[what] = self._shown.get(what), now
        which = np.arange(len(now)) if before is None else np.flatnonzero(now != before)
        return [*zip(which.tolist(), now[which].tolist(), strict=True)]


def indices(layout: Layout, kinds: Container[str]) -> list[int]:
    """Return the indices of the bodies of these kinds, in the order of `layout.starts`."""
    return [i for i, start in enumerate(layout.starts) if start.kind in kinds]


CHUNKS = 35  # pieces of a row, 2 m each with rows of the usual length, picked or not
FRUIT_IN_A_CHUNK = 8
FRUIT_Z = 1.95  # m, just below the pergola


class RowView:
    """A strip of ground and a cloud of fruit per row.

    `show` adds the rows of which another piece has been picked.
    """

    def __init__(self, columns: Columns, layout: Layout) -> None:
        self.columns, self._names = columns, [f"row_{lane.number:02d}" for lane in layout.lanes]
        self._lengths = np.array([[lane.length] for lane in layout.lanes])  # m
        self._done = np.full((len(layout.lanes), 4), -1)  # of each row, as in `show`, pieces of it
        self._fruit = [_fruit(lane) for lane in layout.lanes]
        for lane, row in zip(layout.lanes, self._names, strict=True):
            points, triangles = _strip(lane)
            strip = rr.Mesh3D.from_fields(vertex_positions=points, triangle_indices=triangles)
            columns.rec.log(f"world/rows/{row}", strip, static=True)
            columns.rec.log(
                f"canopy/fruit/{row}",
                rr.Points3D.from_fields(radii=[0.085], colors=[palette.KIWI]),
                static=True,
            )

    def show(self, row_ends: np.ndarray) -> None:
        """Add the rows that changed. `row_ends`: (r, 4) how far each is picked, as in `World`."""
        done = (CHUNKS * np.minimum(row_ends / self._lengths, 1.0) + 1e-9).astype(int)
        for row in np.flatnonzero((done != self._done).any(axis=1)).tolist():
            self._paint(row, *done[row].tolist())
        self._done = done

    def _paint(self, row: int, west: int, east: int, inside_west: int, inside_east: int) -> None:
        pieces = np.arange(CHUNKS)
        picked = (
            (pieces < west)
            | (pieces >= CHUNKS - east)
            | ((pieces < inside_west) & (pieces >= CHUNKS - inside_east))
        )
        colours = np.where(picked[:, None], palette.ROW_PICKED, palette.ROW_RIPE).astype(np.uint8)
        self.columns.add(
            f"world/rows/{self._names[row]}", rr.Mesh3D, vertex_colors=np.repeat(colours, 4, axis=0)
        )
        self.columns.add(
            f"canopy/fruit/{self._names[row]}",
            rr.Points3D,
            positions=self._fruit[row][~picked].reshape(-1, 3),
        )


def _strip(lane: Lane) -> tuple[np.ndarray, np.ndarray]:
    edges, half = np.linspace(lane.west, lane.east, CHUNKS + 1), lane.width / 2 - 0.6
    south, north = lane.y - half, lane.y + half
    corners = [
        [(w, south, ROW_Z), (e, south, ROW_Z), (e, north, ROW_Z), (w, north, ROW_Z)]
        for w, e in pairwise(edges)
    ]
    triangles = (4 * np.arange(CHUNKS)[:, None] + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return np.array(corners, np.float32).reshape(-1, 3), triangles.astype(np.uint32)


def _fruit(lane: Lane) -> np.ndarray:
    """Return where a lane's fruit hangs, (CHUNKS, FRUIT_IN_A_CHUNK, 3), m.

    It is the same every time.
    """
    draw = np.random.default_rng(lane.number)
    size, chunk = (CHUNKS, FRUIT_IN_A_CHUNK), lane.length / CHUNKS
    west = lane.west + chunk * np.arange(CHUNKS)[:, None]
    x = west + chunk * draw.random(size)
    across = lane.y + (lane.width - 0.8) * (draw.random(size) - 0.5)
    return np.stack([x, across, FRUIT_Z + 0.12 * draw.random(size)], axis=2).astype(np.float32)
