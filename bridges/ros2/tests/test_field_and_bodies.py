"""The map and the descriptions of robots."""

from array import array
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from orchard_ros2.plain import bodies, field, topics

ROOT = Path(__file__).parents[3]
coordinates = st.floats(-60.0, 60.0)
halves = st.floats(0.05, 20.0)


def test_the_laser_is_as_high_as_the_scan_plane():
    assert (
        f"The scan plane is {topics.LASER_HEIGHT} m above the ground"
        in (ROOT / "docs/reference.md").read_text()
    )


def test_a_description_has_the_frames_and_the_box_of_its_body():
    robot = ElementTree.fromstring(
        bodies.description("picker_07", (2.5, 1.5, 1.0), (255, 0, 0), 1.25)
    )
    assert [link.get("name") for link in robot.findall("link")] == [
        topics.base_link("picker_07"),
        topics.laser("picker_07"),
    ]
    assert robot.find("link/collision/geometry/box").get("size") == "2.5 1.5 1.0"
    assert robot.find("link/visual/origin").get("xyz") == "0 0 0.5"
    assert robot.find("link/visual/material/color").get("rgba") == "1.000 0.000 0.000 1"
    assert robot.find("joint/origin").get("xyz") == "1.25 0 0.2"


def test_robots_are_named_or_of_a_named_kind():
    names = ["bin_01", "picker_01", "picker_02"]
    kinds = "bin", "picker", "tractor"
    assert bodies.selected(["picker_02", "bin", "tractor"], names, kinds) == ["bin_01", "picker_02"]
    with pytest.raises(
        ValueError,
        match="picker_03, tree: no such body or kind; there are bin_01, picker_01, picker_02",
    ):
        bodies.selected(["picker_03", "picker", "tree"], names, kinds)


@given(
    walls=st.lists(st.tuples(coordinates, coordinates, halves, halves), min_size=1, max_size=4),
    x=coordinates,
    y=coordinates,
)
def test_a_cell_is_occupied_where_a_wall_is(walls, x, y):
    """And none is further than a cell away from one."""
    grid = field.grid_of(walls).fields
    info, cells = grid["info"].fields, grid["data"]
    corner = info["origin"].fields["position"].fields
    column, row = (
        int((x - corner["x"]) // field.RESOLUTION),
        int((y - corner["y"]) // field.RESOLUTION),
    )
    assert len(cells) == info["width"] * info["height"] and isinstance(cells, array)
    if not (0 <= column < info["width"] and 0 <= row < info["height"]):
        return
    off = min(max(abs(x - wall[0]) - wall[2], abs(y - wall[1]) - wall[3]) for wall in walls)
    is_occupied = cells[row * info["width"] + column] == field.OCCUPIED
    assert is_occupied or off > -1e-3
    assert not is_occupied or off < field.RESOLUTION + 1e-3
