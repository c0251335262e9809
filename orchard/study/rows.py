"""The row of a setting in the table of a study, from its runs by one model."""

from collections.abc import Mapping, Sequence

from orchard.report.costs import PAYMENTS
from orchard.study.comparing import interval
from orchard.study.replications import shown_rate
from orchard.study.result import Interval, Row
from orchard.study.runs import RunRecord
from orchard.study.settings import Setting


def row_of(setting: Setting, records: Sequence[RunRecord], confidence: float) -> Row:
    """Return the row of a setting with its figures.

    Its standing is "jammed" and its lead is None: the caller, which knows the other settings, sets
    both.
    """
    jammed = sum(record.is_jammed for record in records)
    harvested = records
    if jammed:
        # The runs that did not jam were lucky, so their figures would be too good.
        harvested = []
    rates = []
    seconds = []
    costs = []
    payments = []
    picker_waiting = []
    carrier_utilisations = []
    for record in harvested:
        rates.append(shown_rate(setting, record))
        picker_waiting.append(record.picker_waiting_seconds)
        carrier_utilisations.append(record.carrier_utilisation)
        of_run = setting.payments(record.bins_per_hour, record.counted_bins)
        payments.append(of_run)
        if record.horizon == "harvest":
            seconds.append(record.sim_seconds)
        if setting.has_prices:
            costs.append(sum(of_run.values()))
    count = max(1, len(harvested))
    ends = None
    if seconds and setting.days is not None:
        ends = setting.days.words(sum(seconds) / count)
    return Row(
        setting=setting.values,
        model=records[0].model,
        replications=len(records),
        jammed=jammed,
        bins_per_hour=_interval_of(rates, confidence),
        harvest_seconds=_interval_of(seconds, confidence),
        cost_per_bin=_interval_of(costs, confidence),
        picker_waiting_seconds=sum(picker_waiting) / count,
        carrier_utilisation=sum(carrier_utilisations) / count,
        bound_bins_per_hour=setting.limit.bins_per_hour,
        bottleneck=setting.limit.bottleneck,
        standing="jammed",
        lead=None,
        paid=_mean_payments(payments),
        ends=ends,
    )


def _interval_of(values: Sequence[float], confidence: float) -> Interval | None:
    """Return the interval of a mean; None without values."""
    if not values:
        return None
    return interval(values, confidence)


def _mean_payments(payments: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each payment for a bin, in the order of PAYMENTS: key -> amount.

    `payments`: for each run key -> amount; a payment of nothing is not there.
    """
    means: dict[str, float] = {}
    for of_run in payments:
        for purpose, amount in of_run.items():
            means[purpose] = means.get(purpose, 0.0) + amount / len(payments)
    return {purpose: means[purpose] for purpose in PAYMENTS if purpose in means}
