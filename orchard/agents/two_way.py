"""The route `two-way`: deliveries drive south on the outer roads, full bins north on the inner ones (docs/traffic.md)."""

from collections.abc import Sequence
from typing import ClassVar

from orchard.agents.robot import LITTLE, Gate, Step
from orchard.agents.route import OneWay, Road, Side
from orchard.agents.steps import DriveTo, Face, Free, Need
from orchard.field.kinds import KINDS
from orchard.field.queue import TOP_ROAD, TWO_WAY

CORNER = "corner/north-east"  # where a full bin that turns west swings over the delivery road
MERGE = "corner/north-west"  # where the full bins of both sides meet
CROSSING = (
    "crossing/north-west"  # where deliveries to the west cross the way of the full bins to the bay
)


class TwoWay(OneWay):
    """Carriers drive south with deliveries and north with full bins, on both sides; the west side is the east side mirrored.

    Above the rows lie the top road of full bins, then the top road of deliveries to the west, then the queue. Deliveries to the east drive
    straight on from their line to the delivery road. Those to the west turn south at the heads, onto a connector.

    Each robot asks for one place after the other, never for two at once: docs/traffic.md says why.
    """

    QUEUE = TWO_WAY
    SOUTH: ClassVar = {"east": 1, "west": 1}
    HOLD = 3.5  # distance before a lane, from the north, at which a delivery waits while the lane's place is taken
    CLEAR = 3.8  # distance past a lane at which the tail of a delivery has left the lane's place
    F_TOP = 14.9  # y of the top road of full bins
    D_TOP = 17.8  # y of the top road of deliveries
    TO_CONNECTOR = 2.5  # distance from the queue's heads east to the connector
    LINE_HOLD = 3.5  # distance north of a line at which a carrier that comes from the north waits for the line's place
    TOP_CLEAR = 3.7  # distance south of a line at which it has left the place
    EXIT_CLEAR = 3.7  # distance east of the connector at which a carrier that drives straight on has left the line's place there
    ENTRY_SIGHT = (
        36.25  # x beyond which a carrier may have to stop for one that stands on the delivery road
    )
    ENTRY_HOLD = 36.6  # x at which a carrier waits to turn onto the delivery road
    F_HOLD = 3.85  # distance before a lane, from the south, at which a carrier with a full bin waits while the lane's place is taken
    F_CLEAR = 4.0  # distance north of a lane at which the tail of a full bin has left the place
    CORNER_HOLD = 16.6  # y at which a carrier with a delivery waits for the first lane and then for the north-east corner
    CORNER_CLEAR = 9.95  # y at which the bin of a delivery has left that corner
    BIN_CLEAR = 35.2  # x at which a full bin that turned west has left the delivery road
    WEST_HOLD = -37.0  # x on both top roads at which a carrier waits for the crossing, or to merge
    MERGE_HOLD = 11.4  # y at which a full bin of the west side waits to merge
    MERGE_CLEAR = 18.6  # y at which it has left the merge
    CROSSING_HOLD = 15.9  # y at which a full bin waits to cross the deliveries to the west
    CROSSING_CLEAR = 22.75  # y at which it has left the crossing

    # -- what plans, bounds and dispatch ask for

    @property
    def connector(self) -> float:
        """x of the road from the queue's heads to the top road of deliveries, m."""
        return self.queue.head + self.TO_CONNECTOR

    def distance(self, x: float, y: float, lane: int, side: Side) -> float:
        road, south = side.x(self.D_ROAD), y - side.y(self.layout.lane(lane).y, self.STOP)
        return south + (
            road - x if side is self.east else self.connector - x + self.connector - road
        )

    def roads(self) -> list[Road]:
        first, last = self.layout.lane(1).y, self.layout.lanes[-1].y
        d, f = ([side.x(x) for side in (self.west, self.east)] for x in (self.D_ROAD, self.F_ROAD))
        lines = sorted(self.queue.used(self.layout.queue_places))
        to_west = [
            (self.connector, lines[-1]),
            (self.connector, self.D_TOP),
            (d[0], self.D_TOP),
            (d[0], last - self.STOP),
        ]
        to_east = [(d[1], lines[-1]), (d[1], last - self.STOP)]
        onward = [[(self.queue.head, y), (d[1], y)] for y in lines]
        full = [(f[1], last), (f[1], self.F_TOP), (f[0], self.F_TOP)]
        to_bay = [(f[0], last), (f[0], TOP_ROAD), (self.queue.head, TOP_ROAD)]
        columns = [
            [(side.x(self.WAITING), y) for y in (first, last)] for side in self.sides.values()
        ]
        roads = [Road("D", points, 1.5) for points in (to_west, to_east, *onward)] + [
            Road("F", points, 1.5) for points in (full, to_bay)
        ]
        return [*roads, *(Road("picker", column, 0.0) for column in columns)]

    def holds(self) -> list[tuple[str, float, float]]:
        front, lanes = KINDS["carrier"].length / 2, self.layout.lanes
        deliveries = [lane.y + self.HOLD - front for lane in lanes[1:]]
        full = [lane.y - self.F_HOLD + front for lane in lanes[:-1]]
        before = [("D", self.D_ROAD, y) for y in deliveries] + [("F", self.F_ROAD, y) for y in full]
        at_lanes = [(road, side.x(x), y) for side in self.sides.values() for road, x, y in before]
        return [*at_lanes, ("D", self.east.x(self.D_ROAD), self.CORNER_HOLD - front)]

    # -- pickers

    def cross(self, side: Side, lane: int, at: float) -> list[Gate]:
        """The places that a picker needs to drive over both roads. It waits for the second one while it has the first."""
        return [Gate([side.place("D", lane)], at), Gate([side.place("F", lane)], at)]

    def turn_in(self, row: int, side: Side) -> list[Step]:
        _both, *turn = super().turn_in(row, side)
        return [Need([side.place("D", row)]), Need([side.place("F", row)]), *turn]

    # -- carriers

    def approach(self, lane: int, side: Side, carrier: int = 1) -> list[Step]:
        """A carrier's way from its head of the queue to the stop at which it leaves the empty bin."""
        y = self.queue.place(carrier - 1).y
        return self._to_the_east(y, lane) if side is self.east else self._to_the_west(y, lane)

    def _to_the_east(self, y: float, lane: int) -> list[Step]:
        side, exit_, entries = self.east, self._lines("exit", y)[:1], self._lines("entry", y)
        turn = [Gate([place], side.x(self.ENTRY_HOLD)) for place, _ in entries[:2]]
        straight = [Gate([place], self.queue.head) for place, _ in exit_]
        passed = [Gate([place], self._exit_clear(side)) for place, _ in exit_]
        onward = [Gate([place], line + self.LINE_HOLD) for place, line in entries[2:]]
        corner = [Gate([side.place("D", 1)], self.CORNER_HOLD), Gate([CORNER], self.CORNER_HOLD)]
        frees = [Gate([place], line - self.TOP_CLEAR) for place, line in entries] + [
            Gate([CORNER], self.CORNER_CLEAR)
        ]
        drive = DriveTo(x=side.x(self.D_ROAD), needs=[*straight, *turn], frees=passed)
        return [drive, Face("SOUTH"), self._deliver(lane, side, [*onward, *corner], frees)]

    def _exit_clear(self, side: Side) -> float:
        """x at which a carrier that drives on gives its line's place back, m: before it may have to stop, or beyond its hold."""
        clear, hold = self.connector + self.EXIT_CLEAR, side.x(self.ENTRY_HOLD)
        return clear if clear <= side.x(self.ENTRY_SIGHT) else max(clear, hold + LITTLE)

    def _to_the_west(self, y: float, lane: int) -> list[Step]:
        side, exits = self.west, self._lines("exit", y)
        turn = [Gate([place], self.queue.head) for place, _ in exits[:2]]
        onward = [Gate([place], line + self.LINE_HOLD) for place, line in exits[2:]]
        passed = [Gate([place], line - self.TOP_CLEAR) for place, line in exits]
        crossing = [Gate([side.place("D", 1)], self.WEST_HOLD), Gate([CROSSING], self.WEST_HOLD)]
        return [
            DriveTo(x=self.connector, needs=turn),
            Face("SOUTH"),
            DriveTo(y=self.D_TOP, needs=onward, frees=passed),
            Face("WEST"),
            DriveTo(x=side.x(self.D_ROAD), needs=crossing),
            Face("SOUTH"),
            Free([CROSSING]),
            self._deliver(lane, side),
        ]

    def go_to_bay(self, lane: int, side: Side) -> list[Step]:
        """Take the full bin north on the full-bin road; from the east side along the top to the west; and to the bay."""
        blind = self.at_work(lane, side)
        out: list[Step] = [DriveTo(x=side.x(self.F_ROAD), blind_to=blind), Face("NORTH", blind)]
        if side is self.west:
            return [
                *out,
                *self._to_bay(self._northward(lane, side), [Gate([MERGE], self.MERGE_HOLD)]),
            ]
        enter, leave = self._northward(lane, side)
        return [
            *out,
            DriveTo(y=self.F_TOP, needs=enter, frees=leave),
            Need([CORNER]),
            Face("WEST"),
            DriveTo(
                x=self.west.x(self.F_ROAD),
                needs=[Gate([MERGE], self.WEST_HOLD)],
                frees=[Gate([CORNER], side.x(self.BIN_CLEAR))],
            ),
            Face("NORTH"),
            *self._to_bay(([], [])),
        ]

    # -- the roads

    def _lines(self, where: str, y: float) -> list[tuple[str, float]]:
        """The places of the line at y and of the lines in use south of it, from north to south, with their y. A single line needs none."""
        lines = self.queue.used(self.layout.queue_places)
        return (
            [
                (f"{where}/{lines.index(line) + 1}", line)
                for line in sorted(lines, reverse=True)
                if line <= y
            ]
            if len(lines) > 1
            else []
        )

    def _deliver(
        self, lane: int, side: Side, needs: Sequence[Gate] = (), frees: Sequence[Gate] = ()
    ) -> Step:
        """Drive south past lanes to the stop at this one. The first lane's place is among `needs`, or is reserved already."""
        lanes, stop = range(1, lane + 1), side.y(self.layout.lane(lane).y, self.STOP)
        enter = [Gate([side.place("D", n)], self.layout.lane(n).y + self.HOLD) for n in lanes[1:]]
        leave = [
            Gate([side.place("D", n)], side.y(self.layout.lane(n).y, self.CLEAR)) for n in lanes
        ]
        return DriveTo(y=stop, needs=[*needs, *enter], frees=[*leave, *frees])

    def _northward(self, lane: int, side: Side) -> tuple[list[Gate], list[Gate]]:
        """The gates of a full bin's way north from a lane: where it needs the places of lanes, and where it gives them back."""
        lanes = [(n, side.place("F", n), self.layout.lane(n).y) for n in range(lane, 0, -1)]
        enter = [Gate([place], y - self.F_HOLD) for n, place, y in lanes if n != lane]
        return enter, [Gate([place], y + self.F_CLEAR) for _, place, y in lanes]

    def _to_bay(
        self, lanes: tuple[list[Gate], list[Gate]], needs: Sequence[Gate] = ()
    ) -> list[Step]:
        enter, leave = lanes
        crossing = Gate([CROSSING], self.CROSSING_HOLD)
        frees = [Gate([MERGE], self.MERGE_CLEAR), Gate([CROSSING], self.CROSSING_CLEAR)]
        north = DriveTo(y=TOP_ROAD, needs=[*enter, *needs, crossing], frees=[*leave, *frees])
        return [north, Face("EAST"), DriveTo(x=self.layout.bay_stop)]
