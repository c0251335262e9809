"""The roads of carriers as nodes and edges, made from the drives of the scenario's route: where they turn, wait and work.

A node is where a drive ends, or where a carrier waits for the next place on the roads. An edge holds the steps that lead to its end. With
them a carrier takes turns with all others, because traffic grants it the places that it needs, and it stops for obstacles.
"""

import heapq
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot, inf

from msgspec import structs

from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.agents.steps import DriveTo, Face, Free, Need
from orchard.field.geometry import Pose
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout

BAY = "bay"
QUEUE = "queue/"  # the beginning of the names of the queue's nodes
NEAR = 0.5  # m from a node within which a vehicle stands on it
NEAR_IN_QUEUE = 2.0  # m, the same in the queue, where vehicles stand closer at the start than later
RADIUS = KINDS["carrier"].radius  # m
PITCH = 4.15  # m from one node in a line of the queue to the next: a vehicle behind another one reaches the next


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
    """What a kind of vehicle drives on. `lines`: the nodes at the heads of the queue's lines. `stations`: station -> the nodes at which it
    works there."""

    kind: str
    nodes: Mapping[str, Node]
    edges: Mapping[tuple[str, str], Edge]
    lines: tuple[str, ...]
    stations: Mapping[str, tuple[str, ...]]

    @property
    def bins(self) -> list[str]:
        """The nodes at which full bins are coupled."""
        return [nodes[1] for nodes in self.stations.values() if len(nodes) > 1]

    def station_of(self, stop: str) -> str:
        """Return the station at which a vehicle stops at this node to hand over; '' if it is no such node."""
        return next(
            (name for name, nodes in self.stations.items() if len(nodes) > 1 and nodes[0] == stop),
            "",
        )

    def at(self, x: float, y: float) -> str:
        """Return the node on which a vehicle at (x, y) stands; '' if there is none."""
        near = min(self.nodes.values(), key=lambda node: hypot(node.x - x, node.y - y))
        most = NEAR_IN_QUEUE if near.name.startswith(QUEUE) else NEAR
        return near.name if hypot(near.x - x, near.y - y) <= most else ""

    def way(self, start: str, ends: Iterable[str]) -> list[str]:
        """Return the nodes of the shortest way to the nearest of some nodes, the first one left out. Raises ValueError if there is none."""
        ends, known, queue = set(ends), {start: (0.0, "")}, [(0.0, start)]
        while queue:
            so_far, name = heapq.heappop(queue)
            if name in ends:
                return list(_back(known, name))[::-1][1:]
            for edge in self._out(name):
                further = so_far + edge.length
                if further < known.get(edge.end, (inf, ""))[0]:
                    known[edge.end] = further, name
                    heapq.heappush(queue, (further, edge.end))
        raise ValueError(f"no way from {start} to {', '.join(sorted(ends))}")

    def _out(self, name: str) -> list[Edge]:
        return [edge for (start, _), edge in self.edges.items() if start == name]


def _back(known: Mapping[str, tuple[float, str]], name: str) -> Iterator[str]:
    while name:
        yield name
        name = known[name][1]


@dataclass(frozen=True)
class Leg:
    """A drive between two points, before they have names. `waits_for`: the place for which a carrier waits at its end; '' for none."""

    start: Pose
    end: Pose
    steps: tuple[Step, ...]
    waits_for: str = ""


def graph_of(layout: Layout, route: OneWay) -> Graph:
    """Return the roads of an orchard, by its route."""
    legs: list[Leg] = []
    named: dict[tuple[float, float], str] = {}
    stations: dict[str, tuple[str, ...]] = {BAY: (BAY,)}
    for head in range(0, layout.queue_places, layout.queue.places):
        line = f"{QUEUE}{head // layout.queue.places + 1}"
        first, count = (
            layout.queue.place(head),
            min(layout.queue.places, layout.queue_places - head),
        )
        slots = [first._replace(x=first.x - PITCH * slot) for slot in range(count)]
        named |= {
            _point(pose): f"{line}/{slot + 1}" if slot else line for slot, pose in enumerate(slots)
        }
        stations[line] = (line,)
        bay = Pose(layout.bay_stop, layout.queue.lines[0], 0.0)
        named[_point(bay)] = BAY
        home = [
            *route.go_to_line(head + 1),
            *(DriveTo(x=slot.x, queueing=True) for slot in reversed(slots)),
        ]
        legs += _legs(home, bay)
        legs += [
            leg
            for slot, ahead in pairwise(reversed(slots))
            for leg in _legs([DriveTo(x=ahead.x, queueing=True)], slot)
        ]
        for side in route.sides.values():
            for lane in layout.lanes:
                legs += _legs(route.approach(lane.number, side, head + 1), slots[0])
    for side in route.sides.values():
        for lane in layout.lanes:
            name = f"{side.name}/{lane.number}"
            stations[name] = f"{side.name}/stop/{lane.number}", f"{side.name}/bin/{lane.number}"
            stop = Pose(side.x(route.D_ROAD), side.y(lane.y, route.STOP), 0.0)
            loop = _legs(route.loop_to_full_bin(lane.number, side), stop)
            named |= dict(zip((_point(stop), _point(loop[-1].end)), stations[name], strict=True))
            legs += [*loop, *_legs(route.go_to_bay(lane.number, side), loop[-1].end)]
            legs += _legs(_over_to_the_other_road(route, side, lane.number, stop), stop)
    return _joined(legs, named, stations)


