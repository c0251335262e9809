"""Random orders, instant actions, torn messages and cuts: no vehicle breaks, and each is in the
queue in the end.
"""

import random

import pytest
from orchard_vda5050.vehicle import Timing
from orchards import SMALL, Fleet
from standard import check

INSTANT = [
    "startPause",
    "stopPause",
    "cancelOrder",
    "cancelOrder",
    "stateRequest",
    "clearInstantActions",
    "fly",
]
WORK = ["pick", "drop", "handOver", "unload"]


@pytest.mark.parametrize(
    ("seed", "route"), [(0, "two-way"), (2, "two-way"), (4, "two-way"), (5, "one-way")]
)
def test_whatever_comes_each_vehicle_is_in_the_queue_in_the_end(seed, route):
    chance, fleet = (
        random.Random(seed),
        Fleet(SMALL | {"route": route}, released=1 + seed % 4, timing=Timing(patience=40.0)),
    )
    for _ in range(2500):
        fleet.tick()
        assert all(action.state != "broken" for action in fleet.run.actions.values())
        if chance.random() < 0.02:
            disturb(fleet, chance)
    fleet.has_master = False
    for name, wire in fleet.wires.items():
        wire.inbox.clear()
        wire.is_up = True
        fleet.master.instant(name, "stopPause")
    for _ in range(3000):
        fleet.tick()
    for name in fleet.wires:
        assert (
            fleet.graph.at(*fleet.pose(name)[:2]).startswith("queue/")
            and fleet.run.memories[name].reserved == []
        )
    for _, topic, message in fleet.heard:
        check(topic, message)


def disturb(fleet, chance):
    """One disturbance of one vehicle."""
    name = chance.choice(list(fleet.wires))
    wire, what = fleet.wires[name], chance.random()
    if what < 0.35:
        fleet.master.instant(name, chance.choice(INSTANT))
    elif what < 0.7:
        start = fleet.state(name).get("lastNodeId") or "bay"
        way = fleet.master.way(
            start, chance.choice(["bay", "queue/1", "east/bin/2", "west/stop/1", "east/stop/3"])
        )
        work = {
            node: (chance.choice(WORK), f"bin_0{chance.randrange(1, 5)}")
            for node in way
            if chance.random() < 0.3
        }
        fleet.master.jobs.pop(name, None)
        fleet.master.drive(name, "", way, work)
    elif wire.inbox:
        topic, payload = wire.inbox[-1]
        at = chance.randrange(len(payload))
        wire.inbox[-1] = topic, payload[:at] + bytes([chance.randrange(256)]) + payload[at + 1 :]
    else:
        fleet.cut(name, is_up=chance.random() < 0.7)
