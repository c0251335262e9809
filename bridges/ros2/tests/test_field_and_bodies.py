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
SLACK = 1e-3  # m, for points on the border of a cell


def test_the_laser_is_as_high_as_the_scan_plane():
    reference = (ROOT / "docs/reference.md").read_text()
    assert f"The scan plane is {topics.LASER_HEIGHT} m above the ground" in reference


def test_a_description_has_the_frames_and_the_box_of_its_body():
    """A red box of 2.5 x 1.5 x 1 m with its laser 1.25 m ahead of its centre."""
    urdf = bodies.description("picker_07", (2.5, 1.5, 1.0), (255, 0, 0), 1.25)
    robot = ElementTree.fromstring(urdf)
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
    # There is no tractor in this run; its kind may be named all the same.
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
    """The cell of a point in a wall is occupied, and no occupied cell is further than a cell away
    from a wall.
    """
    grid = field.grid_of(walls).fields
    info = grid["info"].fields
    cells = grid["data"]
    assert isinstance(cells, array)
    assert len(cells) == info["width"] * info["height"]
    corner = info["origin"].fields["position"].fields
    column = int((x - corner["x"]) // field.RESOLUTION)
    row = int((y - corner["y"]) // field.RESOLUTION)
    is_on_map = 0 <= column < info["width"] and 0 <= row < info["height"]
    if not is_on_map:
        return
    # Metres from the point to the nearest wall, along x or y; below 0 in a wall.
    distance = min(
        max(abs(x - middle_x) - half_x, abs(y - middle_y) - half_y)
        for middle_x, middle_y, half_x, half_y in walls
    )
    is_occupied = cells[row * info["width"] + column] == field.OCCUPIED
    if is_occupied:
        assert distance < field.RESOLUTION + SLACK
    else:
        assert distance > -SLACK
