"""Bodies and rows in the recording: frames, shapes, pins, names, bars, fruit, and how far each row
is picked.
"""

from collections.abc import Container, Mapping
from itertools import pairwise

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.field.kinds import ANIMALS, HAULERS, KINDS, PEOPLE, VEHICLES
from orchard.field.lanes import Lane
from orchard.field.layout import Layout
from orchard.field.placement import Start
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.columns import TIMELINE, Columns
from orchard.view.scenery import BARE, ROW_Z, model

# Kinds that share a branch of world/.
BRANCHES = dict.fromkeys(PEOPLE, "people") | dict.fromkeys(ANIMALS, "animals")
# Radius of a laser hit. A negative number is in screen points.
HIT_RADIUS = -1.8
# m: well above the pergola.
PIN_Z = 4.4

# z up to which fruit fills an empty bin and a full one, m, without the heap on it.
BIN_FLOOR = 0.2
BIN_RIM = 0.94
# Levels of fruit that are shown between these two.
FILL_STEPS = 14
# A level, or a piece of a row, counts as reached if so small a part of it is missing: sums of
# metres are rounded.
ROUNDING = 1e-9
# z of the bar between a robot and its bin, m.
BAR_Z = 0.42
FRUIT_BOTTOM = 0.17  # m: z of the lower side of the fruit
# Scales of a mesh that is shown, and of one that is hidden.
WHOLE = (1.0, 1.0, 1.0)
UNSEEN = (0.01, 0.01, 0.01)


