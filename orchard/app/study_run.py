"""A study from the page: what it compares, and the command `orchard study` that does it."""

import sys
from dataclasses import dataclass

import msgspec

from orchard.app.command import Files, Latest, PageCommand
from orchard.app.typed_numbers import number_problem, with_point
from orchard.field.scenario import Scenario
from orchard.study.result import Horizon, StudyResult

# Limits, both included: s of wall time.
BUDGET = (1, 86_400)


@dataclass(frozen=True)
class StudySettings:
    """What a study compares beside numbers of carriers, as a user entered it.

    `dispatch`, `route`: the rules to compare; without any, the one of the scenario. `budget`: s of
    wall time.
    """

    dispatch: tuple[str, ...] = ()
    route: tuple[str, ...] = ()
    horizon: Horizon = "long"
    budget: str = "300"

    @property
    def problem(self) -> str:
        """What is wrong with the budget; '' if nothing is."""
        return number_problem(self.budget, BUDGET)


def study_command(settings: StudySettings, files: Files) -> list[str]:
    """Return the command that a user would type for a study."""
    line = [sys.executable, "-u", "-P", "-m", "orchard", "study", str(files.scenario)]
    line += ["--vary", "carriers"]
    if settings.dispatch:
        line += ["--vary", f"dispatch={','.join(settings.dispatch)}"]
    if settings.route:
        line += ["--vary", f"route={','.join(settings.route)}"]
    line += ["--horizon", settings.horizon]
    line += ["--budget", f"{with_point(settings.budget)}s"]
    line += ["--progress", "json", "--summary", str(files.summary)]
    return line


class StudyRun(PageCommand):
    """One study. `result`: what is known so far, and at its end the answer."""

    def __init__(self, scenario: Scenario, settings: StudySettings, files: Files) -> None:
        """Start the study. Raises OSError."""
        self.settings = settings
        self.result: StudyResult | None = None
        super().__init__(scenario, files, study_command(settings, files))

    def message_of(self, line: str) -> str | None:
        """Take the result so far, if a line holds it. Return any other line for a person."""
        try:
            result = msgspec.json.decode(line, type=dict[str, StudyResult])["study"]
        except (ValueError, KeyError, RecursionError):
            return super().message_of(line)
        self.result = result
        self.has_begun = True
        return None

    def finish(self) -> None:
        """Read the answer. If there is none, the last result so far stays."""
        self.result = self.read(self.files.summary, StudyResult) or self.result

    @property
    def is_complete(self) -> bool:
        """Whether there is an answer, and the study was not stopped before it."""
        return self.result is not None and not self.asked_to_stop


Studies = Latest[StudyRun]
