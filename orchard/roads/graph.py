"""The roads of carriers as nodes and edges, made from the drives of the scenario's route.

Theory of operation. The plans of carriers are cut into legs: a leg ends where a drive ends, and
where a carrier may have to wait for the next place on the roads (docs/traffic.md). Legs that end at
the same point meet there, in a node. An edge holds the steps of the leg that leads to its end. With
them a carrier takes turns with all others, because traffic grants it the places that it needs, and
it stops for obstacles.

Names of nodes: `bay`, `bay/2`: places of the bay. `queue/1`: the head of the first line of the
queue, `queue/1/2` the second place of that line. `east/stop/3`, `east/bin/3`: where a carrier hands
an empty bin over at lane 3, and where it couples the full bin. A node where a carrier waits for a
place has the name of that place, as `east/D/4`. All others are named by their x and y.
"""

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import dropwhile, pairwise
from math import hypot, inf

from msgspec import structs

from orchard.field.geometry import Pose
from orchard.field.kinds import KINDS
from orchard.field.lanes import Lane
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.queue import CLOSED_UP
from orchard.plans.robot import Gate, Step
from orchard.plans.route import OneWay, Side
from orchard.plans.steps import DriveTo, DriveToBay, Face, Free, Need

# The name of the bay's station, and of its first node.
BAY = "bay"
# The beginning of the names of the queue's nodes.
QUEUE = "queue/"
# A vehicle that is nearer to a node than this stands on it, m.
NEAR = 0.5
# The same in the queue, m: there vehicles stand closer at the start of a harvest than later, and so
# beside their nodes.
NEAR_IN_QUEUE = 2.0
RADIUS = KINDS["carrier"].radius  # m
# m from one node in a line of the queue to the next. It is 5 cm more than the greatest distance
# from one waiting carrier to the next, so that a vehicle behind another one reaches its node.
PITCH = round(CLOSED_UP + 0.05, 2)


@dataclass(frozen=True)
class Node:
    """A node: its name, and its place in the frame `map`, m."""

    name: str
    x: float
    y: float


@dataclass(frozen=True)
class Edge:
    """A way from one node to another, m long, and the steps that drive it."""

    start: str
    end: str
    length: float
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class Graph:
    """What a kind of vehicle drives on."""

    kind: str
    #: Name -> node.
    nodes: Mapping[str, Node]
    #: Names of the nodes at both ends -> edge.
    edges: Mapping[tuple[str, str], Edge]
    #: The nodes at the heads of the queue's lines.
    lines: tuple[str, ...]
    #: Station -> the nodes at which a vehicle works there. For a carrier a lane's end has two: that
    #: at which it hands the empty bin over, and that at which it couples the full bin.
    stations: Mapping[str, tuple[str, ...]]

    @property
    def bins(self) -> list[str]:
        """The nodes at which full bins are coupled."""
        return [nodes[1] for nodes in self.stations.values() if len(nodes) > 1]

    def station_of(self, stop: str) -> str:
        """Return the station at whose first node a vehicle hands a bin over; "" if there is none.

        `stop`: the name of that node.
        """
        for name, nodes in self.stations.items():
            if len(nodes) > 1 and nodes[0] == stop:
                return name
        return ""

    def at(self, x: float, y: float) -> str:
        """Return the node on which a vehicle at (x, y), m, stands; "" if there is none."""

        def distance(node: Node) -> float:
            return hypot(node.x - x, node.y - y)

        nearest = min(self.nodes.values(), key=distance)
        tolerance = NEAR
        if nearest.name.startswith(QUEUE):
            tolerance = NEAR_IN_QUEUE
        if distance(nearest) <= tolerance:
            return nearest.name
        return ""

    def way(self, start: str, ends: Iterable[str]) -> list[str]:
        """Return the nodes of the shortest way to the nearest of some nodes, without the first.

        Raises ValueError if there is no way.
        """
        wanted = set(ends)
        # Dijkstra's algorithm. Node -> the shortest way to it so far, m, and the node before it on
        # that way; "" before the start.
        shortest = {start: (0.0, "")}
        # The nodes from which the search goes on, with the length of the way there: a heap.
        reached = [(0.0, start)]
        while reached:
            length, name = heapq.heappop(reached)
            if name in wanted:
                from_start = _way_back(shortest, name)[::-1]
                return from_start[1:]
            for edge in self._edges_from(name):
                further = length + edge.length
                known_length, _ = shortest.get(edge.end, (inf, ""))
                if further < known_length:
                    shortest[edge.end] = further, name
                    heapq.heappush(reached, (further, edge.end))
        raise ValueError(f"no way from {start} to {', '.join(sorted(wanted))}")

    def _edges_from(self, name: str) -> list[Edge]:
        """Return the edges that begin at a node."""
        return [edge for (start, _), edge in self.edges.items() if start == name]


