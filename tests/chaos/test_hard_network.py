"""What a network and a disk do at their worst happens in schedules, and breaks no promise."""

import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from chaos.simulated.link import Delays
from chaos.simulated.plan import Fault, Plan, draw
from chaos.simulated.schedule import Schedule
from chaos.simulated.tearing import Tears
from chaos.simulated.verdict import Verdict
from orchard.server.options import PATIENCE
from orchard.sim.snapshot import snapshots_in
from orchard.wire.keys import PHYSICS

NO_TEARS = Tears()
# What is promised also where a payload is torn into another valid message, which nobody notices.
PROMISED = ("lost: ", "no end: ", "crash: ", "wrong tick: ", "physics has waited")


def plan(*faults: Fault, **others) -> Plan:
    """A quiet plan with these faults."""
    quiet = {
        "mode": "lockstep",
        "ticks": 60,
        "hosts": 2,
        "has_logger": False,
        "has_router": False,
        "is_elsewhere": False,
        "has_bare_client": False,
        "delays": Delays(),
        "patience": PATIENCE,
        "late": 0.0,
    }
    return replace(draw(1), faults=faults, **quiet | others)


class Carried:
    """A schedule that has been carried out, and the snapshots that it has left."""

    def __init__(self, plan: Plan, tears: Tears = NO_TEARS, disk_seconds: float = 0.1) -> None:
        with tempfile.TemporaryDirectory() as folder:
            self.schedule = Schedule(plan, Path(folder))
            self.schedule.world.network.tears = tears
            self.schedule.world.disk_seconds = disk_seconds
            self.verdict: Verdict = self.schedule.run()
            snapshots = Path(folder) / "snapshots"
            self.whole = {path.name for path in snapshots_in(snapshots)}
            self.left = [path.name for path in snapshots.glob(".*.new")]


def test_a_disk_that_takes_half_of_a_write_changes_nothing():
    full = Fault("full disk", PHYSICS, 10, 0.0, 2.0)
    carried = Carried(plan(full, Fault("kill", PHYSICS, 40), ticks=150))
    assert carried.schedule.world.half_writes > 0
    assert carried.verdict.complaints == []
    assert carried.left == []


def test_physics_that_is_killed_while_it_writes_leaves_half_a_file_that_goes():
    half_writes = 0
    for tick in (20, 40, 60, 80):
        carried = Carried(plan(Fault("kill", PHYSICS, tick, 0.02), ticks=150), disk_seconds=1.0)
        half_writes += carried.schedule.world.half_writes
        assert carried.verdict.complaints == []
        assert carried.left == []
    assert half_writes > 0


@pytest.mark.parametrize("others", [{"hosts": 3}, {"has_bare_client": True}], ids=str)
@pytest.mark.parametrize("tears", [Tears(torn=0.05), Tears(changed=0.05)], ids=["torn", "changed"])
def test_no_agent_is_lost_where_payloads_change_on_their_way(tears, others):
    """Physics sends the tick again, and the host its answer."""
    torn = malformed = 0
    for seed in range(6):
        carried = Carried(replace(plan(ticks=150, **others), seed=seed), tears)
        complaints = carried.verdict.complaints
        assert [said for said in complaints if said.startswith(PROMISED)] == []
        torn += carried.schedule.world.network.torn
        malformed += carried.verdict.summary["messages_refused"].get("malformed", 0)
    assert 0 < malformed <= torn
