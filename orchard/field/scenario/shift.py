"""The working day: when it begins and ends, and its breaks."""

from typing import Annotated

from pydantic import Field, field_serializer, model_validator

from orchard.field.problems import Called, Section

# A time of day, "HH:MM", from 00:00 to 23:59.
TIME = r"^([01][0-9]|2[0-3]):[0-5][0-9]$"
MOST_BREAKS = 10
# Working time of a day, at least, s.
LEAST_WORK = 3600.0

BEGIN = 'time at which a day\'s work begins, such as "07:00"; null: no days'
END = 'time at which a day\'s work ends, such as "16:30"; null: no days'
BREAKS = 'begin and end of each break in which all work stops, such as [["10:00", "10:15"]]'
A_TIME = Called('null or a time of day as "HH:MM"')
PAIRS = Called(f'a list of at most {MOST_BREAKS} pairs of times, each as "HH:MM"')

Time = Annotated[str, Field(pattern=TIME)]
Break = Annotated[tuple[Time, Time], Field(strict=False)]


class WorkShift(Section):
    """The working day, the same each day. Without begin and end a harvest goes on for ever.

    The time of a harvest is working time: it stands still from a day's end to the next begin, and
    in breaks.
    """

    begin: Annotated[str | None, Field(pattern=TIME, description=BEGIN), A_TIME] = None
    end: Annotated[str | None, Field(pattern=TIME, description=END), A_TIME] = None
    breaks: Annotated[
        tuple[Break, ...],
        Field(strict=False, max_length=MOST_BREAKS, description=BREAKS),
        PAIRS,
    ] = ()

    @property
    def is_set(self) -> bool:
        """Whether there are working days: else work never stops."""
        return self.begin is not None and self.end is not None

    @property
    def spans(self) -> list[tuple[int, int]]:
        """Begin and end of each part of a day in which there is work, minutes after midnight."""
        if self.begin is None or self.end is None:
            return []
        spans = []
        begin = minutes_of(self.begin)
        for pause, resumption in self.breaks:
            spans.append((begin, minutes_of(pause)))
            begin = minutes_of(resumption)
        spans.append((begin, minutes_of(self.end)))
        return spans

    @property
    def work_seconds(self) -> float:
        """The working time of a day, s; 0 without days."""
        return 60.0 * sum(end - begin for begin, end in self.spans)

    def time_after(self, seconds: float) -> str:
        """Return the time of day after so much work of a day, "HH:MM".

        `seconds`: at most `work_seconds`. The end of a span of work is not the begin of the next.
        """
        minutes = seconds / 60.0
        moment = 0.0
        for begin, end in self.spans:
            moment = begin + min(minutes, end - begin)
            minutes -= end - begin
            if minutes <= 0.0:
                break
        hours, rest = divmod(round(moment), 60)
        return f"{hours:02d}:{rest:02d}"

    @field_serializer("breaks")
    def _as_lists(self, breaks: tuple[Break, ...]) -> list[list[str]]:
        """Return the breaks as a file has them: pairs are lists there, and tuples here."""
        return [list(pair) for pair in breaks]

    @model_validator(mode="after")
    def _is_a_day(self) -> "WorkShift":
        """Check that breaks lie inside the day, one after another, and that work is left."""
        are_together = (self.begin is None) == (self.end is None)
        self._demand(are_together, "must be set together", "begin", "end")
        if self.begin is None or self.end is None:
            text = "breaks need a day: set begin and end too"
            self._demand(not self.breaks, text, "breaks")
            return self
        text = "must end after it begins, on the same day"
        self._demand(minutes_of(self.begin) < minutes_of(self.end), text, "begin", "end")
        for pause, resumption in self.breaks:
            self._check_break(pause, resumption)
        self._demand_no_overlap()
        text = f"must leave at least {LEAST_WORK / 3600.0:g} h of work beside the breaks"
        self._demand(self.work_seconds >= LEAST_WORK, text, "begin", "end", "breaks")
        return self

    def _check_break(self, pause: str, resumption: str) -> None:
        """Check that a break ends after it begins, within the day."""
        words = f"the break from {pause} to {resumption}"
        is_forward = minutes_of(pause) < minutes_of(resumption)
        self._demand(is_forward, f"{words} must end after it begins", "breaks")
        begin = minutes_of(self.begin or "")
        end = minutes_of(self.end or "")
        is_inside = begin < minutes_of(pause) and minutes_of(resumption) < end
        text = f"{words} must lie inside the day, from {self.begin} to {self.end}"
        self._demand(is_inside, text, "breaks", "begin", "end")

    def _demand_no_overlap(self) -> None:
        """Check that each break begins after the one before it has ended."""
        for before, after in zip(self.breaks, self.breaks[1:], strict=False):
            text = (
                f"the break from {after[0]} must begin after the one before it has ended, at"
                f" {before[1]}"
            )
            self._demand(minutes_of(before[1]) < minutes_of(after[0]), text, "breaks")


def minutes_of(time: str) -> int:
    """Return the minutes after midnight of a time "HH:MM"."""
    hours, _, minutes = time.partition(":")
    return 60 * int(hours) + int(minutes)
