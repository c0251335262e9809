"""What a log says of the orchard itself: how many pickers and carriers, and which rows.

The option `--on` names the user's scenario of the orchard. Without it rows are assumed.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from statistics import fmean

from orchard.calibrate.bins import LoggedBin
from orchard.calibrate.log_lines import BinLog
from orchard.field.problems import Problem, ScenarioError, printable
from orchard.field.scenario import Scenario, with_changes
from orchard.field.survey import FEWEST_ROWS, MOST_ROWS

# The fewest pickers that a scenario can have.
FEWEST_PICKERS = 2
# These numbers are assumed of rows if no scenario is named. A picker of the model must fill several
# bins. So a row fills at least LEAST_BINS_A_ROW, unless each picker has LEAST_ROWS_A_PICKER rows.
LEAST_BINS_A_ROW = 3.0
LEAST_ROWS_A_PICKER = 3
# The most that a scenario can have.
MOST_BINS_A_ROW = 40.0
# m of a row for each of its bins, at least, so that the bins fit into it.
METRES_A_BIN = 10.0
# A row's name that is a number: "7", "row 7", "R-07".
_NUMBER = re.compile(r"(?:row|r)?[ _.-]*0*([1-9][0-9]*)", re.IGNORECASE)


@dataclass(frozen=True)
class LogOrchard:
    """The orchard of a log.

    `base`: the scenario, with numbers of pickers and carriers of the log; the log does not tell the
    rest. `bins`: of the log. `has_rows`: whether their rows are numbers of rows of `base`.
    `is_assumed`: the user has named no scenario. `notes`: what was assumed, a sentence each.
    """

    base: Scenario
    bins: list[LoggedBin]
    has_rows: bool
    is_assumed: bool
    notes: list[str]


def orchard_of(
    log: BinLog, bins: Sequence[LoggedBin], on: Scenario | None, on_file: str = ""
) -> LogOrchard:
    """Return the orchard of a log. `on`: the scenario that the user has; None: there is none.
    `on_file`: where it stands.

    Raises ScenarioError for rows and numbers that the scenario cannot have.
    """
    notes: list[str] = []
    changes: dict[str, object] = {}
    rows = {logged.row for logged in bins if logged.row}
    if on is None:
        base = Scenario()
        changes |= _rows_of_the_log(bins, rows, notes)
    else:
        base = _without_rates(on, notes)
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
    base = _changed(base, changes, log.file, on_file)
    if on is None or not rows:
        return LogOrchard(base, list(bins), False, on is None, notes)
    numbered = _numbered(log.file, bins, base)
    if numbered is None:
        notes.append("rows of the log have names, and those of the scenario numbers")
        return LogOrchard(base, list(bins), False, False, notes)
    return LogOrchard(base, numbered, True, False, notes)


def _without_rates(on: Scenario, notes: list[str]) -> Scenario:
    """Return a scenario without rates of its pickers, which may be more than those of the log."""
    if not on.picker_rates:
        return on
    notes.append("picker_rates of the scenario are left out: the log tells them")
    return on.model_copy(update={"picker_rates": {}})


def _changed(
    base: Scenario, changes: Mapping[str, object], log_file: str, on_file: str
) -> Scenario:
    """Return a scenario as the log says. Raises ScenarioError, which names the log where a value of
    the log is at fault, and else the scenario's file.
    """
    try:
        return with_changes(base, **changes)
    except ScenarioError as error:
        problems = []
        for problem in error.problems:
            keys = {path.split(".")[0] for path in problem.path.split(", ")}
            at_fault = on_file
            if not on_file or keys & changes.keys():
                at_fault = log_file
            problems.append(replace(problem, file=at_fault))
        raise ScenarioError(problems) from None


def _most_a_day(bins: Sequence[LoggedBin], column: str) -> int:
    """Return how many pickers or carriers work on one day at most; 0 if they have no names.

    `column`: "picker" or "carrier".
    """
    of_days: dict[date, set[str]] = {}
    for logged in bins:
        name = getattr(logged, column)
        if name:
            of_days.setdefault(logged.day, set()).add(name)
    return max((len(names) for names in of_days.values()), default=0)


def _rows_of_the_log(
    bins: Sequence[LoggedBin], rows: set[str], notes: list[str]
) -> dict[str, object]:
    """Return the changes of a scenario by what a log says of rows, where no scenario is named.

    `rows`: their names. What is assumed is added to `notes`.
    """
    usual = Scenario()
    pickers = _most_a_day(bins, "picker")
    count = min(MOST_ROWS, max(usual.rows, pickers))
    bins_per_row = LEAST_BINS_A_ROW
    in_the_log = ""
    if len(rows) >= FEWEST_ROWS:
        count = min(MOST_ROWS, max(len(rows), pickers))
        mean = fmean(_most_bins_a_day(bins).values())
        in_the_log = f"; {len(rows)} rows of {mean:.3g} bins a day are in the log"
        has_many_rows = pickers > 0 and count >= LEAST_ROWS_A_PICKER * pickers
        least = LEAST_BINS_A_ROW
        if has_many_rows:
            least = 1.0
        bins_per_row = round(min(MOST_BINS_A_ROW, max(least, mean)), 1)
    length = max(usual.row_length, METRES_A_BIN * bins_per_row)
    notes.append(
        f"no scenario is named (--on): {count} rows of {length:g} m, each of {bins_per_row:g} bins,"
        f" are assumed{in_the_log}"
    )
    return {"rows": count, "row_length": length, "bins_per_row": bins_per_row}


def _most_bins_a_day(bins: Sequence[LoggedBin]) -> dict[str, int]:
    """Return how many bins of each row are full on one day at most: row -> bins.

    Not on all days together: a row that is picked on several days is picked more than once, or rows
    of several blocks have the same name.
    """
    of_days = Counter((logged.row, logged.day) for logged in bins if logged.row)
    most: dict[str, int] = {}
    for (row, _), count in of_days.items():
        most[row] = max(count, most.get(row, 0))
    return most


def _numbered(file: str, bins: Sequence[LoggedBin], base: Scenario) -> list[LoggedBin] | None:
    """Return the bins with the rows' numbers of the scenario; None if rows have other names.

    Raises ScenarioError for some rows that the scenario does not have.
    """
    surveyed = _numbers_of_survey(base)
    numbered = []
    problems = []
    are_names = True
    for logged in bins:
        number = _row_number(logged.row, surveyed)
        row = ""
        if number:
            row = str(number)
            are_names = False
        if logged.row and not 0 < number <= base.rows:
            text = f"must be a row of the scenario, 1 to {base.rows}"
            problems.append(Problem(file, text, "row", printable(logged.row), logged.line))
        numbered.append(replace(logged, row=row))
    if are_names:
        return None
    if problems:
        raise ScenarioError(problems)
    return numbered


def _numbers_of_survey(base: Scenario) -> dict[str, int]:
    """Return the number of each row of a scenario that has a name, by that name."""
    if base.survey is None:
        return {}
    return {row.id: number for number, row in enumerate(base.survey.rows, 1)}


def _row_number(row: str, surveyed: Mapping[str, int]) -> int:
    """Return the number that a row of a log has; 0 if its name says none.

    `surveyed`: the numbers of rows by name.
    """
    if row in surveyed:
        return surveyed[row]
    number = _NUMBER.fullmatch(row)
    if number is None:
        return 0
    return int(number[1])
