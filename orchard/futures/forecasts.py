"""Futures that the event model does: each takes milliseconds, where the simulator takes seconds.

They answer first, and point to where the simulator shall look. What counts is what the simulator
gives.
"""

from orchard.begun_harvest import harvest_from
from orchard.field.layout import Layout
from orchard.futures.moments import Future
from orchard.futures.options import ForkOptions
from orchard.report.limits import delivered_full_bins
from orchard.sim.snapshot import Snapshot

#: Figures of the summary that a forecast has.
FORECAST = ("sim_seconds", "bins_per_hour")
#: The head of what a forecast has of the end, in a table.
EXPECTED_END = "expected to end at, s"


def can_forecast(chosen: ForkOptions) -> bool:
    """Whether the futures that a user asks for are whole harvests in which no robot is stopped."""
    return not chosen.stop and chosen.duration is None


def forecast(job: tuple[int, Snapshot]) -> Future | None:
    """Return what a future gives that goes on to its end: `FORECAST`, and why it `ended`.

    `job`: its number, and its first moment. None where the event model cannot go on from it.
    """
    _, first_moment = job
    harvest = harvest_from(first_moment)
    if harvest is None:
        return None
    seconds = harvest.run().seconds
    if not harvest.is_over:
        return {"ended": "jammed", "sim_seconds": seconds, "bins_per_hour": 0.0}
    rate = 3600.0 * _full_bins(harvest.layout) / seconds
    return {"ended": "harvested", "sim_seconds": seconds, "bins_per_hour": rate}


def _full_bins(layout: Layout) -> float:
    """Return how many full bins the fruit of all rows fills."""
    metres = sum(lane.length for lane in layout.lanes)
    return delivered_full_bins(layout, layout.bins, metres)
