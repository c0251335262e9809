"""The schedule of a harvest without traffic: all drives take their time, and no robot waits for a road, a place or the bay.

It is an ideal to compare a harvest with, for the built-in policy. It is not a proof: another policy may be faster. docs/bounds.md says how
far harvests are from it.
"""

import heapq

from orchard.agents.route import OneWay, route_of
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import QUEUE_LINE_PLACES, QUEUE_PITCH, ROW_LENGTH, Layout
from orchard.report.bounds import approach_seconds, cycle_seconds, duration

WORTH = 0.01  # share of the harvest's time by which a number of carriers must shorten it to be worth its cost


class Schedule:
    """The schedule of one orchard. It is made once; `seconds` may then be asked for any number of carriers."""

    def __init__(self, layout: Layout) -> None:
        route = route_of(layout)
        self._bins, self._row_seconds = layout.scenario.rows, ROW_LENGTH / layout.scenario.picking_speed
        self._blocks = [_exchanges(route, rows) for rows in layout.blocks.values()]

    def seconds(self, carriers: int) -> float:
        """Return the time of the harvest with this number of carriers, s. Bins are served in the order in which they are full."""
        free = [0.0] * carriers  # s, when each carrier is at the queue's head
        full = [(self._row_seconds, block, 0) for block in range(len(self._blocks))]  # s; a picker's block of rows; the row in it
        while full:
            when, block, count = heapq.heappop(full)
            start, (approach, cycle, onward) = max(when, free[0]), self._blocks[block][count]
            heapq.heapreplace(free, start + cycle)
            if count + 1 < len(self._blocks[block]):
                heapq.heappush(full, (start + approach + onward + self._row_seconds, block, count + 1))
        return max(free) - (min(carriers, QUEUE_LINE_PLACES) - 1) * QUEUE_PITCH  # the last carrier stops behind the others of its line

    @property
    def enough_carriers(self) -> int:
        """The number of carriers beyond which more shorten this harvest by at most 1 % (`WORTH`). It is never above the number of bins."""
        times = [self.seconds(carriers) for carriers in range(1, self._bins + 1)]
        return next(number for number, time in enumerate(times, start=1) if time * (1.0 - WORTH) <= min(times))


def _exchanges(route: OneWay, rows: tuple[int, ...]) -> list[tuple[float, float, float]]:
    """For each row of a picker: its approach and cycle, and the picker's way to the head of its next row with the empty bin, s."""
    exchanges = []
    for count, (row, next_row) in enumerate(zip(rows, (*rows[1:], rows[-1]), strict=True)):
        side = route.side(count)
        waiting = Pose(side.x(route.WAITING), route.layout.lane(row).y, HEADINGS[side.heading("EAST")])
        onward = duration(route.go_to_next_row(row, next_row, side), waiting)
        exchanges.append((approach_seconds(route, row, side), cycle_seconds(route, row, side), onward))
    return exchanges
