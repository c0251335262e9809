"""The roads of an orchard as a track layout in the Layout Interchange Format (LIF) of the VDMA,
which fleet control imports.

Keys are those of LIF. A vehicle type is a kind of robot here, a carrier or a picker.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from orchard.roads.actions import ACTIONS
from orchard.roads.graph import BAY, Edge, Graph, Node

# Of LIF.
VERSION = "1.0.0"
# The mapId of all nodes.
MAP = "orchard"
# The greatest speed that a map names for all edges, m/s: that of the manual's robots.
SPEED = 1.0


def lif_of(graphs: Sequence[Graph], creator: str, made_at: str) -> dict[str, Any]:
    """Return the track layout of several kinds of vehicles, as JSON has it.

    `graphs`: the roads of each kind. `creator`: the program that exports it; `made_at`: when, ISO
    8601.
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
        for name, station_nodes in graph.stations.items():
            stations.append(_station(name, station_nodes))
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
    """Return a node of a kind of vehicle, with the actions that are possible there."""
    properties = {"vehicleTypeId": series(vehicle)} | _actions(vehicle, "NODE", node.name)
    return {
        "nodeId": node.name,
        "mapId": MAP,
        "nodePosition": {"x": node.x, "y": node.y},
        "vehicleTypeNodeProperties": [properties],
    }


def _actions(vehicle: str, scope: str, node: str) -> dict[str, Any]:
    """Return the entry `actions` of a node, or of an edge to it; no entry if none is possible.

    `scope`: 'NODE' or 'EDGE'.
    """
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
    """Return an edge of a kind of vehicle: it drives ahead along it, and turns only at its ends."""
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
    """Return a station. The first part of its name says what it is: "queue/1", "row/3"."""
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
