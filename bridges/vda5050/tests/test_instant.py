"""Instant actions: what a vehicle does at once, beside its order; and limits of its memory."""

import json
import random

import pytest
from orchards import SMALL, Fleet
from test_faults import begun, finishes

from orchard.sim.lookahead import IgnoredHolds, Lookahead


def status(fleet, name, action_id):
    """The status of an instant action of a vehicle; None if the vehicle does not know it."""
    for action in fleet.state(name)["instantActionStates"]:
        if action["actionId"] == action_id:
            return action["actionStatus"]
    return None


def test_a_vehicle_that_is_paused_stands_and_goes_on():
    fleet, name = begun()
    pause = fleet.master.instant(name, "startPause")
    fleet.until(lambda: status(fleet, name, pause) == "FINISHED" and fleet.state(name)["paused"])
    here = fleet.pose(name)
    for _ in range(50):
        fleet.tick()
    assert fleet.pose(name) == here
    assert not fleet.state(name)["driving"]
    resume = fleet.master.instant(name, "stopPause")
    fleet.until(lambda: status(fleet, name, resume) == "FINISHED" and fleet.state(name)["driving"])


def test_a_cancelled_order_ends_at_the_next_node():
    """A cancelled order ends at the next node and a new one begins there."""
    fleet, name = begun()
    fleet.has_master = False
    fleet.until(lambda: fleet.state(name)["distanceSinceLastNode"] > 1.0)
    state = fleet.state(name)
    cancel = fleet.master.instant(name, "cancelOrder", orderId=state["orderId"])
    fleet.until(lambda: status(fleet, name, cancel) == "RUNNING")
    fleet.until(lambda: status(fleet, name, cancel) == "FINISHED")
    after = fleet.state(name)
    assert after["lastNodeId"] == state["nodeStates"][0]["nodeId"]
    assert not after["nodeStates"]
    assert not after["driving"]
    assert {action["actionStatus"] for action in after["actionStates"]} == {"FAILED"}
    assert after["orderId"] == state["orderId"]
    fleet.has_master = True
    fleet.master.jobs.clear()
    assert finishes(fleet)


@pytest.mark.parametrize("kind", ["initializePosition", "fly"])
def test_what_a_vehicle_cannot_do_fails_and_is_said(kind):
    fleet, name = begun()
    action = fleet.master.instant(name, kind)
    fleet.until(lambda: status(fleet, name, action) == "FAILED")
    (error,) = fleet.state(name)["errors"]
    assert error["errorType"] == "INVALID_INSTANT_ACTION"
    assert error["errorReferences"] == [{"referenceKey": "actionId", "referenceValue": action}]
    fine = fleet.master.instant(name, "stateRequest")
    fleet.until(
        lambda: status(fleet, name, fine) == "FINISHED" and fleet.state(name)["errors"] == []
    )


def test_nothing_to_cancel_is_said_until_a_new_order_is_taken():
    """That there is no order to cancel is said until a new one is taken."""
    name = "carrier_01"
    fleet = Fleet(SMALL)
    fleet.has_master = False
    fleet.tick()
    action = fleet.master.instant(name, "cancelOrder", orderId="another")
    fleet.until(lambda: status(fleet, name, action) == "FAILED")
    fine = fleet.master.instant(name, "stateRequest")
    fleet.until(lambda: status(fleet, name, fine) == "FINISHED")
    (error,) = fleet.state(name)["errors"]
    assert error["errorType"] == "NO_ORDER_TO_CANCEL"
    assert error["errorReferences"] == [{"referenceKey": "actionId", "referenceValue": action}]
    send_order(fleet, name)
    fleet.until(lambda: fleet.state(name)["driving"])
    assert fleet.state(name)["errors"] == []


def test_a_repeated_cancelling_has_one_state_and_is_no_error():
    """A cancelling that comes twice has one state and is no error."""
    fleet, name = begun()
    fleet.has_master = False
    cancel = {"actionType": "cancelOrder", "actionId": "a", "blockingType": "HARD"}
    for _ in range(2):
        fleet.master.publish(name, "instantActions", {"actions": [cancel]})
    fleet.until(lambda: status(fleet, name, "a") == "FINISHED")
    fleet.master.publish(name, "instantActions", {"actions": [cancel]})
    for _ in range(20):
        fleet.tick()
    state = fleet.state(name)
    (action,) = state["instantActionStates"]
    assert action["actionStatus"] == "FINISHED"
    assert state["errors"] == []


