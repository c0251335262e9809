"""The roads of a route, and the places into which they are cut.

A place is a stretch of a road that the agent `traffic` grants to one robot at a time
(docs/traffic.md). `RoadPlaces` has the figures of the roads, and tells which places lie where. The
ways of pickers and carriers (`picker_ways.py`, `carrier_ways.py`) are built on it, and a route
(`route.py`) on these.

An exchange is what happens at a lane's mouth: a carrier brings an empty bin, and takes the full bin
away. D is the delivery road, on which carriers bring empty bins. F is the full-bin road.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

from orchard.field.layout import EAST_START, Layout
from orchard.field.picking import Absences
from orchard.field.queue import ONE_WAY, TOP_ROAD
from orchard.field.scenario import Failure
from orchard.field.survey import ROUNDING
from orchard.plans import steps as st
from orchard.plans.robot import Gate, Step
from orchard.plans.sides import Side


class RoadPlaces:
    """The roads of one-way carriers: where they lie, and their places.

    Figures are metres on the east side, x with rows of the usual 70 m. docs/traffic.md derives
    them. A distance past or before something is counted in the direction in which carriers drive
    on that road.
    """

    #: The queue in which its carriers wait, see orchard/field/queue.py.
    QUEUE: ClassVar[str] = ONE_WAY
    #: Side -> +1 if carriers that deliver drive south there, -1 if north.
    SOUTH: ClassVar[Mapping[str, int]] = {
        "east": 1,
        "west": -1,
    }
    # The classes of a user's own steps that the ways of the route have. A memory can hold them.
    Steps: ClassVar[Sequence[type[Step]]] = ()
    #: x of the delivery road: a picker's coupling point lies on it.
    D_ROAD = 38.75
    #: x of the full-bin road.
    F_ROAD = 36.25
    #: x at which a picker waits for an empty bin, and of its way to the next row.
    WAITING = EAST_START
    #: x of the full bin that a picker has left.
    FULL_BIN = 32.25
    #: Distance past the lane at which a delivering carrier stops, its bin on the lane's centre
    #: line; its loop begins there.
    STOP = 1.9
    #: Distance before a lane at which a carrier waits while it may not enter the lane's place.
    HOLD = 3.75
    #: Distance past a lane at which a carrier's tail has left the lane's place.
    CLEAR = 5.7
    #: Road -> how far past its lane an exchange sweeps, to the lanes there: it needs their places.
    ZONES: ClassVar[Mapping[str, float]] = {"D": 5.3, "F": 5.3}
    #: Distance from a lane, south of the one into which a picker turns, within which a picker that
    #: drives out and turns there would meet it. It needs that lane's place on D too.
    TURN_ZONE = 4.35
    #: Distance from the last tree line south to the full-bin road along the bottom.
    F_BOTTOM = 3.5
    #: Distance from the last tree line south to the delivery road along the bottom.
    D_BOTTOM = 5.6
    #: Distance, at least, from the last lane to the last tree line. With closer rows both bottom
    #: roads lie as if the line were so far away.
    LAST_LANE = 2.65
    #: Distance south of the southernmost line in use at which a carrier has left the place `top`.
    TOP_CLEAR = 3.75

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.queue = layout.queue
        self.east = Side("east", 1, self.SOUTH["east"], layout.shift)
        self.west = Side("west", -1, self.SOUTH["west"], layout.shift)
        self.sides = {"east": self.east, "west": self.west}
        assert self.queue.lines[0] == TOP_ROAD
        # A carrier leaves the place `top` before it comes to the first lane.
        assert min(self.queue.lines) - self.TOP_CLEAR > layout.tree_lines[0]

    def opposite(self, side: Side) -> Side:
        """Return the other side of the rows."""
        if side is self.east:
            return self.west
        return self.east

    def end(self, row: int, side: Side) -> float:
        """Return x of a row's end on this side, m.

        In a surveyed orchard it may lie further in than the ends of other rows.
        """
        lane = self.layout.lane(row)
        if side is self.east:
            return lane.east
        return lane.west

    @property
    def inner_bottom(self) -> float:
        """y of the full-bin road along the bottom, m."""
        return self._south - self.F_BOTTOM

    @property
    def outer_bottom(self) -> float:
        """y of the delivery road along the bottom, m."""
        return self._south - self.D_BOTTOM

    @property
    def _south(self) -> float:
        """y from which the distances of the bottom roads count, m: of the last tree line, or of one
        that is LAST_LANE south of the last lane.
        """
        line = self.layout.tree_lines[-1]
        missing = self.LAST_LANE - (self.layout.lanes[-1].y - line)
        if missing < ROUNDING:
            return line
        return line - missing

    @cached_property
    def has_zones(self) -> bool:
        """Whether rows are so close that an exchange, or a picker, needs places of other lanes."""
        reach = max(*self.ZONES.values(), self.TURN_ZONE) - ROUNDING
        return any(north.y - south.y < reach for north, south in pairwise(self.layout.lanes))

    @property
    def takes_both(self) -> bool:
        """Whether a picker that crosses the roads asks for the places of both at once.

        Else it asks for one after the other, D first: so it is where exchanges need several places.
        """
        return not self.has_zones

    def zone(self, road: str, lane: int, side: Side) -> list[str]:
        """Return a road's places that an exchange at a lane needs, in the direction of travel.

        They are that of the lane, and those of the lanes past it over which the exchange sweeps.
        """
        return [side.place(road, number) for number in self._swept(road, lane, side)]

    def _swept(self, road: str, lane: int, side: Side) -> list[int]:
        """Return the lanes of `zone`: the lane itself, then those past it."""
        return [lane, *self._within(lane, self.ZONES[road], past=side.south)]

    def _within(self, lane: int, reach: float, past: int) -> list[int]:
        """Return the other lanes that are nearer to a lane than `reach`, m, the nearest first.

        `past`: 1 for the lanes south of it, -1 for those north of it.
        """
        lanes = self.layout.lanes
        y = self.layout.lane(lane).y
        near = []
        number = lane + past
        while 1 <= number <= len(lanes) and abs(y - lanes[number - 1].y) < reach - ROUNDING:
            near.append(number)
            number += past
        return near

    def held_at_stop(self, lane: int, side: Side) -> list[str]:
        """Return the places on D that a carrier has where it stops to deliver.

        They are those of the exchange, and those of lanes before that its tail has not left yet.
        """
        places = self.zone("D", lane, side)
        # `_within` leaves out a lane that is as far away as the reach, to ROUNDING; here that one
        # counts too.
        reach = self.CLEAR - self.STOP + 2.0 * ROUNDING
        for behind in self._within(lane, reach, past=-side.south):
            places.append(side.place("D", behind))
        return places

    def _lanes(self, side: Side, first: int | None = None, last: int | None = None) -> list[int]:
        """Return the lanes that a carrier which delivers passes on this side, in its order.

        They are all lanes, or those from `first` on, or those up to `last`.
        """
        lanes = [lane.number for lane in self.layout.lanes]
        if side.south < 0:
            lanes.reverse()
        if first:
            lanes = lanes[lanes.index(first) :]
        if last:
            lanes = lanes[: lanes.index(last) + 1]
        return lanes

    def _along(
        self,
        side: Side,
        road: str,
        lanes: list[int],
        stop: float,
        *,
        needs: Sequence[Gate] = (),
        frees: Sequence[Gate] = (),
    ) -> st.DriveTo:
        """Return the drive along a road past lanes, up to y = `stop`.

        The carrier has each lane's place from `HOLD` before the lane until its tail has left the
        place. `needs`, `frees`: further gates of the drive.
        """
        enter = []
        leave = []
        for number in lanes:
            place = [side.place(road, number)]
            y = self.layout.lane(number).y
            enter.append(Gate(place, side.y(y, -self.HOLD)))
            leave.append(Gate(place, side.y(y, self.CLEAR)))
        return st.DriveTo(y=stop, needs=[*enter, *needs], frees=[*leave, *frees])

    def may_fail(self, failure: Failure, absences: Absences = ()) -> list[Step]:
        """Return the step before a drive on which its robot may fail or go away.

        No step if it can do neither. `absences`: when the robot is away.
        """
        if failure.mean_between is None and not absences:
            return []
        seed = self.layout.scenario.seed
        return [st.MayFail(seed, failure.mean_between or 0.0, failure.mean_repair, absences)]
