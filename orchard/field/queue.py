"""Where empty carriers wait: lines of places east of the bay, as a route's `QUEUE` has them.

Metres, in the frame `map`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType

from orchard.field.geometry import EAST, Pose, Rect

# m. A row of the manual. All figures of the east side are for such rows; with longer ones they lie
# further east.
USUAL_ROW = 70.0
# y of the road through the bay to the queue.
TOP_ROAD = 24.5
# x of a carrier that unloads, with the bay at its usual place. Its bin stands 1.9 m west of it.
BAY_STOP = -30.0
# m from one waiting carrier to the next at the start.
PITCH = 4.0
# m, at most, from one carrier to the next when they have come back. That leaves 0.8 m from a bin to
# the front of the carrier behind it.
CLOSED_UP = 4.1
# m from a line to the edge of the queue: half a carrier.
BESIDE = 0.75
# m from where carriers turn off the top road to the last place. Their turn stays clear of the
# carrier that waits there.
BEHIND = 5.0
# m from the stop in the bay to the last place of a single line. A carrier that unloads does not
# wait for it.
OFF_THE_BAY = 4.2
# m by which a turn off the top road must be further from the bay, to stay clear of the carrier that
# unloads.
TURN = 0.3
# m from the last place of a single line to where the queue begins.
AREA = 0.8
# x from which a turn off the top road is clear of the tractor and of the driveway.
OFF_THE_TRACK = -18.6
# x of the first head at which a carrier turns south, 2.5 m further east, 0.65 m clear of what the
# tractor sweeps.
NEAREST_HEAD = -23.5
MOST_CARRIERS = 120
SHORTEST_ROW = 20.0  # m
LONGEST_ROW = 400.0  # m

# y of lines, in the order in which they fill: on each route the top road's first.
_NORTH = (27.5, 30.5, 33.5, 36.5, 39.5, 42.5, 45.5)
_LONG = (TOP_ROAD, 21.5, 18.5, *_NORTH)
_SHORT = (TOP_ROAD, 21.5, *_NORTH, 48.5)
# The fewest lines that a queue has, unless it has one.
FEWEST_LINES = 4
# The most places of one of the long lines.
LONGEST_LINE = 12


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
            round(self.turn_off + 0.6, 3),
            min(self.lines) - BESIDE,
            self.head + 0.9,
            max(self.lines) + BESIDE,
        )

    def place(self, number: int) -> Pose:
        """Return the start of a carrier, counted from 0.

        The queue fills line by line, each from its head.
        """
        line, place = divmod(number, self.places)
        return Pose(self.head - place * PITCH, self.lines[line], EAST)

    def whole_lines(self, carriers: int) -> int:
        """Return the number of places of the lines that have a carrier."""
        return -(-carriers // self.places) * self.places

    def used(self, carriers: int) -> list[float]:
        """Return y of each line that has a carrier, in the order in which they fill."""
        return list(self.lines[: -(-carriers // self.places)])

    def in_use(self, carriers: int) -> Rect:
        """Return the part of the queue with the lines of this many carriers."""
        lines = self.used(carriers)
        return self.area._replace(south=min(lines) - BESIDE, north=max(lines) + BESIDE)


Plan = Callable[[float, float, int], Iterator[Queue]]
"""Yields the queues that could be, the preferred first. It gets the row length and the bay, m, and
the number of carriers."""


@dataclass(frozen=True)
class _Lines:
    """Some lines that could make a queue."""

    ys: tuple[float, ...]
    # x on the top road at which a carrier turns to its line.
    turn_off: float
    # x of the last place.
    last: float


def _single_line(bay: float, y: float) -> _Lines:
    """Return one line on the top road, in which no carrier turns."""
    after_bay = BAY_STOP + bay + OFF_THE_BAY
    return _Lines((y,), after_bay - AREA, after_bay)


def _several_lines(bay: float, ys: tuple[float, ...]) -> list[_Lines]:
    """Return the first four of some lines, then five of them, and so on to all."""
    turn_off = max(OFF_THE_TRACK, BAY_STOP + bay + OFF_THE_BAY + TURN)
    counts = range(FEWEST_LINES, len(ys) + 1)
    return [_Lines(ys[:count], turn_off, turn_off + BEHIND) for count in counts]


def long_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """Yield the queues of the route `one-way`.

    Their heads are beside the delivery road, so their lines may be as long as the top road.
    """
    head = 35.4 + (row_length - USUAL_ROW)
    several = _several_lines(bay, _LONG)
    single = _single_line(bay, TOP_ROAD)
    for lines in (*several[:2], single, *several[2:]):
        if head >= lines.last:
            places = min(LONGEST_LINE, _places_between(lines.last, head))
            yield Queue(lines.ys, head, places, lines.turn_off)


def short_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """Yield the queues of the route `two-way`.

    Their heads are as near to the bay as the number of carriers allows.
    """
    # x of a head from which the delivery road can still be reached.
    furthest = 32.5 + (row_length - USUAL_ROW)
    queues = []
    for lines in (_single_line(bay, TOP_ROAD), *_several_lines(bay, _SHORT)):
        if furthest < lines.last:
            continue
        places = min(_places_between(lines.last, furthest), -(-carriers // len(lines.ys)))
        if places:
            head = max(lines.last + CLOSED_UP * (places - 1), NEAREST_HEAD)
            queues.append(Queue(lines.ys, round(head, 3), places, lines.turn_off))
    yield from sorted(queues[:2], key=partial(_preference, carriers))
    yield from queues[2:]


def _preference(carriers: int, queue: Queue) -> tuple[bool, int, int]:
    """Return what is least for the queue to be preferred: with room, near the bay, of few lines."""
    return queue.room < carriers, math.floor(queue.head), len(queue.lines)


def _places_between(last: float, head: float) -> int:
    """Return the number of carriers that fit into a line. `last`, `head`: x of both ends, m."""
    return int((head - last) / CLOSED_UP + 1.0)


# The built-in routes.
ONE_WAY = "one-way"
TWO_WAY = "two-way"
QUEUES: Mapping[str, Plan] = MappingProxyType({ONE_WAY: long_lines, TWO_WAY: short_lines})


def queue_of(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> Queue | None:
    """Return the queue of a built-in route for so many carriers; None if it finds no room.

    `row_length`, `bay`: m. `charge`: each line in which carriers wait has another one beside it, in
    which they charge.
    """
    if charge:
        times = 2
    else:
        times = 1
    for queue in QUEUES[name](row_length, bay, times * carriers):
        if queue.room >= times * queue.whole_lines(carriers):
            return queue
    return None


def lack_of_room(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> str:
    """Return in words that an orchard has no room for so many carriers, with numbers that would do.

    Return '' if it has room. The parameters are those of `queue_of`.
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
