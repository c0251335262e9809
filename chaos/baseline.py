"""The result of a scenario in local mode, without faults.

Each lockstep run must reach the same hash and the same progress.
"""

from math import inf
from typing import NamedTuple

from chaos.mistakes import MISTAKEN, Mistaken
from orchard.field.scenario import Scenario, to_yaml
from orchard.local import Local

# Ticks. Each run ends at a multiple of it (`schedule.SECONDS`), or when the harvest is finished.
EVERY = 600


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
        # Scenario, as YAML -> its run, at the tick that it has come to.
        self._runs: dict[str, Local] = {}
        # (scenario, as YAML, and tick) -> result, for each multiple of EVERY and for the last tick.
        self._results: dict[tuple[str, int], Result] = {}

    def result(self, scenario: Scenario, ticks: int | None) -> Result:
        """Return the result of a scenario after `ticks`; None: when the harvest is finished."""
        key = to_yaml(scenario)
        if key not in self._runs:
            self._runs[key] = Local(scenario)
        local = self._runs[key]
        most = inf
        if ticks is not None:
            most = ticks
        while not local.engine.over and local.engine.tick < most:
            local.tick()
            if local.engine.tick % EVERY == 0 or local.engine.over:
                self._keep(key, local)
        # A harvest that ends before `ticks` ends the run too.
        return self._results[key, int(min(most, local.engine.tick))]

    def _keep(self, key: str, local: Local) -> None:
        """Store the result of a run at its present tick."""
        engine = local.engine
        picked = int(engine.world.rows_done.sum())
        self._results[key, engine.tick] = Result(
            engine.tick, engine.hash, engine.world.delivered, picked
        )


def scenario(seed: int, is_mistaken: bool = False) -> Scenario:
    """The soak's scenario: 3 rows. With an even seed carriers leave before a bin is full.

    `is_mistaken`: with an agent that makes mistakes.
    """
    own = {}
    if is_mistaken:
        own[MISTAKEN] = f"{Mistaken.__module__}.{Mistaken.__name__}"
    dispatch = "nearest"
    if seed % 2 == 0:
        dispatch = "predictive"
    return Scenario(rows=3, seed=seed, agents=own, dispatch=dispatch)
