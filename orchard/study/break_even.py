"""What one more robot may cost: the price at which it is neither worth it nor not."""

from collections.abc import Sequence
from dataclasses import dataclass

from orchard.report.costs import OF_ROBOTS
from orchard.study.comparing import interval
from orchard.study.result import BreakEven, Interval
from orchard.study.runs import RunRecord
from orchard.study.settings import Setting
from orchard.study.words import interval_words, number_words

# The kinds of robots, by the key of their number.
KINDS = {"pickers": "picker", "carriers": "carrier"}
# A price below this is shown as 0.
LEAST_PRICE = 0.0005


@dataclass(frozen=True)
class KnownSetting:
    """A setting and its runs, which have not jammed."""

    setting: Setting
    records: Sequence[RunRecord]

    def number(self, key: str) -> int:
        """Return how many robots there are. `key`: pickers or carriers."""
        scenario = self.setting.scenario
        return scenario.pickers if key == "pickers" else scenario.carrier_count


def break_evens(
    best: KnownSetting, others: Sequence[KnownSetting], confidence: float
) -> list[BreakEven]:
    """Return what the last robot of each kind of the best setting may cost, and one more.

    They are beside settings that differ in the number of this kind only: the nearest ones.
    """
    found = []
    for key in OF_ROBOTS:
        alike = [other for other in others if _differ_only_in(key, best, other)]
        numbers = {other.number(key): other for other in alike}
        fewer = [number for number in numbers if number < best.number(key)]
        more = [number for number in numbers if number > best.number(key)]
        if fewer:
            found.append(_break_even(key, numbers[max(fewer)], best, confidence))
        if more:
            found.append(_break_even(key, best, numbers[min(more)], confidence))
    return found


def _differ_only_in(key: str, one: KnownSetting, other: KnownSetting) -> bool:
    """Whether two settings differ in one key."""
    values = one.setting.values
    others = other.setting.values
    return [name for name in values if values[name] != others[name]] == [key]


def _break_even(key: str, less: KnownSetting, more: KnownSetting, confidence: float) -> BreakEven:
    """Return what the robots may cost that one setting has more than the other."""
    pairs = zip(less.records, more.records, strict=False)
    added = more.number(key) - less.number(key)
    prices = []
    for before, after in pairs:
        saved = _cost(less, before) - _cost(more, after)
        own = sum(_payments(more, after).get(what, 0.0) for what in OF_ROBOTS[key])
        # Of a bin; as many are filled in an hour as the rate says.
        own_of_added = own * added / more.number(key)
        prices.append((own_of_added + saved) * after.bins_per_hour / added)
    per_hour = interval(prices, confidence)
    of_all = more.setting.scenario.prices
    bought = of_all.picker_bought if key == "pickers" else of_all.carrier_bought
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
    """Return the price of a machine that is worth so much an hour, for so many hours."""
    if hours is None:
        return None
    return Interval(
        mean=hours * per_hour.mean, low=hours * per_hour.low, high=hours * per_hour.high
    )


def _cost(known: KnownSetting, record: RunRecord) -> float:
    return sum(_payments(known, record).values())


def _payments(known: KnownSetting, record: RunRecord) -> dict[str, float]:
    return known.setting.payments(record.bins_per_hour, record.counted_bins)


def break_even_words(found: BreakEven) -> str:
    """Return what a robot may cost: 'carrier number 3 pays up to 41 ± 2 an hour'."""
    kind = KINDS[found.key]
    which = f"{kind} number {found.number}"
    if found.number - found.fewer > 1:
        which = f"each {kind} from number {found.fewer + 1} to {found.number}"
    if found.per_hour.mean < LEAST_PRICE:
        return f"{which} does not pay, even if it costs nothing"
    words = f"{which} pays if it costs up to {interval_words(found.per_hour)} an hour"
    if found.price is None or found.years is None or found.hours_per_year is None:
        return words
    return (
        f"{words}; one that is bought is worth {interval_words(found.price)}, with"
        f" {found.years:g} years of {number_words(found.hours_per_year)} hours"
    )
