"""The behaviour of weeds."""

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
