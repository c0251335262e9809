"""Plans of an orchard as SVG, to scale: fences, trees, rows, roads, places, and all bodies at their
starts.
"""

import html
import math

from orchard.field.geometry import Pose, Rect, nearest_heading
from orchard.field.kinds import KINDS, kind_of, number_of
from orchard.field.lanes import Lane
from orchard.field.layout import DRIVEWAY, X_WEST, Layout
from orchard.plans.routes import route_of
from orchard.report.summary import clock
from orchard.sim.world import World

COLOURS = {
    "ground": "#dfe8cf",
    "driveway": "#cbb98f",
    "lane": "#c7b08a",
    "tree": "#7fae5d",
    "trunk": "#5b4128",
    "fence": "#6b6b6b",
    "picked": "#b08d57",
    "D": "#2f7fd1",
    "F": "#c0392b",
    "picker": "#b23bb2",
    "bay": "#e0a030",
    "charging": "#2e9e4f",
}
OTHER_ROAD = "#777777"
# Pixels for a metre.
PIXELS = 12
# Sizes that were chosen by the look of the drawing, m.
# Ground around the fences that is drawn, and the strip above the orchard that holds a title.
MARGIN = 1.0
TITLE_STRIP = 5.0
# Height of the title's letters, at most. A letter is about 0.6 as wide as high, so that a title of
# n letters, LETTERS_IN_WIDTH / n of the width high, fills nearly the whole width.
TITLE_HEIGHT = 2.4
LETTERS_IN_WIDTH = 1.6
# From the top fence up to the title.
ABOVE_FENCE = 1.7
ROBOT_LABEL_HEIGHT = 1.8
ROW_LABEL_HEIGHT = 0.9
# From a row's middle to where its label begins, to the west and to the south.
ROW_LABEL_WEST = 2.0
ROW_LABEL_SOUTH = 0.3
# Half of the drawn width of a row.
HALF_ROW = 1.0
# Half of the length and width of a tree's crown.
HALF_TREE = (2.75, 0.5)
# Half of the length of a line at which robots stop.
HALF_STOP_LINE = 0.75
# Where a robot's label begins, m east and north of a robot that stands along the rows, or across.
BESIDE_ALONG_ROWS = (-1.2, 1.3)
BESIDE_ACROSS_ROWS = (1.2, -0.6)


class Drawing:
    """Ground and roads as SVG elements, in metres, y north.

    `west`, `south`, `east`, `north`: the part that is seen.
    """

    def __init__(
        self, layout: Layout, west: float, south: float, east: float, north: float
    ) -> None:
        """Draw ground and roads. `west`, `south`, `east`, `north`: as above, m."""
        self.west = west
        self.north = north
        self.width = (east - west) * PIXELS
        self.height = (north - south) * PIXELS
        self.elements: list[str] = []
        _ground(self, layout)
        _roads(self, layout)

    def x(self, x: float) -> float:
        """Return x as the drawing has it, pixels from the left."""
        return round((x - self.west) * PIXELS, 2)

    def y(self, y: float) -> float:
        """Return y as the drawing has it, pixels from the top."""
        return round((self.north - y) * PIXELS, 2)

    def box(
        self,
        x: float,
        y: float,
        half_x: float,
        half_y: float,
        style: str,
        *,
        title: str = "",
        yaw: float = 0.0,
    ) -> None:
        """Draw a rectangle about its centre, m, turned by `yaw`, rad. `title`: shown on hover."""
        corner = f'x="{self.x(x - half_x)}" y="{self.y(y + half_y)}"'
        size = f'width="{round(2 * half_x * PIXELS, 2)}" height="{round(2 * half_y * PIXELS, 2)}"'
        turn = ""
        if yaw:
            clockwise = -math.degrees(yaw)
            turn = f' transform="rotate({clockwise:.1f} {self.x(x)} {self.y(y)})"'
        label = ""
        if title:
            label = f"<title>{html.escape(title)}</title>"
        self.elements.append(f'<rect {corner} {size}{turn} style="{style}">{label}</rect>')

    def area(self, rect: Rect, style: str) -> None:
        """Draw a rectangle on the ground."""
        half_x = (rect.east - rect.west) / 2
        half_y = (rect.north - rect.south) / 2
        self.box((rect.west + rect.east) / 2, (rect.south + rect.north) / 2, half_x, half_y, style)

    def line(self, points: list[tuple[float, float]], style: str) -> None:
        """Draw a line through points, m."""
        path = " ".join(f"{self.x(x)},{self.y(y)}" for x, y in points)
        self.elements.append(f'<polyline points="{path}" style="fill:none;{style}"/>')

    def label(self, x: float, y: float, words: str, metres: float) -> None:
        """Write words of this height, m, to the right of a point, with a white edge, to be read on
        any ground.
        """
        at = f'x="{self.x(x)}" y="{self.y(y)}" font-size="{round(metres * PIXELS, 2)}"'
        style = (
            "font-family:sans-serif;font-weight:600;paint-order:stroke;stroke:white;"
            f"stroke-width:{PIXELS / 3}"
        )
        self.elements.append(f'<text {at} style="{style}">{html.escape(words)}</text>')

    def svg(self) -> str:
        """Return the drawing as a file."""
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}">'
        return "\n".join([head, *self.elements, "</svg>", ""])


