"""How far is the fast model from the simulator? The same harvests in both, as docs/bounds.md shows
them.

    python examples/fast_and_full.py [--people SEEDS] [CELL ...]

A cell is a line of the table: ROWS/PICKERS/CARRIERS:ROUTE:POLICY[:PICKING SPEED[:ROW LENGTH]], in
m/s and m. Without --people each cell is harvested once, without people and animals. With it each is
harvested with the people and animals of the default scenario, with as many seeds as you say: the
table then shows means, and the spread between seeds.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import fmean, stdev

from rich.console import Console
from rich.progress import track
from rich.table import Table

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local
from orchard.report.metrics import HarvestFigures, harvest_figures

NOBODY = {
    "people": People(workers=0, visitors=0),
    "animals": Animals(dogs=0, cats=0),
    "tractor": False,
}
# The policies.
N = "nearest"
F = "farthest-first"
P = "predictive"
L = "longest-waiting"
PF = "predictive-farthest"
# Picking speed, m/s, and row length, m, of a cell that does not say them.
USUAL = ["1.0", "70.0"]
# Parts of a cell that must be there: sizes, route and policy.
NEEDED = 3


def _cells(place: str, *policies: str, rest: str = "") -> list[str]:
    """The cells of one size and route with these policies."""
    return [f"{place}:{policy}{rest}" for policy in policies]


CELLS = [
    *_cells("10/5/5:one-way", N, F, P),
    *_cells("10/5/5:two-way", N, P),
    *_cells("20/5/5:one-way", N, P),
    *_cells("20/10/4:one-way", N, P),
    *_cells("10/10/10:one-way", N, F, P),
    *_cells("10/10/10:two-way", N, F, P, PF),
    *_cells("20/10/10:one-way", N, F, P, L, PF),
    *_cells("20/10/10:two-way", N, F, P, L),
    *_cells("20/10/20:one-way", N, P),
    *_cells("20/20/20:one-way", N, F, P),
    *_cells("20/20/20:two-way", N, F, P),
    *_cells("10/5/3:one-way", N, P, rest=":1.0:40.0"),
    *_cells("10/5/3:two-way", P, rest=":1.0:40.0"),
    *_cells("8/4/4:one-way", N, P, rest=":1.0:120.0"),
    *_cells("8/4/4:two-way", P, rest=":1.0:120.0"),
    *_cells("10/5/2:one-way", N, F, P, rest=":0.03"),
    *_cells("10/5/2:two-way", N, P, rest=":0.03"),
    *_cells("10/5/5:one-way", N, P, rest=":0.03"),
    *_cells("10/5/5:two-way", P, rest=":0.03"),
    *_cells("20/10/10:one-way", P, rest=":0.03"),
]
WITH_PEOPLE = [
    *_cells("10/5/5:one-way", N, P),
    *_cells("10/5/5:two-way", P),
    *_cells("10/10/10:one-way", P),
    *_cells("20/10/10:one-way", P),
    *_cells("20/10/10:two-way", N),
    *_cells("20/10/4:one-way", N),
    *_cells("10/5/2:one-way", P, rest=":0.03"),
]


def scenario_of(cell: str, seed: int = 1, **changes: object) -> Scenario:
    """Return the orchard of a cell. Raises ValueError."""
    parts = cell.split(":")
    left_out = USUAL[len(parts) - NEEDED :]
    size, route, policy, speed, length = (parts + left_out)[:5]
    rows, pickers, carriers = map(int, size.split("/"))
    sizes = {
        "rows": rows,
        "pickers": pickers,
        "carriers": carriers,
        "picking_speed": float(speed),
        "row_length": float(length),
    }
    return Scenario.model_validate(
        sizes | {"route": route, "dispatch": policy, "seed": seed, "weeds": 0} | changes
    )


def full(scenario: Scenario) -> dict[str, float]:
    """Return the figures of a harvest in the simulator.

    `seconds`: its length. `wait`: mean wait of a picker for an empty bin, s. `busy`: the share of
    its time for which a carrier works.
    """
    local = Local(scenario, is_hashed=False)
    figures = HarvestFigures()
    while not local.engine.over and not figures.jammed(local.engine.world):
        events = local.tick()
        figures.update(local.engine.world, events, local.engine.answers)
    summary = harvest_figures(local.engine.world, figures)
    return {
        "seconds": summary["sim_seconds"],
        "wait": summary["picker_waiting_seconds"],
        "busy": summary["carrier_utilisation"],
    }


def fast(scenario: Scenario) -> dict[str, float]:
    """Return the same figures in the fast model, and as `cost` its processor time, s."""
    layout = lay_out(scenario)
    begun = time.process_time()
    harvest = DiscreteHarvest(layout).run()
    cost = time.process_time() - begun
    return {
        "seconds": harvest.seconds,
        "wait": harvest.picker_waiting_seconds(),
        "busy": harvest.carrier_utilisation(),
        "cost": cost,
    }


def both(scenario: Scenario) -> tuple[dict[str, float], dict[str, float]]:
    """Return the figures of a harvest in the fast model and in the simulator."""
    return fast(scenario), full(scenario)


def error(pairs: Sequence[tuple[dict[str, float], dict[str, float]]]) -> float:
    """Return by how much the fast model's mean length of a harvest differs from the simulator's, as
    a share of it.

    `pairs`: the figures of each harvest in the fast model and in the simulator.
    """
    quick_seconds = fmean(quick["seconds"] for quick, _ in pairs)
    slow_seconds = fmean(slow["seconds"] for _, slow in pairs)
    return quick_seconds / slow_seconds - 1.0


def lengths(harvests: Sequence[dict[str, float]]) -> str:
    """Return the mean length of harvests, s, and the spread between them, in words."""
    seconds = [harvest["seconds"] for harvest in harvests]
    words = f"{fmean(seconds):.1f}"
    if len(seconds) > 1:
        words += f" (cv {100.0 * stdev(seconds) / fmean(seconds):.1f} %)"
    return words


def mean_of(name: str, harvests: Sequence[dict[str, float]]) -> float:
    """Return the mean of a figure of some harvests."""
    return fmean(harvest[name] for harvest in harvests)


def main() -> None:
    """Do all harvests in both, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--people",
        type=int,
        default=0,
        metavar="SEEDS",
        help="with people and animals, and so many seeds for each cell",
    )
    parser.add_argument("cells", nargs="*", metavar="CELL")
    arguments = parser.parse_args()
    cells = CELLS
    changes = NOBODY
    seeds = 1
    if arguments.people:
        cells = WITH_PEOPLE
        changes = {}
        seeds = arguments.people
    cells = arguments.cells or cells
    runs = []
    try:
        for cell in cells:
            for seed in range(1, 1 + seeds):
                runs.append(scenario_of(cell, seed, **changes))
    except (ValueError, ScenarioError) as problem:
        parser.exit(2, f"{problem}\n")
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        pairs = list(
            track(
                pool.map(both, runs),
                total=len(runs),
                description="harvesting",
                console=Console(stderr=True),
            )
        )
    table = Table(
        "cell",
        "fast, s",
        "full, s",
        "error, %",
        "picker waits, s",
        "carriers busy, %",
        "processor, s",
    )
    errors = []
    for number, cell in enumerate(cells):
        # The harvests of a cell stand together, one for each seed.
        of_cell = pairs[number * seeds : (number + 1) * seeds]
        errors.append(error(of_cell))
        quick, slow = zip(*of_cell, strict=True)
        table.add_row(
            cell,
            lengths(quick),
            lengths(slow),
            f"{100.0 * errors[-1]:+.2f}",
            f"{mean_of('wait', quick):.0f}, {mean_of('wait', slow):.0f}",
            f"{100.0 * mean_of('busy', quick):.0f}, {100.0 * mean_of('busy', slow):.0f}",
            f"{mean_of('cost', quick):.2f}",
        )
    size = [abs(error_of_cell) for error_of_cell in errors]
    Console(width=140).print(
        table,
        f"{len(cells)} cells: mean error {100.0 * fmean(size):.2f} %, worst"
        f" {100.0 * max(size):.2f} %",
    )


if __name__ == "__main__":
    main()