class BodyView:
    """The entities of all bodies. Methods add only what has changed."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        """Log what each body looks like. `columns`: for what changes."""
        self.rec = columns.rec
        self.columns = columns
        self.layout = layout
        self.path = {}
        # Name -> the texts of its states that have occurred, and their colours.
        self._colours: dict[str, dict[str, palette.Colour]] = {}
        for start in layout.starts:
            self.path[start.name] = _path_of(start)
            if start.kind != "weed":
                self._colours[start.name] = {}
        self._bins = indices(layout, {"bin"})
        self._weeds = indices(layout, {"weed"})
        self._towing = indices(layout, HAULERS)
        # The fruit levels of bins, and whether bars and weeds are there, as last shown.
        self._shown: dict[str, np.ndarray] = {}
        for start in layout.starts:
            self._log_static(start)

    def remember(self, colours: Mapping[str, Mapping[str, palette.Colour]]) -> None:
        """Keep the colours of the state texts in earlier parts.

        `colours`: entity path -> text -> colour.
        """
        for name in self._colours:
            self._colours[name] = dict(colours.get(f"/{self.path[name]}", {}))

    def _log_static(self, start: Start) -> None:
        """Log what does not change of a body: its frame, its shape, the look of its laser hits."""
        path = self.path[start.name]
        frame = rr.CoordinateFrame(start.name)
        self.rec.log(path, frame, static=True)
        if start.kind != "weed":
            self.rec.log(path, model(start.kind), static=True)
        if start.kind in VEHICLES:
            self._pin(start)
        if start.kind == "bin":
            self.rec.log(f"{path}/fruit", frame, model("fruit"), static=True)
            self.rec.log(f"{path}/full", frame, model("flag"), static=True)
        colour = palette.SCANS.get(start.kind, palette.OTHER_SCANS)
        look = rr.Points3D.from_fields(colors=[colour], radii=[HIT_RADIUS])
        self.rec.log(f"scans/{start.name}", frame, look, static=True)

    def _pin(self, robot: Start) -> None:
        """Log a ball on a stalk above a robot."""
        # The ball of a high robot, such as the tractor, is 2 m above its roof.
        roof = (0.0, 0.0, KINDS[robot.kind].height)
        top = (0.0, 0.0, max(PIN_Z, KINDS[robot.kind].height + 2.0))
        ball = rr.Points3D([top], labels=[robot.name])
        stalk = rr.LineStrips3D([[roof, top]], colors=[palette.WIRE], radii=[0.04])
        frame = rr.CoordinateFrame(robot.name)
        self.rec.log(f"pins/{robot.name}", frame, ball, stalk, static=True)

    def doing(self, name: str, text: str, state: State) -> None:
        """Add what a body does now: its state, and the colour of its pin.

        Weeds and unknown names are ignored.
        """
        colours = self._colours.get(name)
        if colours is None:
            return
        path = self.path[name]
        colour = palette.STATES[state]
        # Rerun has one colour for a text. A text that was seen in another state gets an addition.
        if colours.get(text, colour) != colour:
            text = f"{text} ({state})"
        if text not in colours:
            colours[text] = colour
            look = rr.StateConfiguration(values=list(colours), colors=list(colours.values()))
            self.rec.log(path, look, static=True)
        self.columns.add(path, rr.StateChange, state=[text])
        if self.layout.starts[self.layout.index[name]].kind in VEHICLES:
            self.columns.add(f"pins/{name}", rr.Points3D, colors=[colour])

    def fills(self, fill: np.ndarray) -> None:
        """Add the fruit level of the bins in which it changed.

        `fill`: (n,) the metres of row that were picked into each body, 0 of all but bins.
        """
        steps_filled = FILL_STEPS * fill[self._bins] / self.layout.metres_per_bin
        # Rounding alone fills no further step.
        levels = np.ceil(steps_filled - ROUNDING).astype(int)
        for i, level in self._changed("levels", levels):
            path = self.path[self.layout.names[self._bins[i]]]
            # The model of the fruit reaches from its origin 1 m down; a heap is on it.
            z = BIN_FLOOR + (BIN_RIM - BIN_FLOOR) * level / FILL_STEPS
            fruit_scale = UNSEEN
            if level:
                fruit_scale = (1.0, 1.0, z - FRUIT_BOTTOM)
            self.columns.add(
                f"{path}/fruit",
                rr.InstancePoses3D,
                translations=[(0.0, 0.0, z)],
                scales=[fruit_scale],
            )
            flag_scale = UNSEEN
            if level >= FILL_STEPS:
                flag_scale = WHOLE
            self.columns.add(f"{path}/full", rr.InstancePoses3D, scales=[flag_scale])

    def bars(self, coupled: np.ndarray) -> None:
        """Add the bars between robots and bins that have changed.

        `coupled`: (n,) for each body the index of the body to which it is coupled; -1: to none.
        """
        for i, is_coupled in self._changed("bars", coupled[self._towing] >= 0):
            robot = self.layout.starts[self._towing[i]]
            path = f"{self.path[robot.name]}/bar"
            kind = KINDS[robot.kind]
            # From the robot's rear to the bin, `tows` behind it, which reaches 0.5 m to both sides
            # of its middle. The bar ends 10 cm inside the robot, and 5 cm inside the bin, so no gap
            # is seen.
            front = (-kind.length / 2 + 0.1, 0.0, BAR_Z)
            rear = (-kind.tows + 0.45, 0.0, BAR_Z)
            strips = []
            if is_coupled:
                strips.append([front, rear])
            self.rec.log(path, rr.CoordinateFrame(robot.name), static=True)
            self.columns.add(
                path,
                rr.LineStrips3D,
                strips=strips,
                colors=[palette.BAR],
                radii=[0.09],
            )

    def weeds(self, alive: np.ndarray) -> None:
        """Log the weeds that have grown, and clear those that are flattened. `alive`: (n,) bool."""
        for i, is_alive in self._changed("weeds", alive[self._weeds]):
            self.rec.set_time(TIMELINE, duration=self.columns.tick * TIME_STEP)
            path = self.path[self.layout.names[self._weeds[i]]]
            if is_alive:
                self.rec.log(path, model("weed"))
            else:
                self.rec.log(path, rr.Clear(recursive=False))

    def _changed(self, subject: str, values: np.ndarray) -> list[tuple[int, int]]:
        """Return the index and value of each value that is not as last shown; at first, of all.

        `subject`: what the values, (k,), are of.
        """
        before = self._shown.get(subject)
        self._shown[subject] = values
        if before is None:
            changed = np.arange(len(values))
        else:
            changed = np.flatnonzero(values != before)
        return list(zip(changed.tolist(), values[changed].tolist(), strict=True))


def _path_of(start: Start) -> str:
    """Return the path of a body's entity, such as world/pickers/picker_01."""
    branch = BRANCHES.get(start.kind, f"{start.kind}s")
    return f"world/{branch}/{start.name}"