def orchard_plan(layout: Layout, title: str = "") -> str:
    """Return the drawing of the whole orchard, with all bodies at their starts, and a title."""
    above = MARGIN
    if title:
        above = TITLE_STRIP
    drawing = _whole_orchard(layout, above)
    if title:
        width = layout.east + MARGIN - X_WEST
        height = min(TITLE_HEIGHT, LETTERS_IN_WIDTH * width / len(title))
        drawing.label(X_WEST, layout.top + ABOVE_FENCE, title, height)
    for start in layout.starts:
        half_x, half_y = _half_sizes(start.kind)
        paint = _paint(start.kind)
        drawing.box(start.pose.x, start.pose.y, half_x, half_y, paint, title=start.name)
    return drawing.svg()


def present_plan(world: World) -> str:
    """Return the drawing of the whole orchard as it is now: what is picked of the rows, and each
    body where it is.
    """
    layout = world.layout
    drawing = _whole_orchard(layout, TITLE_STRIP)
    for number, lane in enumerate(layout.lanes):
        _picked(drawing, lane, world.row_ends[number].tolist(), float(world.row_picked[number]))
    for name, i in layout.index.items():
        if world.alive[i]:
            pose = Pose(*world.pose[i].tolist())
            share = float(world.fill[i]) / layout.metres_per_bin
            _present_body(drawing, name, pose, share)
    all_metres = layout.mean_length * len(layout.lanes)
    picked = f"{world.row_picked.sum():.0f} of {all_metres:.0f} m picked"
    words = f"{clock(world.seconds)}, {picked}, {world.delivered} bins delivered"
    drawing.label(X_WEST, layout.top + ABOVE_FENCE, words, TITLE_HEIGHT)
    return drawing.svg()


def _whole_orchard(layout: Layout, above: float) -> Drawing:
    """Return a drawing of ground and roads, with a strip of `above` m above the top fence."""
    return Drawing(
        layout,
        west=X_WEST - MARGIN,
        south=layout.bottom - MARGIN,
        east=layout.east + MARGIN,
        north=layout.top + above,
    )


def _picked(drawing: Drawing, lane: Lane, ends: list[float], total: float) -> None:
    """Draw what is picked of a row: from its west, from its east, and inside it.

    `ends`: the row's line of `World.row_ends`, m. `total`: m picked.
    """
    # The part inside, if there is one, is given by its ends too: m from the row's west end to its
    # east edge, and m from the row's east end to its west edge; else both are 0.
    from_west, from_east, inside_west, inside_east = ends
    inside_begin = lane.length - inside_east
    parts = (
        (0.0, from_west),
        (lane.length - from_east, lane.length),
        (inside_begin, max(inside_west, inside_begin)),
    )
    style = f"fill:{COLOURS['picked']};opacity:0.8"
    words = f"row {lane.number}: {total:.1f} m picked"
    for begin, end in parts:
        middle = lane.west + (begin + end) / 2
        drawing.box(middle, lane.y, (end - begin) / 2, HALF_ROW, style, title=words)