def _way_back(shortest: Mapping[str, tuple[float, str]], name: str) -> list[str]:
    """Return the nodes from a node back to the start.

    `shortest`: node -> the length of the way to it, m, and the node before it; "" at the start.
    """
    nodes = []
    while name:
        nodes.append(name)
        _, name = shortest[name]
    return nodes


@dataclass(frozen=True)
class Leg:
    """A drive between two points, before they have names.

    Only x and y of the poses matter.
    """

    start: Pose
    end: Pose
    steps: tuple[Step, ...]
    #: The place on the roads for which a carrier may have to wait at its end; "" for none.
    waits_for: str = ""


def graph_of(layout: Layout, route: OneWay) -> Graph:
    """Return the roads of carriers in an orchard, by its route."""
    roads = _Roads(layout, route)
    # The number of the place at the head of each line.
    for head in range(0, layout.queue_places, layout.queue.places):
        roads.add_line(head)
    for side in route.sides.values():
        for lane in layout.lanes:
            roads.add_station(side, lane)
    return _joined(roads.legs, roads.names, roads.stations)


class _Roads:
    """Collects the legs of all roads, the names of some points, and the stations."""

    def __init__(self, layout: Layout, route: OneWay) -> None:
        self._layout = layout
        self._route = route
        self._carrier = layout.machines["carrier"]
        self._bay = Pose(layout.bay_stop, layout.queue.lines[0], 0.0)
        self.legs: list[Leg] = []
        # Point, as of `_point` -> the name of its node.
        self.names: dict[tuple[float, float], str] = {}
        # x of a carrier at each place of the bay, from the east, m.
        self._bay_stops: list[float] = []
        bay_nodes = [BAY]
        for number in range(1, layout.scenario.bays):
            bay_nodes.append(f"{BAY}/{number + 1}")
        for number, name in enumerate(bay_nodes):
            place = self._bay._replace(x=self._bay.x - CLOSED_UP * number)
            self._bay_stops.append(place.x)
            self.names[_point(place)] = name
        # As of `Graph.stations`.
        self.stations: dict[str, tuple[str, ...]] = {BAY: tuple(bay_nodes)}

    def add_line(self, head: int) -> None:
        """Add a line of the queue: the way home into it, along it, and from it to all lanes.

        `head`: the number of the queue's place at the head of the line, from 0 on.
        """
        queue = self._layout.queue
        count = min(queue.places, self._layout.queue_places - head)
        first = queue.place(head)
        line = f"{QUEUE}{head // queue.places + 1}"
        slots = []
        for slot in range(count):
            pose = first._replace(x=first.x - PITCH * slot)
            slots.append(pose)
            self.names[_point(pose)] = f"{line}/{slot + 1}"
        self.names[_point(first)] = line
        self.stations[line] = (line,)
        from_last = slots[::-1]
        into_slots = [DriveTo(x=slot.x, queueing=True) for slot in from_last]
        self.legs += _legs(
            [*self._route.go_to_line(head + 1), *into_slots], self._bay, self._carrier
        )
        for slot_pose, ahead in pairwise(from_last):
            self.legs += _legs([DriveTo(x=ahead.x, queueing=True)], slot_pose, self._carrier)
        for side in self._route.sides.values():
            for lane in self._layout.lanes:
                self.legs += _legs(
                    self._route.approach(lane.number, side, head + 1), first, self._carrier
                )

    def add_station(self, side: Side, lane: Lane) -> None:
        """Add what a carrier drives at a lane: to the full bin, home with it, and home without."""
        route = self._route
        stop = Pose(side.x(route.D_ROAD), side.y(lane.y, route.STOP), 0.0)
        loop = _legs(route.loop_to_full_bin(lane.number, side), stop, self._carrier)
        bin_pose = loop[-1].end
        name = f"{side.name}/{lane.number}"
        stop_name = f"{side.name}/stop/{lane.number}"
        bin_name = f"{side.name}/bin/{lane.number}"
        self.stations[name] = stop_name, bin_name
        self.names[_point(stop)] = stop_name
        self.names[_point(bin_pose)] = bin_name
        self.legs += loop
        to_bay = self._by_places_of_bay(route.go_to_bay(lane.number, side))
        self.legs += _legs(to_bay, bin_pose, self._carrier)
        home = self._by_places_of_bay(_over_to_the_other_road(route, side, lane.number, stop))
        self.legs += _legs(home, stop, self._carrier)

    def _by_places_of_bay(self, steps: Iterable[Step]) -> Iterator[Step]:
        """Yield steps with the drive to a bay of several places cut at each place.

        So fleet control may order a vehicle to any of them.
        """
        for step in steps:
            if isinstance(step, DriveToBay):
                # The drive leads east, to the westernmost place first.
                for x in reversed(self._bay_stops):
                    yield DriveTo(x=x)
            else:
                yield step


