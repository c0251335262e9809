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

WHITE, SLOW = (0.0, 0.01, 0.02, 0.05, MOST_WHITE), (0.0, 0.01, 0.02, MOST_BIAS)  # m
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
    figures, found = RunFigures(local.engine, time.monotonic), Counter[str]()
    while not local.engine.over and local.engine.tick < LONGEST and not figures.jam:
        events = local.tick()
        figures.update(events)
        found.update(event.what for event in events if event.who.startswith(VEHICLES))
    assert not local.engine.violations()
    return Outcome(
        local.engine.over, local.engine.tick * TIME_STEP, found["collision"], found["deed refused"]
    )


def line(white: float, bias: float, outcomes: list[Outcome]) -> str:
    """Return a line of the table. The time is that of the harvests that finished."""
    done = [outcome.seconds for outcome in outcomes if outcome.finished]
    took = f"{mean(done):.0f}" if done else "-"
    collisions, refused = (sum(values) for values in list(zip(*outcomes, strict=True))[2:])
    return (
        f"| {100 * white:g} | {100 * bias:g} | {len(done)} of {len(outcomes)} | {took} |"
        f" {collisions} | {refused} |"
    )


def main() -> None:
    """Print a table of harvests with growing errors of positions."""
    cells = [(white, bias) for white, bias in product(WHITE, SLOW)]
    print(
        "| white, cm | slow, cm | finished | mean time, s | collisions | couplings refused |",
        "| --- |" + " --- |" * 5,
        sep="\n",
    )
    with ProcessPoolExecutor(2) as pool:
        runs = {
            cell: [pool.submit(harvest, *cell, run) for run in range(len(RUNS))] for cell in cells
        }
        for cell, futures in runs.items():
            print(line(*cell, [future.result() for future in futures]), flush=True)


if __name__ == "__main__":
    main()
