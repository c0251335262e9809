"""Free roads: harvests of the event model in which no robot is in another's way.

Limits and proofs of a harvest are computed with them.
"""

from quiet import quiet_layouts

from orchard.event_model.harvest import EventHarvest


def test_no_robot_waits_for_places_on_free_roads() -> None:
    """Each robot has roads of its own, and wishes for no place of them."""
    (layout,) = quiet_layouts(seed=31, count=1)
    harvest = EventHarvest(layout, free_roads=True).run()
    assert len(set(harvest.model.robots.roads)) == len(harvest.names)
    assert not harvest.model.robots.wish.any()
