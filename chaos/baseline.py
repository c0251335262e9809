"""The result of a scenario in local mode, without faults.

Each lockstep run must reach the same hash and the same progress.
"""

from typing import NamedTuple

from chaos.mistakes import MISTAKEN, Mistaken
from orchard.field.scenario import Scenario, to_yaml
from orchard.local import Local

EVERY = 600  # ticks; each run ends at a multiple of it, or when the harvest is finished


class Result(NamedTuple):
    """The state of a run without faults at one tick."""

    ticks: int
    hash: str
    bins: int  # delivered
    rows: int  # picked


class Baseline:
    """Local runs in this process, one for each scenario.

    Each is continued only as far as a result needs it.
    """

    def __init__(self) -> None:
        self._runs: dict[str, Local] = {}
        self._results: dict[tuple[str, int], Result] = {}

    def result(self, scenario: Scenario, ticks: int | None) -> Result:
        """Return the result of a scenario after `ticks`; None: when the harvest is finished."""
        key = to_yaml(scenario)
        local = self._runs.get(key) or self._runs.setdefault(key, Local(scenario))
        while not local.engine.over and (ticks is None or local.engine.tick < ticks):
            local.tick()
            if local.engine.tick % EVERY == 0 or local.engine.over:
                self._keep(key, local)
        return self._results[
            key, local.engine.tick if ticks is None else min(ticks, local.engine.tick)
        ]

    def _keep(self, key: str, local: Local) -> None:
        engine = local.engine
        picked = int(engine.world.rows_done.sum())
        self._results[key, engine.tick] = Result(
            engine.tick, engine.hash, engine.world.delivered, picked
        )


def scenario(seed: int, is_mistaken: bool = False) -> Scenario:
    """The soak's scenario: 3 rows; carriers leave early in every second one.

    `is_mistaken`: with an agent that makes mistakes.
    """
    own = {MISTAKEN: f"{Mistaken.__module__}.{Mistaken.__name__}"} if is_mistaken else {}
    return Scenario(rows=3, seed=seed, agents=own, dispatch=("predictive", "nearest")[seed % 2])
