"""The bins of a log: when each was full, fetched and unloaded.

A log has no number of a bin, so its lines are matched to bins (`_BinBook`):

- A line with "fetched" is about the full bin of its picker, or of its row.
- A line with "unloaded" is about the newest bin that its carrier has fetched on that day.
- If lines name no carrier, it is about the oldest bin that was fetched on that day, because bins of
  several carriers are under way together.
- If no bin was fetched on that day, it is about the newest bin of the days before.

Working seconds are seconds from midnight without the breaks of the scenario's shift.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from itertools import groupby, pairwise

from orchard.calibrate.clock import clock_problems
from orchard.calibrate.log_lines import EVENTS, BinLog, LogLine, whose, whose_in_words
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import WorkShift
from orchard.field.scenario.shift import minutes_of

# A time of a day without any line counts as a silence if it is longer than LEAST_SILENCE, s,
# because short rests are usual, and longer than TIMES_THE_MEAN times the mean time between two
# lines, because a log of few bins has long times between all of its lines.
LEAST_SILENCE = 900.0
TIMES_THE_MEAN = 10.0


@dataclass(frozen=True)
class LoggedBin:
    """A bin, of a log or of a harvest of the event model.

    Times are working seconds of its day; None: not known. Names are "" if not known.
    """

    picker: str
    row: str
    carrier: str
    #: All bins of a model have the same day.
    day: date
    full: float
    fetched: float | None
    unloaded: float | None
    #: The line of the log with "full"; 0 in a model.
    line: int = 0

    @property
    def chain(self) -> str:
        """The name of what fills one bin after another: of its picker, or else of its row."""
        return self.picker or f"row {self.row}"


@dataclass(frozen=True)
class Silence:
    """A time of a day in which nothing was logged, in working seconds."""

    day: date
    begin: float
    end: float


@dataclass(frozen=True)
class LoggedBins:
    """The bins of a log, in the order in which they were full.

    `gaps`: sentences for the user about lines that seem to be missing, silences included.
    """

    bins: list[LoggedBin]
    silences: list[Silence]
    gaps: list[str]


@dataclass
class _OpenBin:
    """A bin while lines are matched: the lines that are about it, None if there is none yet."""

    full: LogLine
    fetched: LogLine | None = None
    unloaded: LogLine | None = None
    #: Whether the next bin of its picker, or row, was full before this one was fetched.
    is_overtaken: bool = False
    #: Whether two more bins were full before that: then it can no longer be fetched.
    is_lost: bool = False
    #: Whether its carrier has meanwhile unloaded a bin that it fetched later.
    is_passed_over: bool = False

    @property
    def waits(self) -> bool:
        """Whether a line with "fetched" may still be about it."""
        return self.fetched is None and not self.is_lost


def bins_of(log: BinLog, shift: WorkShift) -> LoggedBins:
    """Return the bins of a log. `shift`: the working day of the scenario, with its breaks.

    Raises ScenarioError for events that cannot be, such as a bin that is fetched before it is full,
    and for times of another clock.
    """
    # At the same time a bin is first full, then fetched, then unloaded.
    in_order = sorted(log.lines, key=lambda line: (line.time, EVENTS.index(line.event)))
    of_other_clock = list(clock_problems(in_order, shift, log.file))
    if of_other_clock:
        raise ScenarioError(of_other_clock)
    book = _BinBook(log.file)
    for line in in_order:
        book.take(line)
    if book.problems:
        raise ScenarioError(book.problems)
    gaps = list(book.gaps(frozenset(line.event for line in log.lines)))
    silences = []
    for before, after in _silences(in_order, shift):
        gaps.append(_silence_words(log.file, before, after))
        begin = worked_seconds(before.time, shift)
        end = worked_seconds(after.time, shift)
        silences.append(Silence(before.time.date(), begin, end))
    bins = [_times_of(opened, shift) for opened in book.bins]
    return LoggedBins(bins, silences, gaps)


def _times_of(opened: _OpenBin, shift: WorkShift) -> LoggedBin:
    """Return the times of a bin."""
    full = opened.full
    day = full.time.date()
    carrier = ""
    if opened.fetched is not None:
        carrier = opened.fetched.carrier
    return LoggedBin(
        picker=full.picker,
        row=full.row,
        carrier=carrier,
        day=day,
        full=worked_seconds(full.time, shift),
        fetched=_time_on_day(opened.fetched, day, shift),
        unloaded=_time_on_day(opened.unloaded, day, shift),
        line=full.number,
    )


def _time_on_day(line: LogLine | None, day: date, shift: WorkShift) -> float | None:
    """Return the working time of a line, s; None if it is missing, or of another day."""
    if line is None or line.time.date() != day:
        return None
    return worked_seconds(line.time, shift)


@dataclass(frozen=True, eq=False)
class _Carried:
    """A bin that was fetched and is not unloaded yet, and the line by which it was fetched."""

    opened: _OpenBin
    fetched: LogLine

    def is_of_carrier(self, line: LogLine) -> bool:
        """Whether a line names the carrier that has fetched it."""
        return bool(line.carrier) and self.fetched.carrier == line.carrier


class _BinBook:
    """Matches lines to bins, in the order of time.

    Lines may be missing, so the newest bin that fits is taken: of an older one a line is missing.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.bins: list[_OpenBin] = []
        #: Bins that are fetched and not unloaded, in the order in which they were fetched.
        self.on_their_way: list[_Carried] = []
        self.problems: list[Problem] = []

    def take(self, line: LogLine) -> None:
        """Match the next line."""
        if line.event == "full":
            self._begin(line)
        elif line.event == "fetched":
            self._fetch(line)
        else:
            self._unload(line)

    def _begin(self, line: LogLine) -> None:
        """Begin a bin. A bin of the same picker that was not fetched is overtaken."""
        for opened in self.bins:
            if opened.waits and _is_of(line, opened.full):
                # Lost if it was overtaken before.
                opened.is_lost = opened.is_overtaken
                opened.is_overtaken = True
        self.bins.append(_OpenBin(line))

    def _fetch(self, line: LogLine) -> None:
        """Find the bin that is fetched: the newest full one of the line's picker or row."""
        for opened in reversed(self.bins):
            if opened.waits and _is_of(line, opened.full):
                opened.fetched = line
                self.on_their_way.append(_Carried(opened, line))
                return
        text = (
            f"fetched at {line.time.isoformat(' ')}, and no bin of {whose_in_words(line)} is full"
            f" then{self._last_of(line)}; a bin must be full before it is fetched"
        )
        self.problems.append(Problem(self.file, text, line=line.number))

    def _unload(self, line: LogLine) -> None:
        """Find the bin that is unloaded: the newest one of the line's carrier, or the oldest one if
        no carrier is named.
        """
        carried = [taken for taken in self.on_their_way if _is_unloaded_by(line, taken)]
        of_day = [taken for taken in carried if taken.fetched.time.date() == line.time.date()]
        # Without a bin of that day it is the newest one of the days before.
        possible = of_day or carried[-1:]
        if possible:
            unloaded = possible[0]
            own = [taken for taken in possible if taken.is_of_carrier(line)]
            if own:
                *older_ones, unloaded = own
                for older in older_ones:
                    older.opened.is_passed_over = True
            unloaded.opened.unloaded = line
            self.on_their_way.remove(unloaded)
            return
        text = (
            f"unloaded at {line.time.isoformat(' ')}, and no bin of {whose_in_words(line)} is on"
            f" its way then{self._last_of(line)}; a bin must be fetched before it is unloaded"
        )
        self.problems.append(Problem(self.file, text, line=line.number))

    def _last_of(self, line: LogLine) -> str:
        """Return what the log says of the last bin that a line may mean, for an error message."""
        for opened in reversed(self.bins):
            if _is_of(line, opened.full):
                last = opened.unloaded or opened.fetched or opened.full
                return f" (line {last.number}: its last one was {last.event})"
        for opened in reversed(self.bins):
            if not _differs(line, opened.full):
                number = opened.full.number
                return f" (line {number} has no picker and no row in common; name one in both)"
        return ""

    def gaps(self, logged: frozenset[str]) -> Iterator[str]:
        """Yield a sentence for each bin of which lines seem to be missing.

        `logged`: the events that are in the log. One that never is, the user does not log.
        """
        newest = {whose(opened.full): opened for opened in self.bins}
        for opened in self.bins:
            line = opened.full
            name = whose(line)
            shown = whose_in_words(line)
            place = f"{self.file}:{line.number}"
            if opened.is_overtaken and "fetched" in logged:
                yield (
                    f"{place}: this bin of {shown} was not fetched before the next one was full: a"
                    " line with fetched is missing; its times are left out"
                )
            is_on_its_way = opened.fetched is not None and opened.unloaded is None
            # The newest bin may still have been on its way when the log ended.
            is_missing = opened.is_passed_over or opened is not newest[name]
            if is_on_its_way and is_missing and "unloaded" in logged:
                yield (
                    f"{place}: this bin of {shown} was never unloaded: a line with unloaded is"
                    " missing; its drive is left out"
                )


