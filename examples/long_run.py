"""What does traffic cost in the long run? The rate that the parts of a harvest allow without it,
beside that of the event model.

    python examples/long_run.py [--random N] [--against ROWS] [ROWS/PICKERS/CARRIERS ...]
"""

import argparse
from collections.abc import Iterator
from itertools import chain, product
from random import Random
from statistics import fmean, median

from rich.console import Console
from rich.progress import track
from rich.table import Table

from orchard import Scenario, ScenarioError
from orchard.discrete.harvest import Jam
from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds
from orchard.report.long_run import long_run

NO_OBSTACLES = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}
CELLS = ["20/10/4", "20/10/10", "20/10/20", "10/10/10", "20/20/20", "10/5/5"]
ROUTES = ["one-way", "two-way"]
POLICIES = ["nearest", "farthest-first", "predictive"]
SPEEDS = (1.0, 0.03)  # m/s, of picking: a fast robot, and people


def in_cell(cell: str) -> Iterator[Scenario]:
    """Yield the orchards of a cell, ROWS/PICKERS/CARRIERS: all speeds, routes and policies."""
    rows, pickers, carriers = map(int, cell.split("/"))
    for speed, route, dispatch in product(SPEEDS, ROUTES, POLICIES):
        yield orchard(
            rows=rows,
            pickers=pickers,
            carriers=carriers,
            picking_speed=speed,
            route=route,
            dispatch=dispatch,
        )


def drawn(number: int) -> Iterator[Scenario]:
    """Yield so many orchards drawn at random, the same each time.

    Those that are no valid scenario are left out.
    """
    random = Random(1)
    while number:
        pickers = random.choice((2, 3, 4, 5, 6, 8, 10, 13, 15, 20))
        uneven = pickers + random.randint(0, pickers)
        values = {
            "pickers": pickers,
            "rows": random.choice((pickers, 2 * pickers, 3 * pickers, uneven)),
            "carriers": max(1, round(pickers * random.choice((0.3, 0.5, 0.8, 1.0, 1.5, 2.0)))),
            "picking_speed": random.choice((1.0, 0.6, 0.3, 0.1, 0.03)),
            "row_length": random.choice((30.0, 50.0, 70.0, 100.0, 150.0)),
            "route": random.choice(ROUTES),
            "dispatch": random.choice([*POLICIES, "longest-waiting"]),
        }
        try:
            yield orchard(**values)
        except ScenarioError:
            continue
        number -= 1


def orchard(**values: object) -> Scenario:
    """Return an orchard without people, animals, weeds and a tractor."""
    return Scenario(**values | NO_OBSTACLES)  # type: ignore[arg-type]


def arguments_of_command() -> argparse.Namespace:
    """Return what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--random",
        type=int,
        default=0,
        metavar="N",
        help="N orchards drawn at random in place of the cells",
    )
    parser.add_argument(
        "--against",
        type=int,
        default=0,
        metavar="ROWS",
        help="also measure far longer ones, of so many rows of each picker",
    )
    parser.add_argument("cells", nargs="*", default=CELLS, metavar="ROWS/PICKERS/CARRIERS")
    return parser.parse_args()


def orchards_of(arguments: argparse.Namespace) -> list[Scenario]:
    """Return the orchards that are measured."""
    if arguments.random:
        return list(drawn(arguments.random))
    return list(chain.from_iterable(in_cell(cell) for cell in arguments.cells))


def main() -> None:
    """Print a line for each orchard, and a summary of each policy."""
    arguments = arguments_of_command()
    table = Table(
        "rows/pickers/carriers",
        "picking, m/s",
        "row, m",
        "route",
        "policy",
        "limit",
        "by",
        "long run",
        "lost to traffic, %",
    )
    # Policy -> what each of its orchards loses, %.
    losses: dict[str, list[float]] = {}
    # How far each long run is from a far longer one, %.
    errors: list[float] = []
    for scenario in track(orchards_of(arguments), console=Console(stderr=True), transient=True):
        layout = lay_out(scenario)
        bounds = Bounds(layout)
        cells = [
            f"{scenario.rows}/{scenario.pickers}/{scenario.carriers}",
            f"{scenario.mean_picking_speed:g}",
            f"{scenario.row_length:g}",
            scenario.route,
            scenario.dispatch,
            f"{bounds.bins_per_hour:.2f}",
            bounds.bottleneck,
        ]
        try:
            rate = long_run(layout).bins_per_hour
            if arguments.against:
                longer_rate = long_run(layout, arguments.against).bins_per_hour
                errors.append(100.0 * (rate / longer_rate - 1.0))
        except Jam:
            table.add_row(*cells, "none", "leaves a picker out")
            continue
        lost = 100.0 * (1.0 - rate / bounds.bins_per_hour)
        losses.setdefault(scenario.dispatch, []).append(lost)
        table.add_row(*cells, f"{rate:.2f}", f"{lost:+.1f}")
    console = Console(width=150)
    console.print(table)
    if errors:
        sizes = [abs(error) for error in errors]
        console.print(
            f"against {arguments.against} rows each: {fmean(sizes):.1f} % on average,"
            f" {max(sizes):.1f} % at most"
        )
    for policy, lost_by_policy in losses.items():
        console.print(
            f"{policy}: median {median(lost_by_policy):.1f} %, largest {max(lost_by_policy):.1f} %"
        )


if __name__ == "__main__":
    main()
