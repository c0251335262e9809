"""The passes of a picker through its rows.

On each pass it picks what fills its bin, and drives out at the other end than it came in. A bin of
`metres_per_bin` fills inside a row, goes on with the next row, or ends with its picker's last row.
What is unpicked of a row is one interval, because each pass begins or ends at one of its edges.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from orchard.field.plugins import MISTAKES, contained, load_plugin, place_of_class, unusable
from orchard.field.rows import Block, End
from orchard.field.scenario import ONWARD, OUTWARD, Scenario

# m. A bin that lacks at most this is full; a row of which at most this is left is picked.
FULL_WITHIN = 1e-6
_OTHER: dict[End, End] = {"west": "east", "east": "west"}

Order = Callable[[float, float, float], float]
"""Returns the x at which a pass begins to pick, m.

It gets the x of both edges of what is unpicked and the metres that the pass picks, which are fewer.
The first edge is the one to which the picker comes first. The pass must begin at the first edge, or
end at the last one.
"""


def onward(first: float, last: float, metres: float) -> float:
    """Pick from the edge on to which the picker comes first.

    It then drives through what is unpicked with the full bin.
    """
    return first


def outward(first: float, last: float, metres: float) -> float:
    """Pick up to the edge at which the picker drives out, so that its bin is full there.

    It first drives through what stays unpicked.
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
    # x at which it begins to pick, and x at which it has picked its part.
    begin: float
    stop: float
    # Whether it begins beyond fruit that it leaves.
    is_inside: bool
    # Metres of row that are in its bin at that end.
    fill: float
    is_full: bool
    # Whether it leaves the bin at that end, which is full or its last one.
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
        """Return x of both edges in the order in which a picker comes to them that leaves at an
        end.
        """
        if end == "east":
            return self.west, self.east
        return self.east, self.west

    def without(self, begin: float, stop: float) -> "Unpicked":
        """Return what remains when the part between two x is picked. The part ends at an edge."""
        if min(begin, stop) <= self.west:
            return Unpicked(max(begin, stop), self.east)
        return Unpicked(self.west, min(begin, stop))


class Filling(NamedTuple):
    """A bin that is being filled: the metres of row that fill it, and for how many it has room."""

    capacity: float
    room: float

    @classmethod
    def empty(cls, capacity: float) -> "Filling":
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

    def with_more(self, metres: float) -> "Filling":
        """Return the bin with so many metres of row more in it, or as many as it has room for."""
        return Filling(self.capacity, self.room - min(self.room, metres))


def passes_in(scenario: Scenario, rows: Sequence[tuple[float, float]], block: Block) -> list[Pass]:
    """Return the passes of a picker by the order that the scenario names.

    That is a built-in one, or a user's function. Raises ScenarioError for an order or a result
    that cannot be.
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
    fills one bin. Raises ValueError if `order` returns what cannot be.
    """
    passes = list[Pass]()
    end = _OTHER[block.start]
    bin_ = Filling.empty(metres_per_bin or 0.0)
    for count, row in enumerate(block.rows, start=1):
        unpicked = Unpicked(*rows[row - 1])
        if not metres_per_bin:
            bin_ = Filling.empty(unpicked.length)
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
                bin_ = Filling.empty(bin_.capacity)
    return passes


def _part(order: Order, first: float, last: float, metres: float) -> tuple[float, float]:
    """Return x at which a pass that does not pick all begins, and x at which it stops, m."""
    begin = order(first, last, metres)
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
    """Return the error for an order that returned what cannot be."""
    part = f"{metres:g} m of x = {first:g} to {last:g}"
    allowed = f"{first:g} or {outward(first, last, metres):g}"
    return ValueError(f"it returned {begin!r} for {part}; must be {allowed}")