def _is_of(line: LogLine, full: LogLine) -> bool:
    """Whether a line is about the bin of a line with "full": picker or row are the same, and
    neither differs. A name that is missing does not differ.
    """
    if line.picker and full.picker and line.event == "full":
        # The next bin of a picker may be full in another row.
        return line.picker == full.picker
    has_common = _shares(line.picker, full.picker) or _shares(line.row, full.row)
    return has_common and not _differs(line, full)


def _is_unloaded_by(line: LogLine, taken: _Carried) -> bool:
    """Whether a line says that a bin is unloaded: picker, row or carrier are the same, and none
    differs. The line with full may name what the one with fetched does not.
    """
    fetched = taken.fetched
    full = taken.opened.full
    if line.carrier and fetched.carrier not in ("", line.carrier):
        return False
    if _differs(line, fetched) or _differs(line, full):
        return False
    return taken.is_of_carrier(line) or _is_of(line, fetched) or _is_of(line, full)


def _shares(name: str, with_name: str) -> bool:
    """Whether two names are the same, and there is one."""
    return bool(name) and name == with_name


def _differs(line: LogLine, before: LogLine) -> bool:
    """Whether two lines name two pickers, or two rows."""
    pickers = {line.picker, before.picker} - {""}
    rows = {line.row, before.row} - {""}
    return len(pickers) > 1 or len(rows) > 1


