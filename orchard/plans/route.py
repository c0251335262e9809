"""The route that a scenario names: its roads, and the drives of pickers and carriers.

docs/traffic.md explains the roads and the places on them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, zip_longest
from math import inf
from typing import ClassVar, NamedTuple

from msgspec.structs import replace

from orchard.field.kinds import KINDS
from orchard.field.layout import EAST_START, Layout
from orchard.field.machines import haul_charge
from orchard.field.passes import Pass
from orchard.field.picking import Absences, absences_of
from orchard.field.queue import BESIDE, ONE_WAY, TOP_ROAD
from orchard.field.rows import Block
from orchard.field.scenario import Failure
from orchard.field.survey import ROUNDING
from orchard.plans import steps as st
from orchard.plans.robot import Gate, Step
from orchard.plans.sense import STOP_DISTANCE, Box

# The place where the queue's lines meet the delivery road.
TOP = "top"
_OPPOSITE = {"EAST": "WEST", "WEST": "EAST", "NORTH": "SOUTH", "SOUTH": "NORTH"}


@dataclass(frozen=True)
class Side:
    """One side of the rows.

    It turns a route's figures, for the east side and rows of the usual length, into x and y of
    either side. The west side is the east side after half a turn, or mirrored, about x = -1.5 with
    rows of the usual length.
    """

    name: str
    sign: int  #: +1 east, -1 west
    south: int  #: +1 if carriers that deliver drive south, -1 if north
    #: How much further east the east side lies than with rows of the usual length, m.
    shift: float = 0.0

    def x(self, east: float) -> float:
        """Return x, m, of a point that lies at x = `east` on the east side of usual rows."""
        if self.sign > 0:
            return east + self.shift
        return -3.0 - east

    def y(self, lane_y: float, along: float) -> float:
        """Return y of a point that lies `along` metres from a lane's centre line.

        It lies in the direction in which carriers deliver.
        """
        return lane_y - self.south * along

    def heading(self, east: str) -> str:
        """Return the heading on this side that corresponds to a heading on the east side."""
        if east in ("EAST", "WEST"):
            is_turned = self.sign < 0
        else:
            is_turned = self.south < 0
        if is_turned:
            return _OPPOSITE[east]
        return east

    def place(self, road: str, lane: int) -> str:
        """Return the name of a road's place at a lane: 'east/D/3'."""
        return f"{self.name}/{road}/{lane}"

    def crossing(self, lane: int) -> list[str]:
        """Return the places of both roads at a lane."""
        return [self.place("F", lane), self.place("D", lane)]


class Road(NamedTuple):
    """A road as drawings show it."""

    # The colours of plan.COLOURS are keyed by it.
    name: str
    # x, y of its centre line, m.
    points: list[tuple[float, float]]
    width: float  # m; 0: a column of places, drawn dashed


