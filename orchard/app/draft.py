"""What a user has entered so far: good enough to run, or what is wrong with it, field by field."""

from typing import Any

from orchard.agents.catalogue import named_classes
from orchard.app.entries import entries, flat, nested
from orchard.app.numbers import hint, number_of
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, check

CLASSES = "agents"  # the path of the users' own classes, which come with a file and are not entered


class Draft:
    """Values by path, whatever they are; `scenario` and `problems` follow every change."""

    def __init__(self, scenario: Scenario) -> None:
        self.take(scenario)

    def take(self, scenario: Scenario) -> None:
        """All values from a scenario."""
        self.values, self.classes = flat(scenario), dict(scenario.agents)
        self._judge()

    def set(self, path: str, value: Any) -> None:
        self.values[path] = _typed(path, value)
        self._judge()

    def drop_classes(self) -> None:
        """Let our own agents drive again."""
        self.classes = {}
        self._judge()

    def _judge(self) -> None:
        self.scenario, self.problems = None, {}
        try:
            scenario = check(nested(self.values) | {CLASSES: self.classes}, "page")
            if self.classes:
                named_classes(lay_out(scenario))
        except ScenarioError as error:
            self.problems = {path: words + hint(self.values.get(path)) for path, words in _by_field(error.problems).items()}
        except ValueError as error:
            self.problems = {CLASSES: str(error)}
        else:
            self.scenario = scenario


def _typed(path: str, value: Any) -> Any:
    """What was entered as the scenario wants it; what is no number stays as it is, for the check to name."""
    if isinstance(value, str):
        value = number_of(value)
    if entries()[path].kind is int and isinstance(value, float) and value.is_integer():
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
