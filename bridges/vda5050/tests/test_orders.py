"""Which orders a vehicle takes, and how it rejects the others.

These are functions of data, without a robot. `master.py` says what an order, its base and its
horizon are.
"""

import json

import pytest
from msgspec.structs import fields
from orchard_vda5050 import received
from orchard_vda5050.errors import Rejected
from orchard_vda5050.order import take
from orchard_vda5050.order_state import OrderState, arrive, cancel
from orchard_vda5050.received import read_instant_actions, read_order

from orchard import Carrier, Scenario, lay_out
from orchard.roads.graph import graph_of
from orchard.roads.pickers import graph_of_pickers

LAYOUT = lay_out(Scenario(rows=3, pickers=2))
# The carriers' roads, and the way from a place in the queue to a stop beside a picker.
GRAPH = graph_of(LAYOUT, Carrier(LAYOUT, "carrier_01").route)
BINS = ["bin_01", "bin_02"]
START = GRAPH.nodes["queue/1"]
WAY = ["queue/1", *GRAPH.way("queue/1", ["east/stop/1"])]
HEADER = {
    "headerId": 0,
    "timestamp": "2026-01-01T00:00:00.000Z",
    "version": "3.0.0",
    "manufacturer": "orchard",
    "serialNumber": "carrier_01",
}


# -- parts of messages


def node(name, sequence, released=True, actions=(), **more):
    """A node of an order."""
    return {
        "nodeId": name,
        "sequenceId": sequence,
        "released": released,
        "actions": list(actions),
    } | more


def action(kind="handOver", key="loadId", value="bin_01", number=1):
    """An action with one parameter, or with none if `key` is empty."""
    parameters = [{"key": key, "value": value}] if key else []
    return {
        "actionType": kind,
        "actionId": f"action {number}",
        "blockingType": "HARD",
        "actionParameters": parameters,
    }


def order(update=0, first=0, released=99, actions=(), order_id="one"):
    """An order from node number `first` of the way to its end, with `actions` there.

    `released` is the number of the last node of the base.
    """
    nodes = [node(name, 2 * n, n <= released) for n, name in enumerate(WAY)][first:]
    nodes[-1]["actions"] = list(actions)
    edges = [
        {"edgeId": "", "sequenceId": 2 * n + 1, "released": n < released, "actions": []}
        for n in range(first, len(WAY) - 1)
    ]
    return HEADER | {"orderId": order_id, "orderUpdateId": update, "nodes": nodes, "edges": edges}


def read(message):
    """An order as a vehicle reads it."""
    return read_order(json.dumps(message).encode())


def taken(state, message):
    """What a vehicle that stands at the start of the way knows after it has taken an order.

    `state` is what it knew before.
    """
    return take(state, read(message), GRAPH, BINS, x=START.x, y=START.y)


def changed(message, path, value):
    """Change the part of a message at a path of keys; None removes it. Return the message."""
    *keys, last = path
    part = message
    for key in keys:
        part = part[key]
    if value is None:
        del part[last]
    else:
        part[last] = value
    return message


HEIGHT = {
    "actionParameters": [{"key": "loadId", "value": "bin_01"}, {"key": "height", "value": 1.0}]
}


def placed(**more):
    """An order whose first node has its position, with these fields of the position changed."""
    position = {"x": START.x, "y": START.y, "mapId": "orchard"} | more
    return changed(order(), ["nodes", 0, "nodePosition"], position)


# -- what a vehicle may know before it takes an order: that it has begun one, of which three nodes
# are released; that this was cancelled; that there is an action at the end of one; and that it has
# done one until the third node.
BEGUN = taken(OrderState(), order(released=2))
CANCELLED = taken(OrderState(), order(released=2))
cancel(CANCELLED, is_driving=False)
WITH_ACTION = taken(OrderState(), order(actions=[action()]))
DONE = OrderState("one", 3, b"", WAY[2], 4)

# An update that stays at the last node, with an action of an id that is known.
TWICE = order(update=1) | {
    "nodes": [
        node(WAY[-1], 2 * len(WAY) - 2),
        node(WAY[-1], 2 * len(WAY), actions=[action()]),
    ],
    "edges": [{"edgeId": "", "sequenceId": 2 * len(WAY) - 1, "released": True, "actions": []}],
}
ONLY_THE_BAY = order() | {"nodes": [node("bay", 0)], "edges": []}


