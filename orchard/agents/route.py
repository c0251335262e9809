"""The traffic plan: the roads around the rows, the places on them, and the drives that robots make there.

docs/traffic.md says why it is so and that it cannot deadlock; `make docs` draws it to scale. On either side of the rows lie,
outwards: the full bins in the lanes' mouths, the road of full bins (F), the road of deliveries (D), the pickers' waiting
places and their way to the next row. Everybody drives one way: south on the east side, north on the west side, which is the
east side turned by half a turn about x = -1.5.

Each road is cut into one place a lane (`east/D/3`). A carrier holds a place while any part of it or its bin is in it; a
picker that crosses holds both roads' places at its lane. `Side` turns distances from a lane's centre, measured along the
carriers' direction of travel, into x and y; all figures below are metres on the east side.
"""

from dataclasses import dataclass

from orchard.agents.robot import Step
from orchard.agents.sense import Box
from orchard.agents.steps import (
    Alone,
    Confirmed,
    Deliver,
    DriveTo,
    Face,
    FetchEmpty,
    Free,
    Gate,
    Home,
    LeaveBin,
    Need,
    Say,
    TakeBin,
    Unload,
)
from orchard.field.layout import (
    BAY_STOP,
    QUEUE_HEAD,
    QUEUE_LINE_PLACES,
    QUEUE_LINES,
    ROW_EAST,
    ROW_WEST,
    TOP_ROAD,
    TREE_TOP_LINE,
    Layout,
    queue_place,
)

D_ROAD = 38.25  # x of the road of deliveries: a picker's coupling point lies on it
F_ROAD = 36.2  # x of the road of full bins
WAITING = 40.5  # x at which a picker waits, and of its way to the next row
PARKED = 43.5  # x at which a picker stays after its last row
FULL_BIN = 32.25  # x of a full bin that a picker has left
COUPLING = 34.15  # x of a carrier that couples the full bin
STOP = 1.9  # a delivering carrier stands so far past the lane, its bin on the lane's centre line; its loop runs here too
HOLD = 3.75  # a carrier stands so far before a lane while it may not enter the lane's place
CLEAR = 5.7  # and so far past a lane has its tail left the place
PICKER_HOLD = 33.7  # x at which a picker waits to cross the roads, front at 34.95
F_BOTTOM, D_BOTTOM = 3.5, 5.6  # the roads along the bottom, south of the last tree line
CORNER_HOLD_X = -35.5  # x before which a carrier on the outer bottom road waits for the south-west corner
TURN_OFF = -18.6  # x on the top road at which a carrier turns to its queue line
TOP = "top"  # the place where the queue's lines meet the road of deliveries
TOP_CLEAR = 3.75  # so far south of the southernmost line that is used a carrier has left it
PICKER_BOX = (1.25, 0.75)  # half length and width, for what a carrier at work does not take for an obstacle
BIN_BOX = (0.5, 0.5)


@dataclass(frozen=True)
class Side:
    """The east side, or the west side, which is the same turned by half a turn."""

    name: str
    sign: int  # +1 east, -1 west

    def x(self, east: float) -> float:
        """The x of what lies at x = `east` on the east side."""
        return east if self.sign > 0 else -3.0 - east

    def y(self, lane_y: float, along: float) -> float:
        """The y of a point so far along the carriers' direction of travel from a lane's centre."""
        return lane_y - self.sign * along

    def heading(self, east: str) -> str:
        """The heading on this side of what has this heading on the east side."""
        return east if self.sign > 0 else {"EAST": "WEST", "WEST": "EAST", "NORTH": "SOUTH", "SOUTH": "NORTH"}[east]

    def place(self, road: str, lane: int) -> str:
        return f"{self.name}/{road}/{lane}"

    def crossing(self, lane: int) -> list[str]:
        """The places on both roads at a lane."""
        return [self.place("F", lane), self.place("D", lane)]


EAST_SIDE, WEST_SIDE = Side("east", 1), Side("west", -1)
SIDES = {"east": EAST_SIDE, "west": WEST_SIDE}


# -- pickers


def harvest(layout: Layout, rows: tuple[int, ...]) -> list[Step]:
    """A picker's whole work: pick row after row, at each end leave the full bin and fetch an empty one."""
    steps: list[Step] = []
    for count, row in enumerate(rows):
        side = EAST_SIDE if count % 2 == 0 else WEST_SIDE
        steps += pick(layout, row, side, count > 0) + swap_bins(row, side)
        steps += go_to_next_row(layout, row, rows[count + 1], side) if count + 1 < len(rows) else park(row, side)
    return steps


