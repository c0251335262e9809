"""A client that is written from keyspace.md alone holds its velocity: it is asked as seldom as an agent of this program."""

import subprocess
import sys

import pytest
from stage import empty_orchard

from examples import foreign_holder
from orchard import Action, Hold, Local, Twist, Zone
from orchard.field.scenario import People

pytestmark = pytest.mark.processes

TICKS = 400
SCENARIO = empty_orchard(people=People(workers=1, visitors=0))
AHEAD = Zone(*foreign_holder.ZONE)


class Walker:
    """The same person, as an agent of this program."""

    Memory, holds = dict, True

    def __init__(self):
        self.asked = 0

    def tick(self, seen, mail, memory):
        self.asked += 1
        free = not AHEAD.is_occupied(seen)
        hold = Hold(seen.tick + foreign_holder.HELD, watch=(AHEAD,))
        return Action(Twist(0.5 if free else 0.0, 0.0, 0.0 if free else 0.5), doing="walking", state="driving", hold=hold)


def test_a_foreign_client_holds_its_velocity(fleet):
    walker = Walker()
    local = Local(SCENARIO, {"worker_01": walker})
    for _ in range(TICKS):
        local.tick()
    assert TICKS / foreign_holder.HELD < walker.asked < TICKS / 5, "its zone ended some holds"
    others = [word for name in local.engine.layout.agents if name != "worker_01" for word in ("--absent", name)]
    fleet.physics(SCENARIO, "--duration", str(TICKS / 10), *others)
    command = [sys.executable, "-I", foreign_holder.__file__, fleet.endpoint, "worker_01"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0)
    assert done.stdout == f"{walker.asked} {TICKS}\n", done.stderr
    assert fleet.end() == local.engine.hash
