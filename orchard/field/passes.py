"""The passes of a picker through its rows, for `Layout.passes`.

A pass is one drive through a row. On it the picker picks what fills its bin, and drives out at the
other end than it came in. A bin that fills inside a row is left at the row's end. One that is not
full there goes on with the next row, or is left after the picker's last row. The scenario's
`order_in_row` says which part of a row a pass picks. What is unpicked of a row stays one interval,
because each pass begins or ends at one of its edges.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from orchard.field.plugins import MISTAKES, contained, load_plugin, place_of_class, unusable
from orchard.field.rows import Block, End
from orchard.field.scenario import ONWARD, OUTWARD, Scenario

# m. A bin that lacks at most this is full; a row of which at most this is left is picked.
FULL_WITHIN = 1e-6
# The number of a bin of which fleet control decides where it is left.
UNKNOWN = 0
_OTHER: dict[End, End] = {"west": "east", "east": "west"}

Order = Callable[[float, float, float], float]
"""A rule that returns the x at which a pass begins to pick, m.

Its arguments are `first` and `last`, the x of both edges of what is unpicked, and `metres`, how
much the pass picks. The picker comes to `first` first. `metres` is less than the way between the
edges. The pass must begin at `first`, or end at `last`.
"""


def onward(first: float, last: float, metres: float) -> float:
    """Pick from the first edge on, as an `Order`.

    The picker then drives with the full bin through what stays unpicked.
    """
    return first


def outward(first: float, last: float, metres: float) -> float:
    """Pick up to the last edge, as an `Order`, so that the bin is full where the picker drives out.

    The picker first drives with the empty bin through what stays unpicked.
    """
    if last > first:
        return last - metres
    return last + metres


ORDERS: dict[str, Order] = {ONWARD: onward, OUTWARD: outward}


class Pass(NamedTuple):
    """One drive of a picker through a row. x in the orchard's frame, m."""

    row: int
    # The end at which the picker leaves the row.
    end: End
    # Which of its picker's bins it fills, from 1, or UNKNOWN.
    bin_number: int
    # x at which it begins to pick, and x at which it has picked its part.
    begin: float
    stop: float
    # Whether it drives over fruit, which it leaves, before it begins to pick.
    is_inside: bool
    # Metres of row that are in its bin when it leaves the row, also from rows before.
    fill: float
    # Whether the bin is full then.
    is_full: bool
    # Whether it leaves the bin at that end: a full one, or its last one.
    leaves_bin: bool
    # Whether nothing of the row remains to be picked.
    ends_row: bool

    @property
    def metres(self) -> float:
        """The metres of row that it picks."""
        return abs(self.stop - self.begin)


class Unpicked(NamedTuple):
    """The part of a row that is not picked yet: x of its west and of its east edge, m."""

    west: float
    east: float

    @property
    def length(self) -> float:
        """Its length, m."""
        return self.east - self.west

    def towards(self, end: End) -> tuple[float, float]:
        """Return x of both edges, that to which a picker comes first before the other.

        `end`: at which the picker leaves the row.
        """
        if end == "east":
            return self.west, self.east
        return self.east, self.west

    def without(self, begin: float, stop: float) -> "Unpicked":
        """Return what remains when the part between two x is picked. The part ends at an edge."""
        if min(begin, stop) <= self.west:
            return Unpicked(max(begin, stop), self.east)
        return Unpicked(self.west, min(begin, stop))


class FillingBin(NamedTuple):
    """A bin that is being filled. Its fruit is measured in metres of row, m."""

    #: m of row that fill an empty bin.
    capacity: float
    #: m of row for which there is room left.
    room: float

    @classmethod
    def empty(cls, capacity: float) -> "FillingBin":
        """Return a bin without fruit."""
        return cls(capacity, capacity)

    @property
    def fill(self) -> float:
        """The metres of row that are in it."""
        return self.capacity - self.room

    @property
    def is_full(self) -> bool:
        """Whether it has room for no more."""
        return self.room <= FULL_WITHIN

    def with_more(self, metres: float) -> "FillingBin":
        """Return the bin with so many metres of row more in it, or as many as it has room for."""
        return FillingBin(self.capacity, self.room - min(self.room, metres))