def _over_to_the_other_road(route: OneWay, side: Side, lane: int, stop: Pose) -> list[Step]:
    """Return the way home for a carrier that has nothing to do at a lane.

    It leads from its stop over to the full-bin road, and along it. The carrier comes onto that road
    in the middle. So it first takes the places that its turn there touches, one after the other,
    never two at once, as a carrier does that drives along the road.
    """
    turn, along, onward = _longest_way_to_bay(route, side)
    ahead = 1.0
    if turn.heading == "SOUTH":
        ahead = -1.0
    # Place on the full-bin road -> where it begins, and where it ends, m past the stop in the
    # direction of that road; negative before the stop.
    begins: dict[str, float] = {}
    for gate in along.needs:
        begins |= dict.fromkeys(gate.places, ahead * (gate.at - stop.y))
    ends: dict[str, float] = {}
    for gate in along.frees:
        ends |= dict.fromkeys(gate.places, ahead * (gate.at - stop.y))
    touched = []
    for place, ends_at in ends.items():
        # A place without a gate begins before the road: the carrier would have it already.
        if ends_at > -RADIUS and begins.get(place, -inf) < RADIUS:
            touched.append(place)
    touched.sort(key=lambda place: ends[place])
    return [
        *(Need([place]) for place in touched),
        Face(side.heading("WEST")),
        DriveTo(x=side.x(route.F_ROAD)),
        Face(turn.heading),
        Free(route.held_at_stop(lane, side)),
        along,
        *onward,
    ]


def _longest_way_to_bay(route: OneWay, side: Side) -> tuple[Face, DriveTo, list[Step]]:
    """Return the way to the bay that passes all lanes: from the lane that is first on the road.

    It is returned in three parts: the turn onto the full-bin road, the drive along it, and the
    rest.
    """

    def place_count(way: list[Step]) -> int:
        """Return how many gates of places the drive along the road passes."""
        along = way[2]
        if isinstance(along, DriveTo):
            return len(along.frees)
        return 0

    ways = []
    for lane in route.layout.lanes:
        way = route.go_to_bay(lane.number, side)
        # Without the places for the turn at that lane: `_over_to_the_other_road` has its own.
        ways.append(list(dropwhile(lambda step: isinstance(step, Need), way)))
    # The first step is the drive from the full bin to the road.
    _, turn, along, *onward = max(ways, key=place_count)
    assert isinstance(turn, Face) and isinstance(along, DriveTo)
    return turn, along, onward