@pytest.mark.parametrize(
    ("error_type", "state", "message"),
    [
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["nodes", 0, "nodeId"], None)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["orderUpdateId"], "0")),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["orderUpdateId"], -1)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["headerId"], None)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["edges"], [])),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["nodes"], [])),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["nodes", 1, "sequenceId"], 3)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["nodes", 0, "released"], False)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["edges", 0, "released"], False)),
        (
            "VALIDATION_FAILURE",
            OrderState(),
            changed(order(released=2), ["edges", 2, "released"], True),
        ),
        ("VALIDATION_FAILURE", OrderState(), order(update=1)),
        ("VALIDATION_FAILURE", BEGUN, order(update=1, first=1)),
        ("VALIDATION_FAILURE", BEGUN, order(update=1, first=3)),
        ("VALIDATION_FAILURE", DONE, order(update=4, first=1)),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["edges", 0, "startNodeId"], "bay")),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["edges", 1, "endNodeId"], WAY[1])),
        ("VALIDATION_FAILURE", OrderState(), order(actions=[action(), action("drop", key="")])),
        ("VALIDATION_FAILURE", OrderState(), order(order_id="long" * 100)),
        ("VALIDATION_FAILURE", OrderState(), order(order_id="")),
        ("VALIDATION_FAILURE", WITH_ACTION, TWICE),
        (
            "UNSUPPORTED_PARAMETER",
            OrderState(),
            changed(order(), ["edges", 0, "trajectory"], {"controlPoints": []}),
        ),
        ("UNSUPPORTED_PARAMETER", OrderState(), order(actions=[action() | HEIGHT])),
        ("UNSUPPORTED_PARAMETER", OrderState(), placed(theta=0)),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action("fly")])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action("unload", key="")])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action(key="")])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action(value=3)])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action(value="bin_77")])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action(value=["bin_01"])])),
        ("INVALID_ORDER_ACTION", OrderState(), order(actions=[action("drop", value="bin_77")])),
        ("VALIDATION_FAILURE", OrderState(), changed(order(), ["edges", 0, "maximumSpeed"], -1.0)),
        (
            "INVALID_ORDER_ACTION",
            OrderState(),
            changed(order(), ["edges", 0, "actions"], [action("drop")]),
        ),
        ("OTHER_ORDER_ACTIVE", BEGUN, order(order_id="two")),
        ("OUTDATED_ORDER_UPDATE", DONE, order(update=2, first=2)),
        ("SAME_ORDER_UPDATE_ID", BEGUN, order(released=3)),
        ("ORDER_UPDATE_FOLLOWING_CANCEL", CANCELLED, order(update=1, first=2)),
        ("START_NODE_OUT_OF_RANGE", OrderState(), ONLY_THE_BAY),
        ("NO_ROUTE_TO_TARGET", OrderState(), changed(order(), ["nodes", 1, "nodeId"], "nowhere")),
        ("NO_ROUTE_TO_TARGET", OrderState(), changed(order(), ["nodes", 1, "nodeId"], "bay")),
        ("NO_ROUTE_TO_TARGET", OrderState(), placed(x=0.0)),
        ("UNKNOWN_MAP_ID", OrderState(), placed(mapId="cellar")),
    ],
)
def test_an_order_is_rejected_with_the_standards_error(error_type, state, message):
    before = repr(state)
    with pytest.raises(Rejected) as rejected:
        taken(state, message)
    assert rejected.value.error.error_type == error_type
    assert rejected.value.error.error_description
    assert repr(state) == before


@pytest.mark.parametrize("blocking", ["SOFT", "HARD"])
def test_what_is_done_while_driving_cannot_forbid_to_drive(blocking):
    """An action on an edge is done while driving: its blockingType must allow that."""
    graph = graph_of_pickers(LAYOUT, Carrier(LAYOUT, "carrier_01").route)
    way = ["west/in/1", "east/out/1"]
    edge = {
        "edgeId": "",
        "sequenceId": 1,
        "released": True,
        "actions": [action("harvest", key="") | {"blockingType": blocking}],
    }
    message = HEADER | {
        "orderId": "one",
        "orderUpdateId": 0,
        "nodes": [node(way[0], 0), node(way[1], 2)],
        "edges": [edge],
    }
    start = graph.nodes[way[0]]
    with pytest.raises(Rejected, match="its blockingType must be NONE or SINGLE"):
        take(OrderState(), read(message), graph, BINS, x=start.x, y=start.y)
    edge["actions"][0]["blockingType"] = "NONE"
    state = take(OrderState(), read(message), graph, BINS, x=start.x, y=start.y)
    assert state.order_id == "one"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"[]",
        b"{}",
        b"null",
        b"\xff",
        b'{"orderId": 3}',
        b"[" * 100_000,
        b" " * (1 << 20) + b"{}",
    ],
    ids=lambda payload: str(payload[:12]),
)
def test_what_is_no_order_is_rejected(payload):
    with pytest.raises(Rejected, match="not an order"):
        read_order(payload)


