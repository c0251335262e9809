"""What a harvest costs: the only place that knows what is paid for what.

All that is paid is told for a bin, in the currency of the scenario's prices. Wages, rents and
machines that are bought are paid by working hours. What is paid by the day is paid for each day
that is begun. In the long run all days are whole.

A picker's pay of a day is that of its hours and of its bins. If that is less than the least that is
paid for a day, the rest is paid too. All pickers are taken to fill as many bins, and as many an
hour on each day.
"""

from orchard.field.scenario import Prices, Scenario
from orchard.report.days import Day, WorkDays

# What is paid -> what it is in words.
PAYMENTS = {
    "picker_hours": "pickers, by the hour",
    "picker_bins": "pickers, by the bin",
    "picker_least": "pickers, up to the least of a day",
    "picker_bought": "pickers that are bought",
    "carrier_hours": "carriers, by the hour",
    "carrier_days": "carriers, by the day",
    "carrier_bought": "carriers that are bought",
    "overhead_hours": "all else, by the hour",
    "overhead_days": "all else, by the day",
    "bins": "each bin",
}
# Whatever depends on the number of robots of a kind, by the key of this number.
OF_ROBOTS = {
    "pickers": ("picker_hours", "picker_bought"),
    "carriers": ("carrier_hours", "carrier_days", "carrier_bought"),
}


def payments_of_long_run(
    scenario: Scenario, bins_per_hour: float, days: WorkDays | None
) -> dict[str, float]:
    """Return what is paid for what, for a bin, at a rate that goes on: what -> amount.

    `days`: None if there are none; then nothing is paid by the day.
    """
    hours = 1.0
    if days is not None:
        hours = days.day_hours
    whole = Day(count=1, hours=hours, seconds=3600.0 * hours)
    return _payments(scenario, [whole], bins_per_hour * hours)


def payments_of_harvest(
    scenario: Scenario, bins: int, bins_per_hour: float, days: WorkDays | None
) -> dict[str, float]:
    """Return what is paid for what, for a bin of one harvest: what -> amount.

    `bins`: all of the harvest. `days`: as in `payments_of_long_run`.
    """
    seconds = 3600.0 * bins / bins_per_hour
    if days is None:
        return _payments(scenario, [Day(1, seconds / 3600.0, seconds)], bins)
    return _payments(scenario, days.of(seconds), bins)


def _payments(scenario: Scenario, days: list[Day], bins: float) -> dict[str, float]:
    """Return what is paid on some days for a bin of theirs, without what costs nothing."""
    prices = scenario.prices
    pickers = scenario.pickers
    carriers = scenario.carrier_count
    hours = sum(day.count * day.hours for day in days)
    count = sum(day.count for day in days)
    paid = {
        "picker_hours": pickers * hours * (prices.picker_per_hour or 0.0),
        "picker_bins": bins * (prices.picker_per_bin or 0.0),
        "picker_least": pickers * _up_to_least(prices, days, bins / pickers),
        "picker_bought": pickers * hours * prices.picker_bought.per_hour,
        "carrier_hours": carriers * hours * (prices.carrier_per_hour or 0.0),
        "carrier_days": carriers * count * (prices.carrier_per_day or 0.0),
        "carrier_bought": carriers * hours * prices.carrier_bought.per_hour,
        "overhead_hours": hours * (prices.overhead_per_hour or 0.0),
        "overhead_days": count * (prices.overhead_per_day or 0.0),
        "bins": bins * (prices.per_bin or 0.0),
    }
    return {purpose: amount / bins for purpose, amount in paid.items() if amount}


def _up_to_least(prices: Prices, days: list[Day], bins: float) -> float:
    """Return what a picker gets on all days beside its hours and bins. `bins`: that it fills."""
    least = prices.picker_least_per_day
    if least is None:
        return 0.0
    seconds = sum(day.count * day.seconds for day in days)
    rest = 0.0
    for day in days:
        earned = day.hours * (prices.picker_per_hour or 0.0)
        earned += bins * day.seconds / seconds * (prices.picker_per_bin or 0.0)
        rest += day.count * max(0.0, least - earned)
    return rest
