"""What a network and a disk do at their worst happens in schedules, and breaks no promise.

A schedule (chaos/simulated) is a run on a simulated network in virtual time, with faults at random.
Its plan says what happens. Its verdict has the complaints of the oracles: each is a promise that
was broken. Links may be slow, and may tear payloads: their end is replaced by other bytes.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from chaos.simulated.drawing import LASTING, draw
from chaos.simulated.link import DOWN, Delays
from chaos.simulated.network import Network
from chaos.simulated.plan import Fault, Plan
from chaos.simulated.schedule import Schedule
from chaos.simulated.scheduler import Scheduler, VirtualInbox
from chaos.simulated.tearing import NO_TEARS, Tearer, Tears, is_message
from chaos.simulated.verdict import Verdict, judge
from orchard.contract.messages import pack
from orchard.server.options import PATIENCE
from orchard.sim.snapshot import snapshots_in
from orchard.wire.keys import PHYSICS
from orchard.wire.messages import Departure

# What is promised also where a payload is torn into another valid message, which nobody notices.
PROMISED = ("lost: ", "no end: ", "crash: ", "wrong tick: ", "physics has waited")


def plan(*faults: Fault, **others) -> Plan:
    """Return a plan of 60 ticks in which nothing happens but these faults. `others`: its fields.

    What it does not name is as in the plan that seed 1 draws.
    """
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
            self.schedule = Schedule(replace(plan, tears=tears), Path(folder))
            self.schedule.world.disk_seconds = disk_seconds
            self.verdict: Verdict = self.schedule.run(judge)
            snapshots = Path(folder) / "snapshots"
            self.whole = {path.name for path in snapshots_in(snapshots)}
            self.left = [path.name for path in snapshots.glob(".*.new")]


def test_a_disk_that_takes_half_of_a_write_changes_nothing():
    """The disk is full for 2 s from tick 10 on; physics is killed at tick 40, and goes on."""
    full = Fault("full disk", PHYSICS, 10, 0.0, 2.0)
    carried = Carried(plan(full, Fault("kill", PHYSICS, 40), ticks=150))
    assert carried.schedule.world.half_writes > 0
    assert carried.verdict.complaints == []
    assert carried.left == []


def test_physics_killed_while_writing_leaves_half_a_file():
    """A write takes 1 s, and the kill comes 0.02 s after the tick of a snapshot.

    Physics goes on from the snapshot before, and the half file is gone at the end.
    """
    half_writes = 0
    for tick in (20, 40, 60, 80):
        carried = Carried(plan(Fault("kill", PHYSICS, tick, 0.02), ticks=150), disk_seconds=1.0)
        half_writes += carried.schedule.world.half_writes
        assert carried.verdict.complaints == []
        assert carried.left == []
    assert half_writes > 0


def test_a_large_payload_takes_longer_and_the_next_one_waits():
    """Links carry a megabyte a second, and take 1 ms for each message."""
    arrived = {}
    scheduler = Scheduler()
    network = Network(scheduler, "", Delays(1e-3, share=0.0, bytes_per_second=1e6))
    network.start_router("router")
    sender, receiver = (network.open(name, VirtualInbox(scheduler)) for name in ("one", "other"))
    receiver.subscribe("*")
    receiver.listener = lambda key, payload: arrived.setdefault(key, scheduler.now)
    scheduler.run(lambda: bool(network.router.links), 1.0)
    scheduler.run(lambda: False, 1.0)
    begun = scheduler.now
    sender.publish("small", b"1")
    sender.publish("large", b"1" * 100_000)
    sender.publish("after it", b"1")
    scheduler.run(lambda: len(arrived) == 3, 10.0)
    assert arrived["small"] - begun < 0.01
    # 100,000 bytes at a million a second take 0.1 s on each of two links.
    assert 0.2 <= arrived["large"] - begun <= arrived["after it"] - begun < 0.22


def test_arrivals_for_physics_come_from_another_thread():
    """What arrives while physics does something else waits. What physics sends goes at once."""
    scheduler = Scheduler()
    network = Network(scheduler, "", Delays())
    task = scheduler.spawn("physics", lambda: None)
    with network.router_session("physics", task, VirtualInbox(scheduler), None) as bus:
        bus.subscribe("a")
        assert network.router.subscribers_beside("another") == ["a"]
        bus.link.send(DOWN, lambda: bus.hear_sample("a", b"1"))
        assert len(bus.inbox) == 0
        scheduler.run(lambda: len(bus.inbox) > 0, 1.0)
        assert 0.0 < scheduler.now < 0.01


def test_schedules_draw_only_payloads_that_no_receiver_takes():
    """Half of the payloads are torn, and half of the rest changed. What arrives is either whole or
    no message at all: then a receiver sees it, and asks again.
    """
    key = "orchard/hosts/a/left"
    payload = pack(Departure("run1"))
    assert is_message(key, payload)
    tearer = Tearer(Tears(0.5, 0.5), Random(1), lambda: None)
    arrived = {tearer.carry(key, payload, is_reply=False) for _ in range(200)}
    assert len(arrived) > 10
    assert [
        other_payload
        for other_payload in arrived
        if other_payload != payload and is_message(key, other_payload)
    ] == []


@pytest.mark.parametrize("seed", range(4))
def test_changed_payloads_leave_the_hash_of_local_mode(seed):
    """A payload that is no message any more is asked for again. One of 100 is torn, one changed."""
    carried = Carried(replace(plan(ticks=100, hosts=3), seed=seed), Tears(0.01, 0.01))
    assert carried.schedule.world.network.torn > 0
    assert carried.verdict.complaints == []


def test_some_schedules_have_slow_links_and_payloads_that_change():
    """Of 100 schedules enough have them, so that thousands find faults, and enough do not."""
    plans = [draw(seed) for seed in range(100)]
    assert 10 <= sum(bool(plan.tears) for plan in plans) <= 40
    assert 10 <= sum(plan.delays.bytes_per_second < 1e9 for plan in plans) <= 50


def test_in_some_schedules_a_host_is_away_for_too_long():
    """Physics gives the host up, and the host joins again."""
    plans = [draw(seed) for seed in range(200)]
    away = [
        fault
        for plan in plans
        for fault in plan.faults
        if fault.what in LASTING and fault.tick < plan.ticks and fault.seconds > plan.patience
    ]
    assert len(away) >= 10


@pytest.mark.parametrize("others", [{"hosts": 3}, {"has_bare_client": True}], ids=str)
@pytest.mark.parametrize(
    "tears", [Tears(0.05, 0.0, True), Tears(0.0, 0.05, True)], ids=["torn", "changed"]
)
def test_no_agent_is_lost_where_payloads_change_on_their_way(tears, others):
    """Physics sends the tick again, and the host its answer."""
    torn = malformed = 0
    for seed in range(6):
        carried = Carried(replace(plan(ticks=150, **others), seed=seed), tears)
        complaints = carried.verdict.complaints
        assert [complaint for complaint in complaints if complaint.startswith(PROMISED)] == []
        torn += carried.schedule.world.network.torn
        malformed += carried.verdict.summary["messages_refused"].get("malformed", 0)
    assert 0 < malformed <= torn
