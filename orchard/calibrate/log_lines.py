"""Reads a log of bins: CSV with a line of column names, then a line for each event.

A line says when a bin was full, fetched or unloaded, and which picker, row and carrier it was. All
that is wrong with lines is collected (`Problem`), each with the number of its line and with what
would be right. `orchard.calibrate.bins` matches the lines to bins.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

from orchard.calibrate.log_times import LogTime, time_of, time_problems
from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.texts import text_of

Event = Literal["full", "fetched", "unloaded"]
EVENTS: tuple[Event, ...] = ("full", "fetched", "unloaded")
HEADER = "time,event,picker,row,carrier"
# Column -> the names that it may have in a file, as `_plain` returns them.
COLUMNS = {
    "time": ("time", "timestamp", "datetime", "when"),
    "event": ("event", "what", "action", "status"),
    "picker": ("picker", "pickerid", "pickername", "person", "worker"),
    "row": ("row", "rowid", "rowno", "rownumber"),
    "carrier": ("carrier", "carrierid", "tractor", "vehicle", "driver"),
}
# Event -> the words for it in a file, as `_plain` returns them.
WORDS: dict[Event, tuple[str, ...]] = {
    "full": ("full", "filled", "binfull"),
    "fetched": ("fetched", "collected", "pickedup", "taken"),
    "unloaded": ("unloaded", "delivered", "tipped", "emptied"),
}
_SEPARATORS = ";\t,"


@dataclass(frozen=True)
class LogLine:
    """A line of a log: an event of a bin. Names that it lacks are ""."""

    #: The number of the line in the file, from 1.
    number: int
    time: datetime
    event: Event
    picker: str
    row: str
    carrier: str


@dataclass(frozen=True)
class BinLog:
    """A log that was read.

    `file`: its name, printable. `columns`: those of COLUMNS that it has. `notes`: what was assumed,
    and what of the file is not used, a sentence each.
    """

    file: str
    lines: list[LogLine]
    columns: frozenset[str]
    notes: list[str]


def read_log(path: Path) -> BinLog:
    """Return the log in a file. Raises ScenarioError with all wrong lines, and OSError."""
    file = printable(str(path))
    # `assumed`: which encoding the text was taken to have.
    text, assumed = text_of(path.read_bytes())
    notes = list(assumed)
    head = re.split(r"[\r\n]", text, maxsplit=1)[0]
    separator = max(_SEPARATORS, key=head.count)
    names = _names_of(head, separator, file)
    places = _places_of(names, file)
    unused = [name for number, name in enumerate(names) if number not in places.values()]
    if unused:
        notes.append(f"columns that are not used: {', '.join(map(printable, unused))}")
    cells_of = dict(_cells(text, separator, file))
    problems: list[Problem] = []
    lines: list[LogLine] = []
    times: dict[int, LogTime] = {}
    for number, cells in cells_of.items():
        # A cell without a column.
        if _has_text(cells[len(names) :]):
            text = (
                f"has {len(cells)} cells below {len(names)} names; a cell with a separator in it"
                ' must stand in quotes: "Ana, team 2"'
            )
            problems.append(Problem(file, text, line=number))
            continue
        draft = _line_of(number, _values(cells, places), file, problems)
        if draft is not None:
            line, time = draft
            lines.append(line)
            times[line.number] = time
    if not cells_of:
        problems.append(Problem(file, f"has no line below its names; must have lines of {HEADER}"))
    in_other_zones = list(time_problems(times, file))
    problems += in_other_zones
    problems += _repeated(lines, file)
    # Clocks of two zones have no order.
    if not in_other_zones:
        problems += _backwards(lines, file)
    if problems:
        raise ScenarioError(problems)
    return BinLog(file, lines, frozenset(places), notes)


def _has_text(cells: Sequence[str]) -> bool:
    """Whether a cell is more than blanks."""
    return any(cell.strip() for cell in cells)


def _values(cells: Sequence[str], places: Mapping[str, int]) -> dict[str, str]:
    """Return the values of a line by column. A short line lacks its last columns.

    `places`: column -> its number in the file, from 0.
    """
    values = {}
    for column, place in places.items():
        if place < len(cells):
            values[column] = cells[place].strip()
    return values


def _names_of(head: str, separator: str, file: str) -> list[str]:
    """Return the names of the columns. Raises ScenarioError."""
    try:
        names = next(csv.reader([head], delimiter=separator), [])
    except csv.Error as error:
        text = f"names no columns: {error}. It must name them: {HEADER}"
        raise ScenarioError([Problem(file, text, line=1)]) from None
    return [name.strip() for name in names]


def _plain(name: str) -> str:
    """Return a name without case, spaces and signs."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _places_of(names: Sequence[str], file: str) -> dict[str, int]:
    """Return the number of each column of COLUMNS in the file, from 0.

    Raises ScenarioError if one is missing that is needed.
    """
    plain = [_plain(name) for name in names]
    places = {}
    for column, known in COLUMNS.items():
        for name in known:
            if name in plain and column not in places:
                places[column] = plain.index(name)
    missing = [column for column in ("time", "event") if column not in places]
    if "picker" not in places and "row" not in places:
        missing.append("picker or row")
    if missing:
        shown = printable(", ".join(names), 60)
        text = (
            f"its first line names no column {' and no column '.join(missing)}: {shown}. It must"
            f" name time, event, and picker or row: {HEADER}"
        )
        raise ScenarioError([Problem(file, text, line=1)])
    return places


