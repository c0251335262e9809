"""The result of a scenario in local mode, without faults. Each lockstep run must reach the same hash and the same progress."""

from typing import NamedTuple

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.report.metrics import rows_picked

EVERY = 600  # ticks; each run ends at a multiple of it, or when the harvest is finished


class Result(NamedTuple):
    """The state of a run without faults at one tick."""

    ticks: int
    hash: str
    bins: int  # delivered
    rows: int  # picked


class Baseline:
    """Local runs in this process, one for each scenario seed. Each is continued only as far as a result needs it."""

    def __init__(self) -> None:
        self._runs: dict[int, Local] = {}
        self._results: dict[tuple[int, int], Result] = {}

    def result(self, seed: int, ticks: int | None) -> Result:
        """Return the result of the scenario with this seed after `ticks`; None: when the harvest is finished."""
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
    """The soak's scenario: 3 rows, otherwise the defaults."""
    return Scenario(rows=3, seed=seed)
