"""How fast the environments are in which a policy learns: `python -m bench.learning`.

It takes about two minutes, and writes nothing.

Steps and resets are timed in processor time (see timing.py): the median of five measurements, and
the best of them, because the machine may have other work.
"""

import time
from collections.abc import Callable, Iterator
from statistics import median
from typing import Any

import numpy as np

from orchard.field.scenario import Scenario
from orchard.gym import dispatch_env, single_env

STEPS, RESETS, REPEATS = 1000, 10, 5
ROBOT = "carrier_01"


def timed(work: Callable[[], object], count: int) -> list[float]:
    """Return the seconds of processor time of one of `count` units of work, for each of REPEATS
    measurements.
    """
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        times.append((time.process_time() - begun) / count)
    return times


def harvest(choose: Callable[[dict[str, Any]], np.ndarray]) -> list[float]:
    """Return the seconds of a step in the default orchard, in which one carrier learns.

    `choose`: info -> action.
    """
    env = single_env(Scenario(), ROBOT, reward="goal")
    info = env.reset()[1]

    def steps() -> None:
        nonlocal info
        for _ in range(STEPS):
            *_, terminated, truncated, info = env.step(choose(info))
            if terminated or truncated:
                info = env.reset()[1]

    steps()  # loads the compiled kernels
    return timed(steps, STEPS)


def resets(rows: int, pickers: int) -> list[float]:
    """Return the seconds of a reset to a new seed."""
    env, seeds = single_env(Scenario(rows=rows, pickers=pickers), ROBOT), iter(range(2, 1000))

    def some() -> None:
        for _ in range(RESETS):
            env.reset(seed=next(seeds))

    some()
    return timed(some, RESETS)


def dispatch() -> list[float]:
    """Return the seconds of a whole harvest of the default orchard in which dispatch learns."""
    env = dispatch_env(Scenario())

    def episode() -> None:
        info, ended = env.reset(seed=1)[1], False
        while not ended:
            *_, terminated, truncated, info = env.step(info["scripted"])
            ended = terminated or truncated

    return timed(episode, 1)


def lines() -> Iterator[str]:
    """Return the measurements, one in a line."""
    random = np.random.default_rng(1)
    policies = {
        "its agent's velocity": lambda info: info["scripted"],
        "standing": lambda info: np.zeros(2),
        "random velocities": lambda info: random.uniform((-1.0, -0.39), (1.0, 0.39)),
    }
    for name, choose in policies.items():
        times = harvest(choose)
        yield (
            f"one carrier learns, {name}: {1 / median(times):,.0f} steps/s (best"
            f" {1 / min(times):,.0f})"
        )
    for rows, pickers in ((3, 2), (5, 2), (20, 2), (20, 10), (20, 20)):
        times = resets(rows, pickers)
        yield (
            f"reset, {rows} rows, {pickers} pickers: {1e3 * median(times):.1f} ms (best"
            f" {1e3 * min(times):.1f})"
        )
    times = dispatch()
    yield f"dispatch, a whole harvest: {1e3 * median(times):.0f} ms (best {1e3 * min(times):.0f})"


if __name__ == "__main__":
    for line in lines():
        print(line, flush=True)
