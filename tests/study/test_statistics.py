"""Intervals, corrections and races, against published figures and against truths that the test knows."""

from collections.abc import Generator
from itertools import count
from math import sqrt
from statistics import fmean
from typing import Any

import numpy as np
import pytest
import simpy
from made_studies import run_race
from scipy import stats

from orchard.field.repeatable import draw, exponential, normal
from orchard.study.racing import Race, holm, interval, paired_p_value

# NIST/SEMATECH e-Handbook, 1.3.5.2: heat flow meter, ZARR13.DAT: n 195, mean 9.261460, deviation 0.022789, 95 %: 9.258242 to 9.264679


def test_the_t_interval_is_that_of_the_nist_handbook() -> None:
    values = np.linspace(-1.0, 1.0, 195)
    values = 9.261460 + 0.022789 * (values - values.mean()) / values.std(ddof=1)  # any values with this mean and deviation
    found = interval(list(values), 0.95)
    assert (found.low, found.high) == (pytest.approx(9.258242, abs=2e-6), pytest.approx(9.264679, abs=2e-6))


def test_of_one_value_or_equal_values_low_and_high_are_the_mean() -> None:
    for values in ([5.0], [5.0, 5.0, 5.0]):
        assert (interval(values, 0.95).low, interval(values, 0.95).high) == (5.0, 5.0)


def test_the_paired_test_is_that_of_student() -> None:
    """Student, Biometrika 6, 1908, 1-25: additional hours of sleep by two drugs, ten patients; t = 4.06, p = 0.0028 (R: `sleep`)."""
    dextro = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
    laevo = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]
    assert paired_p_value(dextro, laevo) == pytest.approx(0.002833, abs=1e-6)


def test_of_differences_without_spread_only_the_sign_counts() -> None:
    assert paired_p_value([3.0, 4.0], [3.0, 4.0]) == 1.0
    assert paired_p_value([3.0], [2.0]) == 1.0  # one alone tells nothing
    assert paired_p_value([3.0, 4.0, 5.0], [2.0, 3.0, 4.0]) == pytest.approx(stats.binomtest(3, 3).pvalue)


