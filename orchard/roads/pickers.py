"""The roads of pickers, made from the drives of the scenario's route, as those of carriers; they go
on southward only.

At each end of a row there are four nodes: `*/out/*`, where a picker that comes through the row
stands with its bin; `*/wait/*`, beyond the roads; `*/aside/*`, where it holds up no carrier; and
`*/park/*`, where it stays. Where a picker starts in the west there is `west/in/*` too.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from orchard.contract.messages import BinState, StateRequest
from orchard.field.layout import Layout
from orchard.field.passes import Pass
from orchard.plans.robot import PlanExecutor, Step
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import route_of
from orchard.plans.steps import DriveTo, Face, Free, Need
from orchard.roads.graph import Edge, Graph, Node, graph_of


class Weigh(Step, frozen=True):
    """Ask the bin on the bar whether it is full."""

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None:
            return True
        answer = robot.ask(robot.seen.hitch.name, StateRequest())
        if isinstance(answer, BinState):
            duty = robot.duty  # type: ignore[attr-defined]  # of a driver by orders
            duty.is_laden, duty.fill = answer.full, answer.fill
        return isinstance(answer, BinState)


class FreeWithout(Step, frozen=True):
    """Give places back, unless a bin on the bar stands in them."""

    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None:
            robot.free(self.places)
        return True


def graphs_of(layout: Layout) -> list[Graph]:
    """Return the roads of each kind of vehicle in an orchard."""
    return [graph_of(layout, route_of(layout)), graph_of_pickers(layout, route_of(layout))]


def graph_of_pickers(layout: Layout, route: OneWay) -> Graph:
    """Return the roads of pickers, by the route of an orchard."""
    starts = [block.rows[0] for block in layout.blocks.values() if block.start == "west"]
    edges = [_through(route, route.west, row, f"west/in/{row}") for row in starts]
    edges += [
        edge
        for lane in layout.lanes
        for side in route.sides.values()
        for edge in _edges_at(layout, route, lane.number, side)
    ]
    nodes = {name: _node(layout, route, name) for edge in edges for name in (edge.start, edge.end)}
    stations = {
        f"row/{lane.number}": tuple(name for name in nodes if name.endswith(f"/{lane.number}"))
        for lane in layout.lanes
    }
    joined = {(edge.start, edge.end): _measured(edge, nodes) for edge in edges}
    return Graph("picker", nodes, joined, (), stations)


def _edges_at(layout: Layout, route: OneWay, row: int, side: Side) -> Iterator[Edge]:
    """The ways from the places at one end of a row."""
    out, wait, aside, park = (
        f"{side.name}/{place}/{row}" for place in ("out", "wait", "aside", "park")
    )
    place = [side.place("D", row)]
    yield Edge(out, wait, 0.0, (*route.drive_out(row, side), FreeWithout(place)))
    yield _through(route, side, row, wait)
    off = Need(place), Face(side.heading("EAST"))
    yield Edge(wait, park, 0.0, (*off, *route.park(row, side)))
    yield Edge(
        wait, aside, 0.0, (*off, DriveTo(x=side.x(route.PARKING_CLEAR)), Face("SOUTH"), Free(place))
    )
    yield Edge(aside, wait, 0.0, (Face(side.heading("WEST")), DriveTo(x=side.x(route.WAITING))))
    if row < len(layout.lanes):
        steps = route.go_to_next_row(row, row + 1, side)
        over = next(i for i, step in enumerate(steps) if isinstance(step, DriveTo)) + 1
        yield Edge(wait, f"{side.name}/wait/{row + 1}", 0.0, tuple(steps[:over]))


def _through(route: OneWay, side: Side, row: int, start: str) -> Edge:
    """The way through a row, from one side of it to the other."""
    other = route.west if side is route.east else route.east
    turn_in = route.go_to_next_row(row, row, side) if "/wait/" in start else []
    one = pass_at(row, other, route.end(row, side), route.end(row, other))
    return Edge(
        start,
        f"{other.name}/out/{row}",
        0.0,
        (*turn_in, *route.pick(one, came_over=bool(turn_in)), Weigh()),
    )


def pass_at(
    row: int, side: Side, begin: float, stop: float, fill: float = 0.0, is_full: bool = False
) -> Pass:
    """A pass that ends on a side, as the route knows passes.

    Where the bin is left, fleet control says.
    """
    return Pass(
        row, "east" if side.sign > 0 else "west", begin, stop, False, fill, is_full, False, True
    )


def _node(layout: Layout, route: OneWay, name: str) -> Node:
    side, what, row = name.split("/")
    lane, here, beyond = (
        layout.lane(int(row)),
        route.sides[side],
        {"wait": route.WAITING, "aside": route.PARKING_CLEAR, "park": route.PARKED},
    )
    return Node(
        name, here.x(beyond[what]) if what in beyond else route.end(lane.number, here), lane.y
    )


def _measured(edge: Edge, nodes: Mapping[str, Node]) -> Edge:
    start, end = nodes[edge.start], nodes[edge.end]
    return replace(edge, length=abs(end.x - start.x) + abs(end.y - start.y))
