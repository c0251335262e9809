"""What goes wrong between a vehicle and its fleet control, in virtual time."""

import pytest
from orchard_vda5050.vehicle import Timing
from orchards import SMALL, Fleet
from standard import check


def begun(released=4, patience=60.0):
    """Return a fleet of which a vehicle has left the queue, and the name of that vehicle.

    `patience` is how long, in s, a vehicle waits for fleet control before it goes home by itself.
    """
    fleet = Fleet(SMALL, released=released, timing=Timing(patience=patience))

    def first_with_an_order():
        for name in fleet.wires:
            if fleet.state(name)["nodeStates"]:
                return name
        return None

    name = fleet.until(first_with_an_order)
    fleet.until(lambda: not fleet.state(name)["lastNodeId"].startswith("queue/"))
    return fleet, name


def stands_at(fleet, name):
    """Return the node at which a vehicle stands; None while it moves or is between two."""
    seen = fleet.run.seen[name]
    if any(seen.twist):
        return None
    kind, _, _ = name.rpartition("_")
    return fleet.graphs[kind].at(seen.x, seen.y)


def stands_in_the_queue(fleet, name):
    return (stands_at(fleet, name) or "").startswith("queue/")


def finishes(fleet):
    """Drive the harvest to its end and check all messages of the vehicles. Return true."""
    while not fleet.run.engine.over:
        assert fleet.run.engine.tick < 15_000, [fleet.state(name) for name in fleet.wires]
        fleet.tick()
    for _, topic, message in fleet.heard:
        check(topic, message)
    return True


def test_a_vehicle_cut_off_stops_at_its_base_and_then_goes_on():
    """A vehicle whose line is cut drives to the end of its base and goes on when it is mended."""
    fleet, name = begun(patience=1000.0)
    base = [node["nodeId"] for node in fleet.state(name)["nodeStates"] if node["released"]]
    fleet.wires[name].is_up = False
    fleet.until(lambda: stands_at(fleet, name) == base[-1])
    for _ in range(100):
        fleet.tick()
    assert stands_at(fleet, name) == base[-1]
    fleet.wires[name].is_up = True
    fleet.until(lambda: fleet.state(name)["lastNodeId"] == base[-1])
    assert fleet.state(name)["newBaseRequest"]
    assert finishes(fleet) and fleet.state(name)["errors"] == []


def test_an_order_that_is_lost_is_sent_again():
    fleet, _ = begun()
    send = fleet.master.send
    lost = []

    def lose_three(*message):
        if len(lost) < 3:
            lost.append(message)
        else:
            send(*message)

    fleet.master.send = lose_three
    fleet.until(lambda: len(lost) == 3 and fleet.master.finished)


def test_an_update_after_a_lost_one_is_rejected():
    """An update after one that is lost is rejected and the vehicle stays within its base."""
    fleet, name = begun(released=2)
    fleet.has_master = False
    job = fleet.master.jobs[name]
    job["base"] += 2
    job["update"] += 2
    fleet.master.order(name, first=job["base"])
    fleet.until(lambda: fleet.state(name)["errors"])
    (error,) = fleet.state(name)["errors"]
    assert error["errorType"] == "VALIDATION_FAILURE"
    assert "must begin with the last node of the base" in error["errorDescription"]
    fleet.until(lambda: fleet.state(name)["newBaseRequest"] and not fleet.state(name)["driving"])


@pytest.mark.parametrize("after", ["out", "stop", "turn", "bay"])
def test_a_vehicle_left_alone_on_the_roads_goes_home(after):
    """A vehicle that is left alone on the roads goes home by itself and the others finish.

    Its fleet control vanishes on the way out, at the picker, with a promise to take a full bin,
    and with one on its bar.
    """
    fleet, name = begun(released=1)
    job = fleet.master.jobs[name]
    way = job["names"]
    stop = next(node for node in way if "/stop/" in node)
    bin_node = next(node for node in way if "/bin/" in node)
    last_node = {
        "out": fleet.state(name)["lastNodeId"],
        "stop": stop,
        "turn": way[way.index(stop) + 1],
        "bay": bin_node,
    }[after]
    fleet.until(
        lambda: (
            fleet.state(name)["lastNodeId"] == last_node and all_done(fleet, name, last_node, job)
        )
    )
    fleet.cut(name)
    fleet.until(lambda: stands_in_the_queue(fleet, name))
    fleet.cut(name, is_up=True)
    assert finishes(fleet)
    assert fleet.state(name)["operatingMode"] == "AUTOMATIC"


@pytest.mark.parametrize("patience", [60.0, 300.0])
def test_a_vehicle_left_alone_beside_a_picker_hands_over(patience):
    """A vehicle that is left alone beside a picker hands its bin over.

    Its order is cancelled on the last metres, and then its fleet control vanishes.

    With the bin it could not turn beside the picker.

    With much patience the full bin has sent for the other vehicle by then, which waits behind this
    one.
    """
    fleet, name = begun(patience=patience)
    stop = next(node for node in fleet.master.jobs[name]["names"] if "/stop/" in node)
    fleet.until(
        lambda: (
            fleet.state(name)["nodeStates"][0]["nodeId"] == stop
            and fleet.state(name)["distanceSinceLastNode"] > 1.0
        )
    )
    fleet.master.instant(name, "cancelOrder")
    fleet.has_master = False
    fleet.until(lambda: fleet.state(name)["lastNodeId"] == stop)
    fleet.cut(name)
    fleet.has_master = True
    fleet.until(lambda: stands_in_the_queue(fleet, name))
    fleet.cut(name, is_up=True)
    assert finishes(fleet)
    for vehicle in fleet.wires:
        assert fleet.run.memories[vehicle].reserved == []


