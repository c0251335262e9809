"""A study from the page: what it compares, as entered, and the command `orchard study` that does it."""

import contextlib
import sys
from dataclasses import dataclass
from functools import cached_property

import msgspec

from orchard.app.command import Files, Latest, PageCommand
from orchard.app.draft import number_problem, shown
from orchard.field.queue import MOST_CARRIERS
from orchard.field.scenario import Scenario
from orchard.study.result import Goal, StudyResult

CARRIERS = (1, MOST_CARRIERS)
BUDGET = (1, 86_400)  # s of wall time, both included


@dataclass(frozen=True)
class StudySettings:
    """What a study compares, as a user entered it."""

    first: str = "1"  # number of carriers
    last: str = "10"
    dispatch: tuple[str, ...] = ()  # policies to compare; none: that of the scenario
    route: tuple[str, ...] = ()
    goal: Goal = "bins_per_hour"
    budget: str = "60"  # s
    is_checked: bool = True  # whether the simulator checks the best two

    @cached_property
    def problems(self) -> dict[str, str]:
        told = {
            "first": number_problem(self.first, CARRIERS, is_whole=True),
            "last": number_problem(self.last, CARRIERS, is_whole=True),
            "budget": number_problem(self.budget, BUDGET),
        }
        if not told["first"] and not told["last"] and int(self.first) > int(self.last):
            told["last"] = f"must be at least {int(self.first)}, with which it begins"
        return {name: words for name, words in told.items() if words}


def study_command(settings: StudySettings, files: Files) -> list[str]:
    varied = {
        "carriers": f"{int(settings.first)}..{int(settings.last)}",
        "dispatch": ",".join(settings.dispatch),
        "route": ",".join(settings.route),
    }
    ranges = [word for key, values in varied.items() if values for word in ("--vary", f"{key}={values}")]
    how = ["--goal", settings.goal, "--budget", f"{shown(float(settings.budget))}s", "--model", "both" if settings.is_checked else "fast"]
    program = [sys.executable, "-u", "-P", "-m", "orchard", "study", str(files.scenario)]
    return [*program, *ranges, *how, "--progress", "json", "--summary", str(files.summary)]


class StudyRun(PageCommand):
    """One study. `result`: what is known so far, and at its end the answer."""

    def __init__(self, scenario: Scenario, settings: StudySettings, files: Files) -> None:
        self.settings = settings
        self.result: StudyResult | None = None
        super().__init__(scenario, files, study_command(settings, files))

    def words_of(self, line: str) -> str | None:
        with contextlib.suppress(ValueError, KeyError, RecursionError):  # any other line
            self.result = msgspec.json.decode(line, type=dict[str, StudyResult])["study"]
            self.has_begun = True
            return None
        return super().words_of(line)

    def finish(self) -> None:
        self.result = self.read(self.files.summary, StudyResult) or self.result

    @property
    def is_complete(self) -> bool:
        return self.result is not None and not self.asked_to_stop


Studies = Latest[StudyRun]
