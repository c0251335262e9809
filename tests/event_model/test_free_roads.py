"""Roads on which no robot is in another's way."""

from quiet import quiet_layouts

from orchard.event_model.harvest import EventHarvest

LAYOUTS = list(quiet_layouts(seed=31, count=30))


def test_no_robot_waits_for_places_on_free_roads() -> None:
    harvest = EventHarvest(LAYOUTS[0], free_roads=True).run()
    assert len(set(harvest.model.robots.roads)) == len(harvest.names)
    assert not harvest.model.robots.wish.any()
