"""The study of a farm: the same fleet harvests one block after another.

A block is an orchard with a scenario of its own. A transfer is the fleet's way from one block to
the next, which is not simulated. Each block is studied by itself, with its own seeds. The time of
the farm is the sum of the mean times of all blocks and of the transfers. The variances of the
blocks are added up too, and give its interval.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

from scipy import special

from orchard.field.decisions import is_choice
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.report.limits import full_bins
from orchard.study.break_even import break_even_words
from orchard.study.checking import checked_settings
from orchard.study.farm_file import Farm, FarmBlock
from orchard.study.options import StudyOptions
from orchard.study.plus_minus import do_robots_fail
from orchard.study.result import Interval, Row, Standing, StoppedBy, StudyResult
from orchard.study.runs import RunFailed, software
from orchard.study.settings import (
    CARRIERS,
    Setting,
    as_lists,
    is_open,
    most_carriers,
    numbered,
)
from orchard.study.study import study


@dataclass(frozen=True, kw_only=True)
class FarmRow:
    """One setting of a farm."""

    setting: dict[str, Any]
    #: Block -> the length of its harvest, s; None: a run of it jammed.
    blocks: dict[str, Interval | None]
    #: The time of all blocks and transfers, s; None: a run jammed.
    seconds: Interval | None
    #: The full bins that the fruit of all blocks fills.
    bins: float
    #: `bins` over `seconds`; None: a run jammed.
    bins_per_hour: Interval | None
    replications: dict[str, int]
    standing: Standing

    @property
    def mean_seconds(self) -> float:
        """The mean time of the farm, s; infinity if a run jammed."""
        if self.seconds is None:
            return math.inf
        return self.seconds.mean


@dataclass(frozen=True, kw_only=True)
class FarmResult:
    """The answer of a farm. `orchard study --summary` writes it as JSON, with these names."""

    answer: str
    #: Of the settings whose time is as good as the shortest one, that with the fewest robots; None:
    #: all jammed.
    best: dict[str, Any] | None
    table: list[FarmRow]
    #: Name -> file.
    blocks: dict[str, str]
    transfer_minutes: float
    confidence: float
    within: float
    varied: dict[str, list[Any]]
    wall_seconds: float
    notes: list[str]
    version: str
    violations: list[str] = field(default_factory=list)
    #: Settings of which a run of a block failed, as by an error in a policy. `notes` tell which.
    failed: list[dict[str, Any]] = field(default_factory=list)
    #: Why the study of a block made no more replications: the first one that is not certain.
    stopped_by: StoppedBy = "certain"
    #: Whether robots may fail in any block, and their harvests last longer then.
    do_robots_fail: bool = False

    @property
    def best_row(self) -> FarmRow | None:
        """The row of the answer; None if there is no answer."""
        for row in self.table:
            if row.setting == self.best:
                return row
        return None

    def settings_that_are(self, standing: Standing) -> list[dict[str, Any]]:
        """Return the settings that stand so beside the best one."""
        return [row.setting for row in self.table if row.standing == standing]


def farm_study(
    farm: Farm,
    varied: Mapping[str, Sequence[Any]],
    options: StudyOptions,
    tell: Callable[[str, StudyResult], None] = lambda name, partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> FarmResult:
    """Study each block of a farm, and return the answer for the farm.

    `options`: as of a study, but for the horizon, which is one harvest of each block; the blocks
    share the budget. `tell` gets the name of the block that is studied, and its result so far.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError, RunFailed or
    StoreFailed if runs cannot be done or kept.
    """
    begun = time.time()
    options = _options_of_harvests(options, len(farm.blocks))
    known = with_numbers_of_carriers(farm, varied)
    problems = farm_problems(farm, known, options)
    if problems:
        raise ScenarioError(problems)
    results = []
    for block in farm.blocks:
        # The default keeps this block's name for later calls.
        def tell_of_block(partial: StudyResult, name: str = block.name) -> None:
            tell(name, partial)

        try:
            results.append(study(block.scenario, known, options, tell_of_block, is_stopped))
        except RunFailed as failure:
            # All settings of this block failed.
            raise RunFailed(f"block {block.name}: {failure}") from None
    return _result(farm, known, options, results, time.time() - begun)


def _options_of_harvests(options: StudyOptions, blocks: int) -> StudyOptions:
    """Return the options of the study of each block."""
    model = options.model
    if model == "both":
        # The best setting of a block need not be that of the farm, which the simulator would check.
        model = "fast"
    return replace(
        options,
        horizon="harvest",
        goal="harvest_seconds",
        model=model,
        budget_seconds=options.budget_seconds / blocks,
    )


def with_numbers_of_carriers(
    farm: Farm, varied: Mapping[str, Sequence[Any]]
) -> dict[str, list[Any]]:
    """Return what varies, with numbers of carriers if the user gives none.

    They are all numbers with which the study of a block would begin, and for which each block has
    room.
    """
    known = as_lists(varied)
    if not is_open(varied):
        return known
    numbers = set[int]()
    for block in farm.blocks:
        numbers.update(numbered(block.scenario, varied)[CARRIERS])
    most = min(most_carriers(block.scenario) for block in farm.blocks)
    possible = [number for number in sorted(numbers) if number <= most]
    known[CARRIERS] = possible or [most]
    return known


def farm_problems(
    farm: Farm, varied: Mapping[str, Sequence[Any]], options: StudyOptions
) -> list[Problem]:
    """Return what is wrong with the settings of a farm, for each block by its name."""
    problems = []
    for key, values in varied.items():
        if not is_choice(Scenario, key, values):
            text = "nobody chooses it; a farm compares what is chosen. Change it in the blocks"
            problems.append(Problem(f"--vary {key}", text))
    if problems:
        return problems
    for block in farm.blocks:
        for problem in checked_settings(block.scenario, varied, options)[1]:
            problems.append(replace(problem, file=f"{problem.file}: block {block.name}"))
    return problems


def sum_of(parts: Sequence[tuple[Interval, int]], confidence: float) -> Interval:
    """Return the interval of a sum of independent means, by Welch and Satterthwaite.

    `parts`: each mean with its interval of this confidence, and the number of its runs. By as much
    as that of a part is wider than Student's, because its runs are skewed, its deviation counts as
    larger.
    """
    mean = sum(part.mean for part, _ in parts)
    # The variance of the sum of means, and the terms of its degrees of freedom by Satterthwaite.
    variance = 0.0
    terms = 0.0
    for part, count in parts:
        half = part.high - part.mean
        if count > 1 and half > 0.0:
            of_part = (half / _quantile(count - 1, confidence)) ** 2
            variance += of_part
            terms += of_part**2 / (count - 1)
    if variance == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = _quantile(variance**2 / terms, confidence) * math.sqrt(variance)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def _quantile(freedom: float, confidence: float) -> float:
    """Return half the width of a t interval, in standard deviations of the mean.

    `freedom`: its degrees of freedom.
    """
    return float(special.stdtrit(freedom, 0.5 + confidence / 2.0))


# -- the result


def _result(
    farm: Farm,
    varied: dict[str, list[Any]],
    options: StudyOptions,
    results: Sequence[StudyResult],
    wall_seconds: float,
) -> FarmResult:
    """Return the answer for the farm. `results`: the study of each block."""
    rows = []
    # Settings without a run in every block.
    missing = []
    failed = _failed(results)
    for setting in _settings_in_order(results):
        of_blocks = _rows_of(setting, results)
        if setting in failed:
            continue
        if len(of_blocks) < len(results):
            missing.append(setting)
        else:
            rows.append(_farm_row(farm, setting, of_blocks, options.confidence))
    best = _best(farm, rows, options.within)
    best_setting = None
    if best is not None:
        best_setting = best.setting
    table = []
    for row in rows:
        table.append(replace(row, standing=_standing(row, best, rows, options.within)))
    violations = set[str]()
    for result in results:
        violations.update(result.violations)
    return FarmResult(
        answer="",
        best=best_setting,
        table=table,
        blocks={block.name: block.file for block in farm.blocks},
        transfer_minutes=farm.transfer_seconds / 60.0,
        confidence=options.confidence,
        within=options.within,
        varied=varied,
        wall_seconds=wall_seconds,
        notes=_notes(farm, rows, missing, results, options),
        version=software(),
        violations=sorted(violations),
        failed=failed,
        stopped_by=_stopped_by(results),
        do_robots_fail=any(do_robots_fail(each.scenario, varied) for each in results),
    )


def _stopped_by(results: Sequence[StudyResult]) -> StoppedBy:
    """Return why no more replications were made: by what the first block that is not certain was
    ended, but by the user if any was.
    """
    reasons = [result.stopped_by for result in results]
    if "stopped" in reasons:
        return "stopped"
    for reason in reasons:
        if reason != "certain":
            return reason
    return "certain"


def _failed(results: Sequence[StudyResult]) -> list[dict[str, Any]]:
    """Return the settings of which a run failed in any block, each once."""
    return _each_once(result.failed for result in results)


def _each_once(of_blocks: Iterable[Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return all settings of some blocks, each once."""
    settings: list[dict[str, Any]] = []
    for of_block in of_blocks:
        for setting in of_block:
            if setting not in settings:
                settings.append(setting)
    return settings