def passes_in(scenario: Scenario, rows: Sequence[tuple[float, float]], block: Block) -> list[Pass]:
    """Return the passes of a picker by the order that the scenario names.

    That is a built-in one, or a user's function. `rows`: x of the west and of the east end of each
    row of the orchard, m. Raises ScenarioError for a function that cannot be used, or that returns
    an x at which no pass may begin.
    """
    key = "order_in_row"
    path = scenario.order_in_row
    if path in ORDERS:
        return passes_of(rows, block, scenario.bin_metres, ORDERS[path])
    order = load_plugin(key, path)
    try:
        return passes_of(rows, block, scenario.bin_metres, partial(contained, order))
    except MISTAKES as error:
        raise unusable(
            key,
            path,
            error,
            "a function of (first, last, metres) that returns x",
            place_of_class(order),
        ) from error


def passes_of(
    rows: Sequence[tuple[float, float]], block: Block, metres_per_bin: float | None, order: Order
) -> list[Pass]:
    """Return the passes of a picker, in their order.

    `rows`: x of the west and of the east end of each row, m. `metres_per_bin`: None if each row
    fills one bin. Raises ValueError if `order` returns an x at which no pass may begin.
    """
    passes = list[Pass]()
    # The end at which the next pass leaves its row.
    end = _OTHER[block.start]
    bin_ = FillingBin.empty(metres_per_bin or 0.0)
    bin_number = 1
    for count, row in enumerate(block.rows, start=1):
        unpicked = Unpicked(*rows[row - 1])
        if not metres_per_bin:
            # Each row has a bin of its own, which is as large as the row is long.
            bin_ = FillingBin.empty(unpicked.length)
        is_last_row = count == len(block.rows)
        while unpicked.length > FULL_WITHIN:
            ends_row = unpicked.length - bin_.room <= FULL_WITHIN
            first, last = unpicked.towards(end)
            if ends_row:
                begin = first
                stop = last
            else:
                begin, stop = _part(order, first, last, bin_.room)
            bin_ = bin_.with_more(unpicked.length)
            unpicked = unpicked.without(begin, stop)
            passes.append(
                Pass(
                    row=row,
                    end=end,
                    bin_number=bin_number,
                    begin=begin,
                    stop=stop,
                    is_inside=begin != first,
                    fill=bin_.fill,
                    is_full=bin_.is_full,
                    leaves_bin=bin_.is_full or (ends_row and is_last_row),
                    ends_row=ends_row,
                )
            )
            end = _OTHER[end]
            if bin_.is_full:
                bin_ = FillingBin.empty(bin_.capacity)
                bin_number += 1
    return passes


def _part(order: Order, first: float, last: float, metres: float) -> tuple[float, float]:
    """Return x at which a pass begins to pick, and x at which it stops, m.

    The pass leaves a part of the row: `metres` is less than the way from `first` to `last`. An
    order may miss an edge by rounding; the edge itself is taken then.
    """
    begin = order(first, last, metres)
    # The x from which a pass picks up to the last edge.
    outermost = outward(first, last, metres)
    if not isinstance(begin, float | int):
        raise _wrong(begin, first, last, metres)
    if abs(begin - first) <= FULL_WITHIN:
        if last > first:
            forward = metres
        else:
            forward = -metres
        return first, first + forward
    if abs(begin - outermost) <= FULL_WITHIN:
        return outermost, last
    raise _wrong(begin, first, last, metres)


def _wrong(begin: object, first: float, last: float, metres: float) -> ValueError:
    """Return the error for an order that returned something at which no pass may begin."""
    part = f"{metres:g} m of x = {first:g} to {last:g}"
    allowed = f"{first:g} or {outward(first, last, metres):g}"
    return ValueError(f"it returned {begin!r} for {part}; must be {allowed}")
