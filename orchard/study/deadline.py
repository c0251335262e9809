"""The deadline of a harvest: so many hours of work, or the end of a day; and times in words."""

import math
from dataclasses import dataclass

from orchard.study.settings import Setting

# Limits of a deadline, both included: s of work, and days of the shift.
LEAST_DEADLINE = 60.0
MOST_DEADLINE = 3.6e7
MOST_DAYS = 1000
# Replications at least and at most, by which a fleet is said to be in time.
FEWEST = 20
MOST = 80


@dataclass(frozen=True)
class Deadline:
    """Until when a harvest must be done: one of the two is set."""

    #: S of work.
    within_seconds: float | None = None
    #: Days of the shift, of which the last one ends with the deadline.
    days: int | None = None

    def seconds(self, setting: Setting) -> float:
        """Return how long the harvest of a setting may be, s."""
        if self.days is not None and setting.days is not None:
            return self.days * setting.days.day_seconds
        return self.within_seconds or 0.0

    @property
    def option(self) -> str:
        """The option of the command that says it."""
        if self.days is not None:
            return f"--finish-by {self.days}d"
        return f"--finish-within {(self.within_seconds or 0.0) / 3600.0:g}h"

    @property
    def words(self) -> str:
        """When a harvest must be done: 'within 8 h', 'by the end of day 2'."""
        if self.days is not None:
            return f"by the end of day {self.days}"
        return f"within {(self.within_seconds or 0.0) / 3600.0:.4g} h of work"


@dataclass(frozen=True)
class Trial:
    """How many harvests of a fleet must be in time, of how many, for a confidence."""

    replications: int
    late: int  #: that may be late at most

    @classmethod
    def of(cls, confidence: float) -> "Trial":
        """Return the trial after which a fleet is in time with a confidence: 19 of 20 for 95 %."""
        wanted = math.ceil(1.0 / (1.0 - confidence) - 1e-9)
        replications = min(MOST, max(FEWEST, wanted))
        return cls(replications, math.floor((1.0 - confidence) * replications + 1e-9))


def hours_words(seconds: float, half: float = 0.0) -> str:
    """Return a time in hours and minutes: '7:41 h'; with half of its interval: '7:41 ± 0:08 h'."""
    words = _hours(seconds)
    if round(half / 60.0):
        words += f" ± {_hours(half)}"
    return f"{words} h"


def _hours(seconds: float) -> str:
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours}:{minutes:02d}"
