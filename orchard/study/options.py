"""How a study is done: which runs it makes, what it looks for, and for how long."""

from dataclasses import dataclass
from pathlib import Path

from orchard.folders import runs_folder
from orchard.study.result import Goal, Horizon, Model, Models

STORE = "studies.db"


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How a study is done. The command `orchard study` has an option for each field."""

    horizon: Horizon = "long"
    # None: the least cost if the scenario has prices, else the most bins.
    goal: Goal | None = None
    confidence: float = 0.95
    # A share, 0.02 is 2 %: settings that differ by less count as equally good.
    within: float = 0.02
    budget_seconds: float = 300.0
    model: Models = "both"
    # How many processes work here; None: one per core.
    workers: int | None = None
    # The address of a scheduler of dask.distributed, which gets the runs instead.
    scheduler: str | None = None
    # None: studies.db in the folder of runs.
    store: str | Path | None = None
    # Whether the runs in a store of another version of this software are deleted.
    anew: bool = False

    @property
    def first_model(self) -> Model:
        """The model that does all settings; the other one may check the best of them."""
        if self.model == "full":
            return "full"
        return "fast"

    @property
    def confirms(self) -> bool:
        """Whether the full model checks the answer of the fast one. It can do no long run."""
        return self.model == "both" and self.horizon == "harvest"

    @property
    def store_file(self) -> Path:
        """The database in which the runs are kept."""
        if self.store is None:
            return runs_folder() / STORE
        return Path(self.store)