def test_each_instant_action_has_one_state():
    fleet, name = begun()
    for kind in ("stateRequest", "stateRequest", "startPause"):
        action = {"actionType": kind, "actionId": "a", "blockingType": "NONE"}
        fleet.master.publish(name, "instantActions", {"actions": [action]})
    fleet.until(lambda: fleet.state(name)["paused"])
    (state,) = fleet.state(name)["instantActionStates"]
    assert (state["actionType"], state["actionStatus"]) == ("startPause", "FINISHED")


def test_a_factsheet_is_sent_on_request():
    """A factsheet is sent on request and finished instant actions are forgotten."""
    fleet, name = begun()
    request = fleet.master.instant(name, "factsheetRequest")
    fleet.until(lambda: status(fleet, name, request) == "FINISHED")
    factsheet = fleet.master.newest["factsheet"][name]
    assert factsheet["typeSpecification"]["seriesName"] == "orchard-carrier"
    fleet.master.instant(name, "clearInstantActions")

    def only_the_last_is_known():
        known = fleet.state(name)["instantActionStates"]
        return [action["actionType"] for action in known] == ["clearInstantActions"]

    fleet.until(only_the_last_is_known)


@pytest.mark.parametrize(
    "payload",
    [b"{", b"[]", b'{"actions": 3}', b" " * (1 << 20) + b"{}"],
    ids=lambda payload: str(payload[:12]),
)
def test_what_is_no_instant_action_is_said(payload):
    fleet, name = begun()
    fleet.wires[name].inbox.append(("instantActions", payload))
    fleet.until(lambda: fleet.state(name)["errors"])
    assert fleet.state(name)["errors"][0]["errorType"] == "VALIDATION_FAILURE"


@pytest.mark.parametrize("holds", [Lookahead, IgnoredHolds])
def test_an_idle_vehicle_sends_a_state_each_second(holds):
    """A vehicle to which nothing happens sends a state each second.

    So it does where it is asked only when something happens, and where it is asked at every tick,
    as in real time (`IgnoredHolds`).
    """
    fleet = Fleet(SMALL, holds=holds)
    for _ in range(101):  # 10 s and the first tick
        fleet.tick()
    senders = [name for name, _, _ in fleet.heard]
    for name in fleet.wires:
        assert senders.count(name) == 11


def test_an_idle_vehicle_is_asked_once_a_second():
    """A vehicle to which nothing happens is asked once a second, and a few times at the start."""
    fleet = Fleet(SMALL, names=["picker", "carrier"])
    fleet.has_master = False
    asked = []
    for _ in range(100):  # 10 s
        fleet.tick()
        asked += fleet.run.answers
    for name in fleet.wires:
        assert asked.count(name) <= 15


def noise(seed, length):
    """A text that no compression makes shorter than half."""
    return "".join(random.Random(seed).choices("0123456789abcdef", k=length))


def order_of(order_id, **more):
    """An order to stand at the first node of the queue."""
    node = {"nodeId": "queue/1", "sequenceId": 0, "released": True, "actions": []}
    return {"orderId": order_id, "orderUpdateId": 0, "nodes": [node], "edges": []} | more


def actions_of(kind, action_id, **more):
    """A message with one instant action."""
    action = {"actionType": kind, "actionId": action_id, "blockingType": "NONE"}
    return {"actions": [action]} | more


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("order", order_of(noise(0, 400_000), orderUpdateId=3, nodes=[])),
        ("instantActions", actions_of(noise(1, 400_000), "one")),
        ("instantActions", actions_of("stateRequest", noise(2, 400_000))),
        ("order", order_of("one", serialNumber="carrier_02")),
        ("instantActions", {"actions": [], "serialNumber": "carrier_02"}),
    ],
    ids=["order", "type", "id", "order of another", "actions of another"],
)
def test_an_impossible_or_foreign_action_is_rejected_briefly(topic, message):
    """What is too long to keep, or for another vehicle, is rejected in few words."""
    name = "carrier_01"
    fleet = Fleet(SMALL)
    fleet.has_master = False
    fleet.tick()
    fleet.master.publish(name, topic, message)
    state = fleet.until(lambda: fleet.state(name).get("errors") and fleet.state(name), seconds=5.0)
    assert [error["errorType"] for error in state["errors"]] == ["VALIDATION_FAILURE"]
    assert len(json.dumps(state)) < 3000


