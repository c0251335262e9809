"""Draws the exchange of bins at the end of a row: the places, and the areas that turns sweep."""

from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import route_of
from orchard.report.plan import COLOURS, PIXELS, Drawing

# Radii of the circles that turns sweep, m: of a carrier, of a carrier with its bin, and of a picker
# with its bin. docs/reference.md has them in the table of "Towing", and `sense.sweep_radius`
# computes them.
CARRIER_SWEEPS = 1.17
CARRIER_AND_BIN_SWEEP = 2.45
PICKER_AND_BIN_SWEEP = 2.80


def exchange_plan(layout: Layout) -> str:
    """Return the drawing of the east ends of the first three lanes: the places, and the areas that
    turns sweep.

    The west side is the same, turned by half a turn, or mirrored.
    """
    route = route_of(layout)
    # What is drawn, m: from within the rows to beyond the parked picker, and a little more than the
    # first three lanes.
    drawing = Drawing(
        layout, route.east.x(30.0), layout.lane(3).y - 4, route.east.x(46.0), layout.lane(1).y + 5
    )
    for lane in layout.lanes[:3]:
        _exchange(drawing, route, lane.y, route.east)
    return drawing.svg()


def _exchange(drawing: Drawing, route: OneWay, y: float, side: Side) -> None:
    """Draw the outlines of all places of an exchange, and the circles that turns sweep.

    `y`: of the lane, m.
    """
    picker = KINDS["picker"]
    carrier = KINDS["carrier"]
    fruit = KINDS["bin"]
    outline = "fill:none;stroke-width:1.5;stroke:"
    for x in (route.WAITING, route.PARKED):
        drawing.box(side.x(x), y, picker.length / 2, picker.width / 2, outline + COLOURS["picker"])
    for x in (route.FULL_BIN, route.D_ROAD):
        drawing.box(side.x(x), y, fruit.length / 2, fruit.width / 2, outline + "firebrick")
    stop = side.y(y, route.STOP)
    drawing.box(
        side.x(route.D_ROAD), stop, carrier.width / 2, carrier.length / 2, outline + COLOURS["D"]
    )
    drawing.box(
        side.x(route.COUPLING), y, carrier.length / 2, carrier.width / 2, outline + COLOURS["F"]
    )
    # The places at which the carrier turns, in its order; the last one with the full bin.
    sweeps = {
        (route.D_ROAD, stop): CARRIER_SWEEPS,
        (route.COUPLING, stop): CARRIER_SWEEPS,
        (route.COUPLING, y): CARRIER_SWEEPS,
        (route.F_ROAD, y): CARRIER_AND_BIN_SWEEP,
    }
    of_picker = {(route.WAITING, y): PICKER_AND_BIN_SWEEP}
    for (x, at), radius in (sweeps | of_picker).items():
        circle = (
            f'<circle cx="{drawing.x(side.x(x))}" cy="{drawing.y(at)}"'
            f' r="{round(radius * PIXELS, 2)}"'
        )
        drawing.elements.append(
            f'{circle} style="fill:none;stroke:#888;stroke-width:0.7;stroke-dasharray:3"/>'
        )
    # The way of the carrier.
    drawing.line([(side.x(x), at) for x, at in sweeps], "stroke:black;stroke-width:1")
