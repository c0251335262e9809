"""What local mode makes of a scenario: the hash, and how far the harvest is, that every run in lockstep must have as well."""

from typing import NamedTuple

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.report.metrics import rows_picked

EVERY = 600  # ticks; runs end at a multiple of it, or when all is harvested


class Result(NamedTuple):
    """A run that nothing happened to."""

    ticks: int
    hash: str
    bins: int  # delivered
    rows: int  # picked


class Undisturbed:
    """Runs in this process, one for each scenario, that go on as far as somebody asks."""

    def __init__(self) -> None:
        self._runs: dict[int, Local] = {}
        self._results: dict[tuple[int, int], Result] = {}

    def result(self, seed: int, ticks: int | None) -> Result:
        """Of 3 rows with this seed, after so many ticks; None: when all is harvested."""
        local = self._runs.setdefault(seed, Local(scenario(seed)))
        while not local.engine.over and (ticks is None or local.engine.tick < ticks):
            local.tick()
            if local.engine.tick % EVERY == 0 or local.engine.over:
                self._keep(seed, local)
        return self._results[seed, local.engine.tick if ticks is None else min(ticks, local.engine.tick)]

    def _keep(self, seed: int, local: Local) -> None:
        engine = local.engine
        self._results[seed, engine.tick] = Result(engine.tick, engine.hash, engine.world.delivered, rows_picked(engine.world))


def scenario(seed: int) -> Scenario:
    return Scenario(rows=3, seed=seed)
