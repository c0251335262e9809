"""Two questions about the runs of a study, as docs/study.md tells of them.

How much of the beginning of a long run must be left out? MSER-5 finds it in the times between the
run's deliveries (White, Cobb and Spratt, "A comparison of five steady-state truncation heuristics
for simulation", 2000): it leaves out as many fives of them as make the standard error of the rest
least. Beside it stands the share that a study leaves out, and how far apart both rates are.

How much of what differs between the seeds of a harvest does its limit without traffic explain? That
share of the variance would go if the limit were the control variate of a mean over seeds.

    python examples/run_statistics.py [--seeds SEEDS] [CELL ...]

A cell is rows/pickers/carriers:route:dispatch:m/s.
"""

import argparse
from collections.abc import Sequence
from statistics import correlation, fmean

import numpy as np
from rich.progress import track

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.report.bounds import schedule_seconds
from orchard.report.long_run import BEGINNING

CELLS = (
    "8/4/2:one-way:rolling:0.3",
    "8/4/4:one-way:rolling:0.3",
    "20/10/4:one-way:rolling:0.3",
    "20/10/10:one-way:rolling:0.3",
    "10/5/4:one-way:rolling:0.2",
    "6/2/1:two-way:rolling:0.3",
    "12/6/3:one-way:nearest:0.3",
    "12/6/5:two-way:predictive:0.05",
)
# Rows that each picker picks in a long run.
ROWS_EACH = 60
# Share of a long run's deliveries that is kept: at its end the first pickers have picked all.
UNTIL_THE_END = 0.85


def orchard(cell: str, seed: int) -> Scenario:
    """Return the quiet orchard of a cell, with rows that are picked at different speeds."""
    size, route, dispatch, speed = cell.split(":")
    rows, pickers, carriers = map(int, size.split("/"))
    return Scenario(
        rows=rows,
        pickers=pickers,
        carriers=carriers,
        route=route,
        dispatch=dispatch,
        picking_speed=float(speed),
        picking={"spread": {"distribution": "lognormal", "cv": 0.28}},
        people={"workers": 0, "visitors": 0},
        animals={"dogs": 0, "cats": 0},
        tractor=False,
        weeds=0,
        seed=seed,
    )


def mser5(times: Sequence[float]) -> int:
    """Return how many times at the beginning MSER-5 leaves out, at most half of them."""
    # The means of five times each; what is left at the end is too little for one.
    fives = np.array(times[: len(times) // 5 * 5]).reshape(-1, 5).mean(axis=1)
    # The square of the standard error of the rest, by the number of fives that are left out.
    errors = [fives[cut:].var() / (len(fives) - cut) for cut in range(len(fives) // 2)]
    return 5 * int(np.argmin(errors))


def warm_up(cell: str, seed: int) -> tuple[float, float]:
    """Return the share of a long run that MSER-5 leaves out, and how far its rate is from the rate
    that a study takes, as a share of that.
    """
    harvest = DiscreteHarvest(lay_out(orchard(cell, seed)), ROWS_EACH).run()
    deliveries = harvest.deliveries[: int(UNTIL_THE_END * len(harvest.deliveries))]
    between = np.diff(deliveries)
    cut = mser5(between)
    rate = 1.0 / between[cut:].mean()
    rate_of_study = 1.0 / between[int(BEGINNING * len(between)) :].mean()
    return cut / len(between), rate / rate_of_study - 1.0


def explained(cell: str, seeds: Sequence[int]) -> float:
    """Return which share of the variance of a harvest's length over seeds its limit explains."""
    lengths = []
    limits = []
    for seed in seeds:
        layout = lay_out(orchard(cell, seed))
        lengths.append(DiscreteHarvest(layout).run().seconds)
        limits.append(schedule_seconds(layout))
    return correlation(limits, lengths) ** 2


def main() -> None:
    """Print both answers for each cell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30, help="of each cell")
    parser.add_argument("cells", nargs="*", default=CELLS, metavar="CELL")
    options = parser.parse_args()
    seeds = range(1, options.seeds + 1)
    for cell in track(options.cells, "cells"):
        runs = [warm_up(cell, seed) for seed in seeds]
        cuts = [cut for cut, _ in runs]
        differences = [difference for _, difference in runs]
        print(
            f"{cell}: MSER-5 leaves out {100.0 * fmean(cuts):.0f} % on average,"
            f" {100.0 * max(cuts):.0f} % at most; its rate is {100.0 * fmean(differences):+.2f} %"
            f" from a study's; the limit explains {100.0 * explained(cell, seeds):.1f} % of the"
            " variance of a harvest"
        )


if __name__ == "__main__":
    main()
