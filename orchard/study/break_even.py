"""What one more robot may cost: the price at which a bin costs the same with it and without it.

It is computed from two settings of a study that differ in one number only, of pickers or carriers,
and from their runs with the same seeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from orchard.field.scenario.prices import Bought
from orchard.report.costs import OF_ROBOTS
from orchard.study.comparing import interval
from orchard.study.result import BreakEven, Interval
from orchard.study.runs import RunRecord
from orchard.study.settings import Setting
from orchard.study.words import interval_words, number_words

# The kinds of robots, by the key of their number.
KINDS = {"pickers": "picker", "carriers": "carrier"}
# A price below this, in the currency of the prices an hour, would be shown as 0.
LEAST_PRICE = 0.0005


@dataclass(frozen=True)
class KnownSetting:
    """A setting and its runs, which have not jammed."""

    setting: Setting
    records: Sequence[RunRecord]

    def number(self, key: str) -> int:
        """Return how many robots there are. `key`: pickers or carriers."""
        if key == "pickers":
            return self.setting.scenario.pickers
        return self.setting.scenario.carrier_count

    def working_life(self, key: str) -> Bought:
        """Return how long a bought robot of a kind works. `key`: pickers or carriers."""
        prices = self.setting.scenario.prices
        if key == "pickers":
            return prices.picker_bought
        return prices.carrier_bought

    def paid_for_robots(self, key: str, record: RunRecord) -> float:
        """Return what is paid for all robots of a kind, for a bin of a run."""
        payments = self.payments(record)
        return sum(payments.get(purpose, 0.0) for purpose in OF_ROBOTS[key])

    def cost(self, record: RunRecord) -> float:
        """Return what a bin of a run costs."""
        return sum(self.payments(record).values())

    def payments(self, record: RunRecord) -> dict[str, float]:
        """Return what a bin of a run costs: key of a payment -> amount."""
        return self.setting.payments(record.bins_per_hour, record.counted_bins)


def break_evens(
    best: KnownSetting, others: Sequence[KnownSetting], confidence: float
) -> list[BreakEven]:
    """Return for each kind of robots what the last one of the best setting may cost, and one more.

    The best setting is compared with two of those that differ only in the number of this kind: with
    the next smaller number, and with the next larger one.
    """
    prices = []
    for key in OF_ROBOTS:
        by_number = {}
        for other in others:
            if _differ_only_in(key, best, other):
                by_number[other.number(key)] = other
        by_number[best.number(key)] = best
        numbers = sorted(by_number)
        place = numbers.index(best.number(key))
        # The number before, the best one, and the number after, as far as there are such.
        nearest = numbers[max(0, place - 1) : place + 2]
        for fewer, more in pairwise(nearest):
            prices.append(_break_even(key, by_number[fewer], by_number[more], confidence))
    return prices


def _differ_only_in(key: str, best: KnownSetting, other: KnownSetting) -> bool:
    """Whether two settings differ in this key, and in no other one."""
    values = best.setting.values
    others = other.setting.values
    return [name for name in values if values[name] != others[name]] == [key]


def _break_even(key: str, less: KnownSetting, more: KnownSetting, confidence: float) -> BreakEven:
    """Return what each of the robots may cost that one setting has beyond the other.

    `less`, `more`: the settings with fewer and with more robots of a kind.
    """
    added = more.number(key) - less.number(key)
    prices = []
    # Records are paired by seeds; one setting may have more of them. For each bin the added robots
    # may cost what is paid for them now, and what a bin costs less with them. Times the bins an
    # hour that is the price of an hour of all of them, and divided by their number of one of them.
    for with_fewer, with_more in zip(less.records, more.records, strict=False):
        saved_per_bin = less.cost(with_fewer) - more.cost(with_more)
        paid_per_bin = more.paid_for_robots(key, with_more) * added / more.number(key)
        prices.append((paid_per_bin + saved_per_bin) * with_more.bins_per_hour / added)
    per_hour = interval(prices, confidence)
    bought = more.working_life(key)
    return BreakEven(
        key=key,
        number=more.number(key),
        fewer=less.number(key),
        per_hour=per_hour,
        price=_times(per_hour, bought.hours),
        years=bought.years,
        hours_per_year=bought.hours_per_year,
    )


def _times(per_hour: Interval, hours: float | None) -> Interval | None:
    """Return the price of a machine that is worth so much an hour and works for so many hours; None
    if these are not known.
    """
    if hours is None:
        return None
    return Interval(
        mean=hours * per_hour.mean, low=hours * per_hour.low, high=hours * per_hour.high
    )


def break_even_words(break_even: BreakEven) -> str:
    """Return what a robot may cost: 'carrier number 3 pays up to 41 ± 2 an hour'."""
    kind = KINDS[break_even.key]
    robots = f"{kind} number {break_even.number}"
    if break_even.number - break_even.fewer > 1:
        robots = f"each {kind} from number {break_even.fewer + 1} to {break_even.number}"
    if break_even.per_hour.mean < LEAST_PRICE:
        return f"{robots} does not pay, even if it costs nothing"
    words = f"{robots} pays if it costs up to {interval_words(break_even.per_hour)} an hour"
    if break_even.price is None or break_even.years is None or break_even.hours_per_year is None:
        return words
    return (
        f"{words}; one that is bought is worth {interval_words(break_even.price)}, with"
        f" {break_even.years:g} years of {number_words(break_even.hours_per_year)} hours"
    )
