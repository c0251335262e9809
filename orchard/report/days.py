"""The working days of a harvest.

The time of a harvest is working time, without nights. A shift says on which day and at which hour
that is. Each morning the robots go on from where they stopped.

Carriers must be at home when a day ends. So the work of a day ends earlier by the time that a
carrier needs at most for a job and the way home, on free roads: in that time only jobs that were
begun are finished. That counts a little less than a day allows, because pickers could go on until
the end.
"""

import math
from dataclasses import dataclass

from orchard.field.scenario import Scenario, WorkShift
from orchard.report.bounds import Bounds

# s. A harvest that ends at most this much after a day's end ends on that day: its length is a
# float.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Day:
    """Some days that are alike."""

    count: int
    #: The working hours that are paid on each of them.
    hours: float
    #: How much of the harvest's time each of them does, s: less than its hours.
    seconds: float


@dataclass(frozen=True)
class WorkDays:
    """The days of a harvest."""

    shift: WorkShift
    #: How long before a day's end its work ends.
    homing_seconds: float

    @property
    def day_seconds(self) -> float:
        """How much of a harvest a day does, s."""
        return self.shift.work_seconds - self.homing_seconds

    @property
    def day_hours(self) -> float:
        """The working hours of a day, which are paid."""
        return self.shift.work_seconds / 3600.0

    def count(self, seconds: float) -> int:
        """Return on which day a harvest of this length ends, from 1."""
        return max(1, math.ceil((seconds - ROUNDING) / self.day_seconds))

    def of(self, seconds: float) -> list[Day]:
        """Return the days of a harvest of this length: the whole ones, and the last one.

        Of the last one only the hours up to the harvest's end are paid.
        """
        whole = self.count(seconds) - 1
        rest = seconds - whole * self.day_seconds
        last = Day(count=1, hours=rest / 3600.0, seconds=rest)
        if whole == 0:
            return [last]
        return [Day(count=whole, hours=self.day_hours, seconds=self.day_seconds), last]

    def words(self, seconds: float) -> str:
        """Return when a harvest of this length ends: 'day 2 at 09:40'."""
        day = self.count(seconds)
        rest = seconds - (day - 1) * self.day_seconds
        return f"day {day} at {self.shift.time_after(rest)}"


def work_days(scenario: Scenario, bounds: Bounds) -> WorkDays | None:
    """Return the days of a harvest; None if the scenario has no shift.

    `bounds`: those of the scenario. Where a carrier's job is longer than half a day, a day still
    does half of its time, so that a harvest ends at all.
    """
    if not scenario.shift.is_set:
        return None
    longest_job = max(times.cycle for times in bounds.of_pickers.values())
    half_a_day = scenario.shift.work_seconds / 2.0
    return WorkDays(scenario.shift, min(longest_job, half_a_day))
