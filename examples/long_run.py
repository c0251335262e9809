"""How good is the closed form of the long-run rate? Beside it, the discrete-event model with rows that are picked again and again.

python examples/long_run.py [--rounds 20] [ROWS/PICKERS/CARRIERS ...]
"""

import argparse

from rich.console import Console
from rich.table import Table

from orchard import Scenario
from orchard.discrete.harvest import long_run_bins_per_hour
from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds

NO_OBSTACLES = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0, "tractor": False}
CELLS = ["20/10/4", "20/10/10", "20/10/20", "10/10/10", "20/20/20", "10/5/5"]
PLANS = [("one-way", "nearest"), ("one-way", "predictive"), ("two-way", "nearest"), ("two-way", "predictive")]

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--rounds", type=int, default=20, help="how often each picker picks its rows")
parser.add_argument("cells", nargs="*", default=CELLS, metavar="ROWS/PICKERS/CARRIERS")
arguments = parser.parse_args()
table = Table("rows/pickers/carriers", "picking, m/s", "route", "policy", "closed form", "bottleneck", "long run", "difference, %")
for cell in arguments.cells:
    rows, pickers, carriers = map(int, cell.split("/"))
    for speed in (1.0, 0.03):
        for route, dispatch in PLANS:
            plan = {"picking_speed": speed, "route": route, "dispatch": dispatch}
            layout = lay_out(Scenario(rows=rows, pickers=pickers, carriers=carriers, **plan, **NO_OBSTACLES))
            bounds, rate = Bounds(layout), long_run_bins_per_hour(layout, arguments.rounds)
            form = bounds.bins_per_hour
            figures = [f"{form:.2f}", bounds.bottleneck, f"{rate:.2f}", f"{100.0 * (form / rate - 1.0):+.1f}"]
            table.add_row(cell, f"{speed:g}", route, dispatch, *figures)
Console(width=120).print(table)
