"""The course of a run over simulated time: what the charts show."""

from collections.abc import Iterable, Mapping, Sequence

from orchard.field.scenario import Scenario
from orchard.report.history import shares

Points = list[list[float]]  # [simulated min, value]
Course = Mapping[str, Points]  # title of a chart -> its line
BINS, WAITING, BUSY = "Bins delivered", "Pickers that wait, %", "Carriers at work, %"


def course_of(history: Mapping[str, Sequence[float]], scenario: Scenario) -> Course:
    """Return figures of a run over time. `history`: as in the summary, as far as the run has got."""

    def points(values: Iterable[float]) -> Points:
        return [[round(s / 60.0, 2), round(value, 1)] for s, value in zip(history["seconds"], values, strict=True)]

    waited = shares(history, "pickers_waited_seconds", scenario.pickers)
    busy = shares(history, "carriers_busy_seconds", scenario.carrier_count)
    percent = {WAITING: points(100.0 * share for share in waited), BUSY: points(100.0 * share for share in busy)}
    return {BINS: points(history["bins_delivered"]), **percent}
