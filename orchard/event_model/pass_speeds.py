"""How fast pickers pick on each pass through a row, for the event model.

A program belongs to a geometry, and its passes to the program. The speeds are drawn by the seed of
a harvest, so they are no part of the program.
"""

from typing import NamedTuple

import numpy as np

from orchard.field.layout import Layout
from orchard.field.passes import Pass
from orchard.field.picking import bin_speed_of
from orchard.field.scenario import Scenario


class PickersPass(NamedTuple):
    """A pass, and the picker that does it."""

    picker: str
    drive: Pass


class PassSpeeds:
    """Tells the speeds of the passes of a program, by the scenario of a harvest."""

    def __init__(self) -> None:
        # In the order of the program's passes.
        self._passes: list[PickersPass] = []

    def add(self, picker: str, drive: Pass) -> None:
        """Note the program's next pass."""
        self._passes.append(PickersPass(picker, drive))

    def in_layout(self, layout: Layout) -> np.ndarray:
        """Return the speeds in a layout of the program's geometry, (passes,), m/s."""
        of_rows = np.array([lane.picking_speed for lane in layout.lanes])
        return self.drawn(layout.scenario, of_rows)

    def drawn(self, scenario: Scenario, of_rows: np.ndarray) -> np.ndarray:
        """Return the speeds as the seed of a scenario draws them, (passes,), m/s.

        `of_rows`: (rows,), m/s, at which each row is picked with that seed.
        """
        rows = np.array([drive.row - 1 for _, drive in self._passes], dtype=np.int64)
        speeds: np.ndarray = of_rows[rows]
        if scenario.picking.spread_of_bins.distribution != "none":
            for number, (picker, drive) in enumerate(self._passes):
                of_row = float(speeds[number])
                speeds[number] = bin_speed_of(scenario, picker, drive.bin_number, of_row)
        return speeds
