"""What a sensitivity study found, as data. `orchard study --sensitivity --summary` writes it."""

from dataclasses import dataclass, field
from typing import Any

from orchard.study.result import Goal, Horizon, Interval, StoppedBy


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What one value does to the result when it is moved through its range.

    Shares are of all variance of a run's result: 0.5 is half. Their intervals are by bootstrap.
    """

    key: str
    low: float
    high: float
    #: The mean result where the value is at its low end, and the others are anywhere in theirs.
    #: None: the fit is not good enough to tell it.
    at_low: float | None
    at_high: float | None
    #: By itself: what would be gone if this value were known.
    first_order: Interval
    #: With all in which it takes part: what would be left if all but this one were known.
    total: Interval

    @property
    def swing(self) -> float | None:
        """How far the mean result goes from one end to the other; None if that is not told."""
        if self.at_low is None or self.at_high is None:
            return None
        return abs(self.at_high - self.at_low)


@dataclass(frozen=True, kw_only=True)
class SensitivityResult:
    """What a result hangs on."""

    answer: str
    orchard: str
    goal: Goal
    horizon: Horizon
    #: A value that moves the mean by a smaller share is worth nothing.
    within: float
    confidence: float
    #: The effects, greatest total first. Empty: too few runs.
    effects: list[Effect]
    #: The mean of all runs, and between which values 95 % of them lie.
    mean: float
    spread: Interval
    #: Of all variance: of runs that differ only in their seeds.
    luck: Interval
    #: Of all variance: what neither the fit nor the seeds tell. It may come from any value.
    unfitted: Interval
    #: How much of what the values move the fit tells: R2, without the luck of the seeds. It is that
    #: of points which the fit has not seen.
    fit: float
    points: int
    points_asked: int
    runs: int
    jammed: list[dict[str, Any]]
    stopped_by: StoppedBy
    wall_seconds: float
    scenario: dict[str, Any]
    version: str
    notes: list[str] = field(default_factory=list)
