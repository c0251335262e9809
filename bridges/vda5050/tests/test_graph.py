"""The roads as nodes and edges, and as a LIF map that others read."""

import pytest
from orchard_vda5050.graph import BAY, graph_of
from orchard_vda5050.lif import lif_of
from vdma_lif.models import LIFLayoutCollection

from orchard import Carrier, Scenario, lay_out

SCENARIOS = [
    {"rows": 3, "pickers": 2},
    {"rows": 12, "carriers": 14},
    {"rows": 6, "route": "one-way"},
    {"rows": 12, "carriers": 14, "route": "one-way"},
    {"rows": 6, "carrying": {"battery": {"hours": 5}}, "chargers": 2},
]


@pytest.fixture(params=SCENARIOS, ids=str)
def graph(request):
    layout = lay_out(Scenario(**request.param))
    return graph_of(layout, Carrier(layout, "carrier_01").route)


def test_every_node_has_a_way_to_the_bay_and_to_every_line_of_the_queue(graph):
    for name in graph.nodes:
        assert (graph.way(name, [BAY]) or [name])[-1] == BAY
        for line in graph.lines:
            assert (graph.way(name, [line]) or [name])[-1] == line


def test_from_every_line_there_is_a_way_to_every_station(graph):
    for line in graph.lines:
        for nodes in graph.stations.values():
            for node in nodes:
                assert (graph.way(line, [node]) or [line])[-1] == node


def test_an_edge_is_one_straight_drive(graph):
    for edge in graph.edges.values():
        start, end = graph.nodes[edge.start], graph.nodes[edge.end]
        assert edge.length > 0.0 and (start.x == pytest.approx(end.x) or start.y == pytest.approx(end.y))


def test_others_read_the_map(graph):
    lif = lif_of(graph, "test", "2026-01-01T00:00:00.00Z")
    (layout,) = LIFLayoutCollection.from_dict(lif).to_dict()["layouts"]
    assert layout == lif["layouts"][0]
    nodes = {node["nodeId"] for node in layout["nodes"]}
    assert {name for station in layout["stations"] for name in station["interactionNodeIds"]} <= nodes
    assert {edge[end] for edge in layout["edges"] for end in ("startNodeId", "endNodeId")} <= nodes