@pytest.mark.parametrize(
    ("where", "has_bin"), [("east/out/1", True), ("east/wait/1", False), ("east/wait/1", True)]
)
def test_a_picker_that_is_left_alone_clears_the_roads(where, has_bin):
    """Left alone, a picker drives aside by itself.

    At the end of a row, and beyond the roads with its bin on them, it would hold up carriers.
    Beyond the roads without a bin it would hold up the one that brings a bin.
    """
    name = "picker_01"
    fleet = Fleet(SMALL, ["picker"], timing=Timing(patience=20.0))
    fleet.until(
        lambda: (
            fleet.state(name).get("lastNodeId") == where
            and bool(fleet.state(name)["loads"]) is has_bin
        )
    )
    fleet.cut(name)
    fleet.wires[name].inbox.clear()
    fleet.until(
        lambda: (
            stands_at(fleet, name) == "east/aside/1" and fleet.run.memories[name].reserved == []
        ),
        seconds=200.0,
    )
    assert fleet.run.seen[name].hitch
    fleet.cut(name, is_up=True)
    fleet.until(
        lambda: (
            fleet.state(name)["lastNodeId"] == "east/aside/1"
            and fleet.state(name)["operatingMode"] == "AUTOMATIC"
        )
    )
    assert finishes(fleet)


def test_a_picker_waits_for_its_bin_and_says_what_it_cannot_do():
    """A picker waits for its empty bin and says what it cannot do."""
    name = "picker_01"
    fleet = Fleet(SMALL, ["picker"])
    fleet.has_master = False
    fleet.tick()
    way = ["west/in/1", "east/out/1", "east/wait/1", "east/wait/2"]
    fleet.master.drive(name, "", way, {"east/out/1": ("drop", None)})
    error = fleet.until(lambda: fleet.state(name)["errors"])[0]
    assert "it must first couple the empty bin" in error["errorDescription"]
    assert fleet.run.memories[name].reserved == []
    fleet.master.instant(name, "cancelOrder")
    fleet.until(lambda: fleet.state(name)["instantActionStates"])
    fleet.has_master = True
    assert finishes(fleet)


@pytest.mark.parametrize("route", ["two-way", "one-way"])
def test_a_vehicle_that_cannot_turn_there_serves_the_picker(route):
    """A vehicle that is ordered on where it cannot turn serves the picker beside it.

    It was sent to the stop without an action.

    The full bin has sent for the vehicle behind it.
    """
    name = "carrier_01"
    fleet = Fleet(SMALL | {"route": route}, timing=Timing(patience=60.0))
    fleet.has_master = False
    fleet.tick()
    way = fleet.master.way(fleet.state(name)["lastNodeId"], "east/stop/1")
    fleet.master.drive(name, "", way, {})
    fleet.has_master = True
    assert finishes(fleet)


def test_a_vehicle_that_is_left_alone_in_the_queue_drives_up():
    fleet = Fleet(SMALL, timing=Timing(patience=60.0), names=["carrier_02"])
    fleet.has_master = False
    fleet.tick()
    fleet.until(lambda: stands_at(fleet, "carrier_02") == fleet.graph.lines[0])
    fleet.until(lambda: fleet.state("carrier_02")["lastNodeId"] == fleet.graph.lines[0])


def all_done(fleet, name, node, job):
    """Whether the action of a job at a node is finished, if there is one."""
    if node not in job["actions"]:
        return True
    kind, _ = job["actions"][node]
    finished = {
        action["actionId"]
        for action in fleet.state(name)["actionStates"]
        if action["actionStatus"] == "FINISHED"
    }
    return f"{job['order']} {kind}" in finished


def test_a_vehicle_that_drives_home_says_so_and_takes_no_order():
    """A vehicle that drives home by itself says so and takes no order."""
    fleet, name = begun(released=1)
    fleet.has_master = False
    fleet.until(lambda: fleet.state(name)["operatingMode"] == "MANUAL")
    assert fleet.state(name)["nodeStates"] == []
    fleet.master.drive(name, "new", ["queue/1"], {})
    fleet.until(lambda: fleet.state(name)["errors"])
    assert [error["errorType"] for error in fleet.state(name)["errors"]] == [
        "MOBILE_ROBOT_NOT_AVAILABLE"
    ]
    fleet.until(lambda: fleet.state(name)["operatingMode"] == "AUTOMATIC")
    assert fleet.state(name)["lastNodeId"].startswith("queue/")
    assert fleet.state(name)["errors"] == []


def test_a_bin_that_another_carrier_fetches_fails_the_action():
    """A bin that another carrier fetches fails the action and the order can be cancelled."""
    fleet, name = begun(released=99)
    (other,) = set(fleet.wires) - {name}
    fleet.master.begin(other, fleet.master.jobs[name]["call"])
    fleet.until(
        lambda: any(error["errorType"] == "ACTION_FAILED" for error in fleet.state(other)["errors"])
    )
    assert finishes(fleet)
