"""What a sensitivity study found, as data. `orchard study --sensitivity --summary` writes it."""

from dataclasses import dataclass, field
from typing import Any

from orchard.study.result import Goal, Horizon, Interval, StoppedBy


@dataclass(frozen=True, kw_only=True)
class Effect:
    """How one value changes the result when it is moved through its range.

    Shares are of the whole variance of a run's result: 0.5 is half. Their intervals are computed by
    bootstrap.
    """

    key: str
    low: float
    high: float
    #: The mean result where the value is at its low end, or its high one, and the others are
    #: anywhere in their ranges. None: the fit is not good enough for that.
    at_low: float | None
    at_high: float | None
    #: The share of this value by itself: how much less the variance were if the value were known.
    first_order: Interval
    #: The share with all that it does together with others: how much variance would be left if all
    #: other values were known.
    total: Interval

    @property
    def swing(self) -> float | None:
        """How far apart the mean results at both ends are; None if they are not known."""
        if self.at_low is None or self.at_high is None:
            return None
        return abs(self.at_high - self.at_low)


@dataclass(frozen=True, kw_only=True)
class SensitivityResult:
    """What a result depends on."""

    answer: str
    orchard: str
    goal: Goal
    horizon: Horizon
    #: A share: a value that moves the mean by less does not matter.
    within: float
    confidence: float
    #: The effects, greatest total first. Empty: too few runs.
    effects: list[Effect]
    #: The mean of all runs, and the interval in which 95 % of them lie.
    mean: float
    spread: Interval
    #: The share of all variance that runs have which differ only in their seeds.
    luck: Interval
    #: The share of all variance that neither the fit nor the seeds explain. It may come from any
    #: value.
    unfitted: Interval
    #: How well the fit predicts points that it has not seen: R2, 0 to 1, without the luck of the
    #: seeds.
    fit: float
    #: How many points have all their runs done, and none jammed.
    points: int
    points_asked: int
    runs: int
    #: The values of points in which a run jammed.
    jammed: list[dict[str, Any]]
    stopped_by: StoppedBy
    wall_seconds: float
    scenario: dict[str, Any]
    version: str
    notes: list[str] = field(default_factory=list)
