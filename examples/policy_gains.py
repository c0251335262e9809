"""What does one dispatch policy gain over another, where picking times are drawn and pickers fail? As docs/bounds.md shows it.

python examples/policy_gains.py [--seeds 12] [--policy predictive] [--over predictive-farthest] [ROWS/PICKERS/CARRIERS:PICKING SPEED ...]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import fmean

from rich.console import Console
from rich.table import Table

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out

NO_OBSTACLES = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0, "tractor": False}
CELLS = [
    "20/10/10:0.5", "20/10/7:0.5", "20/10/4:0.5", "20/20/20:0.5", "20/5/5:0.5", "20/5/3:0.5", "10/10/10:0.5",
    "20/10/10:0.2", "20/10/4:0.1", "20/5/2:0.03",
]  # fmt: skip
SPREAD = {"distribution": "lognormal", "cv": 0.2}
FAILURE = {"mean_between": 1200.0, "mean_repair": 120.0}  # s
PLANS = [(route, picking) for route in ("one-way", "two-way") for picking in ({"spread": SPREAD}, {"spread": SPREAD, "failure": FAILURE})]


def bins_per_hour(cell: str, policy: str, route: str, picking: dict, seed: int) -> float:
    """Return the bins per hour of one harvest by the discrete-event model."""
    size, _, speed = cell.partition(":")
    rows, pickers, carriers = map(int, size.split("/"))
    plan = {"picking_speed": float(speed), "picking": picking, "route": route, "dispatch": policy, "seed": seed}
    layout = lay_out(Scenario(rows=rows, pickers=pickers, carriers=carriers, **plan, **NO_OBSTACLES))
    return 3600.0 * rows / DiscreteHarvest(layout).run().seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12, help="harvests of each cell, with the seeds from 1 on")
    parser.add_argument("--policy", default="predictive")
    parser.add_argument("--over", default="predictive-farthest", metavar="POLICY")
    parser.add_argument("cells", nargs="*", default=CELLS, metavar="ROWS/PICKERS/CARRIERS:PICKING SPEED")
    arguments = parser.parse_args()
    table = Table("rows/pickers/carriers:picking, m/s", "one-way, %", "with failures, %", "two-way, %", "with failures, %")
    gains = []
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as processes:
        for cell in arguments.cells:
            jobs = [(cell, policy, *plan, seed) for plan in PLANS for policy in (arguments.policy, arguments.over)
                    for seed in range(1, arguments.seeds + 1)]  # fmt: skip
            rates = list(processes.map(bins_per_hour, *zip(*jobs, strict=True)))
            means = [fmean(rates[i : i + arguments.seeds]) for i in range(0, len(rates), arguments.seeds)]
            gained = [100.0 * (one / other - 1.0) for one, other in zip(means[::2], means[1::2], strict=True)]
            table.add_row(cell, *(f"{gain:+.1f}" for gain in gained))
            gains += gained
    Console(width=120).print(table)
    print(f"on average {fmean(gains):+.1f} %, from {min(gains):+.1f} to {max(gains):+.1f} %")


if __name__ == "__main__":
    main()
