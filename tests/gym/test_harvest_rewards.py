"""The rewards of the environments in which bodies of a harvest learn."""

import math

import numpy as np
import pytest
from learning_orchards import SMALL
from msgspec.structs import replace

from orchard.behaviour.carrier import CarrierMemory
from orchard.field.geometry import STILL
from orchard.field.scenario import Scenario
from orchard.gym import REWARDS, Moment, single_env
from orchard.gym.spaces import goal_of
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo


def follow(reward, name, ticks, command=lambda info: info["scripted"]):
    """Let a body of the small orchard move for some ticks as `command` says of each info.

    Return the rewards of all steps, and the world. By default it moves as its own agent.
    """
    env = single_env(SMALL, name, reward=reward)
    _, info = env.reset()
    rewards = []
    for _ in range(ticks):
        _, earned, *_, info = env.step(command(info))
        rewards.append(earned)
    return rewards, env.local.engine.world


# A reward, the body, ticks; what it must sum up to, of the world and the body's index; and the
# metres that it comes to at least, so that it counts something.
COUNTED = [
    ("picking", "picker_01", 300, lambda world, i: world.fill[world.coupled[i]], 20.0),
    ("goal", "tractor_01", 100, lambda world, i: world.distance[i], 5.0),
]


@pytest.mark.parametrize(("reward", "name", "ticks", "counted", "least"), COUNTED)
def test_picking_counts_own_metres_and_goal_those_on_the_way(reward, name, ticks, counted, least):
    """Picking counts the metres of row in the picker's own bin, goal those on the way."""
    rewards, world = follow(reward, name, ticks)
    assert sum(rewards) == pytest.approx(counted(world, world.index[name]))
    assert sum(rewards) > least


@pytest.mark.parametrize(
    ("gate_at", "reserved", "end"),
    [(15.0, [], 15.0), (15.0, ["F"], 20.0), (5.0, [], 20.0)],
    ids=["closed", "open", "behind the robot"],
)
def test_the_goal_of_a_drive_is_the_first_closed_gate_ahead(gate_at, reserved, end):
    """A robot at x = 10 drives to x = 20. A gate that it has passed does not count."""
    env = single_env(Scenario(), "carrier_01")
    env.reset()
    seen = replace(env.local.seen["carrier_01"], x=10.0, y=2.0)
    drive = DriveTo(x=20.0, needs=[Gate(["F"], gate_at)])
    assert goal_of(seen, CarrierMemory(plan=[drive], reserved=reserved)) == (end, 2.0, 0.0)


@pytest.mark.parametrize(("yaw", "reward"), [(0.5, 0.5), (-0.5, -0.5), (2.0, 0.0)])
def test_goal_counts_radians_towards_the_heading(yaw, reward):
    """A picker that is to turn to the left by 1 rad has turned there, away, or too far."""
    env = single_env(Scenario(), "picker_01")
    env.reset()
    # An orientation is (sin, cos) of half the yaw.
    before = replace(env.local.seen["picker_01"], orientation=(0.0, 1.0))
    after = replace(before, orientation=(math.sin(yaw / 2), math.cos(yaw / 2)))
    goal = (before.x, before.y, 1.0)
    moment = Moment(before, after, goal, velocity=STILL, scripted=STILL, filled=0.0, events=[])
    assert REWARDS["goal"](moment) == pytest.approx(reward)


def test_imitation_is_best_for_our_agent():
    """It is 0 at the velocity of our agent, and less at any other one."""
    assert set(follow("imitation", "picker_01", 20)[0]) == {0.0}
    assert max(follow("imitation", "picker_01", 20, lambda info: np.array([-1.0, 0.0]))[0]) < 0.0


def test_care_counts_collisions():
    """At full speed in a curve the picker leaves its row, and drives into trees."""
    rewards, world = follow("care", "picker_01", 200, lambda info: np.array([1.0, 0.3]))
    collisions = world.collisions[world.index["picker_01"]]
    assert collisions > 0
    assert sum(rewards) == -collisions


def test_a_reward_may_be_a_function_of_ones_own():
    """At 1 m/s a body drives 0.1 m in a tick."""
    rewards, _ = follow(
        lambda moment: moment.after.x - moment.before.x,
        "picker_01",
        10,
        lambda info: np.array([1.0, 0.0]),
    )
    assert rewards == pytest.approx([0.1] * 10)
