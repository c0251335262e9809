"""Where empty carriers wait: a queue of lines of places, east of the bay.

Each built-in route has a function that proposes queues for an orchard (`QUEUES`); `queue_of` takes
the first one with room for all carriers. A route of a user's own names the route of which it uses
the queue, in its attribute `QUEUE`. Carriers drive along the top road from the bay to the east,
turn off to a line, and stand in it facing east. The first place of a line, in the east, is its
head. Metres, in the frame `map`: x east, y north.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from types import MappingProxyType

from orchard.field.geometry import EAST, Pose, Rect

# Length of a row of the manual, m. All figures of the east side are for such rows; with longer rows
# it lies further east.
USUAL_ROW = 70.0
# y of the top road, which leads through the bay to the queue, m.
TOP_ROAD = 24.5
# x of a carrier that unloads, with the bay at its usual place, m. Its bin stands 1.9 m west of it.
BAY_STOP = -30.0
# m from one waiting carrier to the next at the start of a harvest.
PITCH = 4.0
# m, at most, from one carrier to the next when they have come back. That leaves 0.8 m from a bin to
# the front of the carrier behind it.
CLOSED_UP = 4.1
# m from a line to the edge of the queue's area: half the width of a carrier.
BESIDE = 0.75
# m from where carriers turn off the top road to the last place. Their turn stays clear of the
# carrier that waits there.
BEHIND = 5.0
# m from the stop in the bay to the last place of a single line. A carrier that unloads does not
# wait for it.
OFF_THE_BAY = 4.2
# m by which a turn off the top road must be further from the bay than OFF_THE_BAY, to stay clear of
# the carrier that unloads.
TURN_CLEARANCE = 0.3
# m from where the queue begins to the last place of a single line.
BEFORE_SINGLE_LINE = 0.8
# x from which on a turn off the top road is clear of the tractor and of the driveway, m.
OFF_THE_TRACK = -18.6
# x of the westernmost head, m. A carrier that leaves it for the south turns 2.5 m further east, and
# so stays 0.65 m clear of what the tractor sweeps.
NEAREST_HEAD = -23.5
# m from where carriers turn off the top road to the west edge of the queue's area, and from the
# heads to its east edge: half the length of a carrier.
TURN_TO_AREA = 0.6
HEAD_TO_EDGE = 0.9
# Limits of a scenario.
MOST_CARRIERS = 120
SHORTEST_ROW = 20.0  # m
LONGEST_ROW = 400.0  # m
# Queues that are kept. All seeds of an orchard have the same one.
KEPT_QUEUES = 64

# y of the lines of each route, m, in the order in which they fill. The top road is the first line.
_NORTH = (27.5, 30.5, 33.5, 36.5, 39.5, 42.5, 45.5)
_LONG = (TOP_ROAD, 21.5, 18.5, *_NORTH)
_SHORT = (TOP_ROAD, 21.5, *_NORTH, 48.5)
# A queue has one line, or at least so many.
FEWEST_LINES = 4
# The most places of one of the long lines.
LONGEST_LINE = 12
# x of the heads, m, with rows of USUAL_ROW: of the long lines, which are beside the delivery road,
# and of the short lines at most, from where carriers can still turn to the delivery road.
LONG_HEAD = 35.4
FURTHEST_SHORT_HEAD = 32.5


@dataclass(frozen=True)
class Queue:
    """The queue of one orchard. Carriers wait in it facing east."""

    #: y of each line, in the order in which they fill.
    lines: tuple[float, ...]
    #: x of the first carrier of each line.
    head: float
    #: The number of places of each line.
    places: int
    #: x on the top road at which a carrier turns to its line.
    turn_off: float

    @property
    def room(self) -> int:
        """The number of carriers that it holds."""
        return len(self.lines) * self.places

    @cached_property
    def area(self) -> Rect:
        """What contains all carriers that wait, and those that drive up their lines."""
        return Rect(
            west=round(self.turn_off + TURN_TO_AREA, 3),
            south=min(self.lines) - BESIDE,
            east=self.head + HEAD_TO_EDGE,
            north=max(self.lines) + BESIDE,
        )

    def place(self, number: int) -> Pose:
        """Return where a carrier stands at the start of a harvest. `number`: of the place, from 0.

        The queue fills line by line, each from its head.
        """
        line, place = divmod(number, self.places)
        return Pose(self.head - place * PITCH, self.lines[line], EAST)

    def whole_lines(self, carriers: int) -> int:
        """Return the number of places of the lines in which so many carriers wait.

        The last line counts as a whole, also if it is not full.
        """
        return math.ceil(carriers / self.places) * self.places

    def used(self, carriers: int) -> list[float]:
        """Return y of each line in which so many carriers wait, in the order in which they fill."""
        return list(self.lines[: math.ceil(carriers / self.places)])

    def in_use(self, carriers: int) -> Rect:
        """Return the part of the area with the lines in which so many carriers wait."""
        lines = self.used(carriers)
        return self.area._replace(south=min(lines) - BESIDE, north=max(lines) + BESIDE)


Plan = Callable[[float, float, int], Iterator[Queue]]
"""A function that yields the possible queues of an orchard, the preferred ones first.

