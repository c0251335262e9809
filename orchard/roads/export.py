"""Writes the roads of an orchard into a file, as a map for fleet control: `orchard layout export
--lif`.
"""

import json
from datetime import UTC, datetime
from pathlib import Path

from orchard.field.layout import Layout
from orchard.folders import write_whole
from orchard.roads.lif import lif_of
from orchard.roads.pickers import graphs_of
from orchard.terminal.files import KindOfFile

# The maker that a map names.
CREATOR = "the Orchard"
# How a file begins that this command may replace: a map that it has written itself.
MAP = KindOfFile("a map", rb'\{\n "metaInformation": \{.*"creator": "the Orchard"')


def export_map(layout: Layout, file: Path) -> str:
    """Write a map in LIF, in place of an old one. Return what is in it, in words.

    Raises OSError.
    """
    graphs = graphs_of(layout)
    made_at = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    text = json.dumps(lif_of(graphs, CREATOR, made_at), indent=1) + "\n"
    write_whole(file, text.encode())
    nodes = sum(len(graph.nodes) for graph in graphs)
    edges = sum(len(graph.edges) for graph in graphs)
    return f"{nodes} nodes, {edges} edges"