def test_names_of_instant_actions_are_kept_while_they_fit():
    """The names of many instant actions are kept while they fit, the newest among them."""
    name = "carrier_01"
    fleet = Fleet(SMALL)
    fleet.has_master = False
    fleet.tick()
    for number in range(50):
        actions = actions_of(noise(number, 200), noise(100 + number, 200))
        fleet.master.publish(name, "instantActions", actions)
    state = fleet.until(lambda: fleet.state(name).get("errors") and fleet.state(name), seconds=5.0)
    known = state["instantActionStates"]
    assert 20 < len(known) < 50
    assert known[-1]["actionId"] == noise(149, 200)


def send_order(fleet, name, change=lambda order: None):
    """Send a vehicle in the queue an order to a stop, after `change` has changed it."""
    fleet.tick()
    stop = "east/stop/1"
    fleet.master.drive(name, "", fleet.master.way(fleet.state(name)["lastNodeId"], stop), {})
    order = fleet.master.jobs.pop(name)["sent"]
    change(order)
    fleet.wires[name].inbox.clear()
    fleet.master.publish(name, "order", order)


def test_a_vehicle_remembers_no_more_than_it_can():
    """Its memory is limited: more would make it stand for ever."""
    name = "carrier_01"
    fleet = Fleet(SMALL)
    for _ in range(60):
        fleet.master.instant(name, "stateRequest")
    actions = [
        {
            "actionType": "drop",
            "actionId": noise(number, 200),
            "blockingType": "HARD",
            "actionParameters": [],
        }
        for number in range(200)
    ]
    send_order(fleet, name, lambda order: order["nodes"][-1].update(actions=actions))
    state = fleet.until(lambda: fleet.state(name)["errors"] and fleet.state(name))
    assert [error["errorType"] for error in state["errors"]] == ["INSUFFICIENT_MEMORY"]
    assert len(state["instantActionStates"]) == 50
    send_order(fleet, name)
    fleet.until(lambda: fleet.state(name)["driving"])


def test_an_edge_may_be_driven_more_slowly():
    name = "carrier_01"
    fleet = Fleet(SMALL)
    send_order(fleet, name, lambda order: order["edges"][0].update(maximumSpeed=0.3))
    fleet.until(lambda: fleet.state(name)["velocity"]["vx"] == 0.3)
    fleet.until(lambda: fleet.state(name)["velocity"]["vx"] == 1.0)


def test_a_vehicle_drops_no_other_bin_than_the_one_that_is_named():
    name = "carrier_01"
    fleet = Fleet(SMALL)
    fleet.has_master = False
    other = {
        "actionType": "drop",
        "actionId": "a",
        "blockingType": "HARD",
        "actionParameters": [{"key": "loadId", "value": "bin_02"}],
    }
    send_order(fleet, name, lambda order: order["nodes"][-1].update(actions=[other]))
    (error,) = fleet.until(lambda: fleet.state(name)["errors"])
    (load,) = fleet.state(name)["loads"]
    assert error["errorType"] == "ACTION_FAILED"
    assert error["errorDescription"] == f"its bin is {load['loadId']}, not bin_02"


@pytest.mark.parametrize("ticks", [1, 2])
def test_an_order_cancelled_in_the_queue_frees_its_places(ticks):
    """An order that is cancelled in the queue leaves the vehicle no places of the roads.

    Also those that traffic grants only then.
    """
    name = "carrier_01"
    fleet = Fleet(SMALL | {"route": "one-way"}, holds=IgnoredHolds)
    fleet.has_master = False
    send_order(fleet, name)
    for _ in range(ticks):
        fleet.tick()
    fleet.master.instant(name, "cancelOrder")
    for _ in range(20):
        fleet.tick()
    assert fleet.state(name)["lastNodeId"] == "queue/1"
    assert fleet.run.memories[name].reserved == []
