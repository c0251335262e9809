"""How fast the environments are in which a policy learns: `python -m bench.learning`.

It takes about three minutes, and writes nothing. With `--many` it measures only dispatch in many
orchards at once, and what stands beside it, and writes both into bench/results.md. Beside it stand
rware, the Multi-Robot Warehouse, and RobotWarehouse of Jumanji, each measured in an environment of
its own, if it can be installed.

Steps and resets are timed in processor time (see timing.py): the median of five measurements, and
the best of them, because the machine may have other work.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from statistics import median
from typing import Any

import numpy as np

from bench.learning_report import FIGURES, with_learning
from bench.peer_simulators import JUMANJI, LEARNING_PACKAGES, RWARE, agent_steps
from orchard.field.scenario import Scenario
from orchard.gym import dispatch_env, dispatch_vec_env, single_env

# Steps, and resets, of a measurement; measurements of a figure.
STEPS = 1000
RESETS = 10
REPEATS = 5
ROBOT = "carrier_01"
# Orchards that are stepped at once, and steps of all of them in a measurement.
ORCHARDS = 64
VECTOR_STEPS = 100
# Rows, pickers and carriers.
SIZES = ((8, 4, 4), (20, 10, 10))
# Environments of rware, with 2, 4 and 8 robots.
WAREHOUSES = ("rware-tiny-2ag-v2", "rware-small-4ag-v2", "rware-medium-8ag-v2")
# Warehouses of Jumanji at once: as many as orchards, and more.
AT_ONCE = (ORCHARDS, 1024)
JUMANJI_STEPS = 50


def timed(work: Callable[[], object], units: int) -> list[float]:
    """Return the seconds of processor time of a unit of work, for each of REPEATS measurements.

    `work`: does so many `units` of it.
    """
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        times.append((time.process_time() - begun) / units)
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
    env = single_env(Scenario(rows=rows, pickers=pickers), ROBOT)
    seeds = count(1)

    def reset_often() -> None:
        for _ in range(RESETS):
            env.reset(seed=next(seeds))

    # The first ones load the compiled kernels.
    reset_often()
    return timed(reset_often, RESETS)


def dispatch() -> list[float]:
    """Return the seconds of a whole harvest of the default orchard in which dispatch learns."""
    env = dispatch_env(Scenario())

    def episode() -> None:
        info = env.reset(seed=1)[1]
        has_ended = False
        while not has_ended:
            # What the scenario's policy would do.
            *_, terminated, truncated, info = env.step(info["scripted"])
            has_ended = terminated or truncated

    return timed(episode, 1)


def decisions(scenario: Scenario) -> list[float]:
    """Return the seconds of a decision in one orchard, with random actions that can be."""
    env = dispatch_env(scenario)
    random = np.random.default_rng(1)
    env.reset(seed=1)
    times = []
    for seed in range(1, 1 + REPEATS):
        begun = time.process_time()
        info = env.reset(seed=seed)[1]
        decided = 0
        has_ended = False
        while not has_ended:
            action = random.choice(np.flatnonzero(info["action_mask"]))
            *_, terminated, truncated, info = env.step(action)
            has_ended = terminated or truncated
            decided += 1
        times.append((time.process_time() - begun) / decided)
    return times


def decisions_of_many(scenario: Scenario, may_wait: bool) -> list[float]:
    """Return the seconds of a decision in ORCHARDS at once, resets included, with random actions.

    `may_wait`: whether 0, which sends no carrier, is one of them. Steps that begin an episode are
    no decisions.
    """
    envs = dispatch_vec_env(scenario, ORCHARDS)
    random = np.random.default_rng(1)
    infos = envs.reset(seed=1)[1]
    times = []
    # The first one loads the compiled code.
    for _ in range(1 + REPEATS):
        spent = 0.0
        decided = 0
        begin_anew = 0
        for _ in range(VECTOR_STEPS):
            # Of the actions that can be, the one with the greatest random number; 0, which always
            # can be, has the least one unless an orchard may wait.
            chances = random.random(infos["action_mask"].shape) + 1e-9
            if not may_wait:
                chances[:, 0] = 1e-12
            actions = (infos["action_mask"] * chances).argmax(axis=1)
            begun = time.process_time()
            *_, terminated, truncated, infos = envs.step(actions)
            spent += time.process_time() - begun
            decided += ORCHARDS - begin_anew
            begin_anew = int((terminated | truncated).sum())
        times.append(spent / decided)
    return times[1:]


def dispatch_lines() -> Iterator[str]:
    """Yield the rates of dispatch in one orchard and in many, and those of its peers, in lines."""
    for rows, pickers, carriers in SIZES:
        scenario = Scenario(rows=rows, pickers=pickers, carriers=carriers)
        size = f"{rows} rows, {pickers} pickers, {carriers} carriers"
        yield f"dispatch_env, {size}: {rates(decisions(scenario))} decisions/s"
    for name, figures in many().items():
        yield f"{name}: {figures if isinstance(figures, str) else rates(figures)}"


def many() -> dict[str, list[float] | str]:
    """Return the seconds of a step of what steps many robots at once, by name, or why it was not
    measured.

    A step is a decision, or an action of one agent of a warehouse.
    """
    measured: dict[str, list[float] | str] = {}
    for rows, pickers, carriers in SIZES:
        scenario = Scenario(rows=rows, pickers=pickers, carriers=carriers)
        for may_wait in (True, False):
            how = "any action" if may_wait else "sends at once"
            name = f"`dispatch_vec_env`, {ORCHARDS} of {rows}/{pickers}/{carriers}, {how}"
            measured[name] = decisions_of_many(scenario, may_wait)
    for name in WAREHOUSES:
        measured[f"{_title(RWARE)}, `{name}`"] = _peer(RWARE, name, str(STEPS))
    for warehouses in AT_ONCE:
        name = f"{_title(JUMANJI)}, {warehouses} of `RobotWarehouse-v0`"
        measured[name] = _peer(JUMANJI, str(warehouses), str(JUMANJI_STEPS))
    return measured


def _title(peer: str) -> str:
    return LEARNING_PACKAGES[peer].replace("==", " ")


def _peer(name: str, *words: str) -> list[float] | str:
    """Return the seconds of an agent's step, or why it was not measured."""
    try:
        return [1.0 / rate for rate in agent_steps(name, *words)]
    except RuntimeError as error:
        return f"not measured: {error}"


def write_many() -> None:
    """Measure `many`, and write it into bench/results.md."""
    before = os.getloadavg()[0]
    measured = {}
    for name, figures in many().items():
        measured[name] = figures
        print(name, figures if isinstance(figures, str) else rates(figures), flush=True)
    load = [before, os.getloadavg()[0]]
    FIGURES.write_text(json.dumps({"load": load, "seconds": measured}, indent=1) + "\n")
    results = FIGURES.with_name("results.md")
    results.write_text(with_learning(results.read_text()))


def rates(times: list[float]) -> str:
    """Return how many a second of processor time, from the seconds of one: median and best."""
    return f"{1 / median(times):,.0f} (best {1 / min(times):,.0f})"


def lines() -> Iterator[str]:
    """Yield the measurements, one in a line."""
    random = np.random.default_rng(1)
    policies = {
        "its agent's velocity": lambda info: info["scripted"],
        "standing": lambda info: np.zeros(2),
        # Up to its limits, 1 m/s and pi / 8 rad/s.
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
    yield from dispatch_lines()


if __name__ == "__main__":
    if sys.argv[1:] == ["--many"]:
        write_many()
        sys.exit()
    for line in lines():
        print(line, flush=True)
