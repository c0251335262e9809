"""What a study found, as data: the settings in a table, the best of them, and the answer in two
sentences. `orchard study --summary` writes it as JSON, and the page shows it.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

# The model that does a run. fast: the event model. full: the simulator. proven, in benchmarks only:
# the time that is proven of the shortest harvest.
Model = Literal["fast", "full", "proven"]
Models = Literal["fast", "full", "both"]
# What a run is: one harvest, or the long run of a harvest that goes on.
Horizon = Literal["harvest", "long"]
# Why a study made no more replications: the answer is certain, the budget is used, all replications
# were made, or the user stopped it.
StoppedBy = Literal["certain", "budget", "seeds", "stopped"]
# See `Row.standing`.
Standing = Literal["best", "equal", "worse", "unknown", "alone", "jammed"]
Goal = Literal["bins_per_hour", "cost_per_bin", "harvest_seconds"]


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean with its confidence interval.

    `low` and `high` are equal to the mean if all replications gave the same value.
    """

    mean: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class BreakEven:
    """What a robot may cost: at that price a bin costs the same with it and without it."""

    #: pickers or carriers.
    key: str
    #: Two settings are compared: one with so many robots of this kind, and one with `fewer`.
    number: int
    fewer: int
    #: In the currency of the prices, for each hour in which it works.
    per_hour: Interval
    #: The same as the price of a machine that is bought, and works for `years` of `hours_per_year`.
    #: None: the scenario does not say these.
    price: Interval | None = None
    years: float | None = None
    hours_per_year: float | None = None


@dataclass(frozen=True, kw_only=True)
class Check:
    """The result of the full model (the simulator) for a setting, with seeds of the fast model."""

    bins_per_hour: Interval
    #: The full model's rate less the fast model's on these seeds, as a share of the latter: 0.01 is
    #: 1 % more.
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
    # Full bins, in rows that take their mean times, so that no run exceeds the bound. The two
    # figures below are of the bins and the rows as they were. None: every replication jammed.
    bins_per_hour: Interval | None
    harvest_seconds: Interval | None
    cost_per_bin: Interval | None  # None too if the scenario has no prices
    #: How long a picker stands until it has an empty bin, on average.
    picker_waiting_seconds: float
    #: Share of the time outside the queue, 0 to 1.
    carrier_utilisation: float
    # The limit without traffic with this policy and route, whatever the seed:
    # orchard.report.limits.
    bound_bins_per_hour: float
    bottleneck: str
    #: best: the answer; there is one for each combination of values that nobody can choose, such as
    #: the number of people. Others are compared with the setting of the best mean. equal, worse:
    #: for certain. unknown: too few runs. alone: nothing that can be chosen varies. jammed: a run
    #: did.
    standing: Standing
    # By how much the best mean is ahead, as a share of the mean of this setting. The intervals of
    # all rows hold together, with the study's confidence. None: not known, as after one run, and
    # where all seeds agree by luck.
    lead: Interval | None
    #: The same without an interval, which is known after one run. None: this is the best mean, or
    #: it jammed.
    behind: float | None = None
    check: Check | None = None
    #: It is proven that no harvest without traffic is shorter, s. None: nothing is proven, or the
    #: study is about the long run.
    proven_seconds: float | None = None
    #: What a bin costs, on average: key of `orchard.report.costs.PAYMENTS` -> amount.
    paid: dict[str, float] = field(default_factory=dict)
    #: How many of the replications were done by the deadline; None: there is none.
    in_time: int | None = None
    #: When a harvest of the mean time ends: 'day 2 at 09:40'. None without a shift, or in the long
    #: run.
    ends: str | None = None


@dataclass(frozen=True, kw_only=True)
class StudyResult:
    """The whole answer. `orchard study --summary` writes it as JSON, with these names."""

    #: In two sentences.
    answer: str
    #: The values of the orchard that do not vary, in words.
    orchard: str
    # The answer: of the settings that are as good as the best mean, that with the fewest robots,
    # trailers, chargers and `bays`. None: all jammed, or something varies that nobody can choose
    # (`given`).
    best: dict[str, Any] | None
    table: list[Row]
    goal: Goal
    horizon: Horizon
    confidence: float  #: 0 to 1
    #: A share: settings that differ by less count as equally good.
    within: float
    scenario: dict[str, Any]
    #: What varies -> its values, in the order of the command line.
    varied: dict[str, list[Any]]
    wall_seconds: float
    #: Why no more replications were made.
    stopped_by: StoppedBy
    #: Settings of which more runs may show that they are the answer.
    undecided: list[dict[str, Any]]
    #: About how long it takes to decide that; or, if settings have no run, to run each of them
    #: once. None: more replications than a study makes, or nothing is undecided.
    seconds_needed: float | None
    #: Key -> a value beyond the range that was tried. It may be better, because the best setting
    #: has the last value of this range.
    beyond: dict[str, Any]
    #: What the budget did not allow, what jammed, where fast and full model disagree.
    notes: list[str]
    version: str
    #: Of invariants, in full runs.
    violations: list[str] = field(default_factory=list)
    #: Settings that are asked for, and have no run yet. One of them may be the best.
    not_run: list[dict[str, Any]] = field(default_factory=list)
    #: The keys with several values that nobody can choose, such as the number of people. With such
    #: keys `best` is None: each combination of their values has a best row.
    given: list[str] = field(default_factory=list)
    #: What the last robots of the best setting may cost, and one more.
    break_even: list[BreakEven] = field(default_factory=list)
    #: Settings of which a run failed, as by an error in a policy. `notes` tell which, and where.
    failed: list[dict[str, Any]] = field(default_factory=list)
    #: Settings of the table of which a run failed in the simulator, which was to check them: they
    #: have no check. `notes` tell which run, and where.
    check_failed: list[dict[str, Any]] = field(default_factory=list)
    #: Settings that may be as good as the answer, too, of which more runs would hardly tell.
    on_the_edge: list[dict[str, Any]] = field(default_factory=list)
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

    @property
    def has_failures(self) -> bool:
        """Whether a run of any setting failed."""
        return bool(self.failed or self.check_failed)

    def row_of(self, setting: dict[str, Any]) -> Row | None:
        """Return the row of a setting; None if the table has none."""
        for row in self.table:
            if row.setting == setting:
                return row
        return None

    @property
    def equal_settings(self) -> list[dict[str, Any]]:
        """The settings with the standing "equal"."""
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
        """The keys with several values, or all keys if none has several."""
        return [key for key, values in self.varied.items() if len(values) > 1] or list(self.varied)
