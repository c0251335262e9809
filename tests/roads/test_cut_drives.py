"""Drives are cut where a vehicle may have to wait: the parts of one, and what they give back.

orchard/roads makes a map of roads for fleet control, of nodes and edges. A drive of a plan has
gates: points before which the robot must get places on the roads (`needs`), or behind which it
gives them back (`frees`). It may have to stand at each gate, so the map has a node there.
"""

from itertools import pairwise

import pytest

from orchard.field.geometry import Pose
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo
from orchard.roads.graph import BAY, _parts
from orchard.roads.pickers import graphs_of


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_drive_is_cut_at_the_gates_ahead_of_it(direction):
    """The drive leads from 0 m to 10 m, to the east or the west, and is cut at 4 m.

    Each gate belongs to one part. Gates beyond the end belong to none, and needs behind the start
    neither: the robot asks for nothing there any more.
    """

    def gates(**places: float) -> list[Gate]:
        """Return gates: the name of a place, and how far along the drive its gate is, m."""
        return [Gate([place], direction * at) for place, at in places.items()]

    drive = DriveTo(
        x=direction * 10.0,
        needs=gates(behind=-2.0, start=0.0, middle=4.0, end=10.0),
        frees=gates(left=-1.0, before=3.0, there=4.0, after=5.0, reached=10.0, beyond=11.0),
    )
    (first, waits_for), (second, waits_no_more) = _parts(drive, Pose(0.0, 7.0, 0.0))
    assert waits_for == "middle"
    assert first.x == direction * 4.0
    assert first.needs == gates(start=0.0)
    assert first.frees == gates(left=-1.0, before=3.0, there=4.0)
    assert waits_no_more == ""
    assert second.x == direction * 10.0
    assert second.needs == gates(middle=4.0)
    assert second.frees == gates(after=5.0, reached=10.0)


def test_a_drive_without_gates_stays_whole():
    drive = DriveTo(y=-3.0)
    assert list(_parts(drive, Pose(1.0, 2.0, 0.0))) == [(drive, "")]


@pytest.mark.parametrize("bays", [1, 2, 3])
def test_a_map_has_each_place_of_the_bay(bays):
    """They lie one behind the other, 4.1 m apart (`CLOSED_UP`), and carriers from outside come to
    the last one first.
    """
    carriers = graphs_of(lay_out(Scenario(rows=3, bays=bays)))[0]
    assert carriers.kind == "carrier"
    places = [BAY, "bay/2", "bay/3"][:bays]
    assert carriers.stations[BAY] == tuple(places)
    for ahead, behind in pairwise(places):
        assert carriers.nodes[ahead].x - carriers.nodes[behind].x == pytest.approx(4.1)
        assert carriers.edges[behind, ahead].length == pytest.approx(4.1)
    from_outside = {end for start, end in carriers.edges if start not in places}
    assert from_outside.intersection(places) == {places[-1]}
