"""The behaviour of carriers."""

from stage import Stage, Standing, empty_orchard

from orchard.agents.route import OneWay
from orchard.field.scenario import People


def test_carriers_line_up_in_a_queue_at_the_top_right():
    stage = Stage(empty_orchard(rows=5, pickers=5))
    xs = [stage.pose(f"carrier_0{i}")[0] for i in (1, 2, 3, 4)]
    assert xs[0] == stage.world.layout.queue.head
    assert xs == sorted(xs, reverse=True)
    stage.run(5)
    stage.assert_at("carrier_01", stage.world.layout.queue.head, 24.5, "EAST")


def test_carriers_stop_for_an_obstacle_on_the_road():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", OneWay.D_ROAD, 17.0, "NORTH")
    stage.run(120)
    assert stage.pose("carrier_01")[1] > 17.5, "it waits for as long as the worker stands there"
    stage.assert_no_collisions()


def test_carriers_bring_the_full_bin_to_the_driveway_and_come_back_to_the_queue():
    stage = Stage(empty_orchard())
    stage.run_until(lambda: stage.world.delivered == 1, 500)
    unloader = stage.happened("unloaded")[0]
    carrier = next(n for n in stage.world.layout.names if n.startswith("carrier") and stage.bin_of(n) == unloader.who)
    assert 23.5 < stage.pose(carrier)[1] < 25.5
    assert stage.world.fill[stage.world.index[unloader.who]] == 0.0
    stage.run_until(lambda: stage.doing(carrier) == "waiting in the queue", 200)


def test_a_carrier_at_work_stops_for_a_person_beside_the_bin_that_it_ignores():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 33.2, stage.world.layout.lane(1).y - 1.9, "NORTH")  # in the way of its loop, a metre off the full bin
    stage.run(300)
    assert stage.bin_of("picker_01"), "the empty bin was delivered"
    assert stage.is_full("bin_01")
    stage.assert_at("bin_01", x=32.25)
    stage.assert_no_collisions()
