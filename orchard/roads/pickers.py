"""The roads of pickers as nodes and edges, made from the drives of the scenario's route.

graph.py makes those of carriers in the same way, and has the classes. From row to row the roads
lead southward only, as pickers do.

A node's name is the side, what it is for, and the row: `east/out/3`. At each end of a row there are
four nodes: `*/out/*`, where a picker that comes through the row stands with its bin; `*/wait/*`,
beyond the carriers' roads; `*/aside/*`, further out, where it holds up no carrier; and `*/park/*`,
where it stays. Where a picker starts in the west there is `west/in/*` too.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from orchard.contract.messages import BinState, StateRequest
from orchard.field.layout import Layout
from orchard.field.passes import UNKNOWN, Pass
from orchard.field.rows import End
from orchard.plans.robot import PlanExecutor, Step
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import route_of
from orchard.plans.steps import DriveTo, Face, Free, Need
from orchard.roads.graph import Edge, Graph, Node, graph_of


class Weigh(Step, frozen=True):
    """Ask the bin on the bar for its fill, and note it for fleet control."""

    def act(self, robot: PlanExecutor) -> bool:
        """Ask the bin, if there is one. Return whether it has answered."""
        if robot.seen.hitch is None:
            return True
        answer = robot.ask(robot.seen.hitch.name, StateRequest())
        if isinstance(answer, BinState):
            # Only robots that obey orders have this step: class `Driver` of bridges/vda5050. Its
            # `duty` is what they report.
            duty = robot.duty  # type: ignore[attr-defined]
            duty.is_laden = answer.full
            duty.fill = answer.fill
        return isinstance(answer, BinState)


class FreeWithout(Step, frozen=True):
    """Give places back, unless the robot has a bin: the bin on its bar would still stand there."""

    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        """Give the places back, or keep them for the bin, and be done."""
        if robot.seen.hitch is None:
            robot.free(self.places)
        return True


def graphs_of(layout: Layout) -> list[Graph]:
    """Return the roads of each kind of vehicle in an orchard."""
    route = route_of(layout)
    return [graph_of(layout, route), graph_of_pickers(layout, route)]


def graph_of_pickers(layout: Layout, route: OneWay) -> Graph:
    """Return the roads of pickers, by the route of an orchard."""
    edges = list[Edge]()
    for block in layout.blocks.values():
        if block.start == "west":
            first_row = block.rows[0]
            edges.append(_through(route, route.west, first_row, f"west/in/{first_row}"))
    for lane in layout.lanes:
        for side in route.sides.values():
            edges += _edges_at(layout, route, lane.number, side)
    nodes = dict[str, Node]()
    for edge in edges:
        for name in (edge.start, edge.end):
            nodes[name] = _node(layout, route, name)
    stations = {f"row/{lane.number}": _nodes_at_row(lane.number, nodes) for lane in layout.lanes}
    return Graph(
        kind="picker",
        nodes=nodes,
        edges={(edge.start, edge.end): _measured(edge, nodes) for edge in edges},
        lines=(),
        stations=stations,
    )


def _nodes_at_row(row: int, names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the nodes at both ends of a row."""
    return tuple(name for name in names if name.endswith(f"/{row}"))


def _edges_at(layout: Layout, route: OneWay, row: int, side: Side) -> Iterator[Edge]:
    """Yield the edges between the nodes at one end of a row, and from there to other rows' ends.

    `_measured` gives them their length.
    """
    out = f"{side.name}/out/{row}"
    wait = f"{side.name}/wait/{row}"
    aside = f"{side.name}/aside/{row}"
    park = f"{side.name}/park/{row}"
    places = [side.place("D", row)]
    yield _edge(out, wait, *route.drive_out(row, side), FreeWithout(places))
    yield _through(route, side, row, wait)
    # Away from the rows. The turn swings the bin over the delivery road, so it needs the place.
    face_outward = (Need(places), Face(side.heading("EAST")))
    yield _edge(wait, park, *face_outward, *route.park(row, side))
    off_the_roads = (DriveTo(x=side.x(route.PARKING_CLEAR)), Face("SOUTH"), Free(places))
    yield _edge(wait, aside, *face_outward, *off_the_roads)
    yield _edge(aside, wait, Face(side.heading("WEST")), DriveTo(x=side.x(route.WAITING)))
    if row < len(layout.lanes):
        yield _edge(wait, f"{side.name}/wait/{row + 1}", *_over_to_next_row(route, row, side))


def _edge(start: str, end: str, *steps: Step) -> Edge:
    """Return an edge whose length is not known yet."""
    return Edge(start, end, length=0.0, steps=steps)


def _over_to_next_row(route: OneWay, row: int, side: Side) -> list[Step]:
    """Return the first steps to the next row, up to the first drive, which ends beside that row.

    Raises ValueError for a route without such a drive.
    """
    steps = list[Step]()
    for step in route.go_to_next_row(row, row + 1, side):
        steps.append(step)
        if isinstance(step, DriveTo):
            return steps
    raise ValueError(f"row {row}: the route has no drive from it to the next one")


def _through(route: OneWay, side: Side, row: int, start: str) -> Edge:
    """Return the edge through a row, from one side of it to the other.

    `start`: the node at which it begins. From a node `wait` the picker first drives over the roads.
    """
    opposite = route.opposite(side)
    turn_in: list[Step] = []
    if "/wait/" in start:
        # The way to the next row, where that is the same row.
        turn_in = route.go_to_next_row(row, row, side)
    whole_row = pass_at(row, opposite, route.end(row, side), route.end(row, opposite))
    pick = route.pick(whole_row, came_over=bool(turn_in))
    return _edge(start, f"{opposite.name}/out/{row}", *turn_in, *pick, Weigh())


def pass_at(
    row: int, side: Side, begin: float, stop: float, *, fill: float = 0.0, is_full: bool = False
) -> Pass:
    """Return a pass that ends on a side, as a route takes passes (orchard/field/passes.py).

    `begin`, `stop`: where picking begins and ends, x in the frame `map`, m. `fill`: of the bin at
    its end, m of picked row. The pass leaves no bin: fleet control says where the bin is left.
    """
    end: End = "west"
    if side.sign > 0:
        end = "east"
    return Pass(
        row=row,
        end=end,
        bin_number=UNKNOWN,
        begin=begin,
        stop=stop,
        is_inside=False,
        fill=fill,
        is_full=is_full,
        leaves_bin=False,
        ends_row=True,
    )


def _node(layout: Layout, route: OneWay, name: str) -> Node:
    """Return a node for its name, such as east/wait/3."""
    side_name, kind, row = name.split("/")
    lane = layout.lane(int(row))
    side = route.sides[side_name]
    match kind:
        case "wait":
            x = side.x(route.WAITING)
        case "aside":
            x = side.x(route.PARKING_CLEAR)
        case "park":
            x = side.x(route.PARKED)
        case _:
            x = route.end(lane.number, side)
    return Node(name, x, lane.y)


def _measured(edge: Edge, nodes: Mapping[str, Node]) -> Edge:
    """Return an edge with its length: pickers drive along x or y only."""
    start = nodes[edge.start]
    end = nodes[edge.end]
    return replace(edge, length=abs(end.x - start.x) + abs(end.y - start.y))
