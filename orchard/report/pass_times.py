"""The times of a picker's passes, and of the bins that it leaves at their ends, without traffic.

Limits are made of them (`orchard.report.bounds`), and the long run compares with them what it
measures. docs/bounds.md has their symbols. A pass is one drive of a picker through a row
(`orchard.field.passes`).
"""

from functools import cache
from typing import NamedTuple

from orchard.dispatch.policies import dispatch_of
from orchard.dispatch.policy import is_early
from orchard.field.layout import Layout
from orchard.field.passes import UNKNOWN, Pass
from orchard.plans.jobs import handover_seconds
from orchard.report.plan_times import PlanTimes


class BinTimes(NamedTuple):
    """Mean times of a bin without traffic, or the times of one pass through a row, s."""

    #: T: the picker picks what fills the bin.
    picking: float
    #: t_x: the picker leaves a full bin and goes on, without the wait for an empty one.
    crossing: float
    #: w: the picker waits for an empty bin, if a carrier is free at once.
    waiting: float
    #: C: the carrier drives from the queue's head around the orchard and back.
    cycle: float
    #: The part of t_x that a bin costs because it fills inside a row, and must be driven to the
    #: row's end.
    row_end: float
    #: The carrier charges what a cycle takes out of its battery.
    charging: float

    @property
    def of_picker(self) -> float:
        """The whole time of the picker, s."""
        return self.picking + self.crossing + self.waiting


class PassTimes:
    """The times of the passes of one orchard. The same ones come again and again, so each is
    computed once.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._plans = PlanTimes.of(layout)
        # Whether a carrier leaves before the bin is full.
        self._leaves_early = is_early(dispatch_of(layout))
        self._bins_differ = layout.scenario.picking.spread_of_bins.distribution != "none"
        self._times = cache(self._times_of)

    def of(self, current: Pass, after: Pass) -> BinTimes:
        """Return the times of one pass through a row, and of the exchange at its end, if any.

        `after`: the next pass of the same picker.
        """
        return self._times(self._alike(current), _any_bin(after))

    def going_on(self, current: Pass, after: Pass) -> float:
        """Return the time from a picker's exchange until it is at the head of its next row, s."""
        return self._plans.of_pass(_any_bin(current), _any_bin(after)).going_on

    def _alike(self, current: Pass) -> Pass:
        """Return the same pass as all that have its times: where bins do not differ, for any."""
        if self._bins_differ:
            return current
        return _any_bin(current)

    def _times_of(self, current: Pass, after: Pass) -> BinTimes:
        layout = self._layout
        driving = self._plans.of_pass(_any_bin(current), after)
        picking = layout.seconds_on(current)
        # The driving that exchanges inside rows would save: if the pass picks the rest of its row,
        # that through the part that was picked before; else all driving beside picking.
        row_end = driving.total - driving.handling
        if current.ends_row:
            length = layout.lane(current.row).length
            row_end = (length - current.metres) / layout.machines["picker"].speed
        if not current.leaves_bin:
            return BinTimes(
                picking=picking,
                crossing=driving.total,
                waiting=0.0,
                cycle=0.0,
                row_end=row_end,
                charging=0.0,
            )
        job = self._plans.of_job(current.row, current.end)
        coming = job.coming
        if self._leaves_early:
            # The order comes at the earliest when the picker drives into the row. So the picker
            # waits only for what the carrier's way is longer than all that the picker does until
            # then.
            coming -= driving.way_in + picking + driving.leaving
        waiting = max(coming, driving.coming_out + job.driving_in) + handover_seconds(layout)
        return BinTimes(
            picking=picking,
            crossing=driving.total - driving.coming_out,
            waiting=waiting,
            cycle=job.cycle,
            row_end=row_end,
            charging=job.charging,
        )


def _any_bin(current: Pass) -> Pass:
    """Return a pass for any bin of its picker."""
    return current._replace(bin_number=UNKNOWN)
