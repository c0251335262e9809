"""The route `two-way`, the default (docs/traffic.md).

Carriers that deliver empty bins drive south on the outer roads D, carriers with full bins north on
the inner roads F. Here a delivery is a carrier that brings an empty bin, and a full bin is one with
its carrier. Figures are as in `OneWay`, in m.
"""

from collections.abc import Sequence
from typing import ClassVar

from orchard.field.kinds import KINDS
from orchard.field.queue import TOP_ROAD, TWO_WAY
from orchard.plans.course import LITTLE
from orchard.plans.robot import Gate, Step
from orchard.plans.route import ROAD_WIDTH, OneWay, Road, Side
from orchard.plans.steps import DriveTo, Face, Free, Need

# Places that belong to no lane.
# Where a full bin that turns west swings over the delivery road.
CORNER = "corner/north-east"
# Where the full bins of both sides meet.
MERGE = "corner/north-west"
# Where deliveries to the west cross the way of the full bins to the bay.
CROSSING = "crossing/north-west"


class TwoWay(OneWay):
    """Carriers drive south with deliveries and north with full bins, on both sides.

    The west side is the east side mirrored. Above the rows lie the top road of full bins, then the
    top road of deliveries to the west, then the queue. Deliveries to the east drive straight on
    from their line to the delivery road. Those to the west turn south at the heads, onto a
    connector.

    Each robot asks for one place after the other, never for two at once: docs/traffic.md says why.
    """

    QUEUE = TWO_WAY
    ZONES: ClassVar = {"D": 5.3, "F": 4.3}
    SOUTH: ClassVar = {"east": 1, "west": 1}
    # Distance before a lane, from the north, at which a delivery waits while the lane's place is
    # taken.
    HOLD = 3.5
    # Distance past a lane at which the tail of a delivery has left the lane's place.
    CLEAR = 3.8
    # y of the top road of full bins.
    F_TOP = 14.9
    # y of the top road of deliveries.
    D_TOP = 17.8
    # Distance from the queue's heads east to the connector.
    TO_CONNECTOR = 2.5
    # Distance north of a line at which a carrier that comes from the north waits for the line's
    # place.
    LINE_HOLD = 3.5
    # Distance south of a line at which a carrier from the north has left the line's place.
    TOP_CLEAR = 3.7
    # Distance east of the connector at which a carrier that drives straight on has left the line's
    # place there.
    EXIT_CLEAR = 3.7
    # x beyond which a carrier may have to stop for a carrier that stands on the delivery road.
    ENTRY_SIGHT = 36.25
    # x at which a carrier waits to turn onto the delivery road.
    ENTRY_HOLD = 36.6
    # Distance before a lane, from the south, at which a carrier with a full bin waits while the
    # lane's place is taken.
    F_HOLD = 3.85
    # Distance north of a lane at which the tail of a full bin has left the place.
    F_CLEAR = 4.0
    # y at which a carrier with a delivery waits for the first lane and then for the north-east
    # corner.
    CORNER_HOLD = 16.6
    # y at which the bin of a delivery has left that corner.
    CORNER_CLEAR = 9.95
    # x at which a full bin that turned west has left the delivery road.
    BIN_CLEAR = 35.2
    # x on both top roads at which a carrier waits for the crossing, or to merge.
    WEST_HOLD = -37.0
    # y at which a full bin of the west side waits to merge.
    MERGE_HOLD = 11.4
    # y at which a full bin has left the merge.
    MERGE_CLEAR = 18.6
    # y at which a full bin waits to cross the deliveries to the west.
    CROSSING_HOLD = 15.9
    # y at which a full bin has left the crossing.
    CROSSING_CLEAR = 22.75

    # -- what plans, bounds and dispatch ask for

    @property
    def connector(self) -> float:
        """x of the road from the queue's heads to the top road of deliveries, m."""
        return self.queue.head + self.TO_CONNECTOR

    def distance(self, x: float, y: float, lane: int, side: Side) -> float:
        """Return the metres by road from (x, y) in the queue to the stop at a lane.

        To the west the way leads east to the connector first.
        """
        road = side.x(self.D_ROAD)
        south = y - side.y(self.layout.lane(lane).y, self.STOP)
        if side is self.east:
            return south + (road - x)
        return south + (self.connector - x + self.connector - road)

    def roads(self) -> list[Road]:
        """Return the roads, for drawings."""
        first = self.layout.lane(1).y
        last = self.layout.lanes[-1].y
        end = last - self.STOP
        head = self.queue.head
        # x of both roads on the west and on the east side.
        west_d = self.west.x(self.D_ROAD)
        west_f = self.west.x(self.F_ROAD)
        d = self.east.x(self.D_ROAD)
        f = self.east.x(self.F_ROAD)
        lines = sorted(self.queue.used(self.layout.queue_places))
        connector = [(self.connector, lines[-1]), (self.connector, self.D_TOP)]
        deliveries = [
            [*connector, (west_d, self.D_TOP), (west_d, end)],
            [(d, lines[-1]), (d, end)],
            *([(head, y), (d, y)] for y in lines),
        ]
        full_bins = [
            [(f, last), (f, self.F_TOP), (west_f, self.F_TOP)],
            [(west_f, last), (west_f, TOP_ROAD), (head, TOP_ROAD)],
        ]
        roads = [Road("D", points, ROAD_WIDTH) for points in deliveries]
        roads += [Road("F", points, ROAD_WIDTH) for points in full_bins]
        for side in self.sides.values():
            x = side.x(self.WAITING)
            roads.append(Road("picker", [(x, first), (x, last)], 0.0))
        return roads

    def holds(self) -> list[tuple[str, float, float]]:
        """Return where fronts of carriers stop while a place is taken, for drawings.

        Each is the name of the road, and x and y of the front, m.
        """
        front = KINDS["carrier"].length / 2
        lanes = self.layout.lanes
        places = []
        for side in self.sides.values():
            # Deliveries come to the first lane from other holds. No full bin passes the last lane:
            # the southernmost one begins there.
            x = side.x(self.D_ROAD)
            places += [("D", x, lane.y + self.HOLD - front) for lane in lanes[1:]]
            x = side.x(self.F_ROAD)
            places += [("F", x, lane.y - self.F_HOLD + front) for lane in lanes[:-1]]
        places.append(("D", self.east.x(self.D_ROAD), self.CORNER_HOLD - front))
        return places

    # -- pickers

    @property
    def takes_both(self) -> bool:
        """Never: a picker asks for the place on F once it has the place on D."""
        return False

    # -- carriers

    def approach(self, lane: int, side: Side, carrier: int = 1) -> list[Step]:
        """Return a carrier's way from its head of the queue to where it leaves the empty bin."""
        y = self.queue.place(carrier - 1).y
        if side is self.east:
            return self._to_the_east(y, lane)
        return self._to_the_west(y, lane)

    def _to_the_east(self, y: float, lane: int) -> list[Step]:
        """Return the way from a line at y, m, to the stop at a lane on the east side.

        A line's `exit` is its place at the connector, its `entry` that at the delivery road. A turn
        south reaches to the next line, so it needs the places of two lines.
        """
        side = self.east
        exits = self._lines("exit", y)[:1]
        entries = self._lines("entry", y)
        turn = _gates_at(side.x(self.ENTRY_HOLD), entries[:2])
        straight = _gates_at(self.queue.head, exits)
        passed = _gates_at(self._exit_clear(side), exits)
        onward = _gates_beside(entries[2:], self.LINE_HOLD)
        # Before the corner the carrier takes the places of all lanes for which it would wait in the
        # corner. `last` is the last of these lanes.
        corner = []
        last = 0
        for number in range(1, self._swept("D", lane, side)[-1] + 1):
            if number == 1 or self.layout.lane(number).y + self.HOLD > self.CORNER_CLEAR:
                corner.append(Gate([side.place("D", number)], self.CORNER_HOLD))
                last = number
        corner.append(Gate([CORNER], self.CORNER_HOLD))
        frees = _gates_beside(entries, -self.TOP_CLEAR)
        frees.append(Gate([CORNER], self.CORNER_CLEAR))
        drive = DriveTo(x=side.x(self.D_ROAD), needs=[*straight, *turn], frees=passed)
        onward += corner
        return [drive, Face("SOUTH"), self._deliver(lane, side, onward, frees, after=last)]

    def _exit_clear(self, side: Side) -> float:
        """Return x at which a carrier that drives on gives its line's place back, m.

        That is before x from which it may have to stop, or else beyond its hold: it must not stand
        between, where it would keep the place.
        """
        clear = self.connector + self.EXIT_CLEAR
        if clear <= side.x(self.ENTRY_SIGHT):
            return clear
        return max(clear, side.x(self.ENTRY_HOLD) + LITTLE)

    def _to_the_west(self, y: float, lane: int) -> list[Step]:
        """Return the way from a line at y, m, to the stop at a lane on the west side.

        The turn south at the connector needs the exits of two lines: see `_to_the_east`.
        """
        side = self.west
        exits = self._lines("exit", y)
        turn = _gates_at(self.queue.head, exits[:2])
        onward = _gates_beside(exits[2:], self.LINE_HOLD)
        passed = _gates_beside(exits, -self.TOP_CLEAR)
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
        """Return the drive with the full bin north on the full-bin road, and to the bay.

        From the east side it leads along the top to the west.
        """
        blind = self.at_work(lane, side)
        enter, leave = self._northward(lane, side)
        # The carrier comes onto the road past these gates, so it needs their places before.
        out: list[Step] = []
        while enter and enter[0].at < self.layout.lane(lane).y:
            out.append(Need(enter.pop(0).places))
        out += [DriveTo(x=side.x(self.F_ROAD), blind_to=blind), Face("NORTH", blind)]
        if side is self.west:
            merge = Gate([MERGE], self.MERGE_HOLD)
            return [*out, *self._to_bay([*enter, merge], leave)]
        merge = Gate([MERGE], self.WEST_HOLD)
        corner = Gate([CORNER], side.x(self.BIN_CLEAR))
        return [
            *out,
            DriveTo(y=self.F_TOP, needs=enter, frees=leave),
            Need([CORNER]),
            Face("WEST"),
            DriveTo(x=self.west.x(self.F_ROAD), needs=[merge], frees=[corner]),
            Face("NORTH"),
            *self._to_bay([], []),
        ]

    # -- the roads

    def _lines(self, where: str, y: float) -> list[tuple[str, float]]:
        """Return the places of a line and of the lines south of it, and y of each line, m.

        They come from north to south. `where`: 'exit', for the places at the connector, or 'entry',
        for those at the delivery road. `y`: of the line, m. If only one line is in use it needs no
        place.
        """
        lines = self.queue.used(self.layout.queue_places)
        if len(lines) == 1:
            return []
        passed = [line for line in sorted(lines, reverse=True) if line <= y]
        # A place has the number of its line, in the order in which lines fill.
        return [(f"{where}/{lines.index(line) + 1}", line) for line in passed]

    def _deliver(
        self,
        lane: int,
        side: Side,
        needs: Sequence[Gate] = (),
        frees: Sequence[Gate] = (),
        after: int = 1,
    ) -> Step:
        """Return the drive south past lanes to the stop at a lane.

        `needs`, `frees`: further gates of the drive. `after`: the last lane whose place is among
        `needs`, or is reserved already.
        """
        stop = side.y(self.layout.lane(lane).y, self.STOP)
        enter = []
        leave = []
        for number in range(1, self._swept("D", lane, side)[-1] + 1):
            place = [side.place("D", number)]
            y = self.layout.lane(number).y
            if number > after:
                enter.append(Gate(place, y + self.HOLD))
            leave.append(Gate(place, side.y(y, self.CLEAR)))
        return DriveTo(y=stop, needs=[*needs, *enter], frees=[*leave, *frees])

    def zone(self, road: str, lane: int, side: Side) -> list[str]:
        """Return a road's places that an exchange at a lane needs, in the direction of travel."""
        places = super().zone(road, lane, side)
        if road == "F":
            places.reverse()
        return places

    def _northward(self, lane: int, side: Side) -> tuple[list[Gate], list[Gate]]:
        """Return the gates of a full bin's way north from a lane, in its order.

        The first list has those at which it needs the places of lanes, the second one those at
        which it gives them back.
        """
        enter = []
        leave = []
        for number in range(self._swept("F", lane, side)[-1], 0, -1):
            place = [side.place("F", number)]
            y = self.layout.lane(number).y
            if number < lane:
                enter.append(Gate(place, y - self.F_HOLD))
            leave.append(Gate(place, y + self.F_CLEAR))
        return enter, leave

    def _to_bay(self, enter: list[Gate], leave: list[Gate]) -> list[Step]:
        """Return the drive north on the west side, and to the bay.

        `enter`, `leave`: the gates before the crossing at which the carrier needs places, and gives
        them back.
        """
        crossing = Gate([CROSSING], self.CROSSING_HOLD)
        frees = [Gate([MERGE], self.MERGE_CLEAR), Gate([CROSSING], self.CROSSING_CLEAR)]
        north = DriveTo(y=TOP_ROAD, needs=[*enter, crossing], frees=[*leave, *frees])
        return [north, Face("EAST"), self.to_bay()]


def _gates_at(x: float, lines: Sequence[tuple[str, float]]) -> list[Gate]:
    """Return a gate for the place of each line, all at x, m. `lines`: as of `_lines`."""
    return [Gate([place], x) for place, _ in lines]


def _gates_beside(lines: Sequence[tuple[str, float]], offset: float) -> list[Gate]:
    """Return a gate for the place of each line, at its y + `offset`, m. `lines`: as of `_lines`."""
    return [Gate([place], y + offset) for place, y in lines]