def _settings_in_order(results: Sequence[StudyResult]) -> list[dict[str, Any]]:
    """Return all settings that any block was asked about, in the order of the table."""
    settings = _each_once(result.settings_asked for result in results)
    varied = results[0].varied

    def place(setting: dict[str, Any]) -> tuple[int, ...]:
        return tuple(values.index(setting[key]) for key, values in varied.items())

    return sorted(settings, key=place)


def _rows_of(setting: dict[str, Any], results: Sequence[StudyResult]) -> list[Row]:
    """Return the rows of a setting in the studies of the blocks. A block without a run has none."""
    rows = []
    for result in results:
        row = result.row_of(setting)
        if row is not None:
            rows.append(row)
    return rows


def _farm_row(
    farm: Farm, setting: dict[str, Any], rows: Sequence[Row], confidence: float
) -> FarmRow:
    """Return the row of a setting. `rows`: of the blocks. The caller sets the standing."""
    blocks = {}
    replications = {}
    parts = []
    bins = 0.0
    for block, row in zip(farm.blocks, rows, strict=True):
        blocks[block.name] = row.harvest_seconds
        replications[block.name] = row.replications
        if row.harvest_seconds is not None:
            parts.append((row.harvest_seconds, row.replications))
        bins += full_bins(lay_out(_with(block, setting)))
    seconds = None
    rate = None
    if len(parts) == len(rows):
        harvests = sum_of(parts, confidence)
        seconds = Interval(
            mean=harvests.mean + farm.all_transfers,
            low=harvests.low + farm.all_transfers,
            high=harvests.high + farm.all_transfers,
        )
        rate = Interval(
            mean=3600.0 * bins / seconds.mean,
            low=3600.0 * bins / seconds.high,
            high=3600.0 * bins / seconds.low,
        )
    return FarmRow(
        setting=setting,
        blocks=blocks,
        seconds=seconds,
        bins=bins,
        bins_per_hour=rate,
        replications=replications,
        standing="jammed",
    )


