"""The roads as nodes and edges, and as a LIF map that others read."""

import pytest
from vdma_lif.models import LIFLayoutCollection

from orchard import Carrier, Picker, Scenario, lay_out
from orchard.roads.graph import BAY, graph_of
from orchard.roads.lif import lif_of
from orchard.roads.pickers import graph_of_pickers

LAYOUT = lay_out(Scenario(rows=4, pickers=2))
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


def test_every_node_has_a_way_to_the_bay_and_to_every_line(graph):
    """Every node has a way to the bay and to every line of the queue."""
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
        assert edge.length > 0.0 and (
            start.x == pytest.approx(end.x) or start.y == pytest.approx(end.y)
        )


@pytest.mark.parametrize("route", ["two-way", "one-way"])
def test_pickers_can_drive_through_all_their_rows_and_park(route):
    layout = lay_out(Scenario(rows=12, pickers=5, route=route, rows_to_pickers="balanced-ends"))
    graph = graph_of_pickers(layout, Picker(layout, "picker_01").route)
    for block in layout.blocks.values():
        for row in block.rows:
            begins_here = row == block.rows[0] and block.start == "west"
            start = f"west/in/{row}" if begins_here else f"{block.start}/wait/{row}"
            for end in ("west/park", "east/park"):
                assert graph.way(start, [f"{end}/{block.rows[-1]}"])


def test_others_read_the_map(graph):
    pickers = graph_of_pickers(LAYOUT, Picker(LAYOUT, "picker_01").route)
    lif = lif_of([graph, pickers], "test", "2026-01-01T00:00:00.00Z")
    (layout,) = LIFLayoutCollection.from_dict(lif).to_dict()["layouts"]
    assert layout == lif["layouts"][0]
    nodes = {node["nodeId"] for node in layout["nodes"]}
    for station in layout["stations"]:
        assert set(station["interactionNodeIds"]) <= nodes
    for edge in layout["edges"]:
        assert {edge["startNodeId"], edge["endNodeId"]} <= nodes
