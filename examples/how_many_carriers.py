"""How many carriers are useful for ten pickers in ten rows, at the manual's picking speed and at a person's?

Harvests the same orchard with more and more carriers, in local mode, and compares each result with the theoretical bound. Beyond the
number of carriers that the closed forms call enough, a further carrier gains nothing.

    python examples/how_many_carriers.py [--rows 10] [--pickers 10] [--speeds 1.0 0.03]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from rich.console import Console
from rich.progress import track
from rich.table import Table

from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local
from orchard.report.bounds import Bounds
from orchard.report.metrics import HarvestFigures, harvest_figures

CARRIERS = (1, 2, 3, 4, 6, 8, 10, 14, 20)
NO_OBSTACLES = {
    "people": People(workers=0, visitors=0),
    "animals": Animals(dogs=0, cats=0),
    "weeds": 0,
}  # for equal conditions


def harvest(scenario: Scenario) -> dict:
    """Return the figures of one whole harvest, its bounds, and the number of carriers that is enough ("enough")."""
    local, figures = Local(scenario), HarvestFigures()
    while not local.engine.over:
        events = local.tick()
        figures.update(local.engine.world, events, local.actions)
    return harvest_figures(local.engine.world, figures) | {"enough": Bounds(local.engine.layout).enough_carriers}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=10)
    parser.add_argument("--pickers", type=int, default=10)
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 0.03], help="picking speeds, m/s")
    arguments = parser.parse_args()
    scenarios = [
        Scenario(rows=arguments.rows, pickers=arguments.pickers, carriers=carriers, picking_speed=speed, **NO_OBSTACLES)
        for speed in arguments.speeds
        for carriers in CARRIERS
    ]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        results = list(track(pool.map(harvest, scenarios), total=len(scenarios), description="harvesting"))
    Console().print(table_of(scenarios, results))


def table_of(scenarios: list[Scenario], results: list[dict]) -> Table:
    """Return a table with one line for each harvest."""
    table = Table("picking, m/s", "carriers", "harvest, s", "at least, s", "bins/h", "bound", "bottleneck", "enough", "wait, s", "busy")
    for scenario, result in zip(scenarios, results, strict=True):
        table.add_row(
            f"{scenario.picking_speed:g}",
            str(scenario.carriers),
            f"{result['sim_seconds']:.0f}",
            f"{result['bound_sim_seconds']:.0f}",
            f"{result['bins_per_hour']:.1f}",
            f"{result['bound_bins_per_hour']:.1f}",
            result["bottleneck"],
            f"{result['enough']:.1f}",
            f"{result['picker_waiting_seconds']:.0f}",
            f"{100 * result['carrier_utilisation']:.0f} %",
        )
    return table


if __name__ == "__main__":
    main()
