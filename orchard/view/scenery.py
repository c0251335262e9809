"""The fixed scenery: ground, driveway, fences, trees, posts, wires, the pergola, and the plan's
camera. It is logged once.

Shapes are models, which are GLB files for any 3-D program (as Blender), or batches of boxes and
discs whose sizes the orchard gives. A body's model stands with the middle of its base at the
origin, x ahead, z up, and fills the length, width and height of its kind; a hat may rise above
them. The colours, sRGB, are those of its vertices.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from orchard.field import layout as field
from orchard.field.layout import Lane, Layout, TreeLine
from orchard.view import palette
from orchard.view.palette import Colour

MODELS = Path(__file__).with_name("models")
Coordinate = float | Sequence[float] | np.ndarray  # of a middle, m; several numbers: a copy at each


class Part(NamedTuple):
    """A form of one size and colour; or several copies of it in a grid."""

    size: tuple[float, float, float]  # m along x, y, z
    at: tuple[Coordinate, Coordinate, Coordinate]
    colour: Colour | tuple[int, int, int, int]  # sRGB, and perhaps how opaque it is, up to 255


def model(name: str) -> rr.Asset3D:
    """Return the model of a kind of body, or of another thing in MODELS."""
    return rr.Asset3D(path=MODELS / f"{name}.glb")


def boxes(parts: Iterable[Part]) -> rr.Boxes3D:
    sizes, middles, colours = _batch(parts)
    return rr.Boxes3D(sizes=sizes, centers=middles, colors=colours, fill_mode="solid")


def discs(parts: Iterable[Part]) -> rr.Ellipsoids3D:
    """Return all parts as ellipsoids: discs, if they are flat."""
    sizes, middles, colours = _batch(parts)
    return rr.Ellipsoids3D(half_sizes=sizes / 2, centers=middles, colors=colours, fill_mode="solid")


def _batch(parts: Iterable[Part]) -> tuple[np.ndarray, np.ndarray, list[Sequence[int]]]:
    copies = [(part, middle) for part in parts for middle in product(*map(np.ravel, part.at))]
    sizes, middles = (
        np.array(values)
        for values in zip(*((part.size, middle) for part, middle in copies), strict=True)
    )
    return sizes, middles, [part.colour for part, _ in copies]


WORLD_FRAME = "tf#/"  # Rerun's name for the frame of the root entity
PLAN_CAMERA = "plan/camera"
RAILS_Z = (0.9, 1.6, 2.3)  # m, of a fence
MOWER = 3.5  # m, width of a mown stripe
MARGIN = 6.0  # m of meadow that the plan shows around the fences
CAMERA_UP = 400.0  # m above the ground
PATCH = 4.5  # m, width of a patch of the pergola: of a row between trees 5 m apart
FOCAL = 4000.0  # pixels: 10 pixels per metre on the ground

# z of the layers on the ground, m: at least 5 cm apart, or they flicker from afar
MEADOW_Z, GRASS_Z, ROADS_Z, DRIVEWAY_Z, ROW_Z, SHADE_Z = -0.35, -0.26, -0.18, -0.10, -0.04, 0.02


def log_scenery(rec: rr.RecordingStream, layout: Layout) -> None:
    trees = [(x, line.y, 1.0) for line in layout.lines for x in line.trees_x]
    posts = [(x, line.y, 1.0) for line in layout.lines for x in line.posts_x]
    patches = [
        (x, lane.y, (lane.width - 0.5) / PATCH) for lane in layout.lanes for x in trees_over(lane)
    ]
    rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log("world/ground", boxes(_ground(layout)), static=True)
    rec.log("world/fences", boxes(_fences(layout)), static=True)
    _instances(rec, "world/trees", "trunk", trees)
    _instances(rec, "world/posts", "line_post", posts)
    _instances(rec, "canopy/crowns", "crown", trees)
    _instances(rec, "canopy/pergola", "pergola", patches)
    beside = [(np.subtract(line.trees_x, 0.3), line.y + 0.3, SHADE_Z) for line in layout.lines]
    rec.log(
        "canopy/shade",
        discs(Part((5.6, 1.7, 0.01), at, (*palette.SHADE, 110)) for at in beside),
        static=True,
    )
    rec.log(
        "canopy/wires",
        rr.LineStrips3D(_wires(layout), colors=[palette.WIRE], radii=[0.02]),
        static=True,
    )
    _plan_canopy(rec, layout)
    _camera(rec, layout)


def _instances(
    rec: rr.RecordingStream, path: str, name: str, at: Sequence[tuple[float, float, float]]
) -> None:
    """Log a model at many places, half of them turned to look less alike.

    `at`: x and y, m, and the share of the model's own width.
    """
    x, y, width = np.array(at, dtype=np.float32).T
    none, turned = np.zeros_like(x), (np.arange(len(x)) * 7 // 3) % 2
    quaternions = np.stack([none, none, turned, 1 - turned], axis=1)
    scales = np.stack([none + 1.0, width, none + 1.0], axis=1)
    places = rr.InstancePoses3D(
        translations=np.stack([x, y, none], axis=1), quaternions=quaternions, scales=scales
    )
    rec.log(path, model(name), places, static=True)


def _slab(
    west: float, south: float, east: float, north: float, z: float, colour: palette.Colour
) -> Part:
    return Part(
        (east - west, north - south, 0.02), ((west + east) / 2, (south + north) / 2, z), colour
    )


def _ground(layout: Layout) -> list[Part]:
    first, last, drive = layout.tree_lines[0], layout.tree_lines[-1], field.DRIVEWAY
    return [
        *_fields(),
        *_lawn(layout),
        *(
            _slab(
                line.west - 1.0, line.y - 0.6, line.east + 2.0, line.y + 0.6, ROADS_Z, palette.BARE
            )
            for line in layout.lines
        ),
        _slab(36.5 + layout.shift, last - 8, 42.5 + layout.shift, 26, ROADS_Z, palette.SOIL),
        _slab(-45.5, last - 8, -36.5, 23, ROADS_Z, palette.SOIL),
        _slab(-36.5, last - 8, 36.5 + layout.shift, last - 3.5, ROADS_Z, palette.SOIL),
        _slab(-36.5, first + 3.5, 36.5 + layout.shift, 26, ROADS_Z, palette.SOIL),
        _slab(*drive, DRIVEWAY_Z, palette.ROAD_EDGE),
        _slab(
            drive.west + 0.4,
            drive.south + 0.4,
            drive.east - 0.4,
            drive.north - 0.4,
            DRIVEWAY_Z + 0.06,
            palette.GRAVEL,
        ),
        *_bay(layout),
        *queue_lines(layout),
    ]


def _fields() -> list[Part]:
    draw, hues = np.random.default_rng(1), palette.FIELDS
    edges = [
        -2000.0,
        -1300.0,
        -850.0,
        -560.0,
        -360.0,
        -220.0,
        180.0,
        310.0,
        520.0,
        800.0,
        1250.0,
        2000.0,
    ]
    squares = [
        (west, south, east, north)
        for west, east in pairwise(edges)
        for south, north in pairwise(edges)
    ]
    colours = (
        palette.MEADOW if w < 0 < e and s < 0 < n else hues[draw.integers(len(hues))]
        for w, s, e, n in squares
    )
    return [
        _slab(*square, MEADOW_Z, colour) for square, colour in zip(squares, colours, strict=True)
    ]


def _lawn(layout: Layout) -> list[Part]:
    edges = np.linspace(layout.bottom, layout.top, round((layout.top - layout.bottom) / MOWER) + 1)
    colours = (palette.GRASS, palette.MOWN)
    return [
        _slab(field.X_WEST, s, layout.east, n, GRASS_Z, colours[i % 2])
        for i, (s, n) in enumerate(pairwise(edges))
    ]


def _bay(layout: Layout) -> list[Part]:
    west, south, east, north = layout.bay
    z = DRIVEWAY_Z + 0.12
    sides = [_slab(west, y, east, y + 0.15, z, palette.PAINT) for y in (south, north - 0.15)]
    return sides + [_slab(x, south, x + 0.15, north, z, palette.PAINT) for x in (west, east - 0.15)]


def queue_lines(layout: Layout) -> list[Part]:
    """The lines of the queue: white those in which carriers wait, green those in which they
    charge.
    """
    places = [layout.queue.place(number) for number in range(layout.queue_places)]
    lines = {y: min(place.x for place in places if place.y == y) - 3.5 for _, y, _ in places}
    paint = {y: palette.CHARGING if y in layout.charging_lines else palette.PAINT for y in lines}
    beside = [(west, y + side, paint[y]) for y, west in lines.items() for side in (-1.1, 1.1)]
    return [
        _slab(west, y - 0.075, layout.queue.head + 1.4, y + 0.075, ROW_Z, colour)
        for west, y, colour in beside
    ]


def _fences(layout: Layout) -> list[Part]:
    x, y = (field.X_WEST, layout.east), (layout.bottom, layout.top)
    width, length = x[1] - x[0], y[1] - y[0]
    middle_x, middle_y = sum(x) / 2, sum(y) / 2
    along_x, along_y = (
        np.linspace(*x, round(width / 5.0) + 1),
        np.linspace(*y, round(length / 5.0) + 1),
    )
    post = (0.25, 0.25, field.FENCE_HEIGHT)
    return [
        Part(post, (along_x, y, field.FENCE_HEIGHT / 2), palette.FENCE),
        Part(post, (x, along_y[1:-1], field.FENCE_HEIGHT / 2), palette.FENCE),
        Part((width, 0.1, 0.16), (middle_x, y, RAILS_Z), palette.FENCE),
        Part((0.1, length, 0.16), (x, middle_y, RAILS_Z), palette.FENCE),
        Part((width + 1.0, field.FENCE_THICKNESS, 0.25), (middle_x, y, 0.0), palette.KERB),
        Part((field.FENCE_THICKNESS, length + 1.0, 0.25), (x, middle_y, 0.0), palette.KERB),
    ]


def _wires(layout: Layout) -> list[np.ndarray]:
    along = [
        np.array([(line.trees_x[0], line.y, 2.75), (line.trees_x[-1], line.y, 2.75)])
        for line in layout.lines
    ]
    at: dict[float, list[float]] = {}
    for line in layout.lines:
        for x in line.posts_x:
            at.setdefault(x, []).append(line.y)
    return along + [
        np.array([(x, max(ys), 2.78), (x, min(ys), 2.78)]) for x, ys in sorted(at.items())
    ]


def _plan_canopy(rec: rr.RecordingStream, layout: Layout) -> None:
    patches = (
        Part((1.7, lane.width - 0.5, 0.02), (trees_over(lane), lane.y, 3.2), (*palette.VINE, 70))
        for lane in layout.lanes
    )
    crowns = (
        Part((5.5, 1.4, 0.02), (line.trees_x, line.y, 3.4), (*palette.LEAVES, 130))
        for line in layout.lines
    )
    rec.log("plan/pergola", boxes(patches), static=True)
    rec.log("plan/crowns", discs(crowns), static=True)


def trees_over(lane: Lane) -> tuple[float, ...]:
    """Return the x of the trees beside a lane, m."""
    return TreeLine(lane.y, lane.west, lane.east).trees_x


def _camera(rec: rr.RecordingStream, layout: Layout) -> None:
    height, width = plan_size(layout)
    scale = FOCAL / CAMERA_UP
    middle = (layout.shift / 2, (layout.top + layout.bottom) / 2, CAMERA_UP)
    about = rr.Quaternion(xyzw=(1.0, 0.0, 0.0, 0.0))
    down = rr.Transform3D(
        translation=middle, quaternion=about, child_frame="plan_eye", parent_frame=WORLD_FRAME
    )
    image = rr.Pinhole(
        focal_length=FOCAL,
        width=width * scale,
        height=height * scale,
        child_frame="plan_image",
        parent_frame="plan_eye",
    )
    rec.log("plan/eye", down, static=True)
    rec.log(
        PLAN_CAMERA, image, rr.CoordinateFrame("plan_image"), static=True
    )  # it finds named frames only if its own are named


def plan_size(layout: Layout) -> tuple[float, float]:
    """Return the height and width of the area on the plan, m."""
    return layout.top - layout.bottom + 2 * MARGIN, layout.east - field.X_WEST + 2 * MARGIN