def indices(layout: Layout, kinds: Container[str]) -> list[int]:
    """Return the indices of the bodies of these kinds, in the order of `layout.starts`."""
    return [i for i, start in enumerate(layout.starts) if start.kind in kinds]


# Pieces of a row, each picked or not. With rows of the usual length, 70 m, a piece has 2 m.
PIECES = 35
FRUIT_PER_PIECE = 8
FRUIT_Z = 1.95  # m, just below the pergola


class RowView:
    """A strip of ground and a cloud of fruit per row.

    `show` adds the rows of which another piece has been picked.
    """

    def __init__(self, columns: Columns, layout: Layout) -> None:
        """Log the look of the rows. `columns`: for what changes."""
        self.columns = columns
        self._names = [f"row_{lane.number:02d}" for lane in layout.lanes]
        self._lengths = np.array([[lane.length] for lane in layout.lanes])  # (r, 1) m
        # How many pieces of each row are picked, (r, 4), as in `show`; -1: not shown yet.
        self._pieces = np.full((len(layout.lanes), 4), -1)
        self._fruit = [_fruit(lane) for lane in layout.lanes]
        for lane, row in zip(layout.lanes, self._names, strict=True):
            points, triangles = _strip(lane)
            strip = rr.Mesh3D.from_fields(vertex_positions=points, triangle_indices=triangles)
            columns.rec.log(f"world/rows/{row}", strip, static=True)
            look = rr.Points3D.from_fields(radii=[0.085], colors=[palette.KIWI])
            columns.rec.log(f"canopy/fruit/{row}", look, static=True)

    def show(self, row_ends: np.ndarray) -> None:
        """Add the rows that changed.

        `row_ends`: (r, 4) m, as in `World`: of each row how much is picked from the western and
        from the eastern end; and, of a part inside it that is picked too, how far this part reaches
        measured from the western and from the eastern end, 0 if there is none.
        """
        # Rounding alone leaves no piece unpicked.
        pieces = (PIECES * np.minimum(row_ends / self._lengths, 1.0) + ROUNDING).astype(int)
        has_changed = (pieces != self._pieces).any(axis=1)
        for row in np.flatnonzero(has_changed).tolist():
            self._paint(row, *pieces[row].tolist())
        self._pieces = pieces

    def _paint(self, row: int, west: int, east: int, inside_west: int, inside_east: int) -> None:
        """Add which pieces of a row are picked: so many from each end, and a part inside it.

        That part reaches from `inside_east` pieces before the eastern end to `inside_west` pieces
        after the western one.
        """
        pieces = np.arange(PIECES)
        from_west = pieces < west
        from_east = pieces >= PIECES - east
        inside = (pieces < inside_west) & (pieces >= PIECES - inside_east)
        picked = from_west | from_east | inside
        # A colour for each piece, and then for each of its four corners.
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
    """Return the mesh of a row's ground: four corners of each piece, m, and its triangles.

    Shapes (4 * PIECES, 3) float32 and (2 * PIECES, 3) uint32, indices of corners.
    """
    edges = np.linspace(lane.west, lane.east, PIECES + 1)
    half = lane.width / 2 - BARE
    south = lane.y - half
    north = lane.y + half
    corners = []
    for west, east in pairwise(edges):
        corners += [(west, south), (east, south), (east, north), (west, north)]
    on_ground = np.column_stack([np.array(corners), np.full(len(corners), ROW_Z)])
    # Two triangles of each piece, which share the corners 0 and 2.
    triangles = (4 * np.arange(PIECES)[:, None] + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return on_ground.astype(np.float32), triangles.astype(np.uint32)


def _fruit(lane: Lane) -> np.ndarray:
    """Return where a lane's fruit hangs, (PIECES, FRUIT_PER_PIECE, 3), m.

    It is the same every time, because the number of the lane is the seed.
    """
    draw = np.random.default_rng(lane.number)
    shape = (PIECES, FRUIT_PER_PIECE)
    piece_length = lane.length / PIECES
    west = lane.west + piece_length * np.arange(PIECES)[:, None]
    x = west + piece_length * draw.random(shape)
    # No fruit within 40 cm of a line of trees.
    y = lane.y + (lane.width - 0.8) * (draw.random(shape) - 0.5)
    z = FRUIT_Z + 0.12 * draw.random(shape)
    return np.stack([x, y, z], axis=2).astype(np.float32)
