"""The times of a log: ISO 8601, in one time zone, which may change to or from summer time once.

An offset is the difference of a zone's clock to UTC, as "+13:00". A time may be written without
one.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from itertools import pairwise

from orchard.field.problems import Problem

_HAS_TIME_OF_DAY = re.compile(r"\d[T ]\d")


@dataclass(frozen=True)
class LogTime:
    """A time as it is written in a log."""

    #: What the clock of the place shows, without an offset.
    local: datetime
    #: To UTC; None if none is written.
    offset: timedelta | None


def time_of(text: str) -> LogTime | None:
    """Return the time in a text; None if the text is no time, or a date only."""
    # Python takes a date for its midnight.
    if not _HAS_TIME_OF_DAY.search(text):
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    return LogTime(time.replace(tzinfo=None), time.utcoffset())


def time_problems(times: Mapping[int, LogTime], file: str) -> Iterator[Problem]:
    """Yield the lines of which the time is of another zone than that of most lines.

    `times`: by number of the line. An offset that changes once, from one day to the next, is summer
    time, and is no problem.
    """
    offsets = Counter(time.offset for time in times.values())
    if len(offsets) < 2 or _is_summer_time(times):
        return
    home = offsets.most_common(1)[0][0]
    # The number of the first line of that zone.
    example = 0
    for line, time in times.items():
        if time.offset == home and not example:
            example = line
    for line, time in times.items():
        if time.offset != home:
            text = f"is in another time zone than line {example}, {_zone_words(home)}; "
            text += _right_time(time, home)
            yield Problem(file, text, "time", _as_written(time), line)


def _is_summer_time(times: Mapping[int, LogTime]) -> bool:
    """Whether each day has one offset, and the offset changes once, by an hour at most."""
    of_days: dict[str, set[timedelta | None]] = {}
    for time in times.values():
        of_days.setdefault(time.local.date().isoformat(), set()).add(time.offset)
    in_order = [of_days[day] for day in sorted(of_days)]
    if any(len(offsets) > 1 for offsets in in_order):
        return False
    changes = []
    for before, after in pairwise(in_order):
        if before != after:
            # Each set has one offset. It may be None, which has no order.
            changes.append((min(before, key=str), min(after, key=str)))
    if len(changes) != 1:
        return False
    before_change, after_change = changes[0]
    if before_change is None or after_change is None:
        return False
    return abs(after_change - before_change) <= timedelta(hours=1)


def _zone_words(offset: timedelta | None) -> str:
    """Return a zone in words."""
    if offset is None:
        return "which has none"
    return f"which has {_sign_of(offset)}"


def _sign_of(offset: timedelta) -> str:
    """Return an offset as ISO 8601 writes it: "+13:00"."""
    # Any time of this zone ends so: the last six characters are the offset.
    return datetime(2000, 1, 1, tzinfo=timezone(offset)).isoformat()[-6:]


def _as_written(time: LogTime) -> str:
    """Return a time as it stands in the file."""
    written = time.local.isoformat()
    if time.offset is None:
        return written
    return written + _sign_of(time.offset)


def _right_time(time: LogTime, home: timedelta | None) -> str:
    """Return what would be right in the zone of the other lines."""
    if home is None:
        return "write all times in one zone: leave out the zone if the clock is the same"
    if time.offset is None:
        return f"write {time.local.isoformat()}{_sign_of(home)} if the clock is the same"
    try:
        moved = time.local - time.offset + home
    except OverflowError:
        return f"write a time of the years 1 to 9999 with {_sign_of(home)}"
    return f"write {moved.isoformat()}{_sign_of(home)}"
