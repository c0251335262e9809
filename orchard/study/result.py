"""What a study found, as data: the settings in a table, the best among them, and the answer in two
sentences.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

# `proven`, which only benchmarks have: what is proven of the shortest harvest.
Model = Literal["fast", "full", "proven"]
Models = Literal["fast", "full", "both"]
Horizon = Literal["harvest", "long"]
StoppedBy = Literal["certain", "budget", "seeds", "stopped"]
Standing = Literal["best", "equal", "worse", "unknown", "alone", "jammed"]
Goal = Literal["bins_per_hour", "cost_per_bin", "harvest_seconds"]


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean with its confidence interval.

    `low` and `high` are the mean if all replications gave the same.
    """

    mean: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class BreakEven:
    """What a robot may cost: at that price a bin costs the same with it and without it."""

    #: pickers or carriers.
    key: str
    #: Which robot it is: the last of so many, beside the fewer ones of another setting.
    number: int
    fewer: int
    #: In the currency of the prices, for each hour in which it works.
    per_hour: Interval
    #: The same as the price of a machine that is bought, for so many years of so many hours. None:
    #: the scenario does not say them.
    price: Interval | None = None
    years: float | None = None
    hours_per_year: float | None = None


@dataclass(frozen=True, kw_only=True)
class Check:
    """What the full model (the simulator) says of a setting, on common seeds with the fast
    model.
    """

    bins_per_hour: Interval
    #: Full over fast, on these seeds, as a share of the fast model's mean: 0.01 is 1 %.
    difference: float
    replications: int
    jammed: int


@dataclass(frozen=True, kw_only=True)
class Row:
    """One setting of the table.

    Rates are in bins per hour, times in s, costs in the currency of the scenario's prices.
    """

    #: What varies: {"carriers": 9, "dispatch": "predictive"}.
    setting: dict[str, Any]
    model: Model
    replications: int
    # Replications in which robots waited for ever, or too few carriers came to a picker; all other
    # figures are of the rest.
    jammed: int
    # Full bins, in rows that take their mean times, so that no run exceeds the bound. None: every
    # replication jammed. The two figures below are of the bins and the rows as they were.
    bins_per_hour: Interval | None
    harvest_seconds: Interval | None
    cost_per_bin: Interval | None  # None too if the scenario has no prices
    #: How long a picker stands until it has an empty bin, by the mean.
    picker_waiting_seconds: float
    #: Share of the time outside the queue, 0 to 1.
    carrier_utilisation: float
    # What this policy and route allow without traffic, whatever the seed: orchard.report.limits.
    bound_bins_per_hour: float
    bottleneck: str
    #: best: the answer, for each combination of what nobody chooses. The others are beside the best
    #: mean. unknown: the runs do not tell. alone: nothing that can be chosen varies.
    standing: Standing
    # By how much the best mean is ahead, as a share of this one's; all hold together; None: not
    # known.
    lead: Interval | None
    #: The same without an interval: one run tells it. None: this is the best mean, or it jammed.
    behind: float | None = None
    check: Check | None = None
    #: No harvest without traffic is shorter; None: it is not about harvests, or nothing is proven.
    proven_seconds: float | None = None
    #: What is paid for what, for a bin, by the mean: the names of `orchard.report.costs.PAYMENTS`.
    paid: dict[str, float] = field(default_factory=dict)
    #: How many of the replications were done by the deadline; None: there is none.
    in_time: int | None = None


@dataclass(frozen=True, kw_only=True)
class StudyResult:
    """The whole answer. `orchard study --summary` writes it as JSON, with these names."""

    #: In two sentences.
    answer: str
    #: What of it does not vary, in words.
    orchard: str
    # Of the settings that are as good as the best mean, that with the fewest robots; None: all
    # jammed.
    best: dict[str, Any] | None
    table: list[Row]
    goal: Goal
    horizon: Horizon
    confidence: float  # 0.95
    #: A difference below this share is worth nothing: 0.02.
    within: float
    scenario: dict[str, Any]
    #: What varies -> its values, in the order of the command line.
    varied: dict[str, list[Any]]
    wall_seconds: float
    #: Why no more replications were made.
    stopped_by: StoppedBy
    #: Settings that more runs may show to be the answer.
    undecided: list[dict[str, Any]]
    #: About how much longer that takes, or a run of each setting that has none. None: longer than a
    #: study goes on, or nothing is undecided.
    seconds_needed: float | None
    #: Key -> a value that was not tried, and may be better: the best has the last one that was.
    beyond: dict[str, Any]
    #: What the budget did not allow, what jammed, where fast and full model disagree.
    notes: list[str]
    version: str
    #: Of invariants, in full runs.
    violations: list[str] = field(default_factory=list)
    #: Settings that are asked for, and have no run yet. One of them may be the best.
    not_run: list[dict[str, Any]] = field(default_factory=list)
    #: The keys with several values that nobody chooses. Then `best` is None: each combination of
    #: them has a best row of its own, if anything can be chosen.
    given: list[str] = field(default_factory=list)
    #: What the last robots of the best setting may cost, and one more.
    break_even: list[BreakEven] = field(default_factory=list)
    #: By when a harvest must be done, in words; '' without a deadline.
    deadline: str = ""
    #: The same as an option of the command.
    deadline_option: str = ""

    @property
    def best_row(self) -> Row | None:
        """The row of the answer; None if there is no answer."""
        if self.best is None:
            return None
        return self.row_of(self.best)

    def row_of(self, setting: dict[str, Any]) -> Row | None:
        """Return the row of a setting; None if the table has none."""
        for row in self.table:
            if row.setting == setting:
                return row
        return None

    @property
    def equal_settings(self) -> list[dict[str, Any]]:
        """The settings that are as good as the best mean, for certain."""
        return [row.setting for row in self.table if row.standing == "equal"]

    @property
    def settings_asked(self) -> list[dict[str, Any]]:
        """The settings of the table, then those without a run."""
        return [*(row.setting for row in self.table), *self.not_run]

    @property
    def has_costs(self) -> bool:
        """Whether what a bin costs is known of a setting."""
        return any(row.cost_per_bin is not None for row in self.table)

    @property
    def is_cut(self) -> bool:
        """Whether the budget or the user ended the study before its answer was certain."""
        return self.stopped_by in ("budget", "stopped")

    @property
    def best_rows(self) -> list[Row]:
        """The rows that the answer names: the best one, or one for each of what is given."""
        return [row for row in self.table if row.standing in ("best", "alone")]

    @property
    def compared(self) -> list[str]:
        """The keys with several values, or all keys if none has. The answer names the others."""
        return [key for key, values in self.varied.items() if len(values) > 1] or list(self.varied)
