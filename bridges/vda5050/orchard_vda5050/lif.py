"""The roads of an orchard as a track layout in the Layout Interchange Format (LIF) of the VDMA, which fleet control imports."""

from typing import Any

from orchard_vda5050.actions import ACTIONS
from orchard_vda5050.graph import BAY, Edge, Graph, Node

VERSION = "1.0.0"
MAP = "orchard"  # the mapId of all nodes
SERIES = "orchard-carrier"  # the vehicleTypeId
SPEED = 1.0  # m/s


def lif_of(graph: Graph, creator: str, made_at: str) -> dict[str, Any]:
    """Return the layout. `creator`: who exports it; `made_at`: when, ISO 8601."""
    meta = {"projectIdentification": MAP, "creator": creator, "exportTimestamp": made_at, "lifVersion": VERSION}
    layout = {
        "layoutId": MAP,
        "layoutName": "the roads of the orchard",
        "layoutVersion": "1",
        "nodes": [_node(graph, node) for node in graph.nodes.values()],
        "edges": [_edge(edge) for edge in graph.edges.values()],
        "stations": [_station(graph, name) for name in graph.stations],
    }
    return {"metaInformation": meta, "layouts": [layout]}


def edge_id(edge: Edge) -> str:
    """Return the name of an edge in maps and orders."""
    return f"{edge.start}>{edge.end}"


def _node(graph: Graph, node: Node) -> dict[str, Any]:
    actions = [
        {"actionType": kind, "requirementType": "OPTIONAL", "blockingType": "HARD"}
        for kind, action in ACTIONS.items()
        if action.is_done_at(node.name)
    ]
    properties = {"vehicleTypeId": SERIES} | ({"actions": actions} if actions else {})
    return {
        "nodeId": node.name,
        "mapId": MAP,
        "nodePosition": {"x": node.x, "y": node.y},
        "vehicleTypeNodeProperties": [properties],
    }


def _edge(edge: Edge) -> dict[str, Any]:
    properties = {
        "vehicleTypeId": SERIES,
        "vehicleOrientation": 0.0,
        "orientationType": "TANGENTIAL",
        "rotationAllowed": False,
        "rotationAtStartNodeAllowed": "BOTH",
        "rotationAtEndNodeAllowed": "BOTH",
        "maxSpeed": SPEED,
        "reentryAllowed": False,
    }
    return {"edgeId": edge_id(edge), "startNodeId": edge.start, "endNodeId": edge.end, "vehicleTypeEdgeProperties": [properties]}


def _station(graph: Graph, name: str) -> dict[str, Any]:
    nodes = graph.stations[name]
    what = {BAY: "the bay, where full bins are unloaded", "queue": "a line of the queue"}.get(name.split("/")[0], "the end of a row")
    return {"stationId": name, "stationDescription": what, "interactionNodeIds": list(nodes)}
