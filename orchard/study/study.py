"""A study: which of many settings of a scenario is best, by how much, and with what confidence."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from orchard.field.scenario import Scenario
from orchard.study.result import Goal, StudyResult

Horizon = Literal["harvest", "long"]
Models = Literal["fast", "full", "both"]


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How a study is done. The command `orchard study` has an option for each field."""

    horizon: Horizon = "harvest"
    goal: Goal = "bins_per_hour"
    confidence: float = 0.95
    within: float = 0.01  # half the width of an interval, as a share of its mean, at which a setting needs no more replications
    budget_seconds: float = 60.0
    model: Models = "both"
    workers: int | None = None  # processes here; None: one per core
    scheduler: str | None = None  # address of a dask.distributed scheduler, which gets the runs instead
    store: Path | None = None  # None: studies.db in the folder of runs
    anew: bool = False  # forget what a store of another version holds


def study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    options: StudyOptions,
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Compare all settings of a scenario, and return the answer.

    `varied`: dotted path of the scenario -> its values; each combination is a setting. `tell` hears what is known so far, at most
    twice a second. `is_stopped` is asked several times a second; when it says True, the study returns what it knows.

    Raises ScenarioError or ValueError for what a user can correct.
    """
    raise NotImplementedError
