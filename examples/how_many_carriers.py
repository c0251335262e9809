"""How many carriers are useful for ten pickers in ten rows, at the manual's picking speed and at a person's?

Harvests the same orchard with more and more carriers, in local mode, and compares each result with two ideals: the schedule without
traffic, and the long-run rate of the built-in policy. With the number of carriers that is called enough, the schedule is within 1 % of
the shortest one.

    python examples/how_many_carriers.py [--rows 10] [--pickers 10] [--speeds 1.0 0.03]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import track
from rich.table import Table

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Animals, People, Scenario, check
from orchard.local import Local
from orchard.report.metrics import HarvestFigures, harvest_figures
from orchard.report.schedule import WORTH, Schedule

CARRIERS = (1, 2, 3, 4, 6, 8, 10, 14, 20)  # tried; never more than there are bins, one for each row
NO_OBSTACLES = {
    "people": People(workers=0, visitors=0),
    "animals": Animals(dogs=0, cats=0),
    "weeds": 0,
}  # for equal conditions


def harvest(scenario: Scenario) -> dict:
    """Return the figures of one whole harvest, and the number of carriers that is enough for it ("enough")."""
    local, figures = Local(scenario), HarvestFigures()
    while not local.engine.over:
        events = local.tick()
        figures.update(local.engine.world, events, local.engine.answers)
    return harvest_figures(local.engine.world, figures) | {"enough": Schedule(local.engine.layout).enough_carriers}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=10)
    parser.add_argument("--pickers", type=int, default=10)
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 0.03], help="picking speeds, m/s")
    arguments = parser.parse_args()
    try:
        scenarios = [scenario_of(arguments, carriers, speed) for speed in arguments.speeds for carriers in CARRIERS]
    except ScenarioError as error:
        parser.exit(2, f"{error}\n")
    scenarios = [scenario for scenario in scenarios if scenario.carrier_count <= scenario.rows]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        results = list(track(pool.map(harvest, scenarios), total=len(scenarios), description="harvesting"))
    Console().print(table_of(scenarios, results), *conclusions(scenarios, results), sep="\n", highlight=False)


def scenario_of(arguments: argparse.Namespace, carriers: int, speed: float) -> Scenario:
    """Return one of the orchards to compare. Raises ScenarioError."""
    values = {"rows": arguments.rows, "pickers": arguments.pickers, "carriers": carriers, "picking_speed": speed}
    return check(values | NO_OBSTACLES, "the command line")


def conclusions(scenarios: list[Scenario], results: list[dict]) -> list[str]:
    """Return for each picking speed how many carriers are worth it."""
    times: dict[float, dict[int, float]] = {}
    for scenario, result in zip(scenarios, results, strict=True):
        times.setdefault(scenario.picking_speed, {})[scenario.carrier_count] = result["sim_seconds"]
    return [f"At {speed:g} m/s {_worth(by_carriers)}" for speed, by_carriers in times.items()]


def _worth(by_carriers: dict[int, float]) -> str:
    best, most = min(by_carriers.values()), max(by_carriers)
    enough = min(carriers for carriers, seconds in by_carriers.items() if seconds * (1.0 - WORTH) <= best)
    more = f"fewer take over {100 * WORTH:g} % longer" if enough == most else f"more, up to {most}, save at most {100 * WORTH:g} %"
    return f"{enough} carriers harvest in {by_carriers[enough]:.0f} s; {more}."


def table_of(scenarios: list[Scenario], results: list[dict]) -> Table:
    """Return a table with one line for each harvest."""
    table = Table("m/s", "carriers", "harvest, s", "schedule, s", "bins/h", "long run", "bottleneck", "enough", "wait, s", "busy")
    for scenario, result in zip(scenarios, results, strict=True):
        table.add_row(
            f"{scenario.picking_speed:g}",
            str(scenario.carriers),
            f"{result['sim_seconds']:.0f}",
            f"{result['schedule_sim_seconds']:.0f}",
            f"{result['bins_per_hour']:.1f}",
            f"{result['long_run_bins_per_hour']:.1f}",
            result["bottleneck"],
            str(result["enough"]),
            f"{result['picker_waiting_seconds']:.0f}",
            f"{100 * result['carrier_utilisation']:.0f} %",
        )
    table.box, table.padding, table.show_edge = SIMPLE_HEAD, 0, False  # for 80 columns
    for column in table.columns:
        column.no_wrap = " " not in str(column.header)
    return table


if __name__ == "__main__":
    main()