def test_a_rejected_order_is_named():
    with pytest.raises(Rejected) as rejected:
        taken(OrderState(), changed(order(), ["nodes", 0, "nodeId"], None))
    assert references(rejected.value.error) == {"orderId": "one", "orderUpdateId": "0"}


def references(error):
    """What an error refers to: its keys and values."""
    return {
        reference.reference_key: reference.reference_value for reference in error.error_references
    }


def test_an_order_that_comes_twice_changes_nothing():
    assert taken(BEGUN, order(released=2)) is BEGUN


def test_fields_that_the_standard_may_add_are_ignored():
    assert taken(OrderState(), order() | {"new": 1}).order_id == "one"


def test_an_update_extends_the_base_and_replaces_the_horizon():
    begun = taken(OrderState(), order(released=2, actions=[action(number=1)]))
    assert [action.action_id for action in begun.actions] == ["action 1"]
    assert begun.decision_point == (WAY[2], 4)
    updated = taken(begun, order(update=1, first=2, actions=[action(number=2)]))
    all_released = [(name, 2 * n, True) for n, name in enumerate(WAY)]
    ahead = [(node.node_id, node.sequence_id, node.released) for node in updated.nodes]
    assert ahead == all_released[1:]
    assert [edge.sequence_id for edge in updated.edges] == [2 * n + 1 for n in range(len(WAY) - 1)]
    assert [action.action_id for action in updated.actions] == ["action 2"]


def test_an_order_that_is_done_goes_on_with_an_update():
    """An order that is done goes on with an update at its last node."""
    updated = taken(DONE, order(update=7, first=2))
    assert (updated.last_node, updated.last_sequence) == (WAY[2], 4)
    assert len(updated.nodes) == len(WAY) - 3


def test_actions_can_be_added_at_the_decision_point():
    """Actions can be added at the decision point, the end of the base.

    The update does so by a further node of the same name.
    """
    begun = taken(OrderState(), order() | {"nodes": [node(WAY[0], 0)], "edges": []})
    update = order(update=1) | {
        "nodes": [node(WAY[0], 0), node(WAY[0], 2)],
        "edges": [{"edgeId": "", "sequenceId": 1, "released": True, "actions": []}],
    }
    assert [node.sequence_id for node in taken(begun, update).nodes] == [2]


def test_the_first_node_may_allow_a_vehicle_further_away():
    """The first node may allow a vehicle to stand further away."""
    far = START.x - 3.0
    message = read(placed(allowedDeviationXY={"a": 4.0, "b": 4.0, "theta": 0.0}))
    assert take(OrderState(), message, GRAPH, BINS, x=far, y=START.y).order_id == "one"


@pytest.mark.parametrize(("x", "y"), [(-6.0, 0.0), (0.0, 1.0), (-1.0, 3.0)])
def test_an_allowed_deviation_lets_no_vehicle_off_the_roads(x, y):
    """What an order allows lets no vehicle drive off the roads.

    It would drive straight on from where it stands, to the side of the edge or from far away.
    """
    message = read(placed(allowedDeviationXY={"a": 500.0, "b": 500.0, "theta": 0.0}))
    with pytest.raises(Rejected, match="m away"):
        take(OrderState(), message, GRAPH, BINS, x=START.x + x, y=START.y + y)


def nulls(kind):
    """Return null for each optional field of a part of a message."""
    return {field.encode_name: None for field in fields(kind) if not field.required}


def test_a_field_that_is_null_is_not_there():
    message = order(actions=[action("drop", key="") | nulls(received.ActionOrder)])
    assert message["nodes"][-1]["actions"][0]["actionParameters"] is None
    for edge in message["edges"]:
        edge.update(nulls(received.Edge) | dict.fromkeys(received.UNUSABLE))
    message["nodes"][0] |= nulls(received.Node)
    place = {"x": START.x, "y": START.y, "mapId": "orchard"} | nulls(received.NodePosition)
    message["nodes"][0]["nodePosition"] = place
    plain = placed()
    plain["nodes"][-1]["actions"] = [action("drop", key="")]
    state = taken(OrderState(), message | nulls(received.Order))
    assert state == taken(OrderState(), plain)
    assert [action.action_type for action in state.actions] == ["drop"]


def test_a_field_that_must_be_there_may_not_be_null():
    with pytest.raises(Rejected, match="missing required field `nodeId`"):
        read(order() | {"nodes": [node(None, 0)], "edges": []})


