"""The deadline of a harvest (hours of work, or the end of a day), how often a fleet must be in
time, and times in words.
"""

import math
from dataclasses import dataclass

from orchard.study.settings import Setting

# Limits of a deadline, both included: s of work, and days of the shift.
LEAST_DEADLINE = 60.0
MOST_DEADLINE = 3.6e7
MOST_DAYS = 1000
# Replications, at least and at most, after which a fleet counts as in time. With a confidence of
# 99.99 % it would take 10,000.
FEWEST = 20
MOST = 80
# Harvests. 1 / (1 - 0.95) is a little more than 20, as a float.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Deadline:
    """Until when a harvest must be done. One of the two values is set, and the other is None."""

    #: s of work.
    within_seconds: float | None = None
    #: The number of the shift's day at whose end the harvest must be done, from 1.
    days: int | None = None

    def seconds(self, setting: Setting) -> float:
        """Return how long the harvest of a setting may be, s."""
        if self.days is not None and setting.days is not None:
            return self.days * setting.days.day_seconds
        return self.within_seconds or 0.0

    @property
    def option(self) -> str:
        """The same as an option of the command: '--finish-by 2d'."""
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
    """How often a fleet is tried, and how many of these harvests may be late."""

    replications: int
    #: Harvests that may be late at most.
    late: int

    @classmethod
    def of(cls, confidence: float) -> "Trial":
        """Return the trial after which a fleet is in time with a confidence: 19 of 20 for 95 %."""
        # So many that one late harvest is within what the confidence allows: 20 for 95 %.
        wanted = math.ceil(1.0 / (1.0 - confidence) - ROUNDING)
        replications = min(MOST, max(FEWEST, wanted))
        return cls(replications, math.floor((1.0 - confidence) * replications + ROUNDING))


def hours_words(seconds: float, half: float = 0.0) -> str:
    """Return a time in hours and minutes: '7:41 h'.

    `half`: of its interval, s, for '7:41 ± 0:08 h'.
    """
    words = _hours(seconds)
    if round(half / 60.0):
        words += f" ± {_hours(half)}"
    return f"{words} h"


def _hours(seconds: float) -> str:
    """Return a time as '7:41'."""
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours}:{minutes:02d}"
