"""The passes of a picker through its rows. On each it picks what fills its bin, and drives out at the other end than it came in.

A bin of `metres_per_bin` fills inside a row, goes on with the next row, or ends with its picker's last row. What is unpicked of a row is
one interval, because each pass begins or ends at one of its edges.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from orchard.field.plugins import MISTAKES, contained, load_plugin, place_of_class, unusable
from orchard.field.rows import Block, End
from orchard.field.scenario import ONWARD, OUTWARD, Scenario

FULL_WITHIN = 1e-6  # m: a bin that lacks at most this is full, a row is picked
_OTHER: dict[End, End] = {"west": "east", "east": "west"}
Order = Callable[[float, float, float], float]
"""Returns the x at which a pass begins to pick its metres. It gets the x of both edges of what is unpicked, the one first to which the
picker comes first, and those metres, which are fewer. The pass must begin at the first edge, or end at the last one."""


def onward(first: float, last: float, metres: float) -> float:
    """Pick from the edge on to which the picker comes first. It then drives through what is unpicked with the full bin."""
    return first


def outward(first: float, last: float, metres: float) -> float:
    """Pick up to the edge at which the picker drives out, so that its bin is full there. It first drives through what stays unpicked."""
    return last - metres if last > first else last + metres


ORDERS: dict[str, Order] = {ONWARD: onward, OUTWARD: outward}


class Pass(NamedTuple):
    """One drive of a picker through a row."""

    row: int
    end: End  # at which it leaves the row
    begin: float  # x at which it begins to pick, m
    stop: float  # x at which it has picked its part, m
    is_inside: bool  # it begins beyond fruit that it leaves
    fill: float  # metres that are in its bin at that end
    is_full: bool  # the bin, there
    leaves_bin: bool  # there: it is full, or the picker's last one
    ends_row: bool  # nothing of the row is left to pick

    @property
    def metres(self) -> float:
        """What it picks."""
        return abs(self.stop - self.begin)


def passes_in(scenario: Scenario, rows: Sequence[tuple[float, float]], block: Block) -> list[Pass]:
    """Return the passes of a picker by the order that the scenario names: a built-in one, or a user's function.

    Raises ScenarioError for an order or a result that cannot be.
    """
    key, path = "order_in_row", scenario.order_in_row
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
    """Return the passes of a picker, in their order. Raises ValueError if `order` returns what cannot be.

    `rows`: x of the west and of the east end of each row, m. `metres_per_bin`: None if each row fills one bin.
    """
    made, end, room = list[Pass](), _OTHER[block.start], metres_per_bin or 0.0
    for count, row in enumerate(block.rows, start=1):
        west, east = rows[row - 1]
        full = metres_per_bin or east - west
        room = room if metres_per_bin else full
        while east - west > FULL_WITHIN:
            metres, is_done = min(room, east - west), east - west - room <= FULL_WITHIN
            first, last = (west, east) if end == "east" else (east, west)
            begin = first if is_done else _begin(order, first, last, metres)
            is_inside = begin != first
            stop = (
                last
                if is_done or is_inside
                else first + metres
                if end == "east"
                else first - metres
            )
            west, east = sorted((first, begin) if is_inside else (stop, last))
            room -= metres
            is_full, is_last = room <= FULL_WITHIN, is_done and count == len(block.rows)
            made.append(
                Pass(
                    row,
                    end,
                    begin,
                    stop,
                    is_inside,
                    full - room,
                    is_full,
                    is_full or is_last,
                    is_done,
                )
            )
            end, room = _OTHER[end], full if is_full else room
    return made


def _begin(order: Order, first: float, last: float, metres: float) -> float:
    """Return where a pass begins that does not pick all."""
    begin, outermost = order(first, last, metres), outward(first, last, metres)
    for x in (first, outermost):
        if isinstance(begin, float | int) and abs(begin - x) <= FULL_WITHIN:
            return x
    raise ValueError(
        f"it returned {begin!r} for {metres:g} m of x = {first:g} to {last:g}; must be {first:g} or {outermost:g}"
    )
