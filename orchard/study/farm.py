"""The study of a farm: one harvest of each block by the same fleet, one after another.

Each block is studied as an orchard of its own, with seeds of its own. The time of the farm is the
sum of the means of its blocks and of the transfers; its interval is that of the sum of their
variances. No robot is seen on its way from one block to the next.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from scipy import special

from orchard.field.decisions import is_choice
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.report.limits import full_bins
from orchard.study.checking import checked_settings
from orchard.study.farm_file import Farm, FarmBlock
from orchard.study.options import StudyOptions
from orchard.study.result import Interval, Row, Standing, StudyResult
from orchard.study.runs import software
from orchard.study.settings import CARRIERS, is_open, most_carriers, numbered
from orchard.study.study import study


@dataclass(frozen=True, kw_only=True)
class FarmRow:
    """One setting of a farm."""

    setting: dict[str, Any]
    #: One harvest of each block, s, in their order; None: a run of it jammed.
    blocks: dict[str, Interval | None]
    #: Of all blocks, with the transfers, s; None: a run jammed.
    seconds: Interval | None
    #: Full bins of all blocks.
    bins: float
    #: Of the whole time, with the transfers; None: a run jammed.
    bins_per_hour: Interval | None
    replications: dict[str, int]
    standing: Standing


@dataclass(frozen=True, kw_only=True)
class FarmResult:
    """The answer of a farm. `orchard study --summary` writes it as JSON, with these names."""

    answer: str
    #: Of the settings that are as good as the shortest, that with the fewest robots.
    best: dict[str, Any] | None
    table: list[FarmRow]
    blocks: dict[str, str]  # name -> file
    transfer_minutes: float
    confidence: float
    within: float
    varied: dict[str, list[Any]]
    wall_seconds: float
    notes: list[str]
    version: str
    violations: list[str] = field(default_factory=list)

    @property
    def best_row(self) -> FarmRow | None:
        return next((row for row in self.table if row.setting == self.best), None)


def farm_study(
    farm: Farm,
    varied: Mapping[str, Sequence[Any]],
    options: StudyOptions,
    tell: Callable[[str, StudyResult], None] = lambda name, partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> FarmResult:
    """Study each block of a farm, and return what that says of the farm.

    `options`: as of a study; one harvest of each block is asked about, and the budget is shared.
    `tell` hears the block that is studied, and what is known of it.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError, RunFailed or
    StoreFailed if runs cannot be done or kept.
    """
    begun = time.time()
    options = _options_of_harvests(options, len(farm.blocks))
    known = farm_settings(farm, varied)
    problems = farm_problems(farm, known, options)
    if problems:
        raise ScenarioError(problems)
    results = []
    for block in farm.blocks:

        def tell_of_block(partial: StudyResult, name: str = block.name) -> None:
            tell(name, partial)

        results.append(study(block.scenario, known, options, tell_of_block, is_stopped))
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


def farm_settings(farm: Farm, varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return what varies, with the numbers of carriers if the user gives none: those about the
    numbers that keep the pickers of any block busy.
    """
    known = {key: list(values) for key, values in varied.items()}
    if is_open(varied):
        numbers = set[int]()
        for block in farm.blocks:
            numbers.update(numbered(block.scenario, varied)[CARRIERS])
        most = min(most_carriers(block.scenario) for block in farm.blocks)
        known[CARRIERS] = sorted(number for number in numbers if number <= most) or [most]
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

    `parts`: each mean with its t interval of this confidence, and of how many runs it is.
    """
    mean = sum(part.mean for part, _ in parts)
    variance = 0.0
    of_freedom = 0.0
    for part, count in parts:
        half = part.high - part.mean
        if count > 1 and half > 0.0:
            own = (half / _quantile(count - 1, confidence)) ** 2
            variance += own
            of_freedom += own**2 / (count - 1)
    if variance == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = _quantile(variance**2 / of_freedom, confidence) * math.sqrt(variance)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def _quantile(freedom: float, confidence: float) -> float:
    """Return half the width of a t interval, in standard deviations of the mean."""
    return float(special.stdtrit(freedom, 0.5 + confidence / 2.0))


# -- the result


def _result(
    farm: Farm,
    varied: dict[str, list[Any]],
    options: StudyOptions,
    results: Sequence[StudyResult],
    wall_seconds: float,
) -> FarmResult:
    """Return what the studies of all blocks say of the farm."""
    rows = []
    missing = []
    for setting in _settings_in_order(results):
        of_blocks = [_row_of(result, setting) for result in results]
        known = [row for row in of_blocks if row is not None]
        if len(known) < len(of_blocks):
            missing.append(setting)
            continue
        rows.append(_farm_row(farm, setting, known, options.confidence))
    best = _best(farm, rows, options.within)
    rows = [replace(row, standing=_standing(row, best, rows, options.within)) for row in rows]
    violations = set[str]()
    for result in results:
        violations.update(result.violations)
    return FarmResult(
        answer="",
        best=None if best is None else best.setting,
        table=rows,
        blocks={block.name: block.file for block in farm.blocks},
        transfer_minutes=farm.transfer_seconds / 60.0,
        confidence=options.confidence,
        within=options.within,
        varied=varied,
        wall_seconds=wall_seconds,
        notes=_notes(farm, rows, missing, results, options),
        version=software(),
        violations=sorted(violations),
    )


def _settings_in_order(results: Sequence[StudyResult]) -> list[dict[str, Any]]:
    """Return the settings of which a block has a run or should have one, as the table has them."""
    settings: list[dict[str, Any]] = []
    for result in results:
        for setting in [*(row.setting for row in result.table), *result.not_run]:
            if setting not in settings:
                settings.append(setting)
    varied = results[0].varied

    def place(setting: dict[str, Any]) -> tuple[int, ...]:
        return tuple(values.index(setting[key]) for key, values in varied.items())

    return sorted(settings, key=place)


def _row_of(result: StudyResult, setting: dict[str, Any]) -> Row | None:
    """Return what the study of a block says of a setting; None if it has no run of it."""
    return next((row for row in result.table if row.setting == setting), None)


def _farm_row(
    farm: Farm, setting: dict[str, Any], rows: Sequence[Row], confidence: float
) -> FarmRow:
    """Return what the blocks say of a setting."""
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
    """Return the answer: of the settings that are as short as the shortest mean but for what is
    worth nothing, one with the fewest robots. None: all jam.
    """
    timed = [(row.seconds.mean, row) for row in rows if row.seconds is not None]
    if not timed:
        return None
    shortest = min(seconds for seconds, _ in timed)
    near = [row for seconds, row in timed if seconds < (1.0 + within) * shortest]

    def rank(row: FarmRow) -> tuple[int, float]:
        scenario = _with(farm.blocks[0], row.setting)
        mean = row.seconds.mean if row.seconds is not None else math.inf
        return scenario.pickers + scenario.carrier_count, mean

    return min(near, key=rank)


def _standing(
    row: FarmRow, best: FarmRow | None, rows: Sequence[FarmRow], within: float
) -> Standing:
    """Return how a setting stands beside the shortest one.

    The interval of the difference is that of two independent sums: on common seeds it is shorter.
    """
    if row is best:
        return "best" if len(rows) > 1 else "alone"
    timed = [other.seconds for other in rows if other.seconds is not None]
    if row.seconds is None or not timed:
        return "jammed"
    shortest = min(timed, key=lambda seconds: seconds.mean)
    behind = row.seconds.mean - shortest.mean
    half = math.hypot(row.seconds.high - row.seconds.mean, shortest.high - shortest.mean)
    worth = within * shortest.mean
    if behind + half < worth:
        return "equal"
    return "worse" if behind - half >= worth else "unknown"


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
        notes.append(
            f"the budget did not allow a run in every block of {len(missing)} of"
            f" {len(missing) + len(rows)} settings: they are left out. --budget"
        )
    if any(result.scenario["prices"] != Scenario().prices.model_dump() for result in results):
        notes.append("prices of the blocks are not used: a farm is asked for its time")
    if any(result.scenario["shift"]["begin"] is not None for result in results):
        notes.append("the shift of a block is not used: times of a farm are working time")
    for block, result in zip(farm.blocks, results, strict=True):
        for note in result.notes:
            notes.append(f"{block.name}: {note}")
    if options.model == "fast":
        notes.append("by the fast model; the simulator checks a block: orchard study FILE")
    return notes
