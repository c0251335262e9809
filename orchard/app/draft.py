"""What a user has entered so far: good enough to run, or what is wrong with it, field by field."""

from typing import Any

from orchard.app.entries import entries, flat, nested
from orchard.config import Problem, Scenario, ScenarioError, check


class Draft:
    """Values by path, whatever they are; `scenario` and `problems` follow every change."""

    def __init__(self, scenario: Scenario) -> None:
        self.values = flat(scenario)
        self.scenario: Scenario | None = scenario
        self.problems: dict[str, str] = {}

    def take(self, scenario: Scenario) -> None:
        """All values from a scenario."""
        self.values = flat(scenario)
        self._judge()

    def set(self, path: str, value: Any) -> None:
        self.values[path] = _typed(path, value)
        self._judge()

    def _judge(self) -> None:
        try:
            self.scenario, self.problems = check(nested(self.values), "page"), {}
        except ScenarioError as error:
            self.scenario, self.problems = None, _by_field(error.problems)


def _typed(path: str, value: Any) -> Any:
    """A browser's number as the scenario wants it; what is none stays as it is, for the check to name."""
    entry = entries()[path]
    if isinstance(value, str):
        text = value.strip()
        return int(text) if text.removeprefix("-").isdecimal() and len(text) < 30 else text
    if entry.kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _by_field(problems: list[Problem]) -> dict[str, str]:
    """Each field's messages; a rule about several fields is told at each of them, with their values."""
    told: dict[str, str] = {}
    for problem in problems:
        paths = problem.path.split(", ")
        words = f"{problem.path} = {problem.value}: {problem.text}" if len(paths) > 1 else problem.text
        told |= {path: f"{told[path]}; {words}" if path in told else words for path in paths}
    return told
