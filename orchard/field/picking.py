"""How work varies: the speed at which each picker picks each row, when a robot fails, and how long
its repair takes. All of it is drawn by the seed.

The time to pick a row has two parts: the time to drive along it at top speed, which is certain, and
the rest, which is drawn. So no row is picked faster than a picker can drive, and mean and deviation
of the whole time are exactly those that the scenario names. Pickers differ in the same way: a mean
is drawn for each picker, and its rows are drawn about that mean. So are bins, about the time of
their row.
"""

import math
from collections.abc import Callable, Iterator
from itertools import count

from orchard.field.repeatable import draw, exp, exponential, log, normal
from orchard.field.scenario import Scenario, Spread

# With a robot's name behind it, the name under which its failures are drawn (`repeatable.draw`).
# `orchard/event_model` draws the same.
FAILING = "failure of "
# When a picker is away: begin and end of each absence, s since the harvest began.
Absences = tuple[tuple[float, float], ...]
# An endless supply of pairs of random numbers, uniform in [0, 1).
Chances = Iterator[list[float]]


def picking_speed_of(scenario: Scenario, row: int, picker: str) -> float:
    """Return the speed at which a row is picked from end to end by its picker, m/s."""
    mean = picker_speed_of(scenario, picker)
    return _slowed(scenario, scenario.picking.spread, f"row {row}", mean)


def picker_speed_of(scenario: Scenario, picker: str) -> float:
    """Return the mean speed at which a picker picks its rows, m/s."""
    mean = scenario.mean_picking_speed * scenario.picker_rates.get(picker, 1.0)
    return _slowed(scenario, scenario.picking.spread_of_pickers, picker, mean)


def bin_speed_of(scenario: Scenario, picker: str, number: int, of_row: float) -> float:
    """Return the speed at which a picker picks while it fills a bin, m/s.

    `number`: which of its bins, from 1. `of_row`: the speed at which the row is picked, m/s.
    """
    return _slowed(scenario, scenario.picking.spread_of_bins, f"bin {number} of {picker}", of_row)


def absences_of(scenario: Scenario, robot: str) -> Absences:
    """Return when a robot is away, s since the harvest began."""
    absences = scenario.picker_absences.get(robot, ())
    return tuple((3600.0 * begin, 3600.0 * end) for begin, end in absences)


def _slowed(scenario: Scenario, spread: Spread, what: str, mean: float) -> float:
    """Return the speed of a row, a picker or a bin, m/s, drawn by the seed about a mean.

    `what`: the name under which it is drawn, such as "row 3". `mean`: m/s. The spread is that of a
    picker of mean speed, also for a picker that is faster or slower.
    """
    if spread.distribution == "none":
        return mean
    usual = scenario.mean_picking_speed
    most = scenario.top_picking_speed
    # Endless, because a distribution takes as many pairs as it needs, and that depends on what it
    # draws.
    chances = (draw(scenario.seed, f"picking of {what}", number, 2) for number in count())
    # Time for a metre is 1/most + (1/mean - 1/most) * share. Only the second part is drawn, so its
    # deviation is greater, as a share of its mean, than that of the whole time.
    cv_of_drawn_part = spread.cv * most / (most - usual)
    share = _SHARES[spread.distribution](cv_of_drawn_part, chances)
    return most * mean / (mean + (most - mean) * share)


def failure(
    seed: int, robot: str, number: int, mean_between: float, mean_repair: float
) -> tuple[float, float]:
    """Return for how long a robot works until it fails, and how long its repair takes, s.

    Both are exponential. `number`: which failure of this robot, from 0. The first time counts from
    the start or from the repair before, and only while the robot works. `mean_between`,
    `mean_repair`: s.
    """
    until, repair = draw(seed, FAILING + robot, number, 2)
    return exponential(until, mean_between), exponential(repair, mean_repair)


# -- shares of the mean: random numbers with mean 1 and standard deviation `cv`


def _lognormal(cv: float, chances: Chances) -> float:
    """Return a share whose logarithm is normal.

    The logarithm has the mean -variance / 2, with which the share has the mean 1.
    """
    variance = log(1.0 + cv * cv)
    return exp(math.sqrt(variance) * normal(*next(chances)) - variance / 2.0)


def _gamma(cv: float, chances: Chances) -> float:
    """Return a share that is gamma distributed, for shapes of 1 and more: for a cv of at most 1.

    By the method of Marsaglia and Tsang, whose names d, x and u it keeps: A simple method for
    generating gamma variables, ACM TOMS 26 (2000). It draws x until one is accepted.
    """
    shape = 1.0 / (cv * cv)
    d = shape - 1.0 / 3.0
    while True:
        x = normal(*next(chances))
        u, _ = next(chances)
        cube = (1.0 + x / math.sqrt(9.0 * d)) ** 3
        # 1 - u, because u may be 0, which has no logarithm.
        if cube > 0.0 and log(1.0 - u) < 0.5 * x * x + d * (1.0 - cube + log(cube)):
            return d * cube / shape


def _uniform(cv: float, chances: Chances) -> float:
    """Return a share that is uniform about 1.

    A uniform number with standard deviation `cv` lies within sqrt(3) times that of its mean.
    """
    u, _ = next(chances)
    # Rounding must not make it negative where cv is 1 / sqrt(3).
    return max(0.0, 1.0 + math.sqrt(3.0) * cv * (2.0 * u - 1.0))


_SHARES: dict[str, Callable[[float, Chances], float]] = {
    "lognormal": _lognormal,
    "gamma": _gamma,
    "uniform": _uniform,
}
