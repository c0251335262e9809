"""The messages with which the reader of scenarios refuses a faulty text, for tests of these."""

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import parse


def refused(text: str) -> list[str]:
    """Return what is wrong with a scenario text: a line for each problem."""
    with pytest.raises(ScenarioError) as caught:
        parse(text, "my.yaml")
    return str(caught.value).splitlines()


def refusal(text: str) -> str:
    """Return the only problem of a scenario text, as `refused` has it."""
    (line,) = refused(text)
    return line
