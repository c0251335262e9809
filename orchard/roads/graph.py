"""The roads of carriers as nodes and edges, made from the drives of the scenario's route.

Theory of operation. The plans of carriers are cut into legs: a leg ends where a drive ends, and
where a carrier may have to wait for the next place on the roads. Legs that end at the same point
meet there, in a node. An edge holds the steps of the leg that leads to its end. With them a carrier
takes turns with all others, because traffic grants it the places that it needs, and it stops for
obstacles.
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

BAY = "bay"
QUEUE = "queue/"  # the beginning of the names of the queue's nodes
NEAR = 0.5  # m from a node within which a vehicle stands on it
NEAR_IN_QUEUE = 2.0  # m, the same in the queue, where vehicles stand closer at the start than later
RADIUS = KINDS["carrier"].radius  # m
# m from one node in a line of the queue to the next: a vehicle behind another one reaches the next
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
    nodes: Mapping[str, Node]
    edges: Mapping[tuple[str, str], Edge]
    lines: tuple[str, ...]  # the nodes at the heads of the queue's lines
    stations: Mapping[str, tuple[str, ...]]  # station -> the nodes at which a vehicle works there

    @property
    def bins(self) -> list[str]:
        """The nodes at which full bins are coupled."""
        return [nodes[1] for nodes in self.stations.values() if len(nodes) > 1]

    def station_of(self, stop: str) -> str:
        """Return the station at which a vehicle stops at a node to hand over; "" if none."""
        for name, nodes in self.stations.items():
            if len(nodes) > 1 and nodes[0] == stop:
                return name
        return ""

    def at(self, x: float, y: float) -> str:
        """Return the node on which a vehicle at (x, y), m, stands; "" if there is none."""

        def distance(node: Node) -> float:
            return hypot(node.x - x, node.y - y)

        nearest = min(self.nodes.values(), key=distance)
        tolerance = NEAR_IN_QUEUE if nearest.name.startswith(QUEUE) else NEAR
        if distance(nearest) <= tolerance:
            return nearest.name
        return ""

    def way(self, start: str, ends: Iterable[str]) -> list[str]:
        """Return the nodes of the shortest way to the nearest of some nodes, without the first.

        Raises ValueError if there is no way.
        """
        wanted = set(ends)
        known = {start: (0.0, "")}
        queue = [(0.0, start)]
        while queue:
            length, name = heapq.heappop(queue)
            if name in wanted:
                return _way_back(known, name)[::-1][1:]
            for edge in self._out(name):
                further = length + edge.length
                if further < known.get(edge.end, (inf, ""))[0]:
                    known[edge.end] = further, name
                    heapq.heappush(queue, (further, edge.end))
        raise ValueError(f"no way from {start} to {', '.join(sorted(wanted))}")

    def _out(self, name: str) -> list[Edge]:
        """Return the edges that begin at a node."""
        return [edge for (start, _), edge in self.edges.items() if start == name]


def _way_back(known: Mapping[str, tuple[float, str]], name: str) -> list[str]:
    """Return the nodes from one back to the start.

    `known`: node -> the length of the way to it, m, and the node before it.
    """
    nodes = []
    while name:
        nodes.append(name)
        name = known[name][1]
    return nodes


@dataclass(frozen=True)
class Leg:
    """A drive between two points, before they have names."""

    start: Pose
    end: Pose
    steps: tuple[Step, ...]
    waits_for: str = ""  # the place for which a carrier waits at its end; "" for none


def graph_of(layout: Layout, route: OneWay) -> Graph:
    """Return the roads of an orchard, by its route."""
    roads = _Roads(layout, route)
    for head in range(0, layout.queue_places, layout.queue.places):
        roads.add_line(head)
    for side in route.sides.values():
        for lane in layout.lanes:
            roads.add_station(side, lane)
    return _joined(roads.legs, roads.names, roads.stations)


class _Roads:
    """The legs of all roads, and the names of the points that have one."""

    def __init__(self, layout: Layout, route: OneWay) -> None:
        self._layout = layout
        self._route = route
        self._carrier = layout.machines["carrier"]
        self._bay = Pose(layout.bay_stop, layout.queue.lines[0], 0.0)
        self.legs: list[Leg] = []
        self.names: dict[tuple[float, float], str] = {}
        # x of a carrier at each place of the bay, the first one first.
        self._bay_stops: list[float] = []
        of_bay = [BAY]
        for number in range(1, layout.scenario.bays):
            of_bay.append(f"{BAY}/{number + 1}")
        for number, name in enumerate(of_bay):
            place = self._bay._replace(x=self._bay.x - CLOSED_UP * number)
            self._bay_stops.append(place.x)
            self.names[_point(place)] = name
        self.stations: dict[str, tuple[str, ...]] = {BAY: tuple(of_bay)}

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
        """Yield steps with the drive to a bay of several places cut at each place."""
        for step in steps:
            if isinstance(step, DriveToBay):
                for x in reversed(self._bay_stops):
                    yield DriveTo(x=x)
            else:
                yield step


def _over_to_the_other_road(route: OneWay, side: Side, lane: int, stop: Pose) -> list[Step]:
    """Return the way home for a carrier that has nothing to do at a lane.

    It leads from its stop over to the road of the full bins, and along it. The carrier needs the
    places of that road between which it turns, as one that drives along it: one after the other,
    never two at once.
    """
    turn, along, onward = _longest_way_to_bay(route, side)
    ahead = -1.0 if turn.heading == "SOUTH" else 1.0
    # Place -> how far before (below 0) or behind the stop it begins and ends, m.
    enters: dict[str, float] = {}
    for gate in along.needs:
        enters |= dict.fromkeys(gate.places, ahead * (gate.at - stop.y))
    leaves: dict[str, float] = {}
    for gate in along.frees:
        leaves |= dict.fromkeys(gate.places, ahead * (gate.at - stop.y))
    around = []
    for place, leaves_at in leaves.items():
        if leaves_at > -RADIUS and enters.get(place, -inf) < RADIUS:
            around.append(place)
    around.sort(key=lambda place: leaves[place])
    return [
        *(Need([place]) for place in around),
        Face(side.heading("WEST")),
        DriveTo(x=side.x(route.F_ROAD)),
        Face(turn.heading),
        Free(route.held_at_stop(lane, side)),
        along,
        *onward,
    ]


def _longest_way_to_bay(route: OneWay, side: Side) -> tuple[Face, DriveTo, list[Step]]:
    """Return the way to the bay that knows the places of all lanes.

    It is the turn onto the road, the drive along it, and the rest.
    """

    def place_count(way: list[Step]) -> int:
        along = way[2]
        if isinstance(along, DriveTo):
            return len(along.frees)
        return 0

    ways = []
    for lane in route.layout.lanes:
        way = route.go_to_bay(lane.number, side)
        # A carrier that comes from the stop asks for its places by itself.
        ways.append(list(dropwhile(lambda step: isinstance(step, Need), way)))
    _, turn, along, *onward = max(ways, key=place_count)
    assert isinstance(turn, Face) and isinstance(along, DriveTo)
    return turn, along, onward


def _legs(steps: Iterable[Step], start: Pose, machine: Machine) -> list[Leg]:
    """Cut a machine's plan where its drives end, and where they may have to wait.

    What is done before a drive belongs to it.
    """
    legs: list[Leg] = []
    before: list[Step] = []
    pose = start
    for step in steps:
        parts = _parts(step, pose) if isinstance(step, DriveTo) else [(step, "")]
        for part, waits_for in parts:
            begin = pose
            pose = part.motion(begin, machine)[0]
            before.append(part)
            if isinstance(part, DriveTo) and _point(pose) != _point(begin):
                legs.append(Leg(begin, pose, tuple(before), waits_for))
                before = []
    last = legs[-1]
    return [*legs[:-1], replace(last, steps=(*last.steps, *before))]


def _parts(drive: DriveTo, start: Pose) -> Iterator[tuple[DriveTo, str]]:
    """Cut a drive at the gates before which it may have to wait.

    Yields each part, and the place that is needed where it ends.
    """
    axis = drive.axis
    begin = getattr(start, axis)
    end = getattr(drive, axis)

    def along(at: float) -> float:
        """Return a coordinate, m, that grows in the direction of the drive."""
        if end >= begin:
            return at
        return -at

    needs = [gate for gate in drive.needs if along(begin) <= along(gate.at) < along(end)]
    cuts = sorted({gate.at for gate in needs if gate.at != begin}, key=along)
    for first, last in pairwise([begin, *cuts, end]):
        # The first part also gives back what lies behind the start.
        behind = -inf if first == begin else along(first)
        frees = [gate for gate in drive.frees if behind < along(gate.at) <= along(last)]
        needed_at_first = [gate for gate in needs if gate.at == first]
        part = structs.replace(drive, needs=needed_at_first, frees=frees, **{axis: last})
        yield part, _place_needed_at(last, needs)


def _place_needed_at(at: float, gates: Sequence[Gate]) -> str:
    """Return the first place that is needed at a coordinate of a drive; "" if none is."""
    for gate in gates:
        if gate.at == at and gate.places:
            return gate.places[0]
    return ""


def _point(pose: Pose) -> tuple[float, float]:
    """Return a point to the millimetre: drives of several lanes lead to the same one."""
    return round(pose.x, 3), round(pose.y, 3)


def _joined(
    legs: list[Leg], names: dict[tuple[float, float], str], stations: Mapping[str, tuple[str, ...]]
) -> Graph:
    """Join the legs where they meet.

    `names`: point -> name; the others get one here. Of legs with the same ends that counts which
    gives back the most places.
    """
    for leg in legs:
        if leg.waits_for and leg.waits_for not in names.values():
            names.setdefault(_point(leg.end), leg.waits_for)
        for x, y in (_point(leg.start), _point(leg.end)):
            names.setdefault((x, y), f"{x:g},{y:g}")
    edges: dict[tuple[str, str], Edge] = {}
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