def _over_to_the_other_road(route: OneWay, side: Side, lane: int, stop: Pose) -> list[Step]:
    """The way home for a carrier that has nothing to do at a lane: from its stop over to the road of the full bins, and along it.

    It needs the places of that road between which it turns, as one that drives along it: one after the other, never two at once. The
    longest way to the bay knows those of all lanes.
    """
    ways = [route.go_to_bay(one.number, side) for one in route.layout.lanes]
    _, turn, along, *onward = max(
        ways, key=lambda way: len(way[2].frees) if isinstance(way[2], DriveTo) else 0
    )
    assert isinstance(turn, Face) and isinstance(along, DriveTo)
    ahead = -1.0 if turn.heading == "SOUTH" else 1.0
    enters = {place: ahead * (gate.at - stop.y) for gate in along.needs for place in gate.places}
    leaves = {place: ahead * (gate.at - stop.y) for gate in along.frees for place in gate.places}
    around = [
        place for place in leaves if leaves[place] > -RADIUS and enters.get(place, -inf) < RADIUS
    ]
    needs = [Need([place]) for place in sorted(around, key=lambda place: leaves[place])]
    return [
        *needs,
        Face(side.heading("WEST")),
        DriveTo(x=side.x(route.F_ROAD)),
        Face(turn.heading),
        Free([side.place("D", lane)]),
        along,
        *onward,
    ]


def _legs(steps: Iterable[Step], start: Pose) -> list[Leg]:
    """Cut a plan where its drives end, and where they may have to wait. What is done before a drive belongs to it."""
    legs: list[Leg] = []
    before: list[Step] = []
    pose = start
    for step in steps:
        for part, waits_for in _parts(step, pose) if isinstance(step, DriveTo) else [(step, "")]:
            begin, pose = pose, part.motion(pose)[0]
            before.append(part)
            if isinstance(part, DriveTo) and _point(pose) != _point(begin):
                legs.append(Leg(begin, pose, tuple(before), waits_for))
                before = []
    return [*legs[:-1], replace(legs[-1], steps=(*legs[-1].steps, *before))]


def _parts(drive: DriveTo, start: Pose) -> Iterator[tuple[DriveTo, str]]:
    """Cut a drive at the gates before which it may have to wait. Yield each part, and the place that is needed where it ends."""
    axis = "y" if drive.x is None else "x"
    begin, end = getattr(start, axis), getattr(drive, axis)
    ahead = 1.0 if end >= begin else -1.0
    needs = [
        gate
        for gate in drive.needs
        if ahead * (gate.at - begin) >= 0.0 and ahead * (end - gate.at) > 0.0
    ]
    ats = sorted({gate.at for gate in needs if gate.at != begin}, key=lambda at: ahead * at)
    for first, last in pairwise([begin, *ats, end]):
        here = [gate for gate in needs if gate.at == first]
        there = [place for gate in needs if gate.at == last for place in gate.places]
        passed = [
            gate
            for gate in drive.frees
            if ahead * (gate.at - last) <= 0.0
            and (first == begin or ahead * (gate.at - first) > 0.0)
        ]
        yield (
            structs.replace(drive, needs=here, frees=passed, **{axis: last}),
            there[0] if there else "",
        )


def _point(pose: Pose) -> tuple[float, float]:
    """A place to the millimetre: drives of several lanes lead to the same one."""
    return round(pose.x, 3), round(pose.y, 3)


def _joined(
    legs: list[Leg], named: dict[tuple[float, float], str], stations: Mapping[str, tuple[str, ...]]
) -> Graph:
    """Join the legs where they meet. Of those with the same ends that counts which gives back the most places."""
    for leg in legs:
        if leg.waits_for and leg.waits_for not in named.values():
            named.setdefault(_point(leg.end), leg.waits_for)
        for x, y in (_point(leg.start), _point(leg.end)):
            named.setdefault((x, y), f"{x:g},{y:g}")
    edges: dict[tuple[str, str], Edge] = {}
    for leg in sorted(legs, key=lambda leg: len(_freed(leg.steps))):
        start, end = named[_point(leg.start)], named[_point(leg.end)]
        edges[start, end] = Edge(
            start, end, abs(leg.end.x - leg.start.x) + abs(leg.end.y - leg.start.y), leg.steps
        )
    nodes = {name: Node(name, x, y) for (x, y), name in named.items()}
    return Graph(
        "carrier",
        nodes,
        edges,
        tuple(name for name in stations if name.startswith(QUEUE)),
        stations,
    )


def _freed(steps: Iterable[Step]) -> list[str]:
    return [
        place
        for step in steps
        if isinstance(step, DriveTo)
        for gate in step.frees
        for place in gate.places
    ]
