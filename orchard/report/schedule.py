"""The schedule of a harvest without traffic: all drives take their time, and no robot waits for a road, a place or the bay.

It is an ideal to compare a harvest with, for the built-in policy. It is not a proof: another policy may be faster. docs/bounds.md says how
far harvests are from it.
"""

import heapq

from orchard.agents.route import OneWay
from orchard.agents.routes import route_of
from orchard.agents.timing import approach_seconds, duration
from orchard.field.geometry import HEADINGS, WEST, Pose
from orchard.field.layout import EAST_START, Layout
from orchard.field.queue import PITCH
from orchard.field.rows import Block
from orchard.report.bounds import cycle_seconds

WORTH = 0.01  # share of the harvest's time by which a number of carriers must shorten it to be worth its cost


class Schedule:
    """The schedule of one orchard. It is made once; `seconds` may then be asked for any number of carriers."""

    def __init__(self, layout: Layout) -> None:
        route = route_of(layout)
        self._bins, self._places = layout.scenario.rows, layout.queue.places
        self._blocks = [_exchanges(route, block) for block in layout.blocks.values()]
        self._first_full = [_first_full_seconds(route, block) for block in layout.blocks.values()]

    def seconds(self, carriers: int) -> float:
        """Return the time of the harvest with this number of carriers, s. Bins are served in the order in which they are full."""
        free = [0.0] * carriers  # s, when each carrier is at the queue's head
        full = [(when, block, 0) for block, when in enumerate(self._first_full)]  # s; a picker's block of rows; the row in it
        heapq.heapify(full)
        while full:
            when, block, count = heapq.heappop(full)
            start, (_, approach, cycle, onward) = max(when, free[0]), self._blocks[block][count]
            heapq.heapreplace(free, start + cycle)
            if count + 1 < len(self._blocks[block]):
                next_row_seconds = self._blocks[block][count + 1][0]
                heapq.heappush(full, (start + approach + onward + next_row_seconds, block, count + 1))
        return max(free) - (min(carriers, self._places) - 1) * PITCH  # the last carrier stops behind the others of its line

    @property
    def enough_carriers(self) -> int:
        """The number of carriers beyond which more shorten this harvest by at most 1 % (`WORTH`). It is never above the number of bins."""
        times = [self.seconds(carriers) for carriers in range(1, self._bins + 1)]
        return next(number for number, time in enumerate(times, start=1) if time * (1.0 - WORTH) <= min(times))


def _first_full_seconds(route: OneWay, block: Block) -> float:
    """The time until a picker has come from its start to its first row, and has picked it, s."""
    row = block.rows[0]
    start = Pose(EAST_START, route.layout.lane(row).y, WEST)  # of those that do not start at the head of the row
    return duration(route.come_in(block), start) + route.layout.picking_seconds(row)


def _exchanges(route: OneWay, block: Block) -> list[tuple[float, float, float, float]]:
    """For each row of a picker: the time to pick it, its approach and cycle, and the way to the next row with an empty bin, s."""
    exchanges, rows = [], block.rows
    for count, (row, next_row) in enumerate(zip(rows, (*rows[1:], rows[-1]), strict=True)):
        side = route.side(count, block.start)
        waiting = Pose(side.x(route.WAITING), route.layout.lane(row).y, HEADINGS[side.heading("EAST")])
        onward = duration(route.go_to_next_row(row, next_row, side), waiting)
        exchanges.append((route.layout.picking_seconds(row), approach_seconds(route, row, side), cycle_seconds(route, row, side), onward))
    return exchanges
