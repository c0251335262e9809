"""The fixed scenery: ground, driveway, fences, trees, posts, wires, the pergola, and the plan's
camera. It is logged once.

Shapes are models, which are GLB files for any 3-D program (as Blender), or batches of boxes and
discs in the sizes that the orchard gives. A body's model stands with the middle of its base at the
origin, x ahead, z up, and fills the length, width and height of its kind; a hat may rise above
them. The colours, sRGB, are those of its vertices.

What no robot touches, such as the sizes of crowns, shades and wires, was chosen by eye.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from orchard.field import layout as field
from orchard.field.geometry import Rect
from orchard.field.lanes import Lane, TreeLine
from orchard.field.layout import Layout
from orchard.field.walls import FENCE_HEIGHT, FENCE_THICKNESS
from orchard.view import palette
from orchard.view.palette import Colour

MODELS = Path(__file__).with_name("models")
# x, y or z of the middle of a form, m. If it is several numbers, a copy of the form stands at each.
Coordinate = float | Sequence[float] | np.ndarray


class Part(NamedTuple):
    """A form of one size and colour; or several copies of it in a grid.

    `size`: m along x, y, z. `at`: its middle, or the x, the y and the z at which there is a copy in
    each combination. `colour`: sRGB, and perhaps how opaque it is, each up to 255.
    """

    size: tuple[float, float, float]
    at: tuple[Coordinate, Coordinate, Coordinate]
    colour: Colour | tuple[int, int, int, int]


def model(name: str) -> rr.Asset3D:
    """Return the model of a kind of body, or of another thing in MODELS."""
    return rr.Asset3D(path=MODELS / f"{name}.glb")


def boxes(parts: Iterable[Part]) -> rr.Boxes3D:
    """Return all parts as boxes."""
    sizes, middles, colours = _batch(parts)
    return rr.Boxes3D(sizes=sizes, centers=middles, colors=colours, fill_mode="solid")


def discs(parts: Iterable[Part]) -> rr.Ellipsoids3D:
    """Return all parts as ellipsoids: discs, if they are flat."""
    sizes, middles, colours = _batch(parts)
    return rr.Ellipsoids3D(half_sizes=sizes / 2, centers=middles, colors=colours, fill_mode="solid")


def _batch(parts: Iterable[Part]) -> tuple[np.ndarray, np.ndarray, list[Sequence[int]]]:
    """Return sizes and middles of all copies of all parts, (k, 3) m each, and their colours."""
    sizes = []
    middles = []
    colours: list[Sequence[int]] = []
    for part in parts:
        for middle in product(*map(np.ravel, part.at)):
            sizes.append(part.size)
            middles.append(middle)
            colours.append(part.colour)
    return np.array(sizes), np.array(middles), colours


WORLD_FRAME = "tf#/"  # Rerun's name for the frame of the root entity
PLAN_CAMERA = "plan/camera"
RAILS_Z = (0.9, 1.6, 2.3)  # m, of a fence
MOWER = 3.5  # m, width of a mown stripe
MARGIN = 6.0  # m of meadow that the plan shows around the fences
BARE = 0.6  # m on either side of a line of trees on which nothing grows
# m of a row's width that the pergola leaves open: half of it beside each line of trees.
OPEN = 0.5
# m across a row for which the model of the pergola was made: between trees 5 m apart.
PATCH = 5.0 - OPEN
CAMERA_UP = 400.0  # m above the ground
FOCAL = 4000.0  # pixels: at this height 10 pixels per metre on the ground

# z of the layers on the ground, m. Two that overlap are at least 5 cm apart, or they flicker from
# afar.
MEADOW_Z = -0.35
GRASS_Z = -0.26
# Of roads, and of the bare strips below trees.
ROADS_Z = -0.18
# Of the driveway's edge, and of the gravel on it.
DRIVEWAY_Z = -0.10
GRAVEL_Z = -0.04
# Of the strips of rows, which `bodies.RowView` paints.
ROW_Z = -0.04
# Of the lines around bay and queue, which may lie on gravel.
PAINT_Z = 0.02
# Of the shades of trees, which lie on strips of rows, and reach no paint.
SHADE_Z = 0.02
PAINTED = 0.15  # m, width of a painted line
# m from a carrier in a place of the queue to the lines around it: they leave some room around it
# and its bin, whose end is 2.4 m behind the middle of the carrier.
LINE_BEHIND = 3.5
LINE_AHEAD = 1.4
LINE_BESIDE = 1.1


def log_scenery(rec: rr.RecordingStream, layout: Layout) -> None:
    """Log all that does not move, in 3-D and for the plan."""
    # Copies of a model: x and y, m, and how wide each is, as a share of the model.
    trees: list[tuple[float, float, float]] = []
    posts: list[tuple[float, float, float]] = []
    for line in layout.lines:
        trees += [(x, line.y, 1.0) for x in line.trees_x]
        posts += [(x, line.y, 1.0) for x in line.posts_x]
    patches: list[tuple[float, float, float]] = []
    for lane in layout.lanes:
        patches += [(x, lane.y, (lane.width - OPEN) / PATCH) for x in trees_over(lane)]
    rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log("world/ground", boxes(_ground(layout)), static=True)
    rec.log("world/fences", boxes(_fences(layout)), static=True)
    _instances(rec, "world/trees", "trunk", trees)
    _instances(rec, "world/posts", "line_post", posts)
    _instances(rec, "canopy/crowns", "crown", trees)
    _instances(rec, "canopy/pergola", "pergola", patches)
    rec.log("canopy/shade", discs(_shades(layout)), static=True)
    wires = rr.LineStrips3D(_wires(layout), colors=[palette.WIRE], radii=[0.02])
    rec.log("canopy/wires", wires, static=True)
    _plan_canopy(rec, layout)
    _camera(rec, layout)


def _shades(layout: Layout) -> list[Part]:
    """Return the shades of the trees, each a little beside its tree."""
    colour = (*palette.SHADE, 110)
    # A little larger than a crown, and where it falls if the sun stands in the south-east.
    return [
        Part((5.6, 1.7, 0.01), (np.subtract(line.trees_x, 0.3), line.y + 0.3, SHADE_Z), colour)
        for line in layout.lines
    ]


def _instances(
    rec: rr.RecordingStream, path: str, name: str, at: Sequence[tuple[float, float, float]]
) -> None:
    """Log copies of a model. They look less alike, because three of them stand as the model does,
    and the next three the other way round.

    `at`: x and y of each, m, and how wide it is, as a share of the model.
    """
    x, y, width = np.array(at, dtype=np.float32).T
    zero = np.zeros_like(x)
    # 0 or 1: a quaternion of (0, 0, 1, 0) is half a turn about z, (0, 0, 0, 1) none.
    turned = np.arange(len(x)) // 3 % 2
    places = rr.InstancePoses3D(
        translations=np.stack([x, y, zero], axis=1),
        quaternions=np.stack([zero, zero, turned, 1 - turned], axis=1),
        scales=np.stack([zero + 1.0, width, zero + 1.0], axis=1),
    )
    rec.log(path, model(name), places, static=True)


def _slab(area: Rect, z: float, colour: palette.Colour) -> Part:
    """Return a flat piece of ground. `z`: m."""
    west, south, east, north = area
    middle = ((west + east) / 2, (south + north) / 2, z)
    return Part((east - west, north - south, 0.02), middle, colour)


def _ground(layout: Layout) -> list[Part]:
    """Return all that lies on the ground, from the horizon to the queue."""
    return [
        *_fields(),
        *_lawn(layout),
        *(_below_trees(line) for line in layout.lines),
        *_roads(layout),
        *_driveway(),
        *_bay(layout),
        *queue_lines(layout),
    ]


def _below_trees(line: TreeLine) -> Part:
    """Return the bare strip below a line of trees."""
    south = line.y - BARE
    north = line.y + BARE
    return _slab(Rect(line.west - 1.0, south, line.east + 2.0, north), ROADS_Z, palette.BARE)


def _roads(layout: Layout) -> list[Part]:
    """Return the roads around the rows: in the east, west, south and north."""
    # Rows of the usual length lie between x = -35.5 and x = 34.5; longer ones reach further east,
    # by `layout.shift`. A road begins 1 m beyond them in the west, 2 m in the east, and 3.5 m
    # beyond the outer lines of trees in the south and north.
    inner_west = -36.5
    inner_east = 36.5 + layout.shift
    outer_east = 42.5 + layout.shift
    first = layout.tree_lines[0]
    last = layout.tree_lines[-1]
    south = last - 8
    return [
        _slab(Rect(inner_east, south, outer_east, 26), ROADS_Z, palette.SOIL),
        _slab(Rect(-45.5, south, inner_west, 23), ROADS_Z, palette.SOIL),
        _slab(Rect(inner_west, south, inner_east, last - 3.5), ROADS_Z, palette.SOIL),
        _slab(Rect(inner_west, first + 3.5, inner_east, 26), ROADS_Z, palette.SOIL),
    ]


def _driveway() -> list[Part]:
    """Return the driveway: its edge, and the gravel on it."""
    west, south, east, north = field.DRIVEWAY
    edge = 0.4
    edges = _slab(field.DRIVEWAY, DRIVEWAY_Z, palette.ROAD_EDGE)
    gravel = _slab(
        Rect(west + edge, south + edge, east - edge, north - edge),
        GRAVEL_Z,
        palette.GRAVEL,
    )
    return [edges, gravel]


def _fields() -> list[Part]:
    """Return the meadows around the orchard, a chequer of colours that is always the same."""
    draw = np.random.default_rng(1)
    # x of the fields' edges, and y too, m: fields far away are larger.
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
    fields = []
    for (west, east), (south, north) in product(pairwise(edges), repeat=2):
        has_orchard = west < 0 < east and south < 0 < north
        if has_orchard:
            colour = palette.MEADOW
        else:
            colour = palette.FIELDS[draw.integers(len(palette.FIELDS))]
        fields.append(_slab(Rect(west, south, east, north), MEADOW_Z, colour))
    return fields


def _lawn(layout: Layout) -> list[Part]:
    """Return the grass between the fences, mown in stripes of two colours."""
    stripe_count = round((layout.top - layout.bottom) / MOWER)
    edges = np.linspace(layout.bottom, layout.top, stripe_count + 1)
    colours = (palette.GRASS, palette.MOWN)
    return [
        _slab(Rect(field.X_WEST, south, layout.east, north), GRASS_Z, colours[number % 2])
        for number, (south, north) in enumerate(pairwise(edges))
    ]


def _bay(layout: Layout) -> list[Part]:
    """Return the lines that are painted around the bay, and between its places."""
    west, south, east, north = layout.bay
    between = []
    for x in layout.bay_edges:
        between.append(_slab(Rect(x, south, x + PAINTED, north), PAINT_Z, palette.PAINT))
    return [
        _slab(Rect(west, south, east, south + PAINTED), PAINT_Z, palette.PAINT),
        _slab(Rect(west, north - PAINTED, east, north), PAINT_Z, palette.PAINT),
        _slab(Rect(west, south, west + PAINTED, north), PAINT_Z, palette.PAINT),
        _slab(Rect(east - PAINTED, south, east, north), PAINT_Z, palette.PAINT),
        *between,
    ]


def queue_lines(layout: Layout) -> list[Part]:
    """Return the lines of the queue: white those in which carriers wait, green those in which they
    charge.
    """
    # y of a line -> x of its western end.
    west_ends: dict[float, float] = {}
    for number in range(layout.queue_places):
        x, y, _ = layout.queue.place(number)
        west_ends[y] = min(x - LINE_BEHIND, west_ends.get(y, math.inf))
    east = layout.queue.head + LINE_AHEAD
    lines = []
    for y, west in west_ends.items():
        colour = palette.PAINT
        if y in layout.charging_lines:
            colour = palette.CHARGING
        for side in (-LINE_BESIDE, LINE_BESIDE):
            south = y + side - PAINTED / 2
            north = y + side + PAINTED / 2
            lines.append(_slab(Rect(west, south, east, north), PAINT_Z, colour))
    return lines


def _fences(layout: Layout) -> list[Part]:
    """Return posts, rails and kerbs of the fences."""
    x = (field.X_WEST, layout.east)
    y = (layout.bottom, layout.top)
    width = x[1] - x[0]
    length = y[1] - y[0]
    middle_x = sum(x) / 2
    middle_y = sum(y) / 2
    along_x = np.linspace(*x, round(width / 5.0) + 1)
    along_y = np.linspace(*y, round(length / 5.0) + 1)
    post = (0.25, 0.25, FENCE_HEIGHT)
    return [
        Part(post, (along_x, y, FENCE_HEIGHT / 2), palette.FENCE),
        Part(post, (x, along_y[1:-1], FENCE_HEIGHT / 2), palette.FENCE),
        Part((width, 0.1, 0.16), (middle_x, y, RAILS_Z), palette.FENCE),
        Part((0.1, length, 0.16), (x, middle_y, RAILS_Z), palette.FENCE),
        Part((width + 1.0, FENCE_THICKNESS, 0.25), (middle_x, y, 0.0), palette.KERB),
        Part((FENCE_THICKNESS, length + 1.0, 0.25), (x, middle_y, 0.0), palette.KERB),
    ]


def _wires(layout: Layout) -> list[np.ndarray]:
    """Return the wires along each line of trees, and across the lines from post to post."""
    # Wires across lie on those along the lines, which are 3 cm lower.
    wires = []
    # x -> y of the posts there.
    posts: dict[float, list[float]] = {}
    for line in layout.lines:
        first = (line.trees_x[0], line.y, 2.75)
        last = (line.trees_x[-1], line.y, 2.75)
        wires.append(np.array([first, last]))
        for x in line.posts_x:
            posts.setdefault(x, []).append(line.y)
    for x, ys in sorted(posts.items()):
        wires.append(np.array([(x, max(ys), 2.78), (x, min(ys), 2.78)]))
    return wires


def _plan_canopy(rec: rr.RecordingStream, layout: Layout) -> None:
    """Log pergola and crowns as the plan shows them: one can see through them."""
    patches = (
        Part((1.7, lane.width - OPEN, 0.02), (trees_over(lane), lane.y, 3.2), (*palette.VINE, 70))
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
    """Log the camera far above the orchard that makes the plan."""
    height, width = plan_size(layout)
    scale = FOCAL / CAMERA_UP
    middle = (layout.shift / 2, (layout.top + layout.bottom) / 2, CAMERA_UP)
    # Half a turn about x: the camera looks down, and north is above.
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
    # The camera finds named frames only if its own are named.
    rec.log(PLAN_CAMERA, image, rr.CoordinateFrame("plan_image"), static=True)


def plan_size(layout: Layout) -> tuple[float, float]:
    """Return the height and width of the area on the plan, m."""
    return layout.top - layout.bottom + 2 * MARGIN, layout.east - field.X_WEST + 2 * MARGIN
