"""Plans of an orchard as SVG, to scale: fences, trees, rows, roads, places, and all bodies at their
starts.
"""

import html
import math

from orchard.field.geometry import Pose, nearest_heading
from orchard.field.kinds import KINDS, kind_of, number_of
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
PIXELS = 12  # for a metre


class Drawing:
    """Ground and roads as SVG elements, in metres, y north.

    `west`, `south`, `east`, `north`: the part that is seen.
    """

    def __init__(
        self, layout: Layout, west: float, south: float, east: float, north: float
    ) -> None:
        self.west, self.north = west, north
        self.width, self.height = (east - west) * PIXELS, (north - south) * PIXELS
        self.elements: list[str] = []
        _ground(self, layout)
        _roads(self, layout)

    def x(self, x: float) -> float:
        return round((x - self.west) * PIXELS, 2)

    def y(self, y: float) -> float:
        return round((self.north - y) * PIXELS, 2)

    def box(
        self,
        x: float,
        y: float,
        half_x: float,
        half_y: float,
        style: str,
        title: str = "",
        yaw: float = 0.0,
    ) -> None:
        """Draw a rectangle about its centre, m, turned by `yaw`, rad."""
        label = f"<title>{html.escape(title)}</title>" if title else ""
        size = f'width="{round(2 * half_x * PIXELS, 2)}" height="{round(2 * half_y * PIXELS, 2)}"'
        turn = (
            f' transform="rotate({-math.degrees(yaw):.1f} {self.x(x)} {self.y(y)})"' if yaw else ""
        )
        self.elements.append(
            f'<rect x="{self.x(x - half_x)}" y="{self.y(y + half_y)}" {size}{turn}'
            f' style="{style}">{label}</rect>'
        )

    def line(self, points: list[tuple[float, float]], style: str) -> None:
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
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}">'
        return "\n".join([head, *self.elements, "</svg>", ""])


def orchard_plan(layout: Layout) -> str:
    """Return the drawing of the whole orchard, with all bodies at their starts."""
    drawing = Drawing(layout, X_WEST - 1, layout.bottom - 1, layout.east + 1, layout.top + 1)
    for start in layout.starts:
        drawing.box(
            start.pose.x, start.pose.y, *_half_sizes(start.kind), _paint(start.kind), start.name
        )
    return drawing.svg()


def present_plan(world: World) -> str:
    """Return the drawing of the whole orchard as it is now: what is picked of the rows, and each
    body where it is.
    """
    layout = world.layout
    drawing = Drawing(layout, X_WEST - 1, layout.bottom - 1, layout.east + 1, layout.top + 5)
    for lane, (west, east, *inside), total in zip(
        layout.lanes, world.row_ends.tolist(), world.row_picked.tolist(), strict=True
    ):
        words = f"row {lane.number}: {total:.1f} m picked"
        parts = (
            (0.0, west),
            (lane.length - east, lane.length),
            (lane.length - inside[1], max(inside[0], lane.length - inside[1])),
        )
        for begin, end in parts:
            drawing.box(
                lane.west + (begin + end) / 2,
                lane.y,
                (end - begin) / 2,
                1.0,
                f"fill:{COLOURS['picked']};opacity:0.8",
                words,
            )
    for name, i in layout.index.items():
        if world.alive[i]:
            _present_body(
                drawing,
                name,
                Pose(*world.pose[i].tolist()),
                float(world.fill[i]) / layout.metres_per_bin,
            )
    picked = (
        f"{world.row_picked.sum():.0f} of {layout.mean_length * len(layout.lanes):.0f} m picked"
    )
    told = f"{clock(world.seconds)}, {picked}, {world.delivered} bins delivered"
    drawing.label(X_WEST, layout.top + 1.7, told, 2.4)
    return drawing.svg()


def _half_sizes(kind: str) -> tuple[float, float]:
    return KINDS[kind].length / 2, KINDS[kind].width / 2


def _paint(kind: str) -> str:
    return "fill:rgb({},{},{});stroke:black;stroke-width:1".format(*KINDS[kind].colour)


def _present_body(drawing: Drawing, name: str, pose: Pose, share: float) -> None:
    """Draw a body.

    `share`: how full a bin is; an empty one is pale. Pickers and carriers have labels: P1, C2.
    """
    kind = kind_of(name)
    pale = f";fill-opacity:{0.15 + 0.85 * share:.2f}" if kind == "bin" else ""
    drawing.box(pose.x, pose.y, *_half_sizes(kind), _paint(kind) + pale, name, pose.yaw)
    if kind in ("picker", "carrier"):
        x, y = (
            (-1.2, 1.3) if nearest_heading(pose.yaw) in ("EAST", "WEST") else (1.2, -0.6)
        )  # beside it, not on its bin
        drawing.label(pose.x + x, pose.y + y, f"{kind[0].upper()}{number_of(name)}", 1.8)


def _ground(drawing: Drawing, layout: Layout) -> None:
    middle, half = (layout.top + layout.bottom) / 2, (layout.top - layout.bottom) / 2
    width = layout.east - X_WEST
    drawing.box(
        X_WEST + width / 2,
        middle,
        width / 2,
        half,
        f"fill:{COLOURS['ground']};stroke:{COLOURS['fence']};stroke-width:{PIXELS}",
    )
    for rect, colour in ((DRIVEWAY, COLOURS["driveway"]), (layout.bay, COLOURS["bay"])):
        x, y = (rect.west + rect.east) / 2, (rect.south + rect.north) / 2
        drawing.box(
            x, y, (rect.east - rect.west) / 2, (rect.north - rect.south) / 2, f"fill:{colour}"
        )
    for lane in layout.lanes:
        across = (lane.east + lane.west) / 2
        drawing.box(across, lane.y, lane.length / 2, 1.0, f"fill:{COLOURS['lane']};opacity:0.6")
        drawing.label(across - 2.0, lane.y - 0.3, f"row {lane.number}", 0.9)
    for line in layout.lines:
        for x in line.trees_x:
            drawing.box(x, line.y, 2.75, 0.5, f"fill:{COLOURS['tree']};opacity:0.7")
    for x, y, half_x, half_y in layout.walls[4:]:
        drawing.box(x, y, half_x, half_y, f"fill:{COLOURS['trunk']}")


def _roads(drawing: Drawing, layout: Layout) -> None:
    route = route_of(layout)
    for road in route.roads():
        colour = COLOURS.get(road.name, OTHER_ROAD)
        if road.width:
            drawing.line(
                road.points, f"stroke:{colour};stroke-width:{road.width * PIXELS};opacity:0.18"
            )
        drawing.line(
            road.points,
            f"stroke:{colour};stroke-width:2{'' if road.width else ';stroke-dasharray:4'}",
        )
    for y in layout.queue.lines:
        colour = COLOURS["charging" if y in layout.charging_lines else "D"]
        drawing.line(
            [(layout.queue.area.west, y), (layout.queue.area.east, y)],
            f"stroke:{colour};stroke-width:1;stroke-dasharray:6",
        )
    for name, x, y in route.holds():
        drawing.line(
            [(x - 0.75, y), (x + 0.75, y)], f"stroke:{COLOURS.get(name, OTHER_ROAD)};stroke-width:3"
        )