Its arguments are the length of the rows, m, how far east of its usual place the bay lies, m, and
the number of carriers. A queue that it yields may be too small for them.
"""


@dataclass(frozen=True)
class _Lines:
    """Lines that could make a queue, if there is room for their places."""

    # y of each line.
    ys: tuple[float, ...]
    # x on the top road at which a carrier turns to its line.
    turn_off: float
    # x of the last place.
    last: float


def _single_line(bay: float, y: float) -> _Lines:
    """Return one line on the top road, in which no carrier turns.

    `bay`: how far east of its usual place it lies, m. `y`: of the top road.
    """
    last = BAY_STOP + bay + OFF_THE_BAY
    return _Lines((y,), last - BEFORE_SINGLE_LINE, last)


def _several_lines(bay: float, ys: tuple[float, ...]) -> list[_Lines]:
    """Return the first FEWEST_LINES of some lines, then one more of them, and so on to all.

    `bay`: how far east of its usual place it lies, m.
    """
    turn_off = max(OFF_THE_TRACK, BAY_STOP + bay + OFF_THE_BAY + TURN_CLEARANCE)
    counts = range(FEWEST_LINES, len(ys) + 1)
    return [_Lines(ys[:count], turn_off, turn_off + BEHIND) for count in counts]


def long_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """Yield the queues of the route `one-way`, as a `Plan`.

    Their heads are beside the delivery road, so their lines may be as long as the top road. The
    number of carriers does not matter.
    """
    head = LONG_HEAD + (row_length - USUAL_ROW)
    several = _several_lines(bay, _LONG)
    single = _single_line(bay, TOP_ROAD)
    # A single line is preferred to six lines and more, because these move the top fence.
    for lines in (*several[:2], single, *several[2:]):
        if head >= lines.last:
            places = min(LONGEST_LINE, _places_between(lines.last, head))
            yield Queue(lines.ys, head, places, lines.turn_off)


def short_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """Yield the queues of the route `two-way`, as a `Plan`.

    Their heads are as near to the bay as the number of carriers allows.
    """
    furthest = FURTHEST_SHORT_HEAD + (row_length - USUAL_ROW)
    queues = []
    for lines in (_single_line(bay, TOP_ROAD), *_several_lines(bay, _SHORT)):
        if furthest < lines.last:
            continue
        needed = math.ceil(carriers / len(lines.ys))
        places = min(_places_between(lines.last, furthest), needed)
        if places:
            head = max(lines.last + CLOSED_UP * (places - 1), NEAREST_HEAD)
            queues.append(Queue(lines.ys, round(head, 3), places, lines.turn_off))
    # One line and the fewest lines compete. More lines are used only if neither has room.
    yield from sorted(queues[:2], key=partial(_preference, carriers))
    yield from queues[2:]


def _preference(carriers: int, queue: Queue) -> tuple[bool, int, int]:
    """Return the key by which queues are sorted: the preferred queue has the least one.

    Preferred is a queue with room for the carriers, then one with its head near the bay, to a
    metre, then one of few lines.
    """
    has_no_room = queue.room < carriers
    return has_no_room, math.floor(queue.head), len(queue.lines)


def _places_between(last: float, head: float) -> int:
    """Return the number of carriers that fit into a line. `last`, `head`: x of both ends, m."""
    return int((head - last) / CLOSED_UP + 1.0)


# The built-in routes.
ONE_WAY = "one-way"
TWO_WAY = "two-way"
QUEUES: Mapping[str, Plan] = MappingProxyType({ONE_WAY: long_lines, TWO_WAY: short_lines})


@lru_cache(maxsize=KEPT_QUEUES)
def queue_of(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> Queue | None:
    """Return the queue of a built-in route for so many carriers; None if there is no room for it.

    `name`: of the route. `row_length`: m. `bay`: how far east of its usual place it lies, m.
    `charge`: whether carriers have batteries; then there are as many lines to charge in as lines to
    wait in.
    """
    if charge:
        places_each = 2
    else:
        places_each = 1
    for queue in QUEUES[name](row_length, bay, places_each * carriers):
        if queue.room >= places_each * queue.whole_lines(carriers):
            return queue
    return None


def lack_of_room(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> str:
    """Return in words that an orchard has no room for the queue; '' if it has room.

    The words name how many carriers fit, and the row length and the place of the bay with which all
    would fit. The parameters are those of `queue_of`.
    """

    def fits(row_length: float, bay: float, carriers: int) -> bool:
        return queue_of(name, row_length, bay, carriers, charge) is not None

    if fits(row_length, bay, carriers):
        return ""
    most = carriers - 1
    while most > 0 and not fits(row_length, bay, most):
        most -= 1
    cures = []
    for length in range(int(row_length) + 1, int(LONGEST_ROW) + 1):
        if fits(length, bay, carriers):
            cures.append(f"rows of at least {length} m")
            break
    for metres in range(int(bay), -1, -1):
        if fits(row_length, metres, carriers):
            cures.append(f"the bay at most at {metres} m")
            break
    lines = "queue"
    if charge:
        lines = "queue and for as many lines in which they charge"
    where = f"with rows of {row_length:g} m and the bay at {bay:g} m"
    sentence = f"must leave room for the carriers' {lines}: {where} it holds {most}"
    if cures:
        sentence += f"; {carriers} need {' or '.join(cures)}"
    return sentence
