"""A study from the page: what it compares, and the command `orchard study` that does it."""

import sys
from dataclasses import dataclass
from typing import Literal

import msgspec

from orchard.app.also_compared import (
    COMPARED_LABEL,
    compared_option,
    problem_in,
    problem_of_compared,
)
from orchard.app.command import Files, Latest, PageCommand
from orchard.app.entries import label_of
from orchard.app.page_words import BUDGET_LABEL, DEADLINE_LABEL
from orchard.app.typed_numbers import number_of, number_problem, span, with_point
from orchard.field.scenario import Scenario
from orchard.study.deadline import MOST_DAYS, MOST_DEADLINE
from orchard.study.result import Horizon, StudyResult

# Limits, both included: s of wall time, hours of work, days.
BUDGET = (1, 86_400)
HOURS = (0.1, MOST_DEADLINE / 3600.0)
DAYS = (1, MOST_DAYS)
# What the fields are called.
ONLY_FLEETS = "it compares people and carriers, and nothing else: leave these out"
WHOLE_DAYS = f"must be a whole number of days from {span(DAYS)}"
NO_DAY = "days need a working day: enter when work begins and ends, or ask by hours of work"
HORIZON_LABEL = "Horizon"
FREE = "is compared, and would cost nothing: enter 0 if it does, or no prices at all"
NO_FIRST_HOUR = "nobody is away in the long run, which has no first hour: choose one harvest"


@dataclass(frozen=True)
class StudySettings:
    """What a study compares beside numbers of carriers, as a user entered it.

    `dispatch`, `route`: the rules to compare; without any, the one of the scenario. `budget`: s of
    wall time. `deadline`: by when the harvest must be done, in `deadline_unit`: hours of work, or
    days; '' for no deadline. With a deadline the numbers of carriers are compared, and those of
    pickers where `compares_pickers` says so.
    `compared`: the path of one more setting to compare, '' for none; `compared_values`: its values.
    """

    dispatch: tuple[str, ...] = ()
    route: tuple[str, ...] = ()
    horizon: Horizon = "long"
    budget: str = "300"
    deadline: str = ""
    deadline_unit: Literal["h", "d"] = "h"
    compared: str = ""
    compared_values: str = ""

    @property
    def has_deadline(self) -> bool:
        """Whether the harvest must be done by some time."""
        return bool(self.deadline.strip())

    def compares_pickers(self, scenario: Scenario) -> bool:
        """Whether numbers of pickers are compared: where a user asks for them, and by a deadline.

        With a deadline they are not if carriers or all else have a price, and pickers have none:
        the most pickers would be the cheapest.
        """
        if self.compared:
            return self.compared == "pickers"
        prices = scenario.prices
        return self.has_deadline and (prices.are_of_pickers or not prices.are_set)

    @property
    def problem(self) -> str:
        """What is wrong, by the field's label; '' if nothing is."""
        problem = number_problem(self.budget, BUDGET)
        if problem:
            return f"{BUDGET_LABEL}: {problem}"
        problem = problem_of_compared(self.compared, self.compared_values)
        if problem:
            return f"{COMPARED_LABEL}: {problem}"
        if not self.has_deadline:
            return ""
        problem = self._problem_of_deadline()
        if not problem:
            return ""
        return f"{DEADLINE_LABEL}: {problem}"

    def problem_with(self, scenario: Scenario) -> str:
        """Return what is wrong, by itself or with the scenario that is asked; '' if nothing is."""
        if self.has_deadline and self.deadline_unit == "d" and not scenario.shift.is_set:
            return f"{DEADLINE_LABEL}: {NO_DAY}"
        if self.problem:
            return self.problem
        is_long = self.horizon == "long" and not self.has_deadline
        if is_long and scenario.picker_absences:
            return f"{HORIZON_LABEL}: {NO_FIRST_HOUR}"
        problem = self._problem_of_prices(scenario)
        if problem or not self.compared:
            return problem
        problem = problem_in(scenario, self.compared, self.compared_values)
        if not problem:
            return ""
        return f"{COMPARED_LABEL}: {problem}"

    def _problem_of_prices(self, scenario: Scenario) -> str:
        """Return which price is missing where robots are compared and other things have prices."""
        prices = scenario.prices
        if not prices.are_set:
            return ""
        if not prices.are_of_carriers:
            return f"{label_of('prices.carrier_per_hour')}: {FREE}"
        if self.compares_pickers(scenario) and not prices.are_of_pickers:
            return f"{label_of('prices.picker_per_hour')}: {FREE}"
        return ""

    def _problem_of_deadline(self) -> str:
        problem = self._problem_of_number()
        has_other = self.dispatch or self.route or self.compared not in ("", "pickers")
        if not problem and has_other:
            return ONLY_FLEETS
        return problem

    def _problem_of_number(self) -> str:
        if self.deadline_unit == "h":
            return number_problem(self.deadline, HOURS, " hours")
        if not isinstance(number_of(self.deadline), int):
            return WHOLE_DAYS
        return number_problem(self.deadline, DAYS, " days")


def study_command(scenario: Scenario, settings: StudySettings, files: Files) -> list[str]:
    """Return the command that a user would type for a study."""
    line = [sys.executable, "-u", "-P", "-m", "orchard", "study", str(files.scenario)]
    line += ["--vary", "carriers"]
    if settings.compared:
        line += compared_option(settings.compared, settings.compared_values)
    elif settings.compares_pickers(scenario):
        line += ["--vary", "pickers"]
    if settings.has_deadline:
        line += _deadline_option(settings)
    else:
        line += _rules_options(settings)
    line += ["--budget", f"{with_point(settings.budget)}s"]
    line += ["--progress", "json", "--summary", str(files.summary)]
    return line


def _deadline_option(settings: StudySettings) -> list[str]:
    """Return the option that says by when the harvest must be done."""
    number = with_point(settings.deadline)
    if settings.deadline_unit == "d":
        return ["--finish-by", f"{number}d"]
    return ["--finish-within", f"{number}h"]


def _rules_options(settings: StudySettings) -> list[str]:
    """Return the options that say what is compared beside carriers, and for how long."""
    line = []
    if settings.dispatch:
        line += ["--vary", f"dispatch={','.join(settings.dispatch)}"]
    if settings.route:
        line += ["--vary", f"route={','.join(settings.route)}"]
    return [*line, "--horizon", settings.horizon]


class StudyRun(PageCommand):
    """One study. `result`: what is known so far, and at its end the answer."""

    def __init__(self, scenario: Scenario, settings: StudySettings, files: Files) -> None:
        """Start the study. Raises OSError."""
        self.settings = settings
        self.result: StudyResult | None = None
        super().__init__(scenario, files, study_command(scenario, settings, files))

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
