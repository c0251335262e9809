"""The behaviour of the tractor."""

import pytest
from quiet_orchards import meadow
from stage import Driven, Standing

from orchard.agents.walker import tell_where
from orchard.contract.agent import Action, Mail, Observation
from orchard.field.geometry import Twist
from orchard.field.scenario import People


def test_the_tractor_drives_twenty_metres_waits_and_turns_about():
    stage = meadow(tractor=True)
    stage.assert_at("tractor_01", -45.0, 29.0, "EAST")
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded" if stage.local.actions else False, 30)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    assert stage.run_until(lambda: stage.doing("tractor_01") == "turning about", 10) == pytest.approx(5.0)
    stage.run(7.9)
    stage.assert_at("tractor_01", x=-25.0, heading="WEST")
    stage.run_until(lambda: stage.doing("tractor_01") == "being unloaded", 30)
    stage.assert_at("tractor_01", -45.0, 29.0, "WEST")


def test_the_tractor_stops_for_an_obstacle_and_waits_for_it_to_move():
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Standing()
    stage.put("worker_01", -35.0, 29.0, "NORTH")
    stage.run(30)
    assert stage.pose("tractor_01")[0] + 2.5 < -35.5
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded", 30)
    stage.assert_no_collisions()


class Told:
    """A person that stands, and answers requests for its position."""

    Memory = dict

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        return Action(answers=tell_where(seen, mail), memory=memory)


def test_the_tractor_does_not_turn_while_somebody_stands_where_no_laser_looks():
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Told()
    stage.put("worker_01", -27.2, 31.2, "NORTH")  # beside its tail, when it has come to the east end
    stage.run_until(lambda: stage.local.actions and stage.local.actions["tractor_01"].waits_for == "worker_01", 60)
    stage.run(20)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    stage.assert_no_collisions()