def _cells(text: str, separator: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line below the names. Raises ScenarioError."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        next(reader, None)
        for cells in reader:
            if _has_text(cells):
                yield reader.line_num, cells
    except csv.Error as error:
        raise ScenarioError([Problem(file, f"is no CSV: {error}", line=reader.line_num)]) from None


def _line_of(
    number: int, values: dict[str, str], file: str, problems: list[Problem]
) -> tuple[LogLine, LogTime] | None:
    """Return a line, and its time as it is written; None if the line is wrong.

    `values`: by column. What is wrong is added to `problems`.
    """
    before = len(problems)
    time = time_of(values.get("time", ""))
    if time is None:
        text = "must be a date and a time of day, such as 2026-04-14T07:12:30"
        shown = printable(values.get("time", ""), 40) or "empty"
        problems.append(Problem(file, text, "time", shown, number))
    event = _event_of(values.get("event", ""))
    if event is None:
        text = f"must be {', '.join(EVENTS[:-1])} or {EVENTS[-1]}{_guess(values.get('event', ''))}"
        shown = printable(values.get("event", ""), 40) or "empty"
        problems.append(Problem(file, text, "event", shown, number))
    names = {}
    for column in ("picker", "row", "carrier"):
        # Not shortened, because names that begin alike may differ at their ends.
        name = values.get(column, "")
        names[column] = printable(name, len(name))
    of_bin = names["picker"] or names["row"]
    if not of_bin and (event != "unloaded" or not names["carrier"]):
        text = "has neither picker nor row; must say whose bin it is"
        problems.append(Problem(file, text, line=number))
    if time is None or event is None or len(problems) > before:
        return None
    return LogLine(number=number, time=time.local, event=event, **names), time


def _event_of(word: str) -> Event | None:
    """Return the event that a word stands for; None if it stands for none."""
    for event, words in WORDS.items():
        if _plain(word) in words:
            return event
    return None


def _guess(word: str) -> str:
    """Return which event a wrong word may stand for, in words; "" if none is near."""
    near = get_close_matches(_plain(word)[:40], EVENTS, n=1)
    if not near:
        return ""
    return f"; did you mean {near[0]}?"


def whose_in_words(line: LogLine) -> str:
    """Return the same as `whose`, at a length that can be printed in a sentence."""
    return printable(whose(line))


def whose(line: LogLine) -> str:
    """Return the name by which the bins of a log are put together: of the bin's picker, else of its
    row, else of its carrier.
    """
    if line.picker:
        return line.picker
    if line.row:
        return f"row {line.row}"
    return line.carrier


def _repeated(lines: Sequence[LogLine], file: str) -> Iterator[Problem]:
    """Yield lines that are the same as an earlier one."""
    first_of: dict[LogLine, int] = {}
    for line in lines:
        content = replace(line, number=0)
        first = first_of.setdefault(content, line.number)
        if first != line.number:
            text = f"says what line {first} says; leave out one of both"
            yield Problem(file, text, line=line.number)


def _backwards(lines: Sequence[LogLine], file: str) -> Iterator[Problem]:
    """Yield lines whose times are before those of the same events further up."""
    latest: dict[tuple[str, Event], LogLine] = {}
    for line in lines:
        key = (whose(line), line.event)
        before = latest.get(key)
        if before is not None and line.time < before.time:
            latest_time = before.time.isoformat(" ")
            text = (
                f"goes back: {whose_in_words(line)} has {line.event} at {latest_time} on"
                f" line {before.number}; times of one picker must go on from line to line"
            )
            yield Problem(file, text, "time", line.time.isoformat(" "), line.number)
        else:
            latest[key] = line
