"""The route that a scenario names: roads, the places on them, and the drives of pickers and carriers. docs/traffic.md explains it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import ClassVar, NamedTuple

from msgspec.structs import replace

from orchard.agents import steps as st
from orchard.agents.robot import Gate, Step
from orchard.agents.sense import STOP_DISTANCE, Box
from orchard.field.kinds import KINDS
from orchard.field.layout import EAST_START, Layout
from orchard.field.passes import Pass
from orchard.field.queue import BESIDE, ONE_WAY, TOP_ROAD
from orchard.field.rows import Block
from orchard.field.scenario import Failure

TOP = "top"  # the place where the queue's lines meet the delivery road
_OPPOSITE = {"EAST": "WEST", "WEST": "EAST", "NORTH": "SOUTH", "SOUTH": "NORTH"}


@dataclass(frozen=True)
class Side:
    """One side of the rows: it turns a route's figures, for the east side and rows of the usual length, into x and y of either.

    The west side is the east side after half a turn, or mirrored, about x = -1.5 with rows of the usual length.
    """

    name: str
    sign: int  #: +1 east, -1 west
    south: int  #: +1 if carriers that deliver drive south, -1 if north
    shift: float = (
        0.0  #: how much further east the east side lies than with rows of the usual length, m
    )

    def x(self, east: float) -> float:
        """The x, m, of a point that lies at x = `east` on the east side of rows of the usual length."""
        return east + self.shift if self.sign > 0 else -3.0 - east

    def y(self, lane_y: float, along: float) -> float:
        """The y of a point that lies `along` metres from a lane's centre line, in the direction in which carriers deliver."""
        return lane_y - self.south * along

    def heading(self, east: str) -> str:
        """The heading on this side that corresponds to a heading on the east side."""
        turned = self.sign < 0 if east in ("EAST", "WEST") else self.south < 0
        return _OPPOSITE[east] if turned else east

    def place(self, road: str, lane: int) -> str:
        """The name of a road's place at a lane: 'east/D/3'."""
        return f"{self.name}/{road}/{lane}"

    def crossing(self, lane: int) -> list[str]:
        """The places of both roads at a lane."""
        return [self.place("F", lane), self.place("D", lane)]


class Road(NamedTuple):
    """A road as drawings show it."""

    name: str  # the colours of plan.COLOURS are keyed by it
    points: list[tuple[float, float]]  # x, y of its centre line, m
    width: float  # m; 0: a column of places, drawn dashed


