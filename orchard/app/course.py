"""The course of a run over simulated time: what the charts show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from orchard.field.scenario import Scenario
from orchard.report.history import shares

Points = list[list[float]]  # [simulated min, value]


@dataclass(frozen=True)
class Course:
    """Figures of a run over time. `history`: as in the summary, as far as the run has got."""

    history: Mapping[str, Sequence[float]]
    scenario: Scenario

    def bins(self) -> Points:
        """Bins that have been delivered."""
        return self._points(self.history["bins_delivered"])

    def waiting(self) -> Points:
        """Percent of the pickers' time that they waited."""
        return self._shares("pickers_waited_seconds", self.scenario.pickers)

    def busy(self) -> Points:
        """Percent of the carriers' time outside the queue."""
        return self._shares("carriers_busy_seconds", self.scenario.carrier_count)

    def _shares(self, name: str, robots: int) -> Points:
        return self._points([100.0 * share for share in shares(self.history, name, robots)])

    def _points(self, values: Sequence[float]) -> Points:
        return [[round(s / 60.0, 2), round(value, 1)] for s, value in zip(self.history["seconds"], values, strict=True)]
