"""A study from the page: what it compares, as a user entered it, and the command `orchard study` that does it."""

import contextlib
import sys
from dataclasses import dataclass
from functools import cached_property

import msgspec

from orchard.app.command import PageCommand
from orchard.app.draft import hint, number_of, shown
from orchard.app.harvest_run import RunState
from orchard.app.latest import Latest
from orchard.app.run_controls import Files
from orchard.field.queue import MOST_CARRIERS
from orchard.field.scenario import Scenario, to_yaml
from orchard.study.result import Goal, StudyResult

GOALS: dict[Goal, str] = {
    "bins_per_hour": "most bins an hour",
    "cost_per_bin": "least cost of a bin",
    "harvest_seconds": "shortest harvest",
}
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
        """Messages for the invalid settings, by name."""
        first, last, budget = number_of(self.first), number_of(self.last), number_of(self.budget)
        told = {
            "first": _problem(first, 1, MOST_CARRIERS, isinstance(first, int), self.first),
            "last": _problem(last, 1, MOST_CARRIERS, isinstance(last, int), self.last),
            "budget": _problem(budget, *BUDGET, True, self.budget),
        }
        if isinstance(first, int) and isinstance(last, int) and first > last and not told["first"]:
            told["last"] = told["last"] or f"must be at least {first}, with which it begins"
        return {name: words for name, words in told.items() if words}


def _problem(number: float | str, least: int, most: int, is_right: bool, text: str) -> str:
    """The problem of a number; '' if it is within the limits."""
    if not isinstance(number, str) and is_right and least <= number <= most:
        return ""
    return f"must be a {'whole ' if most == MOST_CARRIERS else ''}number from {least} to {most}{hint(text)}"


def lacks_prices(settings: StudySettings, scenario: Scenario) -> bool:
    """Whether the goal needs prices, and the scenario has none."""
    return settings.goal == "cost_per_bin" and all(price is None for price in scenario.prices.model_dump().values())


def study_command(settings: StudySettings, files: Files) -> list[str]:
    """Return the command line of a study."""
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
        self.scenario, self.settings, self.files = scenario, settings, files
        self.result: StudyResult | None = None
        files.scenario.write_text(to_yaml(scenario))
        super().__init__(study_command(settings, files), files.folder)

    def words_of(self, line: str) -> str | None:
        """Take the partial result that a line tells."""
        with contextlib.suppress(ValueError, KeyError, RecursionError):  # any other line
            self.result = msgspec.json.decode(line, type=dict[str, StudyResult])["study"]
            self.has_begun = True
            return None
        return super().words_of(line)

    def finish(self) -> None:
        """Read the answer."""
        self.result = self.read(self.files.summary, StudyResult) or self.result

    @property
    def state(self) -> RunState:
        if not self.is_over:
            return RunState.stopping if self.asked_to_stop else RunState.running
        if self.exit_code == 0 and self.result is not None and not self.asked_to_stop:
            return RunState.finished
        return RunState.stopped if self.asked_to_stop else RunState.failed


Studies = Latest[StudyRun, StudySettings]
