"""Which errors of GNSS our agents still harvest with: `python -m bench.sensors` prints the table of
docs/reference.md in some 20 minutes.

Each line is 4 harvests of 3 rows with people and animals, each with another seed, dispatch policy
and route.
"""

import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from statistics import mean
from typing import NamedTuple

from orchard.field.kinds import VEHICLES
from orchard.field.scenario import MOST_BIAS, MOST_WHITE, TIME_STEP, Scenario, with_changes
from orchard.local import Local
from orchard.server.figures import RunFigures

# Standard deviations of the errors of positions, m: that of each tick, and the slow one.
WHITE = (0.0, 0.01, 0.02, 0.05, MOST_WHITE)
SLOW = (0.0, 0.01, 0.02, MOST_BIAS)
# Route and dispatch policy of each harvest of a line; its seed is its number.
RUNS = (
    ("one-way", "predictive"),
    ("two-way", "nearest"),
    ("one-way", "longest-waiting"),
    ("two-way", "farthest-first"),
)
LONGEST = 20_000  # ticks


class Outcome(NamedTuple):
    """What one harvest came to."""

    finished: bool
    seconds: float
    collisions: int  # that robots began: moves that physics refused
    refused: int  # couplings and other deeds that physics refused


def harvest(white: float, bias: float, run: int) -> Outcome:
    """Run a harvest with these deviations, m, to its end, or until it is jammed."""
    route, dispatch = RUNS[run]
    scenario = Scenario(rows=3, seed=run + 1, route=route, dispatch=dispatch)
    local = Local(
        with_changes(scenario, **{"sensors.gnss.white": white, "sensors.gnss.bias": bias}),
        is_hashed=False,
    )
    figures = RunFigures(local.engine, time.monotonic)
    counts = Counter[str]()
    while not local.engine.over and local.engine.tick < LONGEST and not figures.jam:
        events = local.tick()
        figures.update(events)
        counts.update(event.what for event in events if event.who.startswith(VEHICLES))
    # However wrong the sensors are, what holds in every orchard must hold.
    assert not local.engine.violations()
    return Outcome(
        finished=local.engine.over,
        seconds=local.engine.tick * TIME_STEP,
        collisions=counts["collision"],
        refused=counts["deed refused"],
    )


def line(white: float, bias: float, outcomes: list[Outcome]) -> str:
    """Return a line of the table. The time is that of the harvests that finished."""
    done = [outcome.seconds for outcome in outcomes if outcome.finished]
    took = f"{mean(done):.0f}" if done else "-"
    collisions = sum(outcome.collisions for outcome in outcomes)
    refused = sum(outcome.refused for outcome in outcomes)
    return (
        f"| {100 * white:g} | {100 * bias:g} | {len(done)} of {len(outcomes)} | {took} |"
        f" {collisions} | {refused} |"
    )


def main() -> None:
    """Print a table of harvests with growing errors of positions."""
    cells = list(product(WHITE, SLOW))
    print(
        "| white, cm | slow, cm | finished | mean time, s | collisions | couplings refused |",
        "| --- |" + " --- |" * 5,
        sep="\n",
    )
    with ProcessPoolExecutor(2) as pool:
        # All begin now; the lines are printed in their order, each as soon as it is done.
        runs = {}
        for cell in cells:
            runs[cell] = [pool.submit(harvest, *cell, run) for run in range(len(RUNS))]
        for (white, bias), futures in runs.items():
            outcomes = [future.result() for future in futures]
            print(line(white, bias, outcomes), flush=True)


if __name__ == "__main__":
    main()
