"""The behaviour of workers and visitors."""

import pytest
from quiet_orchards import one_guest


@pytest.mark.parametrize("kind", ["worker", "visitor"])
def test_people_walk_straight_on_where_nothing_is_in_their_path(kind):
    stage = one_guest(kind, -20.0, 20.0)
    stage.run(20)
    stage.assert_at(f"{kind}_01", 0.0, 20.0, "EAST")


@pytest.mark.parametrize("kind", ["worker", "visitor"])
def test_people_turn_away_from_an_obstacle_and_walk_on_in_the_new_direction(kind):
    stage = one_guest(kind, 42.0, 8.0)  # towards the east fence
    stage.run(60)
    assert stage.world.distance[stage.world.index[f"{kind}_01"]] > 40
    assert stage.world.collisions.sum() == 0
