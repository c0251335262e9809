"""A harvest that never ends: its rate, its waits and its shares, measured between its beginning and the first picker's end."""

from collections.abc import Sequence
from math import ceil

import numpy as np

from orchard.discrete.harvest import DiscreteFigures, DiscreteHarvest, Jam
from orchard.field.layout import Layout

CHARGES = 1.5  # that each carrier does
LEAST_BINS, LEAST_ROUNDS = 12, 3  # that each picker fills; how often those with most rows pick theirs, if each fills one bin
BEGINNING = 0.2  # share of the bins that is left out


def long_run(layout: Layout, rows_each: int | None = None) -> DiscreteFigures:
    """Let all pickers pick their rows again and again, and measure. `rows_each`: how many; None: as many as a good figure needs.

    Raises ValueError as `DiscreteHarvest` does, and Jam.
    """
    harvest = DiscreteHarvest(layout, rows_each or _rows_each(layout))
    harvest.spread_charges()
    pickers = [harvest.robots[name] for name in harvest.blocks]
    harvest.run(lambda: all(picker.plan for picker in pickers))
    if all(picker.plan for picker in pickers):
        raise Jam(f"only {harvest.delivered} bins were delivered: robots wait for each other")
    measured = harvest.deliveries[int(BEGINNING * harvest.delivered) :]
    since, until = measured[0], measured[-1]
    wait, busy = harvest.picker_waiting_seconds(since, until), harvest.carrier_utilisation(since, until)
    return DiscreteFigures(3600.0 / _between(measured), wait, busy, until - since, len(measured) - 1)


def _rows_each(layout: Layout) -> int:
    each, most = layout.scenario.bin_metres, max(len(block.rows) for block in layout.blocks.values())
    bins_a_row = layout.mean_length / each if each else 1.0
    battery, row = layout.scenario.carrying.battery, layout.picking_seconds(1, layout.mean_length)
    lasts = CHARGES * 3600.0 * (battery.hours or 0.0) * (1.0 - battery.reserve)  # s
    return max(ceil(LEAST_BINS / bins_a_row), ceil(LEAST_ROUNDS / max(1.0, bins_a_row)) * most, ceil(lasts / row))


def _between(deliveries: Sequence[float]) -> float:
    """The time from one delivery to the next, s: the slope of all times. The first and the last one alone would tell of their luck."""
    return float(np.polyfit(np.arange(len(deliveries)), deliveries, 1)[0])
