"""Work as it is: how fast each picker is, and each row is picked; when a robot fails and for how
long. All of it is drawn by the seed.

Of a row's picking time, the time to drive along it at top speed is sure, and the rest is drawn. So
no row is picked faster than a picker can drive, and mean and deviation of the whole time are
exactly those that the scenario names. Pickers differ in the same way: each has a mean of its own,
about which its rows are drawn.
"""

import math
from collections.abc import Callable, Iterator
from itertools import count

from orchard.field.repeatable import draw, exp, exponential, log, normal
from orchard.field.scenario import Scenario, Spread

# What is drawn for a robot: this, and its name.
FAILING = "failure of "
# When somebody is away: begins and ends, s since the harvest began.
Absences = tuple[tuple[float, float], ...]
# Pairs of random numbers, uniform in [0, 1).
Chances = Iterator[list[float]]


def picking_speed_of(scenario: Scenario, row: int, picker: str) -> float:
    """Return the speed at which a row is picked from end to end by its picker, m/s."""
    mean = picker_speed_of(scenario, picker)
    return _slowed(scenario, scenario.picking.spread, f"row {row}", mean)


def picker_speed_of(scenario: Scenario, picker: str) -> float:
    """Return the mean speed at which a picker picks its rows, m/s."""
    mean = scenario.mean_picking_speed * scenario.picker_rates.get(picker, 1.0)
    return _slowed(scenario, scenario.picking.spread_of_pickers, picker, mean)


def absences_of(scenario: Scenario, robot: str) -> Absences:
    """Return when a robot is away, s since the harvest began."""
    absences = scenario.picker_absences.get(robot, ())
    return tuple((3600.0 * begin, 3600.0 * end) for begin, end in absences)


def _slowed(scenario: Scenario, spread: Spread, what: str, mean: float) -> float:
    """Return the speed of a row or of a picker, m/s, drawn by the seed about a mean.

    The spread is that of an usual picker, also for one that has another mean.
    """
    if spread.distribution == "none":
        return mean
    usual = scenario.mean_picking_speed
    most = scenario.top_picking_speed
    # Some distributions take more than one pair, and none knows before how many.
    chances = (draw(scenario.seed, f"picking of {what}", number, 2) for number in count())
    share = _SHARES[spread.distribution](spread.cv * most / (most - usual), chances)
    return most * mean / (mean + (most - mean) * share)


def failure(
    seed: int, robot: str, number: int, mean_between: float, mean_repair: float
) -> tuple[float, float]:
    """Return when a robot fails, and how long its repair takes, s. Both are exponential.

    `number`: which failure of this robot, from 0. The first time is that of its work since it
    started or was repaired.
    """
    until, repair = draw(seed, FAILING + robot, number, 2)
    return exponential(until, mean_between), exponential(repair, mean_repair)


# -- shares of the mean: random numbers with mean 1 and deviation `cv`


def _lognormal(cv: float, chances: Chances) -> float:
    """Return a share whose logarithm is normal, about such a mean that its own mean is 1."""
    variance = log(1.0 + cv * cv)
    return exp(math.sqrt(variance) * normal(*next(chances)) - variance / 2.0)


def _gamma(cv: float, chances: Chances) -> float:
    """Return a share by the method of Marsaglia and Tsang, for shapes of 1 and more.

    A simple method for generating gamma variables, ACM TOMS 26 (2000).
    """
    shape = 1.0 / (cv * cv)
    d = shape - 1.0 / 3.0
    while True:
        x = normal(*next(chances))
        w, _ = next(chances)
        cube = (1.0 + x / math.sqrt(9.0 * d)) ** 3
        if cube > 0.0 and log(1.0 - w) < 0.5 * x * x + d * (1.0 - cube + log(cube)):
            return d * cube / shape


def _uniform(cv: float, chances: Chances) -> float:
    """Return a share that is as far from 1 as sqrt(3) times its deviation, at most."""
    return max(0.0, 1.0 + math.sqrt(3.0) * cv * (2.0 * next(chances)[0] - 1.0))


_SHARES: dict[str, Callable[[float, Chances], float]] = {
    "lognormal": _lognormal,
    "gamma": _gamma,
    "uniform": _uniform,
}
