"""The map and the descriptions of robots agree with the Orchard's own documents, and with the Orchard itself."""

import json
import os
import re
import subprocess
from array import array
from pathlib import Path
from xml.etree import ElementTree

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orchard_ros2 import bodies, field, topics

ROOT = Path(__file__).parents[3]
WALLS = """
import json, sys
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
print(json.dumps([lay_out(Scenario(**scenario)).walls.tolist() for scenario in json.loads(sys.argv[1])]))
"""
coordinates = st.floats(-60.0, 60.0)
halves = st.floats(0.05, 20.0)


def rows_of(document, heading):
    """The cells of the first table below a heading."""
    table = re.search(r"\n\|.*?\n\n", (ROOT / document).read_text().split(f"\n## {heading}\n")[1], re.S)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[0].strip().splitlines()[2:]]


def test_each_kind_is_as_keyspace_says():
    for name, size, _, _, _, ahead, tows, *_ in rows_of("keyspace.md", "The robots"):
        kind = bodies.KINDS[name]
        assert [kind.length, kind.width] == [float(number) for number in size.split(" x ")]
        assert (kind.laser_ahead, kind.tows) == (float(ahead), 0.0 if tows == "-" else float(tows))


def test_each_kind_has_the_height_and_the_colour_of_the_reference():
    rows = rows_of("docs/reference.md", "The things in it")
    assert [row[0] for row in rows] == list(bodies.KINDS)
    for name, size, colour, *_ in rows:
        assert bodies.KINDS[name].height == float(size.split(" x ")[2])
        assert bodies.KINDS[name].colour == tuple(map(int, colour.split(", ")))


def test_the_laser_is_as_high_as_the_scan_plane():
    assert f"The scan plane is {topics.LASER_HEIGHT} m above the ground" in (ROOT / "docs/reference.md").read_text()


@pytest.mark.parametrize("kind", bodies.KINDS)
def test_a_description_has_the_frames_and_the_box_of_its_body(kind):
    name = f"{kind}_07"
    robot = ElementTree.fromstring(bodies.description(name))
    assert [link.get("name") for link in robot.findall("link")] == [topics.base_link(name), topics.laser(name)]
    size = [float(number) for number in robot.find("link/collision/geometry/box").get("size").split()]
    assert size == list(bodies.KINDS[kind][:3])
    assert robot.find("joint/origin").get("xyz").split()[0] == str(bodies.KINDS[kind].laser_ahead)


def test_robots_are_named_or_of_a_named_kind():
    names = ["bin_01", "picker_01", "picker_02"]
    assert bodies.selected(names, ["picker_02", "bin"]) == ["bin_01", "picker_02"]
    with pytest.raises(ValueError, match="picker_03, tree: no such body"):
        bodies.selected(names, ["picker_03", "picker", "tree"])


@pytest.mark.skipif("ORCHARD_PYTHON" not in os.environ, reason="ORCHARD_PYTHON: the Python of the Orchard")
def test_the_walls_are_those_of_the_orchard():
    scenarios = [{}, {"rows": 20, "row_width": 7.25}, {"row_length": 101.0, "pickers": 3}]
    told = subprocess.run([os.environ["ORCHARD_PYTHON"], "-c", WALLS, json.dumps(scenarios)], capture_output=True, check=True, cwd=ROOT)
    usual = {"rows": 5, "row_width": 5.0, "row_length": 70.0}
    for scenario, walls in zip(scenarios, json.loads(told.stdout), strict=True):
        assert numpy.allclose(sorted(field.walls_of(usual | scenario)), sorted(walls), atol=1e-9)


@given(walls=st.lists(st.tuples(coordinates, coordinates, halves, halves), min_size=1, max_size=4), x=coordinates, y=coordinates)
def test_a_cell_is_occupied_where_a_wall_is(walls, x, y):
    """And none is further than a cell away from one."""
    grid = field.grid_of(walls).fields
    info, cells = grid["info"].fields, grid["data"]
    corner = info["origin"].fields["position"].fields
    column, row = int((x - corner["x"]) // field.RESOLUTION), int((y - corner["y"]) // field.RESOLUTION)
    assert len(cells) == info["width"] * info["height"] and isinstance(cells, array)
    if not (0 <= column < info["width"] and 0 <= row < info["height"]):
        return
    off = min(max(abs(x - wall[0]) - wall[2], abs(y - wall[1]) - wall[3]) for wall in walls)
    is_occupied = cells[row * info["width"] + column] == field.OCCUPIED
    assert is_occupied or off > -1e-3
    assert not is_occupied or off < field.RESOLUTION + 1e-3
