"""What a vehicle says of itself, as VDA 5050 writes it: messages without their header, which `line`
adds when it sends them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any, Literal

import msgspec

from orchard import Observation
from orchard.field.kinds import KINDS
from orchard.field.scenario import TIME_STEP
from orchard.roads.actions import ACTIONS, IGNORED, INSTANT, VehicleAction
from orchard.roads.graph import Graph
from orchard.roads.lif import MAP, series
from orchard_vda5050.order import LARGEST, LONGEST_ID, ActionState, Edge, Error, Node, OrderState

Message = dict[str, Any]

BIN, FULL = "empty bin", "full bin"  # types of loads
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
    instant: Sequence[ActionState],
    errors: Sequence[Error],
    waits_for: str,
    graph: Graph,
) -> Message:
    """Return the message `state`.

    `errors`: beside those of orders; `waits_for`: what holds it up, for people.
    """
    nodes, edges = ([], []) if status.is_away else (order.nodes, order.edges)
    last = graph.nodes.get(order.last_node)
    base = [node for node in nodes if node.released]
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
        "newBaseRequest": len(base) < len(nodes) and len(base) <= 1,
        "distanceSinceLastNode": hypot(seen.x - last.x, seen.y - last.y) if last else 0.0,
        "actionStates": msgspec.to_builtins(order.actions),
        "instantActionStates": msgspec.to_builtins(instant),
        "powerSupply": {"stateOfCharge": 100.0 * seen.charge, "charging": status.is_charging},
        "operatingMode": "MANUAL" if status.is_away else "AUTOMATIC",
        "errors": msgspec.to_builtins([*order.errors, *errors]),
        "information": (
            [{"infoType": "waitsFor", "infoLevel": "INFO", "infoDescriptor": waits_for}]
            if waits_for
            else []
        ),
        "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": status.is_blocked},
    }


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


def factsheet_of(kind: str, state_seconds: float) -> Message:
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
            "maximumLoadMass": 0.0,  # the mass of bins is not simulated
            "localizationTypes": ["NATURAL"],
            "navigationTypes": ["VIRTUAL_LINE_GUIDED"],
        },
        "physicalParameters": {
            "minimumSpeed": 0.0,
            "maximumSpeed": body.speed,
            "maximumAngularSpeed": body.turn,
            "maximumAcceleration": body.speed / TIME_STEP,
            "maximumDeceleration": body.speed / TIME_STEP,
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
            "envelopes2d": [
                {"envelope2dId": "alone", "vertices": _box(0.0, body.length, body.width)}
            ]
        },
        "loadSpecification": {
            "loadPositions": ["bar"],
            "loadSets": [_load_set(kind, BIN), _load_set(kind, FULL)],
        },
    }


def _node(node: Node) -> Message:
    at = node.node_position
    position = {"nodePosition": {"x": at.x, "y": at.y, "mapId": at.map_id}} if at else {}
    return {
        "nodeId": node.node_id,
        "sequenceId": node.sequence_id,
        "released": node.released,
    } | position


def _edge(edge: Edge) -> Message:
    return {"edgeId": edge.edge_id, "sequenceId": edge.sequence_id, "released": edge.released}


def _position(seen: Observation) -> Message:
    here = {"x": seen.x, "y": seen.y, "theta": seen.pose.yaw, "mapId": MAP, "localized": True}
    return here | ({"deviationRange": seen.accuracy} if seen.accuracy else {})


def _velocity(seen: Observation) -> Message:
    return {"vx": seen.twist.x, "vy": seen.twist.y, "omega": seen.twist.yaw}


def _loads(kind: str, seen: Observation, is_laden: bool) -> list[Message]:
    load = FULL if is_laden else BIN
    return (
        [{"loadId": seen.hitch.name, "loadType": load, "loadPosition": "bar", **_shape(kind)}]
        if seen.hitch
        else []
    )


def _shape(kind: str) -> Message:
    place, fruit = {"x": -KINDS[kind].tows, "y": 0.0, "z": 0.0}, KINDS["bin"]
    return {
        "boundingBoxReference": place,
        "loadDimensions": {"length": fruit.length, "width": fruit.width, "height": fruit.height},
    }


def _load_set(kind: str, load: str) -> Message:
    return {"setName": load, "loadType": load, "loadPositions": ["bar"], **_shape(kind)}


def _box(x: float, length: float, width: float) -> list[Message]:
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return [{"x": x + a * length / 2, "y": b * width / 2} for a, b in corners]


def _declared(kind: str, action: VehicleAction) -> Message:
    load = {
        "key": "loadId",
        "valueDataType": "STRING",
        "isOptional": not action.needs_load,
        "description": "the name of a bin",
    }
    ignored = [
        {
            "key": key,
            "valueDataType": "STRING",
            "isOptional": True,
            "description": "changes nothing",
        }
        for key in IGNORED
    ]
    return {
        "actionType": kind,
        "actionDescription": (
            f"{action.description}; possible {'at' if action.scope == 'NODE' else 'on the edge to'}"
            f" {action.nodes}"
        ),
        "actionScopes": [action.scope],
        "actionParameters": [load, *ignored],
        "blockingTypes": action.blocking,
        "pauseAllowed": False,
        "cancelAllowed": False,
    }


def _declared_instant(kind: str) -> Message:
    order = [
        {
            "key": "orderId",
            "valueDataType": "STRING",
            "isOptional": True,
            "description": "fails if the active order is another one",
        }
    ]
    return {
        "actionType": kind,
        "actionDescription": INSTANT[kind],
        "actionScopes": ["INSTANT"],
        "actionParameters": order if kind == "cancelOrder" else [],
        "blockingTypes": ["NONE"],
        "pauseAllowed": False,
        "cancelAllowed": False,
    }
