"""The example about carriers: what it refuses, concludes and prints, without its harvests."""

import io
import subprocess
import sys

from command_line import ROOT
from rich.console import Console

from examples.how_many_carriers import conclusions, table_of
from orchard.field.scenario import Scenario

PROGRAM = ROOT / "examples" / "how_many_carriers.py"
FIGURES = {"bins_per_hour": 131.0, "long_run_bins_per_hour": 131.0, "bottleneck": "unloading", "enough": 16.5, "carrier_utilisation": 0.874}


def harvested(**seconds_of: float) -> tuple[list[Scenario], list[dict]]:
    """Harvests with made-up times. `seconds_of`: c1 for one carrier, and so on."""
    scenarios = [Scenario(rows=20, carriers=int(name[1:]), picking_speed=0.03) for name in seconds_of]
    times = [{"sim_seconds": s, "schedule_sim_seconds": s - 1.0, "picker_waiting_seconds": s / 2.0} for s in seconds_of.values()]
    return scenarios, [FIGURES | figures for figures in times]


def test_a_bad_scenario_is_told_as_run_py_tells_it():
    done = subprocess.run([sys.executable, PROGRAM, "--rows", "2"], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("the command line: rows = 2: must be a whole number from 3 to 20")


def test_the_conclusion_names_the_fewest_carriers_that_are_about_as_fast_as_the_fastest():
    assert conclusions(*harvested(c1=900.0, c2=505.0, c4=500.0)) == [
        "At 0.03 m/s 2 carriers harvest in 505 s; more, up to 4, save at most 1 %."
    ]
    assert conclusions(*harvested(c1=900.0, c2=506.0, c4=500.0)) == ["At 0.03 m/s 4 carriers harvest in 500 s; fewer take over 1 % longer."]


def test_the_table_is_whole_at_eighty_columns():
    console = Console(file=io.StringIO(), width=80)
    console.print(table_of(*harvested(c20=12139.0)))
    shown = console.file.getvalue()
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    for words in ("carriers", "harvest,", "bottleneck", "12139", "unloading", "87 %"):
        assert words in shown
