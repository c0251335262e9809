"""What a vehicle says of itself, as VDA 5050 writes it.

The messages are without their header, which `line` adds when it sends them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any, Literal

import msgspec

from orchard import Observation
from orchard.field.kinds import KINDS
from orchard.field.machines import Machine
from orchard.field.scenario import TIME_STEP
from orchard.roads.actions import ACTIONS, IGNORED, INSTANT, VehicleAction
from orchard.roads.graph import Graph
from orchard.roads.lif import MAP, series
from orchard_vda5050.errors import Error
from orchard_vda5050.order import WHERE
from orchard_vda5050.order_state import ActionState, OrderState
from orchard_vda5050.parts import LONGEST_ID
from orchard_vda5050.received import LARGEST, Edge, Node

Message = dict[str, Any]

# Types of loads.
BIN = "empty bin"
FULL = "full bin"
# What a factsheet says of each kind.
DESCRIPTIONS = {
    "carrier": "simulated carrier of bins of kiwifruit; its bin follows it on a bar",
    "picker": "simulated picker of kiwifruit; the bin that it fills follows it on a bar",
}
MAP_STATE = {"mapId": MAP, "mapVersion": "1", "mapStatus": "ENABLED"}


@dataclass(frozen=True)
class Status:
    """What a vehicle does at a tick.

    `is_away`: it drives to the queue by itself, and fleet control is not in control.
    """

    is_driving: bool
    is_paused: bool
    is_laden: bool
    is_charging: bool
    is_blocked: bool
    is_away: bool


def state_of(
    seen: Observation,
    status: Status,
    order: OrderState,
    *,
    instant: Sequence[ActionState],
    errors: Sequence[Error],
    waits_for: str,
    graph: Graph,
) -> Message:
    """Return the message `state`.

    `instant`: how far instant actions are. `errors`: beside those of orders. `waits_for`: what the
    vehicle waits for, in words for people.
    """
    # Where a vehicle drives by itself is no part of the order of fleet control.
    nodes = [] if status.is_away else order.nodes
    edges = [] if status.is_away else order.edges
    base = [node for node in nodes if node.released]
    # At the last node of its base, or on the way there, a vehicle asks for a longer base.
    needs_base = len(base) < len(nodes) and len(base) <= 1
    return {
        "maps": [MAP_STATE],
        "orderId": order.order_id,
        "orderUpdateId": order.update_id,
        "lastNodeId": order.last_node,
        "lastNodeSequenceId": order.last_sequence,
        "nodeStates": [_node(node) for node in nodes],
        "edgeStates": [_edge(edge) for edge in edges],
        "mobileRobotPosition": _position(seen),
        "velocity": _velocity(seen),
        "loads": _loads(graph.kind, seen, status.is_laden),
        "driving": status.is_driving,
        "paused": status.is_paused,
        "newBaseRequest": needs_base,
        "distanceSinceLastNode": _distance(seen, order.last_node, graph),
        "actionStates": msgspec.to_builtins(order.actions),
        "instantActionStates": msgspec.to_builtins(instant),
        "powerSupply": {"stateOfCharge": 100.0 * seen.charge, "charging": status.is_charging},
        "operatingMode": "MANUAL" if status.is_away else "AUTOMATIC",
        "errors": msgspec.to_builtins([*order.errors, *errors]),
        "information": _information(waits_for),
        "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": status.is_blocked},
    }


def _distance(seen: Observation, node_name: str, graph: Graph) -> float:
    """Return how far a vehicle is from a node, m; 0.0 if there is no such node."""
    node = graph.nodes.get(node_name)
    return 0.0 if node is None else hypot(seen.x - node.x, seen.y - node.y)


def _information(waits_for: str) -> list[Message]:
    """Return what a state says for people."""
    if not waits_for:
        return []
    return [{"infoType": "waitsFor", "infoLevel": "INFO", "infoDescriptor": waits_for}]


def visualization_of(seen: Observation, state_header_id: int) -> Message:
    """Return the message `visualization`. `state_header_id`: the headerId of the newest state."""
    return {
        "referenceStateHeaderId": state_header_id,
        "mobileRobotPosition": _position(seen),
        "velocity": _velocity(seen),
    }


def connection_of(state: Literal["ONLINE", "OFFLINE", "CONNECTION_BROKEN"]) -> Message:
    """Return the message `connection`."""
    return {"connectionState": state}


def factsheet_of(kind: str, machine: Machine, state_seconds: float) -> Message:
    """Return the message `factsheet` of a kind of vehicle.

    `state_seconds`: the time between two states, unless something happens.
    """
    body = KINDS[kind]
    return {
        "typeSpecification": {
            "seriesName": series(kind),
            "seriesDescription": DESCRIPTIONS[kind],
            "mobileRobotKinematics": "DIFFERENTIAL",
            "mobileRobotClass": "TUGGER",
            # 0 says nothing: the mass of bins is not simulated.
            "maximumLoadMass": 0.0,
            "localizationTypes": ["NATURAL"],
            "navigationTypes": ["VIRTUAL_LINE_GUIDED"],
        },
        "physicalParameters": {
            "minimumSpeed": 0.0,
            "maximumSpeed": machine.speed,
            "maximumAngularSpeed": machine.turn,
            # A robot has any velocity after one step.
            "maximumAcceleration": machine.speed / TIME_STEP,
            "maximumDeceleration": machine.speed / TIME_STEP,
            "minimumHeight": body.height,
            "maximumHeight": body.height,
            "width": body.width,
            "length": body.length,
        },
        "protocolLimits": {
            "maximumStringLengths": {
                "maximumMessageLength": LARGEST,
                "maximumIdLength": LONGEST_ID,
            },
            "maximumArrayLengths": {},
            "timing": {
                "minimumOrderInterval": TIME_STEP,
                "minimumStateInterval": TIME_STEP,
                "defaultStateInterval": state_seconds,
            },
        },
        "protocolFeatures": {
            "optionalParameters": [
                {"parameter": "order.nodes.nodePosition", "support": "SUPPORTED"},
                {
                    "parameter": "order.nodes.nodePosition.allowedDeviationXY",
                    "support": "SUPPORTED",
                    "description": "of the first node",
                },
                {"parameter": "order.edges.maximumSpeed", "support": "SUPPORTED"},
            ],
            "mobileRobotActions": [
                *(_declared(*action) for action in ACTIONS[kind].items()),
                *map(_declared_instant, INSTANT),
            ],
        },
        "mobileRobotGeometry": {
            "envelopes2d": [{"envelope2dId": "alone", "vertices": _box(body.length, body.width)}]
        },
        "loadSpecification": {
            "loadPositions": ["bar"],
            "loadSets": [_load_set(kind, BIN), _load_set(kind, FULL)],
        },
    }


def _node(node: Node) -> Message:
    message: Message = {
        "nodeId": node.node_id,
        "sequenceId": node.sequence_id,
        "released": node.released,
    }
    at = node.node_position
    if at is not None:
        message["nodePosition"] = {"x": at.x, "y": at.y, "mapId": at.map_id}
    return message


def _edge(edge: Edge) -> Message:
    return {"edgeId": edge.edge_id, "sequenceId": edge.sequence_id, "released": edge.released}


def _position(seen: Observation) -> Message:
    message: Message = {
        "x": seen.x,
        "y": seen.y,
        "theta": seen.pose.yaw,
        "mapId": MAP,
        "localized": True,
    }
    if seen.accuracy:
        message["deviationRange"] = seen.accuracy
    return message


def _velocity(seen: Observation) -> Message:
    return {"vx": seen.twist.x, "vy": seen.twist.y, "omega": seen.twist.yaw}


def _loads(kind: str, seen: Observation, is_laden: bool) -> list[Message]:
    """Return what is on the bar of a vehicle of this kind."""
    if seen.hitch is None:
        return []
    load = FULL if is_laden else BIN
    return [{"loadId": seen.hitch.name, "loadType": load, "loadPosition": "bar", **_shape(kind)}]


def _shape(kind: str) -> Message:
    """Return where the bin on the bar of this kind is, seen from the vehicle, and its size."""
    body = KINDS["bin"]
    return {
        "boundingBoxReference": {"x": -KINDS[kind].tows, "y": 0.0, "z": 0.0},
        "loadDimensions": {"length": body.length, "width": body.width, "height": body.height},
    }


def _load_set(kind: str, load: str) -> Message:
    return {"setName": load, "loadType": load, "loadPositions": ["bar"], **_shape(kind)}


def _box(length: float, width: float) -> list[Message]:
    """Return the corners of a box around the origin, m, from the front left one on."""
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return [{"x": along * length / 2, "y": across * width / 2} for along, across in signs]


def _declared(kind: str, action: VehicleAction) -> Message:
    """Return what a factsheet says of an action."""
    load = _parameter("loadId", "the name of a bin", is_optional=not action.needs_load)
    ignored = [_parameter(key, "changes nothing") for key in IGNORED]
    where = f"{WHERE[action.scope]} {action.nodes}"
    return {
        "actionType": kind,
        "actionDescription": f"{action.description}; possible {where}",
        "actionScopes": [action.scope],
        "actionParameters": [load, *ignored],
        "blockingTypes": action.blocking,
        "pauseAllowed": False,
        "cancelAllowed": False,
    }


def _parameter(key: str, description: str, is_optional: bool = True) -> Message:
    """Return what a factsheet says of a parameter, which is a text."""
    return {
        "key": key,
        "valueDataType": "STRING",
        "isOptional": is_optional,
        "description": description,
    }


def _declared_instant(kind: str) -> Message:
    """Return what a factsheet says of an instant action."""
    parameters = []
    if kind == "cancelOrder":
        parameters.append(_parameter("orderId", "fails if the active order is another one"))
    return {
        "actionType": kind,
        "actionDescription": INSTANT[kind],
        "actionScopes": ["INSTANT"],
        "actionParameters": parameters,
        "blockingTypes": ["NONE"],
        "pauseAllowed": False,
        "cancelAllowed": False,
    }
