"""Random orders, instant actions, torn messages and cut lines break no vehicle.

In the end each is in the queue.
"""

import random

import pytest
from orchard_vda5050.vehicle import Timing
from orchards import SMALL, Fleet
from standard import check

# What is drawn from: a kind that stands twice is drawn twice as often; nothing can fly.
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
    chance = random.Random(seed)
    timing = Timing(patience=40.0)  # s, after which a vehicle without fleet control goes home
    fleet = Fleet(SMALL | {"route": route}, released=1 + seed % 4, timing=timing)
    for _ in range(2500):
        fleet.tick()
        assert all(action.state != "broken" for action in fleet.run.actions.values())
        if chance.random() < 0.02:
            disturb(fleet, chance)
    # Fleet control falls silent, and each vehicle loses its patience and goes home.
    fleet.has_master = False
    for name, wire in fleet.wires.items():
        wire.inbox.clear()
        wire.is_up = True
        fleet.master.instant(name, "stopPause")
    for _ in range(3000):
        fleet.tick()
    for name in fleet.wires:
        x, y, *_ = fleet.pose(name)
        assert fleet.graph.at(x, y).startswith("queue/")
        assert fleet.run.memories[name].reserved == []
    for _, topic, message in fleet.heard:
        check(topic, message)


def disturb(fleet, chance):
    """Disturb one vehicle: by an instant action, an order, a torn message, or a cut of its line."""
    name = chance.choice(list(fleet.wires))
    wire = fleet.wires[name]
    kind = chance.random()
    if kind < 0.35:
        fleet.master.instant(name, chance.choice(INSTANT))
    elif kind < 0.7:
        start = fleet.state(name).get("lastNodeId") or "bay"
        end = chance.choice(["bay", "queue/1", "east/bin/2", "west/stop/1", "east/stop/3"])
        way = fleet.master.way(start, end)
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
        another = bytes([chance.randrange(256)])
        wire.inbox[-1] = (topic, payload[:at] + another + payload[at + 1 :])
    else:
        fleet.cut(name, is_up=chance.random() < 0.7)
