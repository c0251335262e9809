"""The study's statistics on two examples whose answers are published: machines and their repairman, and a choice among five designs."""

from collections.abc import Generator
from itertools import count
from math import sqrt
from statistics import fmean
from typing import Any

import simpy
from made_studies import run_race
from scipy import stats

from orchard.field.repeatable import draw, exponential, normal
from orchard.study.racing import Race, interval

# Six machines and one repairman, M/M/1//6: each fails after 20 on average, and a repair takes 2. As published: P0 0.4845, waiting 0.3297,
# down 0.8451, wait for the repairman 1.279. So 0.3297 / 1.279 are repaired in a unit of time (Little), and all run for 0.4845 of it.
MACHINES, RUNS, REPAIR = 6, 20.0, 2.0
REPAIRED, WAIT = 0.3297 / 1.279, 1.279
STUDIES, REPLICATIONS, WARM_UP, END = 50, 5, 50.0, 250.0


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
    shops = [shop(seed) for seed in range(STUDIES * REPLICATIONS)]
    for truth, values in zip((REPAIRED, WAIT), zip(*shops, strict=True), strict=True):
        all_of_them = interval(values, 0.999)
        assert all_of_them.low <= truth <= all_of_them.high
        assert all_of_them.high - all_of_them.low < 0.2 * truth
        studies = [interval(values[first : first + REPLICATIONS], 0.95) for first in range(0, len(values), REPLICATIONS)]
        assert sum(one.low <= truth <= one.high for one in studies) >= stats.binom.ppf(0.001, STUDIES, 0.95)


# Five designs, of which the first is best: it has the least mean (Chen and Lee, Stochastic Simulation Optimization, 2011). Their OCBA
# shares 100 more runs among them as 48, 38, 11, 2 and 1: most go to those that are hard to tell apart. A race must find the same order.
MEANS, VARIANCES = (1.2, 2.1, 3.4, 4.87, 6.05), (3.3, 2.0, 4.5, 5.3, 6.9)
RACES = 100


def raced(number: int) -> tuple[Race, dict[int, list[float]]]:
    """A race among the five designs, and what it saw of each."""
    race = Race(len(MEANS), False, 0.95, 1e-9)
    return race, run_race(race, lambda i, seed: MEANS[i] + sqrt(VARIANCES[i]) * normal(*draw(number, f"design {i}", seed, 2)))


def test_a_race_finds_the_published_best_of_five_designs_with_fewer_runs_than_equal_shares_need() -> None:
    races = [raced(number) for number in range(RACES)]
    assert sum(0 in race.out for race, _ in races) <= stats.binom.ppf(0.999, RACES, 0.05)  # as sure as it says
    assert sum(race.best == 0 for race, _ in races) >= stats.binom.ppf(0.001, RACES, 0.95)
    spent = [fmean(len(seen[i]) for _, seen in races) for i in range(len(MEANS))]
    equal = fmean(len(MEANS) * max(map(len, seen.values())) for _, seen in races)  # if none left the race before its end
    assert spent == sorted(spent, reverse=True)
    assert sum(spent) < 0.6 * equal