def _silences(lines: Sequence[LogLine], shift: WorkShift) -> Iterator[tuple[LogLine, LogLine]]:
    """Yield the lines before and after each long time of a day in which nothing was logged."""
    for _, of_day in groupby(lines, key=lambda line: line.time.date()):
        day = list(of_day)
        worked = [worked_seconds(line.time, shift) for line in day]
        mean = (worked[-1] - worked[0]) / len(day)
        longest = max(LEAST_SILENCE, TIMES_THE_MEAN * mean)
        for (before, begin), (after, end) in pairwise(zip(day, worked, strict=True)):
            if end - begin > longest:
                yield before, after


def _silence_words(file: str, before: LogLine, after: LogLine) -> str:
    """Return a long time without events in words."""
    return (
        f"{file}:{after.number}: no event from {before.time:%H:%M} (line {before.number}) to"
        f" {after.time:%H:%M}: lines are missing, or it is a break, which belongs in shift.breaks"
        " of the scenario (--on); bins of that time are left out"
    )


def worked_seconds(time: datetime, shift: WorkShift) -> float:
    """Return the working seconds up to a time of day: from midnight, without the shift's breaks."""
    seconds = 3600.0 * time.hour + 60.0 * time.minute + time.second + 1e-6 * time.microsecond
    rested = 0.0
    for pause, resumption in shift.breaks:
        begin = 60.0 * minutes_of(pause)
        end = 60.0 * minutes_of(resumption)
        # A time in a break counts as the break's begin.
        rested += min(max(0.0, seconds - begin), end - begin)
    return seconds - rested