class OneWay:
    """All carriers drive one way.

    They drive south on the east side, west along the bottom, north on the west side, and east along
    the top. From the rows outwards lie the full bins in the lanes' mouths, the full-bin road F, the
    delivery road D, and the pickers' waiting places and their way to the next row. Each road is cut
    into one place a lane (`east/D/3`). A carrier has a place while any part of it or of its bin is
    in it. A picker that crosses has both roads' places at its lane.

    To change the route, derive a class, change figures or replace methods, and name it in the
    scenario: `route: my_package.MyRoute`. The class is called with the layout. Figures are metres
    on the east side, x with rows of the usual 70 m. docs/traffic.md derives them.
    """

    #: The queue in which its carriers wait, see orchard/field/queue.py.
    QUEUE: ClassVar[str] = ONE_WAY
    #: Side -> +1 if carriers that deliver drive south there, -1 if north.
    SOUTH: ClassVar[Mapping[str, int]] = {
        "east": 1,
        "west": -1,
    }
    # User-defined steps that the drives use.
    Steps: ClassVar[Sequence[type[Step]]] = ()
    #: x of the delivery road: a picker's coupling point lies on it.
    D_ROAD = 38.75
    #: x of the full-bin road.
    F_ROAD = 36.25
    #: x at which a picker waits, and of its way to the next row.
    WAITING = EAST_START
    #: x at which a picker stays after its last row.
    PARKED = 44.0
    #: x at which a picker turns, in close rows, to come back to its row: its bin swings 0.3 m off
    #: the west fence, and off one that turns at `WAITING` in the next row.
    ASIDE = 43.4
    #: x of the full bin that a picker has left.
    FULL_BIN = 32.25
    #: x of a carrier that couples the full bin.
    COUPLING = 34.15
    #: Distance past the lane at which a delivering carrier stops, its bin on the lane's centre
    #: line; its loop begins there.
    STOP = 1.9
    #: Distance before a lane at which a carrier waits while it may not enter the lane's place.
    HOLD = 3.75
    #: Distance past a lane at which a carrier's tail has left the place.
    CLEAR = 5.7
    #: Road -> how far past its lane an exchange sweeps, to the lanes there: it needs their places.
    ZONES: ClassVar[Mapping[str, float]] = {"D": 5.3, "F": 5.3}
    #: Distance from a lane, south of the one into which a picker turns, within which a picker that
    #: drives out and turns there would meet it. It needs that lane's place on D too.
    TURN_ZONE = 4.35
    #: Distance north of such a lane at which a picker waits to turn in.
    TURN_HOLD = 4.15
    #: x at which a delivering carrier that turned in towards the lane has left the delivery road.
    LOOP_CLEAR = 36.8
    #: x at which a picker that drives into a row, and its bin, have left these roads.
    PICKER_CLEAR_D = 34.4
    PICKER_CLEAR_F = 32.4
    #: x at which a picker that parks, and its bin, have left the delivery road.
    PARKING_CLEAR = 42.5
    #: x at which a picker waits to cross the roads; its front is at 34.95.
    PICKER_HOLD = 33.7
    #: The same, and x at which one that drives in has left the full-bin road, if the exchange at a
    #: row nearer than `LOOP_ZONE` sweeps over it there.
    INNER_HOLD = 32.1
    INNER_CLEAR_F = 32.0
    LOOP_ZONE = 3.95
    #: Distance of the full-bin road along the bottom, south of the last tree line.
    F_BOTTOM = 3.5
    #: The same of the delivery road.
    D_BOTTOM = 5.6
    #: From the last lane to the last tree line at least: with closer rows, both roads lie as if the
    #: line were there.
    LAST_LANE = 2.65
    #: x before which a carrier on the outer bottom road waits for the south-west corner.
    CORNER_HOLD_X = -35.5
    #: x on the inner bottom road at which a full bin has left the south-east corner.
    CORNER_CLEAR_X = 34.7
    #: Distance north of that road at which a full bin has left the south-west corner.
    CORNER_CLEAR_Y = 1.4
    #: Distance north of it at which a full bin is beyond what the next carrier's turn there sweeps.
    TURN_CLEAR_Y = 3.75
    #: Distance south of the southernmost line in use at which a carrier has left the place `top`.
    TOP_CLEAR = 3.75

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.queue = layout.queue
        self.east = Side("east", 1, self.SOUTH["east"], layout.shift)
        self.west = Side("west", -1, self.SOUTH["west"], layout.shift)
        self.sides = {"east": self.east, "west": self.west}
        assert self.queue.lines[0] == TOP_ROAD
        assert min(self.queue.lines) - self.TOP_CLEAR > layout.tree_lines[0]

    # -- what plans, bounds and dispatch ask for

    def harvest(self, block: Block) -> list[Step]:
        """Return a picker's whole work: pass after pass through its rows.

        Where its bin is full it leaves it, and fetches an empty one.
        """
        passes = self.layout.passes(block)
        steps = self.foresee(passes[0]) + self.come_in(block)
        came_over = block.start == "east"
        for current, after in zip_longest(passes, passes[1:]):
            steps += self.pick(current, came_over=came_over)
            steps += self.go_on(current, after)
            came_over = True
        return steps

    def go_on(self, current: Pass, after: Pass | None) -> list[Step]:
        """Return a picker's way from the end of one pass to the head of the next.

        `after`: the next pass; None: the way leads to where the picker parks.
        """
        side = self.sides[current.end]
        if current.leaves_bin:
            steps = self.swap_bins(current.row, side)
        else:
            steps = self.drive_out(current.row, side)
        if after is None:
            return steps + self.park(current.row, side)
        return steps + self.foresee(after) + self.go_to_next_row(current.row, after.row, side)

    def foresee(self, current: Pass) -> list[Step]:
        """Return the steps in which a picker prepares a pass.

        It announces to its bin where it will be left, unless each row fills one; and it sets from
        where it picks, if that is inside the row.
        """
        steps: list[Step] = []
        if self.layout.scenario.bin_metres and current.leaves_bin:
            steps.append(st.Announce(current.row, current.end, current.fill))
        if current.is_inside:
            steps.append(st.BeginPickingAt(current.begin))
        return steps

    def fetch(self, carrier: int, lane: int, side: Side, picker: str, full_bin: str) -> list[Step]:
        """Return a carrier's whole job.

        It brings an empty bin to the picker, the full bin to the bay, and drives back to the queue.
        `carrier`: see `number`.
        """
        job: list[Step] = [
            st.Confirmed(full_bin, [st.Home(), *self.wait_in_queue()]),
            st.Say(f"bringing an empty bin to {picker}", "driving"),
            *_once_left(self.approach(lane, side, carrier), full_bin, side.place("D", lane)),
            st.Deliver(picker),
            *self.loop_to_full_bin(lane, side),
            st.TakeBin(full_bin),
            st.Say(f"taking {full_bin} to the bay", "hauling"),
            *self.go_to_bay(lane, side),
            st.Say(f"unloading {full_bin}", "unloading"),
            st.Unload(),
            *self.may_charge(carrier),
            *self.go_home(carrier),
        ]
        carrying = self.layout.scenario.carrying
        before_drive = self.may_fail(carrying.failure)
        steps: list[Step] = []
        for step in job:
            if isinstance(step, st.DriveTo) and not step.queueing:
                steps += before_drive
            elif isinstance(step, st.Home):
                steps += self.haul()
            steps.append(step)
        return steps

    def approach(self, lane: int, side: Side, carrier: int = 1) -> list[Step]:
        """Return a carrier's way from the queue's head to where it leaves the empty bin."""
        return self.leave_queue() + self.go_to_lane(lane, side)

    def wait_in_queue(self) -> list[Step]:
        """Wait in the queue, and move up to the head of the line as the others leave."""
        return [
            st.Say("waiting in the queue", "waiting"),
            st.DriveTo(x=self.queue.head, queueing=True),
        ]

    def distance(self, x: float, y: float, lane: int, side: Side) -> float:
        """Return the metres by road from (x, y) in the queue to a lane's stop."""
        east = self.east.x(self.D_ROAD)
        to_road = east - x
        stop = side.y(self.layout.lane(lane).y, self.STOP)
        if side is self.east:
            return to_road + y - stop
        bottom = self.outer_bottom
        west = self.west.x(self.D_ROAD)
        return to_road + (y - bottom) + (east - west) + stop - bottom

    def roads(self) -> list[Road]:
        """Return the roads, for drawings."""
        inner = self.inner_bottom
        outer = self.outer_bottom
        top = self.layout.lane(1).y
        bottom = self.layout.lanes[-1].y
        head = self.queue.head
        # x of both roads on the east and on the west side.
        d = self.east.x(self.D_ROAD)
        f = self.east.x(self.F_ROAD)
        west_d = self.west.x(self.D_ROAD)
        west_f = self.west.x(self.F_ROAD)
        loop_d = [
            (head, TOP_ROAD),
            (d, TOP_ROAD),
            (d, outer),
            (west_d, outer),
            (west_d, top + self.STOP),
        ]
        loop_f = [(f, top), (f, inner), (west_f, inner), (west_f, TOP_ROAD), (head, TOP_ROAD)]
        roads = [Road("D", loop_d, 1.5), Road("F", loop_f, 1.5)]
        for side in self.sides.values():
            x = side.x(self.WAITING)
            roads.append(Road("picker", [(x, top), (x, bottom)], 0.0))
        return roads

    def holds(self) -> list[tuple[str, float, float]]:
        """Return where fronts of carriers stop while a lane's place is taken, for drawings.

        Each is the road, x and y.
        """
        front = KINDS["carrier"].length / 2
        places = []
        for side in self.sides.values():
            for lane in self.layout.lanes:
                y = side.y(lane.y, front - self.HOLD)
                places.append(("D", side.x(self.D_ROAD), y))
                places.append(("F", side.x(self.F_ROAD), y))
        return places

    # -- pickers

    def opposite(self, side: Side) -> Side:
        """Return the other side of the rows."""
        if side is self.east:
            return self.west
        return self.east

    def end(self, row: int, side: Side) -> float:
        """Return x of a row's end on this side, m.

        In a surveyed orchard it may lie further in than the furthest one there.
        """
        lane = self.layout.lane(row)
        if side is self.east:
            return lane.east
        return lane.west

    def hold(self, row: int, side: Side) -> float:
        """Return x at which a picker waits to cross the roads, m.

        It is the end of its row, if that lies just before `PICKER_HOLD`.
        """
        usual = side.x(self.PICKER_HOLD)
        if self._is_swept(row, side):
            usual = side.x(self.INNER_HOLD)
        end = self.end(row, side)
        is_just_before = 0.0 < side.sign * (usual - end) < STOP_DISTANCE
        if is_just_before:
            return end
        return usual

    def _is_swept(self, row: int, side: Side) -> bool:
        """Whether the exchange at the row before sweeps over pickers in the mouth of a row."""
        return bool(self._within(row, self.LOOP_ZONE, past=-side.south))

    def come_in(self, block: Block) -> list[Step]:
        """Return a picker's way from its start to the head of its first row.

        In the west it starts there, with its place if the exchange at the row before could sweep
        over it; in the east it drives over the roads.
        """
        row = block.rows[0]
        if block.start == "west" and self._is_swept(row, self.west):
            return [st.Need([self.west.place("F", row)])]
        if block.start == "west":
            return []
        return [st.Say(f"driving to row {row}", "driving"), *self.turn_in(row, self.east)]

    def pick(self, current: Pass, came_over: bool) -> list[Step]:
        """Drive through a row, and pick a part of it.

        Leave a full bin in the lane's mouth. `came_over`: whether the picker has come over the
        roads.
        """
        row = current.row
        side = self.sides[current.end]
        opposite = self.opposite(side)
        end = self.end(row, side)
        speed = self.layout.lane(row).picking_speed
        frees: list[Gate] = []
        if came_over or self._is_swept(row, opposite):
            frees = self.cleared(row, opposite)
        cross = self.cross(side, row, self.hold(row, side))
        through = st.Say(f"driving through row {row}", "driving")
        steps: list[Step] = []
        if current.begin != self.end(row, opposite):
            steps += [through, st.DriveTo(x=current.begin, needs=cross, frees=frees)]
        steps.append(st.Say(f"picking row {row}", "picking"))
        scenario = self.layout.scenario
        absences = absences_of(scenario, self.layout.picker_of(row))
        steps += self.may_fail(scenario.picking.failure, absences)
        steps.append(st.DriveTo(x=current.stop, speed=speed, needs=cross, frees=frees))
        if current.stop != end:
            steps += [through, st.DriveTo(x=end, needs=cross, frees=frees)]
        if current.leaves_bin:
            steps += self.leave(current, side, cross)
        return steps

    def leave(self, current: Pass, side: Side, cross: list[Gate]) -> list[Step]:
        """Drive to the lane's mouth, and leave the bin there."""
        if current.is_full:
            word = "full"
            metres = self.layout.metres_per_bin
        else:
            word = "last"
            metres = current.fill
        return [
            st.Say(f"leaving the {word} bin of row {current.row}", "handling a bin"),
            st.DriveTo(x=side.x(self.FULL_BIN + KINDS["picker"].tows), needs=cross),
            *self.fill(metres),
            st.LeaveBin(),
        ]

    def drive_out(self, row: int, side: Side) -> list[Step]:
        """Drive out of the lane and over the roads with a bin that goes on with the next row."""
        out = st.DriveTo(x=side.x(self.WAITING), needs=self.cross(side, row, self.hold(row, side)))
        return [
            st.Say(f"driving out of row {row}", "driving"),
            out,
            st.Free([side.place("F", row)]),
        ]

    def may_fail(self, failure: Failure, absences: Absences = ()) -> list[Step]:
        """Return the step before a drive, if its robot may fail on it or leave.

        `absences`: when the robot is away.
        """
        if failure.mean_between is None and not absences:
            return []
        seed = self.layout.scenario.seed
        return [st.MayFail(seed, failure.mean_between or 0.0, failure.mean_repair, absences)]

    def fill(self, metres: float) -> list[Step]:
        """Return the step before a picker leaves its bin, if it is not sure of its place.

        `metres`: what the bin shall hold.
        """
        sensors = self.layout.scenario.sensors
        deviation = sensors.gnss.white + sensors.gnss.bias
        if not deviation:
            return []
        return [st.Fill(3.0 * deviation, metres)]

    def cross(self, side: Side, lane: int, at: float) -> list[Gate]:
        """Return the places that a picker needs to drive over both roads, from x = `at` on."""
        if self.takes_both:
            return [Gate(side.crossing(lane), at)]
        return [Gate([side.place("D", lane)], at), Gate([side.place("F", lane)], at)]

    def swap_bins(self, row: int, side: Side) -> list[Step]:
        """Drive out of the lane and over the roads, and wait there for an empty bin."""
        return [
            st.DriveTo(x=side.x(self.WAITING)),
            st.Free(side.crossing(row)),
            st.Say("waiting for an empty bin", "waiting"),
            st.FetchEmpty(side.place("D", row)),
        ]

    def go_to_next_row(self, row: int, next_row: int, side: Side) -> list[Step]:
        """Turn south, drive over to the next row, and turn in once both roads are free there.

        Where carriers drive north the turn swings the bin over the place of the one that delivered,
        so that one must have left it. Before a picker comes back to the same row, that carrier must
        hold road F there: it then takes the full bin out of the lane's mouth first.
        """
        wait: list[Step] = []
        swings_over_place = side.south < 0 or next_row == row
        if swings_over_place:
            wait.append(st.Alone(side.place("D", row)))
        heading = "NORTH"
        if next_row >= row:
            heading = "SOUTH"
        turn: list[Step] = [st.Face(heading), st.Free([side.place("D", row)])]
        over = st.DriveTo(y=self.layout.lane(next_row).y)
        if next_row == row and self._turn_zone(row):
            turn = self._turn_aside(row, side)
        elif next_row > row and self.has_zones:
            turn = [st.Face(heading)]
            over = self._over_to(next_row, side)
        return [
            st.Say(f"driving to row {next_row}", "driving"),
            *wait,
            *turn,
            over,
            *self.turn_in(next_row, side),
        ]

    def _over_to(self, row: int, side: Side) -> st.DriveTo:
        """Drive south from the row before to the head of a row, where rows are close.

        The picker has the row before's place until one that turns in north of it cannot meet it.
        It stops for the places that its own turn needs where one that turns out cannot meet it.
        """
        y = self.layout.lane(row).y
        before = self.layout.lane(row - 1).y
        leaves = before - max(0.0, self.TURN_ZONE - self._to_the_south(row - 2))
        waits = y + max(0.0, self.TURN_HOLD - self._to_the_south(row))
        needs = [Gate(need.places, waits) for need in self._need_to_turn(row, side)]
        frees = [Gate([side.place("D", row - 1)], leaves)]
        return st.DriveTo(y=y, needs=needs, frees=frees)

    def _turn_aside(self, row: int, side: Side) -> list[Step]:
        """Drive away from the roads and turn there, to come back to the same row.

        At the usual place a picker that drives out of the row to the south would meet this one.
        """
        place = [side.place("D", row)]
        aside = st.DriveTo(x=side.x(self.ASIDE), frees=[Gate(place, side.x(self.PARKING_CLEAR))])
        on_d = self._need_to_turn(row, side)
        return [st.Face(side.heading("EAST")), aside, st.Free(place), *on_d, st.Face("SOUTH")]

    def turn_in(self, row: int, side: Side) -> list[Step]:
        """Turn to the head of a row, and drive there, once both roads are free."""
        turn: list[Step] = [st.Face(side.heading("WEST"))]
        for lane in self._turn_zone(row):
            turn.append(st.Free([side.place("D", lane)]))
        drive = st.DriveTo(x=self.end(row, side), frees=self.cleared(row, side))
        if self.takes_both:
            return [st.Need(side.crossing(row)), *turn, drive]
        on_d = self._need_to_turn(row, side)
        return [*on_d, st.Need([side.place("F", row)]), *turn, drive]

    def _need_to_turn(self, row: int, side: Side) -> list[st.Need]:
        """Return the steps that ask for D's places to turn into a row, in the direction of D."""
        lanes = [row, *self._turn_zone(row)]
        return [st.Need([side.place("D", lane)]) for lane in lanes[:: side.south]]

    def _turn_zone(self, row: int) -> list[int]:
        """Return the lane from which a picker that turns out would meet one that turns in."""
        return self._within(row, self.TURN_ZONE, past=1)

    def _to_the_south(self, row: int) -> float:
        """Return the distance from a lane to the next one in the south, m; far if one is none."""
        lanes = self.layout.lanes
        if not 0 < row < len(lanes):
            return inf
        return lanes[row - 1].y - lanes[row].y

    def cleared(self, row: int, side: Side) -> list[Gate]:
        """Return where a picker that drives into a row gives the places of both roads back."""
        clear_f = self.PICKER_CLEAR_F
        if self._is_swept(row, side):
            clear_f = self.INNER_CLEAR_F
        return [
            Gate([side.place("D", row)], side.x(self.PICKER_CLEAR_D)),
            Gate([side.place("F", row)], side.x(clear_f)),
        ]

    def park(self, row: int, side: Side) -> list[Step]:
        """After the last row drive off the roads with the empty bin, and stay there."""
        place = [side.place("D", row)]
        drive = st.DriveTo(x=side.x(self.PARKED), frees=[Gate(place, side.x(self.PARKING_CLEAR))])
        return [st.Say("parking", "driving"), drive, st.Free(place), st.Say("finished", "resting")]

    # -- carriers

    def leave_queue(self) -> list[Step]:
        """Drive onto the delivery road.

        Carriers of several lines take turns at `top`; those of one line follow each other.
        """
        needs = []
        has_several_lines = self.layout.queue_places > self.queue.places
        if has_several_lines:
            needs.append(Gate([TOP], self.queue.head))
        return [st.DriveTo(x=self.east.x(self.D_ROAD), needs=needs), st.Face("SOUTH")]

    def go_to_lane(self, lane: int, side: Side) -> list[Step]:
        """Drive along the delivery road to a lane, to one on the west side around the bottom."""
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
        """Drive from the stop over the full-bin road to where the full bin stands right behind."""
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
        """Take the full bin along the full-bin road to the bay.

        From the east side the way leads around the bottom.
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

    def go_home(self, carrier: int) -> list[Step]:
        """Drive from the bay to the tail of the carrier's line of the queue, and move up."""
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

    def haul(self) -> list[Step]:
        """Return the steps of a carrier that has unloaded and is away, in its line of the queue."""
        load_out = self.layout.scenario.load_out
        if not load_out.is_of_carriers:
            return []
        return [st.Say("away at the load-out", "hauling"), st.Haul(self.queue.head)]

    def may_charge(self, carrier: int) -> list[Step]:
        """Return the step after a job, if carriers have batteries.

        Where it must charge, a carrier drives to the tail of its charging line.
        """
        first = self.layout.first_charging
        if not first:
            return []
        place = carrier
        if carrier <= first:
            place = carrier + first
        to_head = st.DriveTo(x=self.queue.head, queueing=True)
        go_and_charge: list[Step] = [
            st.Say("driving to the chargers", "driving"),
            *self.go_to_line(place),
            *self.haul(),
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

    def go_to_line(self, place: int) -> list[Step]:
        """Drive from the bay to the tail of the line with this place, counted from 1."""
        y = self.queue.place(place - 1).y
        along_top = st.DriveTo(x=self.queue.turn_off)
        if y == TOP_ROAD:
            return [along_top]
        heading = "SOUTH" if y < TOP_ROAD else "NORTH"
        return [along_top, st.Face(heading), st.DriveTo(y=y), st.Face("EAST")]

    def number(self, carrier: int, y: float) -> int:
        """Return the number, from 1, of the place in the queue that stands for a carrier.

        It is its own, or in a charging line that in it. `y`: where the carrier is, m.
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

        That is the bins there, and the picker.
        """
        y = self.layout.lane(lane).y
        return [
            _box("bin", side.x(self.FULL_BIN), y),
            _box("bin", side.x(self.D_ROAD), y),
            _box("picker", side.x(self.WAITING), y),
        ]

    # -- the roads

    @property
    def top_clear(self) -> float:
        """y at which a carrier is out of the way of carriers that turn in from other lines, m."""
        return min(self.queue.used(self.layout.queue_places)) - self.TOP_CLEAR

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
        """y south of which the bottom roads lie, m."""
        line = self.layout.tree_lines[-1]
        lacks = self.LAST_LANE - (self.layout.lanes[-1].y - line)
        if lacks < ROUNDING:
            return line
        return line - lacks

    @cached_property
    def has_zones(self) -> bool:
        """Whether rows are so close that an exchange, or a picker, needs places of other lanes."""
        reach = max(*self.ZONES.values(), self.TURN_ZONE) - ROUNDING
        return any(north.y - south.y < reach for north, south in pairwise(self.layout.lanes))

    @property
    def takes_both(self) -> bool:
        """Whether a picker that crosses asks for the places of both roads at once.

        Else it asks for one after the other, D first. It must where exchanges need several places.
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
        """Return the lanes nearer to a lane than `reach`, m, on one side: south of it if past = 1.

        The nearest one comes first.
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
        """Return the places on D that a carrier has where it stops to deliver."""
        places = self.zone("D", lane, side)
        reach = self.CLEAR - self.STOP + 2.0 * ROUNDING
        for behind in self._within(lane, reach, past=-side.south):
            places.append(side.place("D", behind))
        return places

    def _lanes(self, side: Side, first: int | None = None, last: int | None = None) -> list[int]:
        """Return the lanes that a carrier passes on this side, in its order.

        They are all, or those from `first` on, or those up to `last`.
        """
        lanes = [lane.number for lane in self.layout.lanes][:: side.south]
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
        """Drive along a road past lanes, up to `stop`.

        The carrier has each lane's place from `HOLD` before the lane until its tail has left the
        place.
        """
        enter = []
        leave = []
        for number in lanes:
            place = [side.place(road, number)]
            y = self.layout.lane(number).y
            enter.append(Gate(place, side.y(y, -self.HOLD)))
            leave.append(Gate(place, side.y(y, self.CLEAR)))
        return st.DriveTo(y=stop, needs=[*enter, *needs], frees=[*leave, *frees])

    def _north_to_bay(self, lanes: list[int], frees: Sequence[Gate] = ()) -> list[Step]:
        """Take the full bin north on the west side, past these lanes, and to the bay."""
        return [
            self._along(self.west, "F", lanes, stop=TOP_ROAD, frees=frees),
            st.Face("EAST"),
            self.to_bay(),
        ]

    def to_bay(self) -> st.DriveTo:
        """Drive along the top road to the first place of the bay that is free.

        With one place all others wait behind it.
        """
        stop = self.layout.bay_stop
        if self.layout.scenario.bays == 1:
            return st.DriveTo(x=stop)
        return st.DriveToBay(x=stop, unloads_from=self.layout.unloads_from)


def _once_left(approach: list[Step], full_bin: str, place: str) -> list[Step]:
    """Let a carrier ask for a lane's place only after the full bin is left there.

    Else it would keep the picker in its row.
    """
    steps: list[Step] = []
    for step in approach:
        if isinstance(step, st.DriveTo):
            needs = list(step.needs)
            for number, gate in enumerate(needs):
                if place in gate.places:
                    needs[number] = replace(gate, bin=full_bin)
            steps.append(replace(step, needs=needs))
        else:
            steps.append(step)
    return steps


def _box(kind: str, x: float, y: float) -> Box:
    """Return the box of a body of a kind at (x, y), m, that faces east or west."""
    return Box(x, y, KINDS[kind].length / 2, KINDS[kind].width / 2)
