"""Checks that the times of a log are of the orchard's own clock, and not of another one, such as
UTC.

With the clock of another zone a day's work would begin on one date and end on the next one.
"""

from collections.abc import Iterator, Sequence
from datetime import timedelta
from itertools import pairwise

from orchard.calibrate.log_lines import LogLine
from orchard.field.problems import Problem
from orchard.field.scenario import WorkShift
from orchard.field.scenario.shift import minutes_of

# The clock counts as right as long as at most this share of lines is outside the working day of the
# scenario: some work begins early or ends late.
MOST_OUTSIDE = 0.25
# If less time than this is between the last line of a date and the first one of the next date, both
# belong to one day's work, which goes on over midnight.
SHORTEST_NIGHT = timedelta(hours=2)


def clock_problems(lines: Sequence[LogLine], shift: WorkShift, file: str) -> Iterator[Problem]:
    """Yield what is wrong if times seem to be those of another clock. `lines`: in order of time."""
    advice = "write the times of the orchard's own clock, not of UTC"
    outside = _outside(lines, shift)
    if len(outside) > MOST_OUTSIDE * len(lines):
        text = (
            f"{len(outside)} of {len(lines)} lines, this one first, lie outside the working day of"
            f" the scenario, {shift.begin} to {shift.end} (shift); {advice}"
        )
        yield Problem(file, text, line=outside[0].number)
    for before, after in pairwise(lines):
        is_next_day = before.time.date() < after.time.date()
        if is_next_day and after.time - before.time < SHORTEST_NIGHT:
            text = (
                f"work goes on over midnight, from {before.time.isoformat(' ')} (line"
                f" {before.number}) to {after.time.isoformat(' ')}; a day's work must lie in one"
                f" day: {advice}"
            )
            yield Problem(file, text, line=after.number)
            # One example is enough: other nights are alike.
            return


def _outside(lines: Sequence[LogLine], shift: WorkShift) -> list[LogLine]:
    """Return the lines before the begin or after the end of a working day."""
    if shift.begin is None or shift.end is None:
        return []
    begin = minutes_of(shift.begin)
    end = minutes_of(shift.end)
    outside = []
    for line in lines:
        minutes = 60 * line.time.hour + line.time.minute
        if not begin <= minutes <= end:
            outside.append(line)
    return outside
