"""What a harvest costs: the only place that knows what is paid for what.

Each amount is for one bin, in the currency of the scenario's prices. Wages, rents and machines that
are bought are paid by working hours. What is paid by the day is paid for each day that is begun. In
the long run all days are whole.

A picker earns by the hour and by the bin. If that is less than `picker_least_per_day`, the
difference is paid too. All pickers are taken to fill bins at the same rate while they are there. A
picker that is away (`picker_absences`) earns nothing then. It gets the least of a day on which it
is there for more than an hour.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from orchard.field.scenario import Prices, Scenario
from orchard.report.days import Day, WorkDays

# Key of a payment -> the same in words.
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
# The key of the scenario that has the number of robots of a kind -> the payments that grow with
# this number.
OF_ROBOTS = {
    "pickers": ("picker_hours", "picker_least", "picker_bought"),
    "carriers": ("carrier_hours", "carrier_days", "carrier_bought"),
}
# s. A picker that is there for no longer, on a day on which it is away, does not get the least of
# this day. Chosen: the hours of an absence are those of a harvest, of which a day does a little
# less than its hours. So a picker that is away on the third day may come for some minutes of it.
LEAST_ATTENDANCE = 3600.0


def payments_of_long_run(
    scenario: Scenario, bins_per_hour: float, days: WorkDays | None
) -> dict[str, float]:
    """Return what a bin costs at a rate that goes on: key of a payment -> amount.

    `days`: None if the scenario has no shift; then an hour is computed, and nothing may be paid by
    the day.
    """
    hours = 1.0
    if days is not None:
        hours = days.day_hours
    whole = Day(count=1, hours=hours, seconds=3600.0 * hours)
    return _payments(scenario, [whole], bins_per_hour * hours)


def payments_of_harvest(
    scenario: Scenario, bins: int, bins_per_hour: float, days: WorkDays | None
) -> dict[str, float]:
    """Return what a bin of one harvest costs: key of a payment -> amount.

    `bins`: all of the harvest. `days`: None if the scenario has no shift; then the whole harvest is
    one day.
    """
    seconds = 3600.0 * bins / bins_per_hour
    if days is None:
        return _payments(scenario, [Day(1, seconds / 3600.0, seconds)], bins)
    return _payments(scenario, days.of(seconds), bins)


@dataclass(frozen=True)
class _Attendance:
    """Days of pickers that are alike: a day of one picker counts as one."""

    count: int
    #: The working hours that are paid to a picker on such a day.
    hours: float
    #: For how much of the harvest's time it is there, s.
    seconds: float
    #: Whether it gets the least of a day.
    has_least: bool = True


def _attendances(scenario: Scenario, days: Sequence[Day]) -> list[_Attendance]:
    """Return when the pickers are there. `days`: on which the work is done, in their order."""
    absences = scenario.picker_absences
    attendances = []
    begin = 0.0
    for day in days:
        always_there = scenario.pickers - len(absences)
        attendances.append(_Attendance(always_there * day.count, day.hours, day.seconds))
        for _ in range(day.count):
            for intervals in absences.values():
                away = _seconds_away(intervals, begin, begin + day.seconds)
                seconds = day.seconds - away
                hours = day.hours * seconds / day.seconds
                has_least = away == 0.0 or seconds > LEAST_ATTENDANCE
                attendances.append(_Attendance(1, hours, seconds, has_least))
            begin += day.seconds
    return attendances


def _seconds_away(intervals: Sequence[Sequence[float]], begin: float, end: float) -> float:
    """Return for how long a picker is away between two moments of a harvest, s.

    `intervals`: pairs of hours, apart from each other.
    """
    away = 0.0
    for first, last in intervals:
        away += max(0.0, min(end, 3600.0 * last) - max(begin, 3600.0 * first))
    return away


def _payments(scenario: Scenario, days: Sequence[Day], bins: float) -> dict[str, float]:
    """Return what a bin costs: key of a payment -> amount, without those of which nothing is paid.

    `days`: on which the work is done. `bins`: that are filled on all these days together.
    """
    prices = scenario.prices
    carriers = scenario.carrier_count
    attendances = _attendances(scenario, days)
    picker_hours = sum(there.count * there.hours for there in attendances)
    hours = sum(day.count * day.hours for day in days)
    count = sum(day.count for day in days)
    paid = {
        "picker_hours": picker_hours * (prices.picker_per_hour or 0.0),
        "picker_bins": bins * (prices.picker_per_bin or 0.0),
        "picker_least": _up_to_least(prices, attendances, bins),
        "picker_bought": picker_hours * prices.picker_bought.per_hour,
        "carrier_hours": carriers * hours * (prices.carrier_per_hour or 0.0),
        "carrier_days": carriers * count * (prices.carrier_per_day or 0.0),
        "carrier_bought": carriers * hours * prices.carrier_bought.per_hour,
        "overhead_hours": hours * (prices.overhead_per_hour or 0.0),
        "overhead_days": count * (prices.overhead_per_day or 0.0),
        "bins": bins * (prices.per_bin or 0.0),
    }
    return {purpose: amount / bins for purpose, amount in paid.items() if amount}


def _up_to_least(prices: Prices, attendances: Sequence[_Attendance], bins: float) -> float:
    """Return what all pickers are paid up to the least of a day, beside hours and bins.

    `bins`: that they fill together.
    """
    if prices.picker_least_per_day is None:
        return 0.0
    seconds = sum(there.count * there.seconds for there in attendances)
    if seconds == 0.0:
        # All are away for all of the time, which may be that of a limit: no harvest is so short.
        return 0.0
    piece_rate_of_second = bins / seconds * (prices.picker_per_bin or 0.0)
    up_to_least = 0.0
    for there in attendances:
        earned = there.hours * (prices.picker_per_hour or 0.0)
        earned += there.seconds * piece_rate_of_second
        if there.has_least:
            up_to_least += there.count * max(0.0, prices.picker_least_per_day - earned)
    return up_to_least
