"""The behaviour of pickers, carriers, their bins, and the tractor.

In the default orchard rows run from x = -35.5 to 34.5 m. A picker is 2.5 m long, a worker 1 m
wide.
"""

import pytest
from local_runs import played
from stage import Acting, Driven, Stage, Standing, empty_orchard, meadow

from orchard.behaviour.walker import tell_where
from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.messages import BinState, Claim, StateRequest
from orchard.field.geometry import Twist
from orchard.field.scenario import NEAREST, People, Scenario
from orchard.plans.route import OneWay


def test_pickers_pick_their_lane_from_its_head_to_its_end():
    # No carrier passes the lane before the row is picked.
    stage = Stage(empty_orchard(dispatch=NEAREST))
    stage.assert_at("picker_01", x=-35.5, y=stage.world.layout.lane(1).y, heading="EAST")
    bin_name = stage.bin_of("picker_01")
    took = stage.run_until(lambda: stage.is_full(bin_name), 80)
    # The row of 70 m, at 1 m/s.
    assert took == pytest.approx(70.0)
    stage.assert_at("picker_01", x=34.5, y=stage.world.layout.lane(1).y, heading="EAST")


def test_pickers_stop_for_an_obstacle_until_it_has_moved():
    """A worker stands at x = 0 in the row of picker_01, and then walks off to the north."""
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 0.0, stage.world.layout.lane(1).y, "NORTH")
    stage.tick()
    stage.run_until(lambda: stage.local.actions["picker_01"].waits_for == "an obstacle ahead", 60)
    stage.run(20)
    assert stage.pose("picker_01")[0] < 0.0
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.world.row_picked[0] == 70.0, 80)
    stage.assert_no_collisions()


def test_pickers_swap_the_full_bin_for_one_of_a_carrier():
    stage = Stage(empty_orchard())
    full = stage.bin_of("picker_01")
    stage.run_until(lambda: stage.is_full(full) and not stage.bin_of("picker_01"), 100)
    # The bin is 2.25 m behind the picker at the end of the row.
    stage.assert_at(full, x=34.5 - 2.25)
    stage.run_until(lambda: bool(stage.bin_of("picker_01")), 200)
    assert stage.bin_of("picker_01") != full
    stage.assert_at("picker_01", x=OneWay.WAITING, heading="EAST")


@pytest.mark.parametrize("speed", [1.0, 0.05])
def test_pickers_ask_for_the_roads_before_they_must_stop(speed):
    """They ask 3 s before they come to their stop line."""
    stage = Stage(
        empty_orchard(pickers=3, carriers=1, row_length=20.0, picking_speed=speed, dispatch=NEAREST)
    )

    def has_claimed_places() -> bool:
        action = stage.local.answers.get("picker_01", Action())
        bodies = [body for _, body in action.requests]
        return any(isinstance(body, Claim) and body.want for body in bodies)

    stage.run_until(has_claimed_places, 500)
    # To the stop line: PICKER_HOLD is its x in rows of 70 m, and `shift` is what this row differs.
    metres = OneWay.PICKER_HOLD + stage.world.layout.shift - stage.pose("picker_01")[0]
    assert metres / speed == pytest.approx(3.0, abs=0.3)


def test_carriers_line_up_in_a_queue_at_the_top_right():
    """For five pickers there are four carriers. The first one stands at the head, y = 24.5 m."""
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
    # It comes from the north, and the worker stands at y = 17 m.
    assert stage.pose("carrier_01")[1] > 17.5, "it waits for as long as the worker stands there"
    stage.assert_no_collisions()


def test_a_carrier_stops_for_a_person_beside_the_bin():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    # In the way of its loop, a metre off the full bin.
    stage.put("worker_01", 33.2, stage.world.layout.lane(1).y - 1.9, "NORTH")
    stage.run(300)
    assert stage.bin_of("picker_01"), "the empty bin was delivered"
    assert stage.is_full("bin_01")
    stage.assert_at("bin_01", x=32.25)
    stage.assert_no_collisions()


class Asker:
    """Asks bin_01 for its state at tick 0, and again at tick 720: the bin is full after 70 s, and
    the picker has left it.
    """

    Memory = dict

    def __init__(self) -> None:
        self.answers: list = []

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        self.answers += [reply.body for reply in mail.replies]
        requests = []
        if seen.tick in (0, 720):
            requests.append(("bin_01", StateRequest()))
        return Action(requests=requests, memory=memory)


def test_bins_tell_whether_they_are_full_and_on_whom():
    """`fill` is in metres of row: 0.1 m after the first tick, and the whole row of 70 m."""
    asker = Asker()
    stage = Stage(
        empty_orchard(people=People(workers=1, visitors=0), dispatch=NEAREST), worker_01=asker
    )
    stage.run(73)
    begun, left = asker.answers
    assert not begun.full
    assert begun.coupled_to == "picker_01"
    assert begun.fill == pytest.approx(0.1), "asked at 0 s, heard at 0.1 s"
    assert left == BinState(full=True, fill=70.0, coupled_to="")


def test_a_bin_without_a_memory_forecasts_by_the_mean_speed():
    """In realtime a process that is killed early has given no memory yet. The bin goes on."""
    local = played(Scenario(rows=3, seed=3), 150)
    del local.memories["bin_01"]
    local.engine.wake(["bin_01"])
    local.tick()
    assert local.answers["bin_01"].state == "picking"


def test_the_tractor_drives_twenty_metres_waits_and_turns_about():
    """It drives on its track, from x = -45 m to -25 m and back, and is loaded for 5 s."""
    stage = meadow(tractor=True)
    stage.assert_at("tractor_01", -45.0, 29.0, "EAST")
    stage.tick()
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded", 30)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    loaded = stage.run_until(lambda: stage.doing("tractor_01") == "turning about", 10)
    assert loaded == pytest.approx(5.0)
    # To turn about it needs 8 s, at 22.5 degrees/s; the wait ended within the first tick of them.
    stage.run(7.9)
    stage.assert_at("tractor_01", x=-25.0, heading="WEST")
    stage.run_until(lambda: stage.doing("tractor_01") == "being unloaded", 30)
    stage.assert_at("tractor_01", -45.0, 29.0, "WEST")


def test_the_tractor_stops_for_an_obstacle_until_it_moves():
    """A worker stands on its track, at x = -35 m, and then walks off to the north."""
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Standing()
    stage.put("worker_01", -35.0, 29.0, "NORTH")
    stage.run(30)
    # Its front, 2.5 m ahead of its middle, is west of the worker, who covers x = -35.5 to -34.5.
    assert stage.pose("tractor_01")[0] + 2.5 < -35.5
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded", 30)
    stage.assert_no_collisions()


def test_the_tractor_does_not_turn_into_what_no_laser_sees():
    """The tractor waits while a person stands where no laser looks."""
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Acting(
        lambda seen, mail, memory: Action(answers=tell_where(seen, mail), memory=memory)
    )
    # Beside its tail when it has come to the east end, x = -25: it would turn its tail there.
    stage.put("worker_01", -27.2, 31.2, "NORTH")
    stage.tick()
    stage.run_until(lambda: stage.local.actions["tractor_01"].waits_for == "worker_01", 60)
    stage.run(20)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    stage.assert_no_collisions()