def _with(block: FarmBlock, setting: dict[str, Any]) -> Scenario:
    """Return the scenario of a block with a setting."""
    return with_changes(block.scenario, **setting)


def _best(farm: Farm, rows: Sequence[FarmRow], within: float) -> FarmRow | None:
    """Return the answer: of the settings whose mean time is at most by `within` above the shortest
    one, that with the fewest robots. None: all jam.
    """
    shortest = min((row.mean_seconds for row in rows), default=math.inf)
    if shortest == math.inf:
        return None
    near = [row for row in rows if row.mean_seconds < (1.0 + within) * shortest]

    def rank(row: FarmRow) -> tuple[int, float]:
        setting = Setting(row.setting, _with(farm.blocks[0], row.setting))
        return setting.robots, row.mean_seconds

    return min(near, key=rank)


def _standing(
    row: FarmRow, best: FarmRow | None, rows: Sequence[FarmRow], within: float
) -> Standing:
    """Return how a setting stands beside the shortest one.

    The interval of their difference is computed as if their runs were independent. They have common
    seeds, so the true interval is shorter.
    """
    if row is best and len(rows) == 1:
        return "alone"
    if row is best:
        return "best"
    shortest = min(rows, key=attrgetter("mean_seconds")).seconds
    if row.seconds is None or shortest is None:
        return "jammed"
    behind = row.seconds.mean - shortest.mean
    half = math.hypot(row.seconds.high - row.seconds.mean, shortest.high - shortest.mean)
    worth = within * shortest.mean
    if behind + half < worth:
        return "equal"
    if behind - half >= worth:
        return "worse"
    return "unknown"


def _notes(
    farm: Farm,
    rows: Sequence[FarmRow],
    missing: Sequence[dict[str, Any]],
    results: Sequence[StudyResult],
    options: StudyOptions,
) -> list[str]:
    """Return what a reader must know beside the table."""
    count = len(farm.blocks)
    notes = [
        f"each of the {count} blocks is harvested once, as an orchard of its own, by the same"
        " fleet, one after another; no recording or picture shows them together",
        "times are sums of the blocks' means and of the transfers; intervals are those of the sums"
        " of their variances",
    ]
    if missing:
        some = f"{len(missing)} of {len(missing) + len(rows)} settings"
        note = f"the budget did not allow a run in every block of {some}: left out. --budget"
        if _stopped_by(results) == "stopped":
            note = f"the study was stopped before a run in every block of {some}: left out"
        notes.append(note)
    if any(result.scenario["prices"] != Scenario().prices.model_dump() for result in results):
        notes.append("prices of the blocks are not used: a farm is asked for its time")
    if any(result.scenario["shift"]["begin"] is not None for result in results):
        notes.append("the shift of a block is not used: times of a farm are working time")
    for block, result in zip(farm.blocks, results, strict=True):
        # A farm is not asked for its costs.
        of_costs = set(map(break_even_words, result.break_even))
        for note in result.notes:
            if note not in of_costs:
                notes.append(f"{block.name}: {note}")
    if options.model == "fast":
        notes.append("by the fast model; the simulator checks a block: orchard study FILE")
    return notes