def test_holms_correction_is_the_published_one() -> None:
    """The example of Wikipedia's "Holm-Bonferroni method", and of R's p.adjust: p-values 0.01, 0.04, 0.03, 0.005."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.01, 0.02, 0.03, 0.005]) == pytest.approx([0.03, 0.04, 0.04, 0.02])
    assert holm([]) == []


STUDIES, DEVIATION = 200, 1.5
ALIKE = [60.0] * 20  # true means of settings of which the best is a matter of luck


def raced(number: int, means: list[float], within: float) -> tuple[Race, dict[int, list[float]]]:
    """A race of settings with these true means, whose results have a common and an own part, and what it saw."""

    def value(i: int, seed: int) -> float:
        common, own = (normal(*draw(number, name, seed, 2)) for name in ("common", f"setting {i}"))
        return means[i] + DEVIATION * (0.3 * common + 0.95 * own)

    race = Race(len(means), True, 0.95, within)
    return race, run_race(race, value)


@pytest.fixture(scope="module")
def studies() -> list[tuple[list[float], Race, dict[int, list[float]]]]:
    """200 small studies: alike settings, one that is better by a little, and settings that differ."""
    kinds = [(ALIKE, 0.0001), ([60.0, 60.0, 60.0, 61.0], 0.0001), ([58.0, 59.0, 60.0, 60.5], 0.01), ([60.0, 63.0], 0.01)]
    return [(means, *raced(number, means, within)) for number in range(STUDIES) for means, within in [kinds[number % len(kinds)]]]


def least(studies: int) -> int:
    """Of so many intervals of 95 % fewer than this hold their truth by chance once in a thousand times."""
    return int(stats.binom.ppf(0.001, studies, 0.95))


def test_the_intervals_of_a_race_cover_the_truth(studies: list) -> None:
    own, together = [], 0
    for means, race, seen in studies:
        best = interval(seen[race.best], race.each)
        own += [means] if best.low <= means[race.best] <= best.high else []
        others = [i for i in range(len(means)) if i != race.best]
        differences = {i: race.verdict(i, seen).difference for i in others}
        together += all(one.low <= means[i] - means[race.best] <= one.high for i, one in differences.items())
    assert len(own) >= least(STUDIES)
    assert own.count(ALIKE) >= least(STUDIES // 4)  # though the best of them had luck
    assert together >= least(STUDIES)


def test_the_truly_best_setting_hardly_ever_leaves_the_race(studies: list) -> None:
    lost = [means for means, race, _ in studies if means.index(max(means)) in race.out and len(set(means)) > 1]
    assert len(lost) <= STUDIES - least(STUDIES)


def test_a_clear_winner_is_certain_and_settings_that_are_alike_cannot_be_told_apart(studies: list) -> None:
    clear = [race for means, race, _ in studies if means == [60.0, 63.0]]
    assert all(race.why in ("certain", "within") and race.best == 1 for race in clear)
    assert sum(race.why == "certain" for race in clear) > 0.9 * len(clear)
    alike = [race for means, race, _ in studies if means == ALIKE]
    assert sum(len(race.left) > 1 for race in alike) >= 0.95 * len(alike)
    assert all(race.why == "seeds" for race in alike if len(race.left) > 1)


def test_less_is_better_where_the_goal_says_so() -> None:
    race = Race(2, False, 0.95, 0.01)
    race.look({0: [3.0, 3.1, 2.9, 3.0, 3.1], 1: [2.0, 2.2, 1.9, 2.0, 2.1]})
    assert (race.best, race.left, race.why) == (1, [1], "certain")


def test_a_setting_that_jams_leaves_the_race_and_is_known() -> None:
    race = Race(2, True, 0.95, 0.01)
    race.jam([1])
    race.look({0: [3.0, 3.1, 2.9, 3.0, 3.1]})
    assert (race.best, race.jammed, race.why) == (0, [1], "certain")
    race.jam([0])
    assert (race.best, race.why) == (None, "certain")


def test_seeds_that_agree_by_chance_end_no_race() -> None:
    """A failure that one seed in ten has: five seeds without it say nothing."""
    race = Race(2, True, 0.95, 0.01)
    race.look({0: [21.4] * 5, 1: [21.0] * 5})
    assert (race.left, race.why) == ([0, 1], None)
    sure = Race(2, True, 0.95, 0.01, frozenset([0, 1]))
    sure.look({0: [21.4] * 5, 1: [21.0] * 5})
    assert (sure.left, sure.why) == ([0], "certain")


def test_what_lost_to_a_setting_that_jams_later_is_back_in_the_race() -> None:
    race = Race(3, True, 0.95, 0.01)
    race.look({0: [100.0, 100.1, 99.9, 100.0, 100.2], 1: [90.0, 90.2, 89.9, 90.1, 90.0], 2: [60.0, 110.0, 70.0, 100.0, 70.0]})
    assert race.left == [0, 2]
    race.jam([0])
    assert (race.left, race.out) == ([1, 2], {})


def test_a_setting_alone_is_replicated_until_its_interval_is_narrow() -> None:
    race = Race(1, True, 0.95, 0.01)
    race.look({0: [20.0, 22.0, 21.0, 23.0, 19.0]})
    assert race.why is None
    race.look({0: [20.0, 20.1, 20.0, 19.9, 20.0]})
    assert race.why == "within"


# Six machines and one repairman, M/M/1//6: each fails after 20 on average, and a repair takes 2. As published: P0 0.4845, waiting 0.3297,
# down 0.8451, wait for the repairman 1.279. So 0.3297 / 1.279 are repaired in a unit of time (Little), and all run for 0.4845 of it.
MACHINES, RUNS, REPAIR = 6, 20.0, 2.0
REPAIRED, WAIT = 0.3297 / 1.279, 1.279
SHOPS, REPLICATIONS, WARM_UP, END = 50, 5, 50.0, 250.0


def shop(seed: int) -> tuple[float, float]:
    """Return what was repaired in a unit of time, and the mean wait for the repairman."""
    env = simpy.Environment()
    repairman, waits = simpy.Resource(env), list[float]()

    def machine(name: str) -> Generator[simpy.Event, Any, None]:
        for number in count():
            runs, takes = draw(seed, name, number, 2)
            yield env.timeout(exponential(runs, RUNS))
            failed = env.now
            with repairman.request() as turn:
                yield turn
                waited = env.now - failed
                yield env.timeout(exponential(takes, REPAIR))
            if env.now > WARM_UP:
                waits.append(waited)

    for number in range(MACHINES):
        env.process(machine(f"machine {number}"))
    env.run(until=END)
    return len(waits) / (END - WARM_UP), fmean(waits)


def test_intervals_over_replications_hold_the_published_figures_of_the_repairman() -> None:
    shops = [shop(seed) for seed in range(SHOPS * REPLICATIONS)]
    for truth, values in zip((REPAIRED, WAIT), zip(*shops, strict=True), strict=True):
        all_of_them = interval(values, 0.999)
        assert all_of_them.low <= truth <= all_of_them.high
        assert all_of_them.high - all_of_them.low < 0.2 * truth
        studies = [interval(values[first : first + REPLICATIONS], 0.95) for first in range(0, len(values), REPLICATIONS)]
        assert sum(one.low <= truth <= one.high for one in studies) >= stats.binom.ppf(0.001, SHOPS, 0.95)


# Five designs, of which the first is best: it has the least mean (Chen and Lee, Stochastic Simulation Optimization, 2011). Their OCBA
# shares 100 more runs among them as 48, 38, 11, 2 and 1: most go to those that are hard to tell apart. A race must find the same order.
MEANS, VARIANCES = (1.2, 2.1, 3.4, 4.87, 6.05), (3.3, 2.0, 4.5, 5.3, 6.9)
RACES = 100


def chosen(number: int) -> tuple[Race, dict[int, list[float]]]:
    """A race among the five designs, and what it saw of each."""
    race = Race(len(MEANS), False, 0.95, 1e-9)
    return race, run_race(race, lambda i, seed: MEANS[i] + sqrt(VARIANCES[i]) * normal(*draw(number, f"design {i}", seed, 2)))


def test_a_race_finds_the_published_best_of_five_designs_with_fewer_runs_than_equal_shares_need() -> None:
    races = [chosen(number) for number in range(RACES)]
    assert sum(0 in race.out for race, _ in races) <= stats.binom.ppf(0.999, RACES, 0.05)  # as sure as it says
    assert sum(race.best == 0 for race, _ in races) >= stats.binom.ppf(0.001, RACES, 0.95)
    spent = [fmean(len(seen[i]) for _, seen in races) for i in range(len(MEANS))]
    equal = fmean(len(MEANS) * max(map(len, seen.values())) for _, seen in races)  # if none left the race before its end
    assert spent == sorted(spent, reverse=True)
    assert sum(spent) < 0.6 * equal