def pick(layout: Layout, row: int, side: Side, came_over: bool) -> list[Step]:
    """Drive a row to its end on this side, at the picking speed, and leave the full bin in the lane's mouth."""
    end = ROW_EAST if side.sign > 0 else ROW_WEST
    other = WEST_SIDE if side.sign > 0 else EAST_SIDE
    frees = [Gate([other.place("D", row)], other.x(34.4)), Gate([other.place("F", row)], other.x(32.4))] if came_over else []
    cross = [Gate(side.crossing(row), side.x(PICKER_HOLD))]
    return [
        Say(f"picking row {row}"),
        DriveTo(x=end, speed=layout.scenario.picking_speed, needs=cross, frees=frees),
        Say(f"leaving the full bin of row {row}"),
        DriveTo(x=side.x(FULL_BIN + 2.25), needs=cross),
        LeaveBin(),
    ]


def swap_bins(row: int, side: Side) -> list[Step]:
    """Drive out of the lane, over the roads, and wait there for an empty bin."""
    return [
        DriveTo(x=side.x(WAITING)),
        Free(side.crossing(row)),
        Say("waiting for an empty bin"),
        FetchEmpty(side.place("D", row)),
    ]


def go_to_next_row(layout: Layout, row: int, next_row: int, side: Side) -> list[Step]:
    """Turn south, drive over to the next row, and turn in once both roads are free there.

    On the west side the turn swings the bin over the place where the carrier stood, which must have left it.
    """
    wait_for_carrier = [Alone(side.place("D", row))] if side is WEST_SIDE else []
    return [
        Say(f"driving to row {next_row}"),
        *wait_for_carrier,
        Face("SOUTH"),
        Free([side.place("D", row)]),
        DriveTo(y=layout.lane(next_row).y),
        Need(side.crossing(next_row)),
        Face(side.heading("WEST")),
        DriveTo(x=side.x(ROW_EAST), frees=[Gate([side.place("D", next_row)], side.x(34.4))]),
    ]


def park(row: int, side: Side) -> list[Step]:
    """After the last row: off the roads, with the empty bin, and stay there."""
    place = [side.place("D", row)]
    return [Say("parking"), DriveTo(x=side.x(PARKED), frees=[Gate(place, side.x(42.0))]), Free(place), Say("finished")]


# -- carriers


def fetch(layout: Layout, line: int, lane: int, side: Side, picker: str, full_bin: str) -> list[Step]:
    """A carrier's whole job: an empty bin to the picker, the full one around the orchard to the bay, and back to the queue."""
    return [
        Confirmed(full_bin, [Home(), *close_up()]),
        Say(f"bringing an empty bin to {picker}"),
        *leave_queue(layout),
        *go_to_lane(layout, lane, side),
        Deliver(picker),
        *loop_to_full_bin(layout, lane, side),
        TakeBin(full_bin),
        Say(f"taking {full_bin} to the bay"),
        *go_to_bay(layout, lane, side),
        Say(f"unloading {full_bin}"),
        Unload(),
        *go_home(line),
    ]


def leave_queue(layout: Layout) -> list[Step]:
    """Onto the road of deliveries; carriers of several lines take turns, those of one line just follow each other."""
    several = layout.scenario.carrier_count > QUEUE_LINE_PLACES
    return [DriveTo(x=D_ROAD, needs=[Gate([TOP], QUEUE_HEAD)] if several else []), Face("SOUTH")]


def go_to_lane(layout: Layout, lane: int, side: Side) -> list[Step]:
    """From the top of the east side, along the road of deliveries, to a lane; to the west side it leads around the bottom."""
    top = [Gate([TOP], top_clear(layout))]
    if side is EAST_SIDE:
        return [_along(layout, side, "D", _lanes_before(layout, side, lane), stop=side.y(layout.lane(lane).y, STOP), frees=top)]
    corner = inner_corner(layout)
    needs = [Gate(["corner/south-east"], corner + HOLD)]
    return [
        _along(layout, EAST_SIDE, "D", _all_lanes(layout, EAST_SIDE), stop=outer_corner(layout), needs=needs, frees=top),
        Face("WEST"),
        Free(["corner/south-east"]),
        DriveTo(x=WEST_SIDE.x(D_ROAD), needs=[Gate(["corner/south-west"], CORNER_HOLD_X)]),
        Face("NORTH"),
        Free(["corner/south-west"]),
        _along(layout, side, "D", _lanes_before(layout, side, lane), stop=side.y(layout.lane(lane).y, STOP)),
    ]


def loop_to_full_bin(layout: Layout, lane: int, side: Side) -> list[Step]:
    """From the stop on the road of deliveries over the other road to where the full bin stands right behind."""
    y = layout.lane(lane).y
    blind = at_work(layout, lane, side)
    return [
        Need([side.place("F", lane)]),
        Face(side.heading("WEST"), blind),
        DriveTo(x=side.x(COUPLING), frees=[Gate([side.place("D", lane)], side.x(36.4))], blind_to=blind),
        Face(side.heading("NORTH"), blind),
        DriveTo(y=y, blind_to=blind),
        Face(side.heading("EAST"), blind),
    ]