@pytest.mark.parametrize("field", ["actions", "instantActions"])
def test_instant_actions_are_read_under_both_names(field):
    """Instant actions are read under both names and with nulls.

    Version 1.1, and software for 2.0 that keeps to it, say `instantActions`.
    """
    pause = {"actionType": "startPause", "actionId": "a", "blockingType": "HARD"}
    message = HEADER | {field: [pause | nulls(received.ActionOrder)]}
    (read,) = read_instant_actions(json.dumps(message).encode()).actions
    assert (read.action_type, read.action_parameters) == ("startPause", [])


def at_the_last_node(actions, number=2):
    """Return an update with these actions at its first node, number `number` of the way."""
    message = order(update=1, first=number)
    message["nodes"][0]["actions"] = actions
    return message


def with_actions_at(number, actions):
    """Return what a vehicle knows of an order with these actions at the last node of its base.

    `number` is that of the node.
    """
    message = order(released=number)
    message["nodes"][number]["actions"] = actions
    return taken(OrderState(), message)


UNLOAD = action("drop", key="")
TO_STOP = len(WAY) - 1  # the number of the last node of the way


@pytest.mark.parametrize(
    ("actions", "why"),
    [
        ([action("drop", key="", number=2)], "a new action"),
        ([action("drop", key=""), action("drop", key="", number=2)], "a new action"),
        ([action("handOver")], "another action of a known actionId"),
    ],
)
@pytest.mark.parametrize("is_there", [False, True])
def test_an_update_cannot_change_the_last_node_of_the_base(actions, why, is_there):
    """An update cannot change what is done at the last node of the base."""
    begun = with_actions_at(TO_STOP, [UNLOAD])
    while is_there and begun.nodes:
        arrive(begun)
    update = at_the_last_node(actions, TO_STOP)
    with pytest.raises(Rejected, match=why) as rejected:
        taken(begun, update)
    wrong = actions[-1]["actionId"]
    error = rejected.value.error
    assert references(error) == {"orderId": "one", "orderUpdateId": "1", "actionId": wrong}
    assert error.error_type == "INVALID_ORDER_ACTION"
    assert wrong in error.error_description
    remedy = f"a further node {WAY[-1]} with sequenceId {2 * TO_STOP + 2}"
    assert remedy in error.error_description


@pytest.mark.parametrize("actions", [[], [UNLOAD]])
@pytest.mark.parametrize("is_done", [False, True])
def test_an_update_may_repeat_or_omit_actions_at_its_first_node(actions, is_done):
    """An update may repeat or leave out the actions at its first node."""
    begun = with_actions_at(TO_STOP, [UNLOAD])
    while is_done and begun.nodes:
        arrive(begun)
    if is_done:
        begun.queue.clear()
        begun.set(UNLOAD["actionId"], "FINISHED")
    updated = taken(begun, at_the_last_node(actions, TO_STOP))
    assert updated.update_id == 1
    assert [action.action_id for action in updated.actions] == [UNLOAD["actionId"]]


def test_an_update_leaves_the_error_with_which_a_vehicle_stands():
    state = taken(OrderState(), order(released=2))
    state.errors = [
        Rejected(kind, "why", {}).error
        for kind in ("ACTION_FAILED", "NODE_UNREACHABLE", "SAME_ORDER_UPDATE_ID")
    ]
    updated = taken(state, order(update=1, first=2))
    assert [error.error_type for error in updated.errors] == ["ACTION_FAILED", "NODE_UNREACHABLE"]


def test_a_cancelled_order_leaves_a_vehicle_its_next_node():
    """A cancelled order leaves a vehicle that drives its next node."""
    begun = taken(OrderState(), order(released=2, actions=[action()]))
    cancel(begun, is_driving=True)
    assert [node.node_id for node in begun.nodes] == WAY[1:2]
    assert not begun.is_idle
    assert [action.action_status for action in begun.actions] == ["FAILED"]
    arrive(begun)
    assert begun.is_idle
    assert begun.order_id == "one"


def base_with_a_gap():
    """An order whose base goes on after a part of the horizon."""
    message = order(released=1)
    message["edges"][2]["released"] = True
    message["nodes"][3]["released"] = True
    return message


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (changed(order(), ["nodes", -1, "sequenceId"], 99), "must grow by 1"),
        (changed(order(), ["edges", 0, "endNodeId"], "bay"), "between which it stands"),
        (base_with_a_gap(), "the base must come first"),
    ],
)
def test_parts_of_an_order_out_of_sequence_are_rejected(message, why):
    with pytest.raises(Rejected, match=why):
        read(message)


def test_cancelling_leaves_a_finished_action_finished():
    state = taken(OrderState(), order(actions=[action()]))
    state.set("action 1", "FINISHED")
    cancel(state, is_driving=False)
    assert [known.action_status for known in state.actions] == ["FINISHED"]
