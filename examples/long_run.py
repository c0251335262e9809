"""What does traffic cost in the long run? The rate that the parts of a harvest allow without it,
beside that of the discrete-event model.

python examples/long_run.py [--random N] [--against ROWS] [ROWS/PICKERS/CARRIERS ...]
"""

import argparse
from collections.abc import Iterator
from itertools import product
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
ROUTES, POLICIES = ["one-way", "two-way"], ["nearest", "farthest-first", "predictive"]


def in_cell(cell: str) -> Iterator[Scenario]:
    """The orchards of a cell of the table: two picking speeds, both routes, three policies."""
    rows, pickers, carriers = map(int, cell.split("/"))
    for speed, route, dispatch in product((1.0, 0.03), ROUTES, POLICIES):
        yield orchard(
            rows=rows,
            pickers=pickers,
            carriers=carriers,
            picking_speed=speed,
            route=route,
            dispatch=dispatch,
        )


def drawn(number: int) -> Iterator[Scenario]:
    """Some orchards drawn at random: the same ones each time.

    Those that are no valid scenario are left out.
    """
    random = Random(1)
    while number:
        pickers = random.choice((2, 3, 4, 5, 6, 8, 10, 13, 15, 20))
        values = {
            "pickers": pickers,
            "rows": random.choice(
                (pickers, 2 * pickers, 3 * pickers, pickers + random.randint(0, pickers))
            ),
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
    """An orchard without people, animals, weeds and a tractor."""
    return Scenario(**values | NO_OBSTACLES)  # type: ignore[arg-type]


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
arguments = parser.parse_args()
orchards = (
    list(drawn(arguments.random))
    if arguments.random
    else [one for cell in arguments.cells for one in in_cell(cell)]
)
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
losses: dict[str, list[float]] = {}
off: list[float] = []
for one in track(orchards, console=Console(stderr=True), transient=True):
    layout = lay_out(one)
    bounds = Bounds(layout)
    what = [
        f"{one.rows}/{one.pickers}/{one.carriers}",
        f"{one.mean_picking_speed:g}",
        f"{one.row_length:g}",
        one.route,
        one.dispatch,
    ]
    what += [f"{bounds.bins_per_hour:.2f}", bounds.bottleneck]
    try:
        rate = long_run(layout).bins_per_hour
        off += (
            [100.0 * (rate / long_run(layout, arguments.against).bins_per_hour - 1.0)]
            if arguments.against
            else []
        )
    except Jam:
        table.add_row(*what, "none", "leaves a picker out")
        continue
    lost = 100.0 * (1.0 - rate / bounds.bins_per_hour)
    losses.setdefault(one.dispatch, []).append(lost)
    table.add_row(*what, f"{rate:.2f}", f"{lost:+.1f}")
console = Console(width=150)
console.print(table)
if off:
    console.print(
        f"against {arguments.against} rows each: {fmean(map(abs, off)):.1f} % on average,"
        f" {max(map(abs, off)):.1f} % at most"
    )
for policy, some in losses.items():
    console.print(f"{policy}: median {median(some):.1f} %, largest {max(some):.1f} %")