def go_to_bay(layout: Layout, lane: int, side: Side) -> list[Step]:
    """With the full bin along the road of full bins, around the bottom from the east side, to the bay."""
    blind = at_work(layout, lane, side)
    out: list[Step] = [DriveTo(x=side.x(F_ROAD), blind_to=blind), Face(side.heading("SOUTH"), blind)]
    y = layout.lane(lane).y
    if side is WEST_SIDE:
        return [*out, *_north_to_bay(layout, _lanes_after(layout, side, lane), y)]
    return [
        *out,
        _along(layout, side, "F", _lanes_after(layout, side, lane), stop=inner_corner(layout)),
        Need(["corner/south-east"]),
        Face("WEST"),
        DriveTo(x=WEST_SIDE.x(F_ROAD), frees=[Gate(["corner/south-east"], 34.7)]),
        Need(["corner/south-west"]),
        Face("NORTH"),
        *_north_to_bay(layout, _all_lanes(layout, WEST_SIDE), None),
    ]


def _north_to_bay(layout: Layout, lanes: list[int], joined_at: float | None) -> list[Step]:
    corner = [] if joined_at is not None else [Gate(["corner/south-west"], inner_corner(layout) + 1.4)]
    return [
        _along(layout, WEST_SIDE, "F", lanes, stop=TOP_ROAD, frees=corner),
        Face("EAST"),
        DriveTo(x=BAY_STOP),
    ]


def go_home(line: int) -> list[Step]:
    """From the bay to the tail of its line of the queue, and up."""
    y = QUEUE_LINES[line]
    aside: list[Step] = [] if y == TOP_ROAD else [Face("SOUTH" if y < TOP_ROAD else "NORTH"), DriveTo(y=y), Face("EAST")]
    return [
        Say("returning to the queue"),
        DriveTo(x=TURN_OFF),
        *aside,
        Home(),
        *close_up(),
    ]


def close_up() -> list[Step]:
    """Wait in the queue, and move up to the head of the line as the others leave."""
    return [Say("waiting in the queue"), DriveTo(x=QUEUE_HEAD, queueing=True)]


def at_work(layout: Layout, lane: int, side: Side) -> list[Box]:
    """The full bin and the picker of a lane: near them a carrier must not take them for obstacles."""
    y = layout.lane(lane).y
    return [Box(side.x(FULL_BIN), y, *BIN_BOX), Box(side.x(D_ROAD), y, *BIN_BOX), Box(side.x(WAITING), y, *PICKER_BOX)]


def top_clear(layout: Layout) -> float:
    """y at which a carrier is out of the way of those that turn in from other lines."""
    lines = QUEUE_LINES[: line_of(layout.scenario.carrier_count) + 1]
    return min(lines) - TOP_CLEAR


def line_of(number: int) -> int:
    """The queue line of the number-th carrier (from 1): the one in which it starts."""
    return QUEUE_LINES.index(queue_place(number - 1).y)


def inner_corner(layout: Layout) -> float:
    """y of the road of full bins along the bottom."""
    return layout.tree_lines[-1] - F_BOTTOM


def outer_corner(layout: Layout) -> float:
    """y of the road of deliveries along the bottom."""
    return layout.tree_lines[-1] - D_BOTTOM


def _all_lanes(layout: Layout, side: Side) -> list[int]:
    """The lanes in the order in which a carrier passes them."""
    numbers = [lane.number for lane in layout.lanes]
    return numbers if side is EAST_SIDE else numbers[::-1]


def _lanes_before(layout: Layout, side: Side, lane: int) -> list[int]:
    """The lanes that a carrier passes on its way to a lane, and that lane."""
    lanes = _all_lanes(layout, side)
    return lanes[: lanes.index(lane) + 1]


def _lanes_after(layout: Layout, side: Side, lane: int) -> list[int]:
    """A lane, and those that a carrier passes on its way from there."""
    lanes = _all_lanes(layout, side)
    return lanes[lanes.index(lane) :]


def _along(
    layout: Layout, side: Side, road: str, lanes: list[int], stop: float, needs: list[Gate] | None = None, frees: list[Gate] | None = None
) -> DriveTo:
    """Drive along a road past lanes, holding each one's place from before it until the tail has left it."""
    enter = [Gate([side.place(road, n)], side.y(layout.lane(n).y, -HOLD)) for n in lanes]
    leave = [Gate([side.place(road, n)], side.y(layout.lane(n).y, CLEAR)) for n in lanes]
    return DriveTo(y=stop, needs=enter + (needs or []), frees=leave + (frees or []))


def distance(layout: Layout, x: float, y: float, lane: int, side: Side) -> float:
    """Metres by road from a place in the queue to a lane's stop."""
    to_road = D_ROAD - x
    if side is EAST_SIDE:
        return to_road + y - side.y(layout.lane(lane).y, STOP)
    bottom = outer_corner(layout)
    return to_road + (y - bottom) + (D_ROAD - WEST_SIDE.x(D_ROAD)) + side.y(layout.lane(lane).y, STOP) - bottom


assert QUEUE_LINES[0] == TOP_ROAD and min(QUEUE_LINES) - TOP_CLEAR > TREE_TOP_LINE
