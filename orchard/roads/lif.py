"""The roads of an orchard as a track layout in the Layout Interchange Format (LIF) of the VDMA,
which fleet control imports.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from orchard.roads.actions import ACTIONS
from orchard.roads.graph import BAY, Edge, Graph, Node

VERSION = "1.0.0"
MAP = "orchard"  # the mapId of all nodes
SPEED = 1.0  # m/s


def lif_of(graphs: Sequence[Graph], creator: str, made_at: str) -> dict[str, Any]:
    """Return the layout of what several kinds of vehicles drive on.

    `creator`: the program that exports it; `made_at`: when, ISO 8601.
    """
    meta = {
        "projectIdentification": MAP,
        "creator": creator,
        "exportTimestamp": made_at,
        "lifVersion": VERSION,
    }
    nodes = []
    edges = []
    stations = []
    for graph in graphs:
        nodes += [_node(graph.kind, node) for node in graph.nodes.values()]
        edges += [_edge(graph.kind, edge) for edge in graph.edges.values()]
        for name, of_station in graph.stations.items():
            stations.append(_station(name, of_station))
    layout = {
        "layoutId": MAP,
        "layoutName": "the roads of the orchard",
        "layoutVersion": "1",
        "nodes": nodes,
        "edges": edges,
        "stations": stations,
    }
    return {"metaInformation": meta, "layouts": [layout]}


def series(kind: str) -> str:
    """Return the vehicleTypeId of a kind of vehicle, which its factsheet names too."""
    return f"orchard-{kind}"


def edge_id(edge: Edge) -> str:
    """Return the name of an edge in maps and orders."""
    return f"{edge.start}>{edge.end}"


def _node(vehicle: str, node: Node) -> dict[str, Any]:
    properties = {"vehicleTypeId": series(vehicle)} | _actions(vehicle, "NODE", node.name)
    return {
        "nodeId": node.name,
        "mapId": MAP,
        "nodePosition": {"x": node.x, "y": node.y},
        "vehicleTypeNodeProperties": [properties],
    }


def _actions(vehicle: str, scope: str, node: str) -> dict[str, Any]:
    """The actions that are possible at a node, or on an edge to it."""
    actions = []
    for kind, action in ACTIONS[vehicle].items():
        if action.scope == scope and action.is_done_at(node):
            actions.append(
                {
                    "actionType": kind,
                    "requirementType": "OPTIONAL",
                    "blockingType": action.blocking[0],
                }
            )
    if not actions:
        return {}
    return {"actions": actions}


def _edge(vehicle: str, edge: Edge) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "vehicleTypeId": series(vehicle),
        "vehicleOrientation": 0.0,
        "orientationType": "TANGENTIAL",
        "rotationAllowed": False,
        "rotationAtStartNodeAllowed": "BOTH",
        "rotationAtEndNodeAllowed": "BOTH",
        "maxSpeed": SPEED,
        "reentryAllowed": False,
    } | _actions(vehicle, "EDGE", edge.end)
    return {
        "edgeId": edge_id(edge),
        "startNodeId": edge.start,
        "endNodeId": edge.end,
        "vehicleTypeEdgeProperties": [properties],
    }


def _station(name: str, nodes: Iterable[str]) -> dict[str, Any]:
    descriptions = {
        BAY: "the bay, where full bins are unloaded",
        "queue": "a line of the queue",
        "row": "a row, and the places at its ends",
    }
    return {
        "stationId": name,
        "stationDescription": descriptions.get(name.split("/")[0], "the end of a row"),
        "interactionNodeIds": list(nodes),
    }
