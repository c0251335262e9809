"""The passes of a picker through its rows. On each it picks what fills its bin, and drives out at the other end than it came in.

A bin of `metres_per_bin` fills inside a row, goes on with the next row, or ends with its picker's last row. What is unpicked of a row is
one interval, because each pass begins at one of its edges.
"""

from collections.abc import Sequence
from typing import NamedTuple

from orchard.field.rows import Block, End

FULL_WITHIN = 1e-6  # m: a bin that lacks at most this is full, a row is picked
_OTHER: dict[End, End] = {"west": "east", "east": "west"}


class Pass(NamedTuple):
    """One drive of a picker through a row."""

    row: int
    end: End  # at which it leaves the row
    begin: float  # x at which it begins to pick, m
    stop: float  # x at which it has picked its part, m
    fill: float  # metres that are in its bin at that end
    is_full: bool  # the bin, there
    leaves_bin: bool  # there: it is full, or the picker's last one
    ends_row: bool  # nothing of the row is left to pick

    @property
    def metres(self) -> float:
        """What it picks."""
        return abs(self.stop - self.begin)


def passes_of(rows: Sequence[tuple[float, float]], block: Block, metres_per_bin: float | None) -> list[Pass]:
    """Return the passes of a picker, in their order.

    `rows`: x of the west and of the east end of each row, m. `metres_per_bin`: None if each row fills one bin.
    """
    made, end, room = list[Pass](), _OTHER[block.start], metres_per_bin or 0.0
    for count, row in enumerate(block.rows, start=1):
        west, east = rows[row - 1]
        full = metres_per_bin or east - west
        room = room if metres_per_bin else full
        while east - west > FULL_WITHIN:
            metres, is_done = min(room, east - west), east - west - room <= FULL_WITHIN
            if end == "east":
                begin, west = west, east if is_done else west + metres
            else:
                begin, east = east, west if is_done else east - metres
            room -= metres
            is_full, is_last = room <= FULL_WITHIN, is_done and count == len(block.rows)
            made.append(Pass(row, end, begin, west if end == "east" else east, full - room, is_full, is_full or is_last, is_done))
            end, room = _OTHER[end], full if is_full else room
    return made
