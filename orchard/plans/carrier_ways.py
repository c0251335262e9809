"""The ways of carriers on a route: from the queue to a lane, to the full bin, to the bay, and home.

Each method returns steps of a plan (orchard/plans/steps.py). `OneWay.fetch` of
orchard/plans/route.py puts them together to a carrier's job.
"""

from collections.abc import Sequence

from orchard.field.machines import haul_charge
from orchard.field.queue import BESIDE, TOP_ROAD
from orchard.plans import steps as st
from orchard.plans.road_places import RoadPlaces
from orchard.plans.robot import Gate, Step
from orchard.plans.sense import Box
from orchard.plans.sides import Side, box_of

# The place where the queue's lines meet the delivery road.
TOP = "top"


class CarrierWays(RoadPlaces):
    """The ways of carriers. Figures are as in `RoadPlaces`."""

    #: x of a carrier that couples the full bin.
    COUPLING = 34.15
    #: x at which a delivering carrier that turned in towards the lane has left the delivery road.
    LOOP_CLEAR = 36.8
    #: x before which a carrier on the outer bottom road waits for the south-west corner.
    CORNER_HOLD_X = -35.5
    #: x on the inner bottom road at which a full bin has left the south-east corner.
    CORNER_CLEAR_X = 34.7
    #: Distance north of that road at which a full bin has left the south-west corner.
    CORNER_CLEAR_Y = 1.4
    #: Distance north of it at which a full bin is beyond what the next carrier's turn there sweeps.
    TURN_CLEAR_Y = 3.75

    def approach(self, lane: int, side: Side, carrier: int = 1) -> list[Step]:
        """Return a carrier's way from its head of the queue to where it leaves the empty bin.

        `carrier`: the number of its place in the queue, from 1. Here it does not matter: all lines
        have their heads side by side.
        """
        return self.leave_queue() + self.go_to_lane(lane, side)

    def wait_in_queue(self) -> list[Step]:
        """Return the wait in the queue, in which the carrier moves up as others leave its line."""
        return [
            st.Say("waiting in the queue", "waiting"),
            st.DriveTo(x=self.queue.head, queueing=True),
        ]

    def leave_queue(self) -> list[Step]:
        """Return the drive from the queue's head onto the delivery road.

        Carriers of several lines take turns at the place `top`. Those of a single line follow each
        other, and need no place.
        """
        needs = []
        has_several_lines = self.layout.queue_places > self.queue.places
        if has_several_lines:
            needs.append(Gate([TOP], self.queue.head))
        return [st.DriveTo(x=self.east.x(self.D_ROAD), needs=needs), st.Face("SOUTH")]

    def go_to_lane(self, lane: int, side: Side) -> list[Step]:
        """Return the drive along the delivery road to a lane: around the bottom to the west."""
        top = [Gate([TOP], self.top_clear)]
        stop = side.y(self.layout.lane(lane).y, self.STOP)
        last = self._swept("D", lane, side)[-1]
        if side is self.east:
            return [self._along(side, "D", self._lanes(side, last=last), stop=stop, frees=top)]
        needs = [Gate(["corner/south-east"], self.inner_bottom + self.HOLD)]
        lanes = self._lanes(self.east)
        next_corner = [Gate(["corner/south-west"], self.CORNER_HOLD_X)]
        return [
            self._along(self.east, "D", lanes, stop=self.outer_bottom, needs=needs, frees=top),
            st.Face("WEST"),
            st.Free(["corner/south-east"]),
            st.DriveTo(x=self.west.x(self.D_ROAD), needs=next_corner),
            st.Face("NORTH"),
            st.Free(["corner/south-west"]),
            self._along(side, "D", self._lanes(side, last=last), stop=stop),
        ]

    def loop_to_full_bin(self, lane: int, side: Side) -> list[Step]:
        """Return the drive from the stop over the full-bin road to where the full bin is right
        behind.
        """
        blind = self.at_work(lane, side)
        frees = [Gate(self.held_at_stop(lane, side), side.x(self.LOOP_CLEAR))]
        return [
            *(st.Need([place]) for place in self.zone("F", lane, side)),
            st.Face(side.heading("WEST"), blind),
            st.DriveTo(x=side.x(self.COUPLING), frees=frees, blind_to=blind),
            st.Face(side.heading("NORTH"), blind),
            st.DriveTo(y=self.layout.lane(lane).y, blind_to=blind),
            st.Face(side.heading("EAST"), blind),
        ]

    def go_to_bay(self, lane: int, side: Side) -> list[Step]:
        """Return the drive with the full bin along the full-bin road to the bay.

        From the east side it leads around the bottom.
        """
        blind = self.at_work(lane, side)
        out: list[Step] = [
            st.DriveTo(x=side.x(self.F_ROAD), blind_to=blind),
            st.Face(side.heading("SOUTH"), blind),
        ]
        if side is self.west:
            return [*out, *self._north_to_bay(self._lanes(side, first=lane))]
        bottom = self.inner_bottom
        south_east = [Gate(["corner/south-east"], self.east.x(self.CORNER_CLEAR_X))]
        south_west = [
            Gate(["corner/south-west"], bottom + self.CORNER_CLEAR_Y),
            Gate(["turn/south-west"], bottom + self.TURN_CLEAR_Y),
        ]
        return [
            *out,
            self._along(side, "F", self._lanes(side, first=lane), stop=bottom),
            st.Need(["corner/south-east"]),
            st.Face("WEST"),
            st.DriveTo(x=self.west.x(self.F_ROAD), frees=south_east),
            st.Need(["corner/south-west", "turn/south-west"]),
            st.Face("NORTH"),
            *self._north_to_bay(self._lanes(self.west), south_west),
        ]

    def _north_to_bay(self, lanes: list[int], frees: Sequence[Gate] = ()) -> list[Step]:
        """Return the drive with the full bin north on the west side, past lanes, and to the bay.

        `frees`: the gates at which the carrier gives places back that it had before.
        """
        return [
            self._along(self.west, "F", lanes, stop=TOP_ROAD, frees=frees),
            st.Face("EAST"),
            self.to_bay(),
        ]

    def to_bay(self) -> st.DriveTo:
        """Return the drive along the top road to the first place of the bay that is free.

        If the bay has one place only, all other carriers wait behind it.
        """
        stop = self.layout.bay_stop
        if self.layout.scenario.bays == 1:
            return st.DriveTo(x=stop)
        return st.DriveToBay(x=stop, unloads_from=self.layout.unloads_from)

    def go_home(self, carrier: int) -> list[Step]:
        """Return the drive from the bay to the tail of the carrier's line, in which it moves up.

        `carrier`: the number of its place in the queue, from 1; see `number`.
        """
        first = self.layout.first_charging
        place = carrier
        is_charging = carrier > first > 0
        if is_charging:
            place = carrier - first
        return [
            st.Say("returning to the queue", "driving"),
            *self.go_to_line(place),
            st.Home(),
            *self.wait_in_queue(),
        ]

    def go_to_line(self, place: int) -> list[Step]:
        """Return the drive from the bay to the tail of the line that has a place.

        `place`: its number in the queue, from 1.
        """
        y = self.queue.place(place - 1).y
        along_top = st.DriveTo(x=self.queue.turn_off)
        if y == TOP_ROAD:
            return [along_top]
        heading = "NORTH"
        if y < TOP_ROAD:
            heading = "SOUTH"
        return [along_top, st.Face(heading), st.DriveTo(y=y), st.Face("EAST")]

    def haul(self) -> list[Step]:
        """Return the steps in which a carrier that has unloaded is away at the load-out.

        No steps if carriers do not drive there. The carrier stands in its line of the queue
        meanwhile.
        """
        load_out = self.layout.scenario.load_out
        if not load_out.is_of_carriers:
            return []
        return [st.Say("away at the load-out", "hauling"), st.Haul(self.queue.head)]

    def may_charge(self, carrier: int) -> list[Step]:
        """Return the step in which a carrier with a battery decides, after its job, to charge.

        If it must charge, it drives to the tail of its charging line. No step without batteries.
        """
        first = self.layout.first_charging
        if not first:
            return []
        # Of the charging line. A carrier that already has a number there keeps it.
        place = carrier
        if carrier <= first:
            place = carrier + first
        to_head = st.DriveTo(x=self.queue.head, queueing=True)
        go_and_charge: list[Step] = [
            st.Say("driving to the chargers", "driving"),
            *self.go_to_line(place),
            *self.haul(),
            # It moves up in its line while it charges. At the head it stands until it is full. The
            # last drive is that of `wait_in_queue`, and has no way left.
            st.Charge(),
            to_head,
            st.Charged(),
            st.Home(),
            st.Say("waiting in the queue", "waiting"),
            to_head,
        ]
        scenario = self.layout.scenario
        # What is left when it is back must not be less than the reserve.
        used = haul_charge(scenario, self.layout.machines["carrier"])
        return [st.MayCharge(scenario.carrying.battery.reserve + used, go_and_charge)]

    def number(self, carrier: int, y: float) -> int:
        """Return the number, from 1, of the place in the queue from which a carrier starts a job.

        `carrier`: its number, which is that of its place in a line to wait in. A carrier that has
        charged starts from its charging line. `y`: where the carrier is, m.
        """
        first = self.layout.first_charging
        if not first:
            return carrier
        charging = first + carrier
        is_there = abs(y - self.queue.place(charging - 1).y) < BESIDE
        if is_there:
            return charging
        return carrier

    def at_work(self, lane: int, side: Side) -> list[Box]:
        """Return what a carrier that works at a lane does not take for obstacles.

        That is the full bin, the empty bin that it delivered, and the picker.
        """
        y = self.layout.lane(lane).y
        return [
            box_of("bin", side.x(self.FULL_BIN), y),
            box_of("bin", side.x(self.D_ROAD), y),
            box_of("picker", side.x(self.WAITING), y),
        ]

    @property
    def top_clear(self) -> float:
        """y at which a carrier is out of the way of carriers that turn in from other lines, m."""
        return min(self.queue.used(self.layout.queue_places)) - self.TOP_CLEAR
