"""All kernels are compiled, or loaded, before the first tick: no tick waits for them."""

import subprocess
import sys
from pathlib import Path

from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine

HARVEST = """
import sys
from numba.core.dispatcher import Dispatcher
from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine
from orchard.local import Local

def known():
    kernels = [f for name in sorted(sys.modules) if name.startswith("orchard.") for f in vars(sys.modules[name]).values()]
    return {str(kernel): len(kernel.signatures) for kernel in kernels if isinstance(kernel, Dispatcher)}

scenario = Scenario(rows=3, pickers=2, laser={"noise": 0.01})
Engine.begin(scenario).rehearse()
rehearsed, run, seen = known(), Local(scenario), set()
while not run.engine.over:
    seen |= {event.what for event in run.tick()}
assert {"coupled", "row picked", "unloaded", "weed flattened"} <= seen, seen
print(*[name for name, signatures in known().items() if signatures != rehearsed[name]])
"""


def test_after_a_rehearsal_a_whole_harvest_needs_no_further_kernel():
    done = subprocess.run([sys.executable, "-c", HARVEST], cwd=Path(__file__).parents[2], capture_output=True, text=True)
    assert done.stderr == ""
    assert done.stdout.split() == []


def test_a_rehearsal_changes_nothing():
    engine, other = Engine.begin(Scenario()), Engine.begin(Scenario())
    engine.rehearse()
    for one in (engine, other):
        one.observe()
        one.advance({}, {})
    assert engine.hash == other.hash
    assert engine.figures_as_data() == other.figures_as_data()
