"""The behaviour of weeds."""

import pytest
from stage import Driven, Stage, Standing, empty_orchard

from orchard.field.geometry import Twist
from orchard.field.scenario import People


def test_weeds_disappear_when_something_moves_within_a_metre():
    stage = Stage(empty_orchard(weeds=1, people=People(workers=1, visitors=0)), worker_01=Driven(Twist(x=1.0)))
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -6.0, 21.5)  # passes with 0.75 m between their edges
    stage.run_until(lambda: not stage.world.alive[stage.world.index["weed_01"]], 20)
    assert -2.0 < stage.pose("worker_01")[0] < -0.5


def test_weeds_stay_for_what_stands_still_or_passes_further_off():
    stage = Stage(empty_orchard(weeds=2, people=People(workers=2, visitors=0)), worker_01=Driven(Twist(x=1.0)), worker_02=Standing())
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -6.0, 22.0)  # 1.25 m
    stage.put("weed_02", 20.0, 19.0)
    stage.put("worker_02", 20.0, 20.0)
    stage.run(12)
    assert stage.world.alive[[stage.world.index["weed_01"], stage.world.index["weed_02"]]].all()


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("speed", "y"), [(1.0, 21.5), (1.0, 21.7), (0.3, 21.5)])
def test_noise_hides_nothing_that_passes_from_a_weed(speed, y, seed):
    """However slowly it passes, and with up to 0.95 m between their edges: it comes at most 0.3 m further than without noise."""
    at = [x_of_passer(noise, speed, y, seed) for noise in (0.0, 0.02)]
    assert abs(at[0] - at[1]) <= 0.3


def x_of_passer(noise, speed, y, seed) -> float:
    """Return the x at which a worker that drives east flattens the weed at (0, 20)."""
    orchard = empty_orchard(weeds=1, people=People(workers=1, visitors=0), laser={"noise": noise}, seed=seed)
    stage = Stage(orchard, worker_01=Driven(Twist(x=speed)))
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -3.0, y)
    stage.run_until(lambda: not stage.world.alive[stage.world.index["weed_01"]], 6.0 / speed)
    return float(stage.pose("worker_01")[0])