class OneWay:
    """All carriers drive one way: south on the east side, west along the bottom, north on the west side, east along the top.

    From the rows outwards lie the full bins in the lanes' mouths, the full-bin road F, the delivery road D, and the pickers' waiting places
    and their way to the next row. Each road is cut into one place a lane (`east/D/3`). A carrier has a place while any part of it or of
    its bin is in it. A picker that crosses has both roads' places at its lane.

    To change the route, derive a class, change figures or replace methods, and name it in the scenario: `route: my_package.MyRoute`.
    The class is called with the layout. Figures are metres on the east side, x with rows of the usual 70 m. docs/traffic.md derives them.
    """

    QUEUE: ClassVar[str] = (
        ONE_WAY  #: the queue in which its carriers wait, see orchard/field/queue.py
    )
    SOUTH: ClassVar[Mapping[str, int]] = {
        "east": 1,
        "west": -1,
    }  #: side -> +1 if carriers that deliver drive south there, -1 if north
    Steps: ClassVar[Sequence[type[Step]]] = ()  # user-defined steps that the drives use
    D_ROAD = 38.75  #: x of the delivery road: a picker's coupling point lies on it
    F_ROAD = 36.25  #: x of the full-bin road
    WAITING = EAST_START  #: x at which a picker waits, and of its way to the next row
    PARKED = 44.0  #: x at which a picker stays after its last row
    FULL_BIN = 32.25  #: x of the full bin that a picker has left
    COUPLING = 34.15  #: x of a carrier that couples the full bin
    STOP = 1.9  #: distance past the lane at which a delivering carrier stops, its bin on the lane's centre line; its loop begins there
    HOLD = 3.75  #: distance before a lane at which a carrier waits while it may not enter the lane's place
    CLEAR = 5.7  #: distance past a lane at which a carrier's tail has left the place
    LOOP_CLEAR = 36.8  #: x at which a delivering carrier that turned in towards the lane has left the delivery road
    PICKER_CLEAR_D, PICKER_CLEAR_F = (
        34.4,
        32.4,
    )  #: x at which a picker that drives into a row, and its bin, have left these roads
    PARKING_CLEAR = (
        42.5  #: x at which a picker that parks, and its bin, have left the delivery road
    )
    PICKER_HOLD = 33.7  #: x at which a picker waits to cross the roads; its front is at 34.95
    F_BOTTOM, D_BOTTOM = (
        3.5,
        5.6,
    )  # distances of the roads along the bottom, south of the last tree line
    CORNER_HOLD_X = (
        -35.5
    )  #: x before which a carrier on the outer bottom road waits for the south-west corner
    CORNER_CLEAR_X = (
        34.7  #: x on the inner bottom road at which a full bin has left the south-east corner
    )
    CORNER_CLEAR_Y = (
        1.4  #: distance north of that road at which a full bin has left the south-west corner
    )
    TURN_CLEAR_Y = 3.75  #: distance north of it at which a full bin is beyond what the next carrier's turn there sweeps
    TOP_CLEAR = 3.75  #: distance south of the southernmost line in use at which a carrier has left the place `top`

    def __init__(self, layout: Layout) -> None:
        self.layout, self.queue = layout, layout.queue
        self.east, self.west = (
            Side("east", 1, self.SOUTH["east"], layout.shift),
            Side("west", -1, self.SOUTH["west"], layout.shift),
        )
        self.sides = {"east": self.east, "west": self.west}
        assert (
            self.queue.lines[0] == TOP_ROAD
            and min(self.queue.lines) - self.TOP_CLEAR > layout.tree_lines[0]
        )

    # -- what plans, bounds and dispatch ask for

    def harvest(self, block: Block) -> list[Step]:
        """A picker's whole work: pass after pass through its rows. Where its bin is full it leaves it, and fetches an empty one."""
        passes = self.layout.passes(block)
        steps = self.foresee(passes[0]) + self.come_in(block)
        for count, (one, after) in enumerate(zip_longest(passes, passes[1:])):
            steps += self.pick(one, came_over=count > 0 or block.start == "east") + self.go_on(
                one, after
            )
        return steps

    def go_on(self, one: Pass, after: Pass | None) -> list[Step]:
        """A picker's way from the end of one pass to the head of the next; None: to where it parks."""
        side = self.sides[one.end]
        steps = self.swap_bins(one.row, side) if one.leaves_bin else self.drive_out(one.row, side)
        return steps + (
            self.foresee(after) + self.go_to_next_row(one.row, after.row, side)
            if after
            else self.park(one.row, side)
        )

    def foresee(self, one: Pass) -> list[Step]:
        """The steps in which a picker announces to its bin where it will be left, unless each row fills one, and sets where it picks."""
        announce = (
            [st.Announce(one.row, one.end, one.fill)]
            if self.layout.scenario.bin_metres and one.leaves_bin
            else []
        )
        return announce + ([st.PickFrom(one.begin)] if one.is_inside else [])

    def fetch(self, carrier: int, lane: int, side: Side, picker: str, full_bin: str) -> list[Step]:
        """A carrier's whole job: an empty bin to the picker, the full bin to the bay, back to the queue. `carrier`: see `number`."""
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
        fails = self.may_fail(self.layout.scenario.carrying.failure)
        return [
            part
            for step in job
            for part in (
                [*fails, step] if isinstance(step, st.DriveTo) and not step.queueing else [step]
            )
        ]

    def approach(self, lane: int, side: Side, carrier: int = 1) -> list[Step]:
        """A carrier's way from the queue's head to the stop at which it leaves the empty bin."""
        return self.leave_queue() + self.go_to_lane(lane, side)

    def wait_in_queue(self) -> list[Step]:
        """Wait in the queue, and move up to the head of the line as the others leave."""
        return [
            st.Say("waiting in the queue", "waiting"),
            st.DriveTo(x=self.queue.head, queueing=True),
        ]

    def distance(self, x: float, y: float, lane: int, side: Side) -> float:
        """Metres by road from (x, y) in the queue to a lane's stop."""
        east = self.east.x(self.D_ROAD)
        to_road = east - x
        if side is self.east:
            return to_road + y - side.y(self.layout.lane(lane).y, self.STOP)
        bottom = self.outer_bottom
        return (
            to_road
            + (y - bottom)
            + (east - self.west.x(self.D_ROAD))
            + side.y(self.layout.lane(lane).y, self.STOP)
            - bottom
        )

    def roads(self) -> list[Road]:
        """The roads, for drawings."""
        inner, outer, top, head = (
            self.inner_bottom,
            self.outer_bottom,
            self.layout.lane(1).y,
            self.queue.head,
        )
        (d, west_d), (f, west_f) = (
            (self.east.x(x), self.west.x(x)) for x in (self.D_ROAD, self.F_ROAD)
        )
        loop_d = [
            (head, TOP_ROAD),
            (d, TOP_ROAD),
            (d, outer),
            (west_d, outer),
            (west_d, top + self.STOP),
        ]
        loop_f = [(f, top), (f, inner), (west_f, inner), (west_f, TOP_ROAD), (head, TOP_ROAD)]
        columns = [
            [(side.x(self.WAITING), y) for y in (top, self.layout.lanes[-1].y)]
            for side in self.sides.values()
        ]
        return [
            Road("D", loop_d, 1.5),
            Road("F", loop_f, 1.5),
            *(Road("picker", column, 0.0) for column in columns),
        ]

    def holds(self) -> list[tuple[str, float, float]]:
        """Where fronts of carriers stop while a lane's place is taken, for drawings: road, x, y."""
        front = KINDS["carrier"].length / 2
        return [
            (road, side.x(x), side.y(lane.y, front - self.HOLD))
            for side in self.sides.values()
            for lane in self.layout.lanes
            for road, x in (("D", self.D_ROAD), ("F", self.F_ROAD))
        ]

    # -- pickers

    def end(self, row: int, side: Side) -> float:
        """x of a row's end on this side, m. In a surveyed orchard it may lie further in than the furthest one there."""
        lane = self.layout.lane(row)
        return lane.east if side is self.east else lane.west

    def hold(self, row: int, side: Side) -> float:
        """x at which a picker waits to cross the roads, m: at the end of its row, if that lies just before `PICKER_HOLD`."""
        at, end = side.x(self.PICKER_HOLD), self.end(row, side)
        return end if 0.0 < side.sign * (at - end) < STOP_DISTANCE else at

    def come_in(self, block: Block) -> list[Step]:
        """A picker's way from its start to the head of its first row. In the west it starts there; in the east it drives over the roads."""
        row = block.rows[0]
        return (
            []
            if block.start == "west"
            else [st.Say(f"driving to row {row}", "driving"), *self.turn_in(row, self.east)]
        )

    def pick(self, one: Pass, came_over: bool) -> list[Step]:
        """Drive through a row, over a part of it at the picking speed, and leave a full bin in the lane's mouth."""
        row, side, end = one.row, self.sides[one.end], self.end(one.row, self.sides[one.end])
        other = self.west if side is self.east else self.east
        frees = self.cleared(row, other) if came_over else []
        cross = self.cross(side, row, self.hold(row, side))
        through = st.Say(f"driving through row {row}", "driving")
        return [
            *(
                []
                if one.begin == self.end(row, other)
                else [through, st.DriveTo(x=one.begin, needs=cross, frees=frees)]
            ),
            st.Say(f"picking row {row}", "picking"),
            *self.may_fail(self.layout.scenario.picking.failure),
            st.DriveTo(
                x=one.stop, speed=self.layout.lane(row).picking_speed, needs=cross, frees=frees
            ),
            *([] if one.stop == end else [through, st.DriveTo(x=end, needs=cross, frees=frees)]),
            *(self.leave(one, side, cross) if one.leaves_bin else []),
        ]

    def leave(self, one: Pass, side: Side, cross: list[Gate]) -> list[Step]:
        """Drive to the lane's mouth, and leave the bin there."""
        return [
            st.Say(
                f"leaving the {'full' if one.is_full else 'last'} bin of row {one.row}",
                "handling a bin",
            ),
            st.DriveTo(x=side.x(self.FULL_BIN + KINDS["picker"].tows), needs=cross),
            *self.fill(self.layout.metres_per_bin if one.is_full else one.fill),
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

    def may_fail(self, failure: Failure) -> list[Step]:
        """The step before a drive, if robots fail on it in this scenario."""
        seed, often = self.layout.scenario.seed, failure.mean_between
        return [st.MayFail(seed, often, failure.mean_repair)] if often is not None else []

    def fill(self, metres: float) -> list[Step]:
        """The step before a picker leaves its bin with so many metres, if pickers do not know exactly where the row ends."""
        gnss = self.layout.scenario.sensors.gnss
        return [st.Fill(3.0 * (gnss.white + gnss.bias), metres)] if gnss.white or gnss.bias else []

    def cross(self, side: Side, lane: int, at: float) -> list[Gate]:
        """The places that a picker needs to drive over both roads, from x = `at` on."""
        return [Gate(side.crossing(lane), at)]

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

        Where carriers drive north the turn swings the bin over the place of the one that delivered, so that one must have left it. Before
        a picker comes back to the same row, that carrier must hold road F there: it then takes the full bin out of the lane's mouth first.
        """
        return [
            st.Say(f"driving to row {next_row}", "driving"),
            *([st.Alone(side.place("D", row))] if side.south < 0 or next_row == row else []),
            st.Face("SOUTH" if next_row >= row else "NORTH"),
            st.Free([side.place("D", row)]),
            st.DriveTo(y=self.layout.lane(next_row).y),
            *self.turn_in(next_row, side),
        ]

    def turn_in(self, row: int, side: Side) -> list[Step]:
        """Turn to the head of a row, and drive there, once both roads are free."""
        drive = st.DriveTo(x=self.end(row, side), frees=self.cleared(row, side))
        return [st.Need(side.crossing(row)), st.Face(side.heading("WEST")), drive]

    def cleared(self, row: int, side: Side) -> list[Gate]:
        """Where a picker that drives into a row gives the places of both roads back."""
        return [
            Gate([side.place("D", row)], side.x(self.PICKER_CLEAR_D)),
            Gate([side.place("F", row)], side.x(self.PICKER_CLEAR_F)),
        ]

    def park(self, row: int, side: Side) -> list[Step]:
        """After the last row drive off the roads with the empty bin, and stay there."""
        place = [side.place("D", row)]
        drive = st.DriveTo(x=side.x(self.PARKED), frees=[Gate(place, side.x(self.PARKING_CLEAR))])
        return [st.Say("parking", "driving"), drive, st.Free(place), st.Say("finished", "resting")]

    # -- carriers

    def leave_queue(self) -> list[Step]:
        """Drive onto the delivery road. Carriers of several lines take turns at `top`; those of one line follow each other."""
        needs = (
            [Gate([TOP], self.queue.head)] if self.layout.queue_places > self.queue.places else []
        )
        return [st.DriveTo(x=self.east.x(self.D_ROAD), needs=needs), st.Face("SOUTH")]

    def go_to_lane(self, lane: int, side: Side) -> list[Step]:
        """Drive along the delivery road to a lane, to one on the west side around the bottom."""
        top = [Gate([TOP], self.top_clear)]
        stop = side.y(self.layout.lane(lane).y, self.STOP)
        if side is self.east:
            return [self._along(side, "D", self._lanes(side, last=lane), stop=stop, frees=top)]
        needs = [Gate(["corner/south-east"], self.inner_bottom + self.HOLD)]
        return [
            self._along(
                self.east,
                "D",
                self._lanes(self.east),
                stop=self.outer_bottom,
                needs=needs,
                frees=top,
            ),
            st.Face("WEST"),
            st.Free(["corner/south-east"]),
            st.DriveTo(
                x=self.west.x(self.D_ROAD), needs=[Gate(["corner/south-west"], self.CORNER_HOLD_X)]
            ),
            st.Face("NORTH"),
            st.Free(["corner/south-west"]),
            self._along(side, "D", self._lanes(side, last=lane), stop=stop),
        ]

    def loop_to_full_bin(self, lane: int, side: Side) -> list[Step]:
        """Drive from the stop over the full-bin road to the point at which the full bin stands right behind."""
        blind = self.at_work(lane, side)
        return [
            st.Need([side.place("F", lane)]),
            st.Face(side.heading("WEST"), blind),
            st.DriveTo(
                x=side.x(self.COUPLING),
                frees=[Gate([side.place("D", lane)], side.x(self.LOOP_CLEAR))],
                blind_to=blind,
            ),
            st.Face(side.heading("NORTH"), blind),
            st.DriveTo(y=self.layout.lane(lane).y, blind_to=blind),
            st.Face(side.heading("EAST"), blind),
        ]

    def go_to_bay(self, lane: int, side: Side) -> list[Step]:
        """Take the full bin along the full-bin road, from the east side around the bottom, to the bay."""
        blind = self.at_work(lane, side)
        out: list[Step] = [
            st.DriveTo(x=side.x(self.F_ROAD), blind_to=blind),
            st.Face(side.heading("SOUTH"), blind),
        ]
        if side is self.west:
            return [*out, *self._north_to_bay(self._lanes(side, first=lane))]
        corner = ("corner/south-west", self.CORNER_CLEAR_Y), ("turn/south-west", self.TURN_CLEAR_Y)
        return [
            *out,
            self._along(side, "F", self._lanes(side, first=lane), stop=self.inner_bottom),
            st.Need(["corner/south-east"]),
            st.Face("WEST"),
            st.DriveTo(
                x=self.west.x(self.F_ROAD),
                frees=[Gate(["corner/south-east"], self.east.x(self.CORNER_CLEAR_X))],
            ),
            st.Need(["corner/south-west", "turn/south-west"]),
            st.Face("NORTH"),
            *self._north_to_bay(
                self._lanes(self.west),
                [Gate([place], self.inner_bottom + clear) for place, clear in corner],
            ),
        ]

    def go_home(self, carrier: int) -> list[Step]:
        """Drive from the bay to the tail of the carrier's line of the queue, and move up."""
        place = (
            carrier - self.layout.first_charging
            if carrier > self.layout.first_charging > 0
            else carrier
        )
        return [
            st.Say("returning to the queue", "driving"),
            *self.go_to_line(place),
            st.Home(),
            *self.wait_in_queue(),
        ]

    def may_charge(self, carrier: int) -> list[Step]:
        """The step after a job, if carriers have batteries: where it must charge, a carrier drives to the tail of its charging line."""
        first, battery = self.layout.first_charging, self.layout.scenario.carrying.battery
        place = carrier if carrier > first else carrier + first
        head = st.DriveTo(x=self.queue.head, queueing=True)
        wait = (
            st.Charge(),
            head,
            st.Charged(),
            st.Home(),
            st.Say("waiting in the queue", "waiting"),
            head,
        )
        go = st.Say("driving to the chargers", "driving"), *self.go_to_line(place), *wait
        return [st.MayCharge(battery.reserve, list(go))] if first else []

    def go_to_line(self, place: int) -> list[Step]:
        """Drive from the bay to the tail of the line with this place, counted from 1."""
        y = self.queue.place(place - 1).y
        aside: list[Step] = (
            []
            if y == TOP_ROAD
            else [st.Face("SOUTH" if y < TOP_ROAD else "NORTH"), st.DriveTo(y=y), st.Face("EAST")]
        )
        return [st.DriveTo(x=self.queue.turn_off), *aside]

    def number(self, carrier: int, y: float) -> int:
        """Return the number, from 1, of the place in the queue that stands for a carrier: its own, or in a charging line that in it."""
        charging = self.layout.first_charging + carrier
        return (
            charging
            if self.layout.first_charging and abs(y - self.queue.place(charging - 1).y) < BESIDE
            else carrier
        )

    def at_work(self, lane: int, side: Side) -> list[Box]:
        """The bins and the picker of a lane, which a carrier that works there does not take for obstacles."""
        y, picker, fruit = self.layout.lane(lane).y, KINDS["picker"], KINDS["bin"]
        bins = [
            Box(side.x(x), y, fruit.length / 2, fruit.width / 2)
            for x in (self.FULL_BIN, self.D_ROAD)
        ]
        return [*bins, Box(side.x(self.WAITING), y, picker.length / 2, picker.width / 2)]

    # -- the roads

    @property
    def top_clear(self) -> float:
        """y at which a carrier is out of the way of carriers that turn in from other lines, m."""
        return min(self.queue.used(self.layout.queue_places)) - self.TOP_CLEAR

    @property
    def inner_bottom(self) -> float:
        """y of the full-bin road along the bottom, m."""
        return self.layout.tree_lines[-1] - self.F_BOTTOM

    @property
    def outer_bottom(self) -> float:
        """y of the delivery road along the bottom, m."""
        return self.layout.tree_lines[-1] - self.D_BOTTOM

    def _lanes(self, side: Side, first: int | None = None, last: int | None = None) -> list[int]:
        """The lanes that a carrier passes on this side, in its order: all, or those from `first` on, or those up to `last`."""
        lanes = [lane.number for lane in self.layout.lanes][:: side.south]
        return lanes[lanes.index(first) if first else 0 : lanes.index(last) + 1 if last else None]

    def _along(
        self,
        side: Side,
        road: str,
        lanes: list[int],
        stop: float,
        needs: Sequence[Gate] = (),
        frees: Sequence[Gate] = (),
    ) -> st.DriveTo:
        """Drive along a road past lanes; hold each lane's place from `HOLD` before it until the tail has left it."""
        enter = [
            Gate([side.place(road, n)], side.y(self.layout.lane(n).y, -self.HOLD)) for n in lanes
        ]
        leave = [
            Gate([side.place(road, n)], side.y(self.layout.lane(n).y, self.CLEAR)) for n in lanes
        ]
        return st.DriveTo(y=stop, needs=[*enter, *needs], frees=[*leave, *frees])

    def _north_to_bay(self, lanes: list[int], frees: Sequence[Gate] = ()) -> list[Step]:
        return [
            self._along(self.west, "F", lanes, stop=TOP_ROAD, frees=frees),
            st.Face("EAST"),
            st.DriveTo(x=self.layout.bay_stop),
        ]


def _once_left(approach: list[Step], full_bin: str, place: str) -> list[Step]:
    """Let a carrier ask for a lane's place only after the full bin is left there: else it would keep the picker in its row."""
    return [
        replace(
            step,
            needs=[
                replace(gate, bin=full_bin) if place in gate.places else gate for gate in step.needs
            ],
        )
        if isinstance(step, st.DriveTo)
        else step
        for step in approach
    ]
