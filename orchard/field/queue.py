"""Where empty carriers wait: lines of places east of the bay, as a route's `QUEUE` has them. Metres, in the frame `map`."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from orchard.field.geometry import EAST, Pose, Rect

USUAL_ROW = 70.0  # m: a row of the manual. All figures of the east side are for such rows; with longer ones they lie further east
TOP_ROAD = 24.5  # y of the road through the bay to the queue
BAY_STOP = (
    -30.0
)  # x of a carrier that unloads: its bin stands 1.9 m west of it; with the bay at its usual place
PITCH = 4.0  # m from one waiting carrier to the next at the start
CLOSED_UP = 4.1  # m, at most, from one to the next when they have come back: 0.8 m from a bin to the front behind it
BESIDE = 0.75  # m from a line to the edge of the queue: half a carrier
BEHIND = 5.0  # m from where carriers turn off the top road to the last place: their turn stays clear of the last one
OFF_THE_BAY = 4.2  # m from the stop in the bay to the last place of a single line: a carrier that unloads does not wait for it
TURN = 0.3  # m by which a turn off the top road must be further from the bay, to stay clear of the carrier that unloads
AREA = 0.8  # m from the last place of a single line to where the queue begins
OFF_THE_TRACK = (
    -18.6
)  # x from which a turn off the top road is clear of the tractor and of the driveway
NEAREST_HEAD = -23.5  # x of the first head whose carrier turns south, 2.5 m further east, 0.65 m clear of what the tractor sweeps
MOST_CARRIERS = 120
SHORTEST_ROW, LONGEST_ROW = 20.0, 200.0  # m


@dataclass(frozen=True)
class Queue:
    """The queue of one orchard. Carriers wait in it facing east."""

    lines: tuple[float, ...]  #: y of each line, in the order in which they fill
    head: float  #: x of each line's first carrier
    places: int  #: of each line
    turn_off: float  #: x on the top road at which a carrier turns to its line

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
        """Return the start of a carrier, counted from 0: the queue fills line by line, each from its head."""
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


Plan = Callable[
    [float, float, int], Iterator[Queue]
]  # row length and bay, m; carriers -> the queues that could be, the preferred first


def long_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """The queue of the route `one-way`: its heads are beside the delivery road, so its lines may be as long as the top road."""
    head = 35.4 + (row_length - USUAL_ROW)
    after_bay = BAY_STOP + bay + OFF_THE_BAY
    turn_off = max(OFF_THE_TRACK, after_bay + TURN)
    several = [
        (_LINES[:number], turn_off, turn_off + BEHIND) for number in range(4, len(_LINES) + 1)
    ]
    single = _LINES[:1], after_bay - AREA, after_bay  # in it no carrier turns
    for lines, west, last in (*several[:2], single, *several[2:]):
        if head >= last:
            yield Queue(lines, head, min(12, int((head - last) / CLOSED_UP + 1.0)), west)


def short_lines(row_length: float, bay: float, carriers: int) -> Iterator[Queue]:
    """The queue of the route `two-way`: its heads are as near to the bay as the number of carriers allows."""
    furthest = 32.5 + (
        row_length - USUAL_ROW
    )  # x of a head from which the delivery road can still be reached
    after_bay = BAY_STOP + bay + OFF_THE_BAY
    turn_off = max(OFF_THE_TRACK, after_bay + TURN)
    queues = []
    several = [
        (_SHORT[:number], turn_off, turn_off + BEHIND) for number in range(4, len(_SHORT) + 1)
    ]
    for lines, west, last in ((_SHORT[:1], after_bay - AREA, after_bay), *several):
        most = int((furthest - last) / CLOSED_UP + 1.0) if furthest >= last else 0
        if places := min(most, -(-carriers // len(lines))):
            queues.append(
                Queue(
                    lines,
                    round(max(last + CLOSED_UP * (places - 1), NEAREST_HEAD), 3),
                    places,
                    west,
                )
            )
    usual, more = queues[:2], queues[2:]
    yield from sorted(
        usual, key=lambda queue: (queue.room < carriers, math.floor(queue.head), len(queue.lines))
    )
    yield from more


_NORTH = (27.5, 30.5, 33.5, 36.5, 39.5, 42.5, 45.5)
_LINES = (24.5, 21.5, 18.5, *_NORTH)
_SHORT = (24.5, 21.5, *_NORTH, 48.5)
ONE_WAY, TWO_WAY = "one-way", "two-way"  # the built-in routes
QUEUES: Mapping[str, Plan] = MappingProxyType({ONE_WAY: long_lines, TWO_WAY: short_lines})


def queue_of(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> Queue | None:
    """Return the queue of a built-in route for so many carriers; None if the orchard has no room for it.

    `charge`: each line in which carriers wait has another one beside it, in which they charge.
    """
    times = 2 if charge else 1
    queues = QUEUES[name](row_length, bay, times * carriers)
    return next(
        (queue for queue in queues if queue.room >= times * queue.whole_lines(carriers)), None
    )


def lack_of_room(
    name: str, row_length: float, bay: float, carriers: int, charge: bool = False
) -> str:
    """Return in words, with numbers that would do, that an orchard has no room for so many carriers; '' if it has."""
    if queue_of(name, row_length, bay, carriers, charge):
        return ""
    lengths = range(int(row_length) + 1, int(LONGEST_ROW) + 1)
    most = next(
        (
            number
            for number in range(carriers - 1, 0, -1)
            if queue_of(name, row_length, bay, number, charge)
        ),
        0,
    )
    longer = next(
        (length for length in lengths if queue_of(name, length, bay, carriers, charge)), None
    )
    nearer = next(
        (
            metres
            for metres in range(int(bay), -1, -1)
            if queue_of(name, row_length, metres, carriers, charge)
        ),
        None,
    )
    cures = [
        f"rows of at least {longer} m" if longer else "",
        f"the bay at most at {nearer} m" if nearer is not None else "",
    ]
    needs = f"; {carriers} need {' or '.join(filter(None, cures))}" if any(cures) else ""
    lines = "queue and for as many lines in which they charge" if charge else "queue"
    return f"must leave room for the carriers' {lines}: with rows of {row_length:g} m and the bay at {bay:g} m it holds {most}{needs}"
