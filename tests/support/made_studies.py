"""Results of studies, made by hand, for tests of what is shown of them.

No harvest stands behind the figures. They are such that each setting is where a test needs it: far
behind the best one, near it, or jammed.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from orchard.field.scenario import Scenario
from orchard.study.comparing import LOOKS, Comparison, compare
from orchard.study.orchard_words import orchard_words
from orchard.study.result import Check, Interval, Row, Standing, StudyResult


def interval(mean: float, half: float = 0.0) -> Interval:
    """Return an interval of confidence: `half` on each side of the mean."""
    return Interval(mean=mean, low=mean - half, high=mean + half)


# How far a setting is behind the best mean, as a share of it: more, and less, than the 2 % that
# count.
FAR = interval(0.05, 0.01)
NEAR = interval(0.005, 0.01)


def a_row(rate: float | None, half: float = 0.0, **changes: Any) -> Row:
    """Return a row of a study of harvests of 20 bins at this rate, bins an hour.

    `rate` None: each run of the setting jammed. `half`: half the interval of the rate.
    """
    known = rate is not None
    row = dict(
        setting={"carriers": 9},
        model="fast",
        replications=5,
        jammed=0 if known else 5,
        bins_per_hour=interval(rate, half) if known else None,
        # 20 bins at so many an hour of 3,600 s.
        harvest_seconds=interval(20 * 3600.0 / rate) if known else None,
        cost_per_bin=None,
        picker_waiting_seconds=316.2,
        carrier_utilisation=0.774,
        bound_bins_per_hour=91.2,
        bottleneck="carriers",
        standing="worse" if known else "jammed",
        lead=FAR if known else None,
        behind=FAR.mean if known else None,
    )
    return Row(**row | changes)


def checked(rate: float, half: float, difference: float, jammed: int = 0) -> Check:
    """Return what the simulator says of a setting: its rate, and the share that this differs."""
    return Check(
        bins_per_hour=interval(rate, half), difference=difference, replications=3, jammed=jammed
    )


def a_result(
    table: list[Row],
    best: dict[str, Any] | None,
    ties: tuple[dict[str, Any], ...] = (),
    **changes: Any,
) -> StudyResult:
    """Return a study of these rows.

    `best`: the setting of the best row, None if no row is best. `ties`: settings as good as that.
    Rows of `undecided` settings, which is one of the changes, get the standing `unknown`. All other
    rows keep theirs. The best row is put near the best mean, unless it says how far it is off.
    """
    varied: dict[str, list[Any]] = {}
    for row in table:
        for key, value in row.setting.items():
            varied[key] = [*dict.fromkeys([*varied.get(key, []), value])]
    undecided = changes.get("undecided", [])

    def standing(row: Row) -> Standing:
        if row.setting == best:
            return "best"
        if row.setting in ties:
            return "equal"
        if row.setting in undecided:
            return "unknown"
        return row.standing

    scenario = Scenario(rows=20, pickers=10)
    shown = [
        replace(
            row,
            standing=standing(row),
            lead=NEAR if row.setting == best and row.lead == FAR else row.lead,
            behind=NEAR.mean if row.setting == best and row.lead == FAR else row.behind,
        )
        for row in table
    ]
    result = dict(
        answer="",
        orchard=orchard_words(scenario, varied),
        best=best,
        table=shown,
        goal="bins_per_hour",
        horizon="harvest",
        confidence=0.95,
        within=0.02,
        scenario=scenario.model_dump(),
        varied=varied,
        wall_seconds=12.3,
        stopped_by="certain",
        undecided=undecided,
        seconds_needed=None,
        beyond={},
        notes=[],
        version="0.1.0",
    )
    return StudyResult(**result | changes)


def compared(
    value: Callable[[int, int], float],
    robots: Sequence[int],
    within: float = 0.02,
    is_max: bool = True,
) -> tuple[Comparison, dict[int, list[float]]]:
    """Compare settings as a study does: look by look, with more seeds each time, until all is
    decided.

    `value`: returns the value of a setting, by its index, and a seed. `robots`: of each setting.
    `within`: what counts, as a share. `is_max`: whether the greatest value is best.
    Return the comparison, and the values that were seen: index of a setting -> value of each seed.
    """
    for look in LOOKS:
        seen = {i: [value(i, seed) for seed in range(look)] for i in range(len(robots))}
        result = compare(seen, dict(enumerate(robots)), is_max, 0.95, within)
        if not result.undecided:
            break
    return result, seen


def carriers(number: int) -> dict[str, int]:
    return {"carriers": number}


# Carriers -> bins an hour.
RATES = {
    1: 7.9,
    2: 15.8,
    4: 31.6,
    6: 50.2,
    8: 66.0,
    9: 70.4,
    10: 72.8,
    12: 73.0,
    14: 73.1,
    20: 73.2,
}
# The cost of a bin with so many carriers: an hour costs 15 for each of 10 pickers, 6 for a carrier.
PRICES = {number: (10 * 15.0 + number * 6.0) / rate for number, rate in RATES.items()}


def by_carriers(**changes: Any) -> StudyResult:
    """Return a study of 20 rows and 10 pickers with more and more carriers.

    The cheapest setting is best, and 20 carriers jammed.
    """
    # Bins an hour: what a carrier, or the unloading at the bay, can do at most.
    bound = {number: min(8.0 * number, 79.2) for number in RATES}
    rows = [
        a_row(
            rate,
            0.6,
            setting=carriers(n),
            cost_per_bin=interval(PRICES[n], 0.03),
            bound_bins_per_hour=bound[n],
        )
        for n, rate in RATES.items()
        if n != 20
    ]
    jammed = a_row(None, setting=carriers(20), bound_bins_per_hour=79.2, bottleneck="unloading")
    return a_result(
        [*rows, jammed], carriers(10), (carriers(9),), **{"goal": "cost_per_bin"} | changes
    )


def by_policies() -> StudyResult:
    """Return a study of five policies, of which the two predictive ones are equally good."""
    rates = {
        "nearest": 59.5,
        "longest-waiting": 68.8,
        "farthest-first": 68.9,
        "predictive": 72.8,
        "predictive-farthest": 72.7,
    }
    rows = [
        a_row(rate, 1.2, setting={"dispatch": name}, bound_bins_per_hour=79.2)
        for name, rate in rates.items()
    ]
    return a_result(rows, {"dispatch": "predictive"}, ({"dispatch": "predictive-farthest"},))


def by_both() -> StudyResult:
    """Return a study of each number of carriers with each of three policies."""
    # Policy -> the share of `RATES` that it reaches.
    gains = {"nearest": 0.8, "farthest-first": 0.92, "predictive": 1.0}
    rows = [
        a_row(
            rate * gain,
            0.9,
            setting={"carriers": n, "dispatch": name},
            bound_bins_per_hour=min(8.0 * n, 79.2),
        )
        for name, gain in gains.items()
        for n, rate in RATES.items()
    ]
    return a_result(rows, {"carriers": 10, "dispatch": "predictive"})
