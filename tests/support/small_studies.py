"""Orchards and options of small studies, for tests of whole studies."""

from typing import Any

from orchard.field.scenario import Scenario
from orchard.study.options import StudyOptions

QUIET: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
}

# An orchard in which only the times of rows are drawn by the seed.
CHANCE = Scenario.model_validate(
    QUIET | {"rows": 3, "picking_speed": 0.5, "picking": {"spread": {"distribution": "gamma"}}}
)

# So much budget that each study decides.
AMPLE = StudyOptions(
    model="fast", horizon="harvest", budget_seconds=10_000.0, within=0.05, workers=1
)
