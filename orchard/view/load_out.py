"""The load-out in the recording: trailers that leave the bay and come back, or the bins that wait
there for a truck. They stand north of the fence, where no robot is. An orchard has one of them or
none.
"""

import numpy as np
import rerun as rr

from orchard.field.layout import Layout
from orchard.view import palette
from orchard.view.columns import Columns

# m from the middle of one trailer to that of the next one.
PITCH = 3.0
# m from the fence to the middle of each.
NORTH = 3.2
# m: half sizes of a trailer's deck along x, y, z, and z of its middle.
DECK = (1.0, 2.4, 0.1)
DECK_Z = 0.7
# m: half sizes of all bins that a trailer can have, and z of their middle: they lie on the deck.
LOAD = (0.9, 2.2, 0.4)
LOAD_Z = DECK_Z + DECK[2] + LOAD[2]
# m: half sizes of a bin that waits for the truck.
BIN = (0.5, 0.5, 0.4)
# m from the middle of one to that of the next one.
BIN_PITCH = 1.3
# Bins of a line of them, along the fence.
BESIDE = 40
# In place of the number of bins on a trailer that is away.
AWAY = -1


class LoadOutView:
    """The entities of the load-out. Methods add only what has changed."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        """Log how they look. `columns`: for what changes."""
        load_out = layout.scenario.load_out
        self._columns = columns
        self._west = layout.bay.west
        self._south = layout.top
        # Trailers, and the bins that one can have.
        self._count = load_out.trailers.count or 0
        self._most = load_out.trailers.bins or 1
        # Bins that belong to the bay, empty or full; 0 without a truck.
        self._bins = 0
        if load_out.has_truck:
            self._bins = load_out.empty_bins or 0
        # Of each trailer, from the newest frame with trailers: bins on it, tick of its return.
        self._known = np.zeros((self._count, 2), dtype=np.int64)
        # Of each trailer the bins on it as last shown, AWAY while it is away; None: not shown yet.
        self._shown: list[int | None] = [None] * self._count
        # Full bins that wait, as last shown; -1: not shown yet.
        self._waiting = -1
        look = rr.Boxes3D.from_fields(fill_mode="solid")
        for number in range(self._count):
            columns.rec.log(_path_of(number), look, static=True)
        if self._bins:
            columns.rec.log("world/load_out/bins", look, static=True)

    def trailers(self, tick: int, trailers: np.ndarray | None) -> None:
        """Add the trailers that changed.

        `trailers`: (t, 3) as in `World`, of which the first two columns are the bins on a trailer
        and the tick of its return. None: as before.
        """
        if trailers is not None:
            self._known = trailers[: self._count, :2]
        for number, (bins, back) in enumerate(self._known.tolist()):
            shown = bins
            if back > tick:
                shown = AWAY
            if shown != self._shown[number]:
                self._shown[number] = shown
                self._show_trailer(number, shown)

    def _show_trailer(self, number: int, bins: int) -> None:
        """Add a trailer with its bins; `bins`: AWAY of one that is away, which has no boxes."""
        x = self._west + PITCH * number
        y = self._south + NORTH
        centers = []
        half_sizes = []
        colours = []
        labels = []
        if bins != AWAY:
            centers.append((x, y, DECK_Z))
            half_sizes.append(DECK)
            colours.append(palette.BARE)
            labels.append(f"trailer {number + 1}: {bins} of {self._most} bins")
        if bins > 0:
            half_length = LOAD[1] * bins / self._most
            centers.append((x, y + LOAD[1] - half_length, LOAD_Z))
            half_sizes.append((LOAD[0], half_length, LOAD[2]))
            colours.append(palette.KIWI)
        self._columns.add(
            _path_of(number),
            rr.Boxes3D,
            centers=centers,
            half_sizes=half_sizes,
            colors=colours,
            labels=labels,
        )

    def bins(self, waiting: int) -> None:
        """Add the bins that belong to the bay, if another number of them is full.

        `waiting`: how many are full, and wait for the truck. They stand before the empty ones.
        """
        if not self._bins or waiting == self._waiting:
            return
        self._waiting = waiting
        centers = []
        colours = []
        for number in range(self._bins):
            x = self._west + BIN_PITCH * (number % BESIDE)
            y = self._south + BIN_PITCH * (1 + number // BESIDE)
            centers.append((x, y, BIN[2]))
            if number < waiting:
                colours.append(palette.KIWI)
            else:
                colours.append(palette.BAR)
        self._columns.add(
            "world/load_out/bins",
            rr.Boxes3D,
            centers=centers,
            half_sizes=[BIN] * self._bins,
            colors=colours,
            labels=[f"{waiting} full bins of {self._bins}"],
        )


def _path_of(number: int) -> str:
    """Return the path of a trailer's entity. `number`: from 0."""
    return f"world/load_out/trailer_{number + 1}"
