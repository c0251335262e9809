"""Which dispatch policy harvests most? One whole harvest with each policy in local mode, without people, animals and weeds.

python examples/compare_policies.py [--rows 10] [--pickers 5] [--carriers 5] [--picking-speed 1.0]
    [--route one-way] [--rows-to-pickers balanced] [POLICY ...]
"""

import argparse

from orchard import Local, Scenario
from orchard.field.scenario import DISPATCH_POLICIES
from orchard.report.metrics import HarvestFigures, harvest_figures
from orchard.report.sentence import clock

NO_OBSTACLES = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
DEFAULTS = {"--rows": 10, "--pickers": 5, "--carriers": 5, "--picking-speed": 1.0, "--route": "one-way", "--rows-to-pickers": "balanced"}
for name, default in DEFAULTS.items():
    parser.add_argument(name, type=type(default), default=default)
parser.add_argument("policies", nargs="*", metavar="POLICY", default=[name for name in DISPATCH_POLICIES if name != "assignment"])
values = vars(parser.parse_args())
for policy in values.pop("policies"):
    run, figures = Local(Scenario(dispatch=policy, **values, **NO_OBSTACLES)), HarvestFigures()
    while not run.engine.over and not figures.jammed(run.engine.world):
        figures.update(run.engine.world, run.tick(), run.engine.answers)
    told = harvest_figures(run.engine.world, figures)
    took = clock(told["sim_seconds"]) + ("" if run.engine.over else ", jammed")
    print(f"{policy:20} {told['bins_per_hour']:6.2f} bins/h, pickers wait {told['picker_waiting_seconds']:4.0f} s, {took}", flush=True)