def _legs(steps: Iterable[Step], start: Pose, machine: Machine) -> list[Leg]:
    """Cut a machine's plan where its drives end, and where the machine may have to wait.

    What is done before a drive belongs to the leg of the drive; what is done after the last drive
    belongs to the last leg. `start`: the pose in which the plan begins.
    """
    legs: list[Leg] = []
    steps_of_leg: list[Step] = []
    pose = start
    for step in steps:
        parts: Iterable[tuple[Step, str]] = [(step, "")]
        if isinstance(step, DriveTo):
            parts = _parts(step, pose)
        for part, waits_for in parts:
            begin = pose
            pose, _ = part.motion(begin, machine)
            steps_of_leg.append(part)
            # A drive of no length leads to no other node.
            if isinstance(part, DriveTo) and _point(pose) != _point(begin):
                legs.append(Leg(begin, pose, tuple(steps_of_leg), waits_for))
                steps_of_leg = []
    last = legs[-1]
    return [*legs[:-1], replace(last, steps=(*last.steps, *steps_of_leg))]


def _parts(drive: DriveTo, start: Pose) -> Iterator[tuple[DriveTo, str]]:
    """Cut a drive at the gates before which the robot may have to wait.

    Yield each part, and the place that is needed where the part ends; "" if none is.
    """
    axis = drive.axis
    begin = getattr(start, axis)
    end = getattr(drive, axis)

    def along(position: float) -> float:
        """Return a coordinate, m, that grows in the direction of the drive, for a position."""
        if end >= begin:
            return position
        return -position

    needs = [gate for gate in drive.needs if along(begin) <= along(gate.at) < along(end)]
    cuts = sorted({gate.at for gate in needs if gate.at != begin}, key=along)
    for first, last in pairwise([begin, *cuts, end]):
        after = along(first)
        if first == begin:
            # The first part also gives back the places of gates behind the start.
            after = -inf
        frees = [gate for gate in drive.frees if after < along(gate.at) <= along(last)]
        needed_at_first = [gate for gate in needs if gate.at == first]
        part = structs.replace(drive, needs=needed_at_first, frees=frees, **{axis: last})
        yield part, _place_needed_at(last, needs)


def _place_needed_at(at: float, gates: Sequence[Gate]) -> str:
    """Return the first place of the gates at a position of a drive; "" if there is none."""
    for gate in gates:
        if gate.at == at and gate.places:
            return gate.places[0]
    return ""


def _point(pose: Pose) -> tuple[float, float]:
    """Return x and y of a pose to the millimetre, m.

    So drives that lead to the same point meet there, also if their last bits differ.
    """
    return round(pose.x, 3), round(pose.y, 3)


def _joined(
    legs: list[Leg], names: dict[tuple[float, float], str], stations: Mapping[str, tuple[str, ...]]
) -> Graph:
    """Return the graph of some legs: those that meet at a point are joined by a node.

    `names`: point -> name of its node. Points without a name get one, and are added to it. Of legs
    between the same two points the one is taken that gives back the most places: it is that of the
    longest way.
    """
    for leg in legs:
        if leg.waits_for and leg.waits_for not in names.values():
            names.setdefault(_point(leg.end), leg.waits_for)
        for x, y in (_point(leg.start), _point(leg.end)):
            names.setdefault((x, y), f"{x:g},{y:g}")
    edges: dict[tuple[str, str], Edge] = {}
    # A later leg takes the place of an earlier one with the same ends.
    for leg in sorted(legs, key=_freed_count):
        start = names[_point(leg.start)]
        end = names[_point(leg.end)]
        # Carriers drive along x or y only.
        length = abs(leg.end.x - leg.start.x) + abs(leg.end.y - leg.start.y)
        edges[start, end] = Edge(start, end, length, leg.steps)
    return Graph(
        kind="carrier",
        nodes={name: Node(name, x, y) for (x, y), name in names.items()},
        edges=edges,
        lines=tuple(name for name in stations if name.startswith(QUEUE)),
        stations=stations,
    )


def _freed_count(leg: Leg) -> int:
    """Return how many places a leg gives back."""
    count = 0
    for step in leg.steps:
        if isinstance(step, DriveTo):
            count += sum(len(gate.places) for gate in step.frees)
    return count
