"""Work as it is: the speed at which each row is picked, when a robot fails and for how long, drawn by the seed.

Of a row's picking time, that to drive along it at top speed is sure, and the rest is drawn. So no row is picked faster than a picker
can drive, and mean and deviation of the whole time are exactly those that the scenario names.
"""

import math
from collections.abc import Callable, Iterator

from orchard.field.kinds import KINDS
from orchard.field.repeatable import draw, exp, exponential, log, normal
from orchard.field.scenario import Scenario

Chances = Iterator[list[float]]  # pairs of random numbers, uniform in [0, 1)


def picking_speed_of(scenario: Scenario, row: int) -> float:
    """Return the speed at which a row is picked from end to end, m/s."""
    mean, most, spread = scenario.mean_picking_speed, KINDS["picker"].speed, scenario.picking.spread
    if spread.distribution == "none":
        return mean
    chances = (draw(scenario.seed, f"picking of row {row}", number, 2) for number in range(2**63))
    rest = _SHARES[spread.distribution](spread.cv * most / (most - mean), chances)
    return most * mean / (mean + (most - mean) * rest)


def failure(
    seed: int, robot: str, number: int, mean_between: float, mean_repair: float
) -> tuple[float, float]:
    """Return how long a robot works until it fails for the number-th time, from 0, and how long its repair takes: exponential, s."""
    until, repair = draw(seed, f"failure of {robot}", number, 2)
    return exponential(until, mean_between), exponential(repair, mean_repair)


# -- shares of the mean: random numbers with mean 1 and deviation `cv`


def _lognormal(cv: float, chances: Chances) -> float:
    variance = log(1.0 + cv * cv)
    return exp(math.sqrt(variance) * normal(*next(chances)) - variance / 2.0)


def _gamma(cv: float, chances: Chances) -> float:
    """Marsaglia and Tsang, A simple method for generating gamma variables, ACM TOMS 26 (2000), for shapes of 1 and more."""
    shape = 1.0 / (cv * cv)
    d = shape - 1.0 / 3.0
    while True:
        (u, v), (w, _) = next(chances), next(chances)
        x = normal(u, v)
        cube = (1.0 + x / math.sqrt(9.0 * d)) ** 3
        if cube > 0.0 and log(1.0 - w) < 0.5 * x * x + d * (1.0 - cube + log(cube)):
            return d * cube / shape


def _uniform(cv: float, chances: Chances) -> float:
    return max(0.0, 1.0 + math.sqrt(3.0) * cv * (2.0 * next(chances)[0] - 1.0))


_SHARES: dict[str, Callable[[float, Chances], float]] = {
    "lognormal": _lognormal,
    "gamma": _gamma,
    "uniform": _uniform,
}
