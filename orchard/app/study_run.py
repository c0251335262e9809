"""A study from the page: what it compares, as entered, and the command `orchard study` that does
it.
"""

import contextlib
import sys
from dataclasses import dataclass

import msgspec

from orchard.app.command import Files, Latest, PageCommand
from orchard.app.draft import number_problem, shown
from orchard.field.scenario import Scenario
from orchard.study.result import Horizon, StudyResult

BUDGET = (1, 86_400)  # s of wall time, both included


@dataclass(frozen=True)
class StudySettings:
    """What a study compares beside numbers of carriers, as a user entered it."""

    dispatch: tuple[str, ...] = ()  # policies to compare; none: that of the scenario
    route: tuple[str, ...] = ()
    horizon: Horizon = "long"
    budget: str = "300"  # s

    @property
    def problem(self) -> str:
        return number_problem(self.budget, BUDGET)


def study_command(settings: StudySettings, files: Files) -> list[str]:
    """Return the command that a user would type for it."""
    compared = {"dispatch": settings.dispatch, "route": settings.route}
    ranges = [
        "carriers",
        *(f"{key}={','.join(values)}" for key, values in compared.items() if values),
    ]
    varied = [word for one in ranges for word in ("--vary", one)]
    program = [
        sys.executable,
        "-u",
        "-P",
        "-m",
        "orchard",
        "study",
        str(files.scenario),
        *varied,
        "--horizon",
        settings.horizon,
    ]
    return [
        *program,
        "--budget",
        f"{shown(float(settings.budget))}s",
        "--progress",
        "json",
        "--summary",
        str(files.summary),
    ]


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
