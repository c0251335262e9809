"""How fast each part of a row is picked.

A row has one stretch for each bin that its picker fills in it: the bins of a row may take unlike
times, as `picking.spread_of_bins` says. So a picker whose agent keeps to no speed gains nothing.
"""

from typing import NamedTuple

import numpy as np

from orchard.field.layout import Layout


class Stretches(NamedTuple):
    """The s stretches of r rows, row by row, and in each row from the west."""

    # (r + 1,) int64: the stretches of row i, from 0, are those from `begin[i]` to `begin[i + 1]`,
    # which is exclusive.
    begin: np.ndarray
    # (s,) m: x of the east end of each stretch. It begins where the one before it ends.
    east: np.ndarray
    # (s,) m/s: how fast each stretch is picked.
    speed: np.ndarray


def stretches_of(layout: Layout) -> Stretches:
    """Return the stretches of all rows. Neighbours that are picked equally fast are one.

    A row that is no picker's is one stretch.
    """
    # Row -> x of the east end and speed of each of its parts.
    parts: dict[int, list[tuple[float, float]]] = {}
    for block in layout.blocks.values():
        for current in layout.passes(block):
            east = max(current.begin, current.stop)
            parts.setdefault(current.row, []).append((east, layout.speed_on(current)))
    begin = [0]
    easts = list[float]()
    speeds = list[float]()
    for lane in layout.lanes:
        whole_row = [(lane.east, lane.picking_speed)]
        for east, speed in sorted(parts.get(lane.number, whole_row)):
            is_first = len(easts) == begin[-1]
            if is_first or speed != speeds[-1]:
                easts.append(east)
                speeds.append(speed)
            else:
                easts[-1] = east
        begin.append(len(easts))
    return Stretches(np.array(begin), np.array(easts), np.array(speeds))
