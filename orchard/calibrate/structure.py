"""What a log says of the orchard itself: how many pickers and carriers, and which rows."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from statistics import fmean

from orchard.calibrate.bins import BinTimes
from orchard.calibrate.log_lines import BinLog
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.field.survey import FEWEST_ROWS

FEWEST_PICKERS = 2
_NUMBER = re.compile(r"(?:row|r)?[ _.-]*0*([1-9][0-9]*)", re.IGNORECASE)


@dataclass(frozen=True)
class LogOrchard:
    """The orchard of a log: `base` has all that the log does not tell.

    `has_rows`: whether rows of the log are numbered as those of the scenario. `notes`: what was
    assumed.
    """

    base: Scenario
    bins: list[BinTimes]
    has_rows: bool
    notes: list[str]


def orchard_of(log: BinLog, bins: Sequence[BinTimes], on: Scenario | None) -> LogOrchard:
    """Return the orchard of a log. `on`: the scenario that the user has; None: there is none.

    Raises ScenarioError for rows and numbers that the scenario cannot have.
    """
    notes: list[str] = []
    changes: dict[str, object] = {}
    base = Scenario() if on is None else on
    rows = {logged.row for logged in bins if logged.row}
    if on is None:
        changes |= _rows_of_the_log(bins, rows, notes)
    pickers = _most_a_day(bins, "picker")
    if pickers:
        changes["pickers"] = max(FEWEST_PICKERS, pickers)
        if pickers < FEWEST_PICKERS:
            notes.append(f"a scenario has {FEWEST_PICKERS} pickers at least; the log has 1")
    else:
        notes.append(f"the log names no pickers: {base.pickers} are assumed")
    carriers = _most_a_day(bins, "carrier")
    if carriers:
        changes["carriers"] = carriers
    else:
        notes.append(f"the log names no carriers: {base.carrier_count} are assumed")
    try:
        base = with_changes(base, **changes)
    except ScenarioError as error:
        problems = [replace(problem, file=log.file) for problem in error.problems]
        raise ScenarioError(problems) from None
    if on is None or not rows:
        return LogOrchard(base, list(bins), False, notes)
    numbered = _numbered(log.file, bins, base)
    if numbered is None:
        notes.append("rows of the log have names, and those of the scenario numbers")
        return LogOrchard(base, list(bins), False, notes)
    return LogOrchard(base, numbered, True, notes)


def _most_a_day(bins: Sequence[BinTimes], column: str) -> int:
    """Return how many pickers or carriers work on one day at most; 0 if they have no names."""
    of_days: dict[date, set[str]] = {}
    for logged in bins:
        name = getattr(logged, column)
        if name:
            of_days.setdefault(logged.day, set()).add(name)
    return max((len(names) for names in of_days.values()), default=0)


def _rows_of_the_log(
    bins: Sequence[BinTimes], rows: set[str], notes: list[str]
) -> dict[str, object]:
    """Return what a log says of rows, where no scenario does. `rows`: their names."""
    usual = Scenario()
    assumed = f"no scenario is named (--on): rows of {usual.row_length:g} m"
    if len(rows) < FEWEST_ROWS:
        count = max(usual.rows, _most_a_day(bins, "picker"))
        notes.append(f"{assumed}, {count} of them, each of one bin, are assumed")
        return {"rows": count}
    bins_of: dict[str, int] = {}
    for logged in bins:
        if logged.row:
            bins_of[logged.row] = bins_of.get(logged.row, 0) + 1
    bins_per_row = round(fmean(bins_of.values()), 1)
    notes.append(f"{assumed} are assumed; {len(rows)} rows of {bins_per_row:g} bins are in the log")
    return {"rows": len(rows), "bins_per_row": bins_per_row}


def _numbered(file: str, bins: Sequence[BinTimes], base: Scenario) -> list[BinTimes] | None:
    """Return the bins with the rows' numbers of the scenario; None if rows have other names.

    Raises ScenarioError for some rows that the scenario does not have.
    """
    number_of = {}
    if base.survey is not None:
        number_of = {row.id: number for number, row in enumerate(base.survey.rows, 1)}
    numbered = []
    problems = []
    for logged in bins:
        number = number_of.get(logged.row)
        match = _NUMBER.fullmatch(logged.row)
        if number is None and match is not None:
            number = int(match[1])
        if logged.row and (number is None or number > base.rows):
            text = f"must be a row of the scenario, 1 to {base.rows}"
            problems.append(Problem(file, text, "row", logged.row, logged.line))
        numbered.append(replace(logged, row="" if number is None else str(number)))
    are_names = all(not logged.row for logged in numbered)
    if are_names:
        return None
    if problems:
        raise ScenarioError(problems)
    return numbered
