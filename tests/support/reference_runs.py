"""Short runs that together use each value of a scenario, and whose results are stored.

tests/sim/test_reference_runs.py does them again. So a change of the code that must change no result
is seen to change none. Where a change is meant to change results, this stores them anew:

    .venv/bin/python tests/support/reference_runs.py
"""

import json
import sys
from pathlib import Path
from typing import Any

import yaml
from msgspec.structs import replace

from orchard.field.geometry import Twist
from orchard.field.scenario import check
from orchard.local import Local

FOLDER = Path(__file__).parents[1] / "sim"
# The length of each run, 5 minutes, unless its harvest is over sooner.
TICKS = 3000
RUNS: dict[str, dict[str, Any]] = yaml.safe_load((FOLDER / "reference_runs.yaml").read_text())
RESULTS = FOLDER / "reference_hashes.json"


def result_of(name: str) -> dict[str, Any]:
    """Return the hash of a run, and figures by which a person sees what has changed."""
    run = RUNS[name]
    local = Local(check(run["scenario"]))
    events = 0
    pushes = run.get("pushes", [])
    fork = run.get("fork")
    while local.engine.tick < TICKS and not local.engine.over:
        if fork is not None and local.engine.tick == fork["tick"]:
            local = local.fork(fork["stop"], **fork["changes"])
        events += len(_tick(local, pushes))
    world = local.engine.world
    return {
        "hash": local.engine.hash,
        "ticks": local.engine.tick,
        "delivered": world.delivered,
        "picked_metres": round(float(world.row_picked.sum()), 6),
        "events": events,
    }


def _tick(local: Local, pushes: list[list[Any]]) -> list[Any]:
    """Advance a run by one tick, and return its events.

    A push drives a robot in place of its agent: [first tick, robot, m/s, rad/s, number of ticks].
    """
    tick = local.engine.tick
    answers = local.ask()
    for begin, name, speed, rate, ticks in pushes:
        if begin <= tick < begin + ticks:
            own = answers.get(name)
            if own is None:
                # Its agent was not asked. Its last action stands, but its letters are sent once.
                own = replace(local.engine.actions[name], requests=[], answers=[])
            answers[name] = replace(own, twist=Twist(x=speed, yaw=rate), hold=None, deeds=[])
            # Its agent must be asked at the next tick: it is not where it expects to be.
            local.engine.wake([name])
    return local.act(answers)


if __name__ == "__main__":
    results = {name: result_of(name) for name in RUNS}
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    sys.exit()