def _half_sizes(kind: str) -> tuple[float, float]:
    """Return half the length and half the width of a kind of body, m."""
    return KINDS[kind].length / 2, KINDS[kind].width / 2


def _paint(kind: str) -> str:
    """Return the style of a kind of body: its own colour, with a black edge."""
    return "fill:rgb({},{},{});stroke:black;stroke-width:1".format(*KINDS[kind].colour)


def _present_body(drawing: Drawing, name: str, pose: Pose, share: float) -> None:
    """Draw a body.

    `share`: how full a bin is; an empty one is pale. Pickers and carriers have labels: P1, C2.
    """
    kind = kind_of(name)
    half_x, half_y = _half_sizes(kind)
    paint = _paint(kind)
    if kind == "bin":
        # An empty bin can still be seen.
        paint = f"{paint};fill-opacity:{0.15 + 0.85 * share:.2f}"
    drawing.box(pose.x, pose.y, half_x, half_y, paint, title=name, yaw=pose.yaw)
    if kind in ("picker", "carrier"):
        # The label stands beside the robot, not on its bin.
        place = BESIDE_ACROSS_ROWS
        if nearest_heading(pose.yaw) in ("EAST", "WEST"):
            place = BESIDE_ALONG_ROWS
        label = f"{kind[0].upper()}{number_of(name)}"
        drawing.label(pose.x + place[0], pose.y + place[1], label, ROBOT_LABEL_HEIGHT)


def _ground(drawing: Drawing, layout: Layout) -> None:
    """Draw what lies within the fences: driveway, bay, rows, trees."""
    orchard = Rect(X_WEST, layout.bottom, layout.east, layout.top)
    fence = f"stroke:{COLOURS['fence']};stroke-width:{PIXELS}"
    drawing.area(orchard, f"fill:{COLOURS['ground']};{fence}")
    drawing.area(DRIVEWAY, f"fill:{COLOURS['driveway']}")
    drawing.area(layout.bay, f"fill:{COLOURS['bay']}")
    for x in layout.bay_edges:
        edge = f"stroke:{COLOURS['ground']};stroke-width:2"
        drawing.line([(x, layout.bay.south), (x, layout.bay.north)], edge)
    for lane in layout.lanes:
        middle = (lane.east + lane.west) / 2
        style = f"fill:{COLOURS['lane']};opacity:0.6"
        drawing.box(middle, lane.y, lane.length / 2, HALF_ROW, style)
        west = middle - ROW_LABEL_WEST
        drawing.label(west, lane.y - ROW_LABEL_SOUTH, f"row {lane.number}", ROW_LABEL_HEIGHT)
    for line in layout.lines:
        for x in line.trees_x:
            drawing.box(x, line.y, *HALF_TREE, f"fill:{COLOURS['tree']};opacity:0.7")
    # The first four walls are the fences, which are drawn above. The others are trunks and posts.
    for x, y, half_x, half_y in layout.walls[4:]:
        drawing.box(x, y, half_x, half_y, f"fill:{COLOURS['trunk']}")


def _roads(drawing: Drawing, layout: Layout) -> None:
    """Draw the roads, the lines of the queue, and the lines at which robots stop."""
    route = route_of(layout)
    for road in route.roads():
        stroke = f"stroke:{COLOURS.get(road.name, OTHER_ROAD)}"
        if road.width:
            width = road.width * PIXELS
            drawing.line(road.points, f"{stroke};stroke-width:{width};opacity:0.18")
            drawing.line(road.points, f"{stroke};stroke-width:2")
        else:
            drawing.line(road.points, f"{stroke};stroke-width:2;stroke-dasharray:4")
    area = layout.queue.area
    for y in layout.queue.lines:
        colour = COLOURS["D"]
        if y in layout.charging_lines:
            colour = COLOURS["charging"]
        style = f"stroke:{colour};stroke-width:1;stroke-dasharray:6"
        drawing.line([(area.west, y), (area.east, y)], style)
    for name, x, y in route.holds():
        style = f"stroke:{COLOURS.get(name, OTHER_ROAD)};stroke-width:3"
        drawing.line([(x - HALF_STOP_LINE, y), (x + HALF_STOP_LINE, y)], style)
