"""The environments in which bodies of a harvest learn: the interfaces' own checks, the same motion
as local mode, episodes, deeds, copies.

At each tick the bodies that learn get a velocity, and all others follow their agents. `info` has
the velocity that the body's own agent wants (`scripted`).
"""

from copy import deepcopy

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from learning_orchards import LEARNED, SMALL, TINY
from msgspec.structs import replace
from pettingzoo.test import parallel_api_test, parallel_seed_test

from orchard.contract.messages import Couple, PickFrom, Uncouple
from orchard.field.geometry import Twist
from orchard.field.problems import ScenarioError
from orchard.field.scenario import with_changes
from orchard.gym import REWARDS, DispatchEnv, dispatch_env, parallel_env, single_env
from orchard.local import Local

MAKERS = [
    lambda: single_env(SMALL, "carrier_01"),
    lambda: parallel_env(SMALL, LEARNED),
    lambda: dispatch_env(SMALL),
]


# With `longest` 15 episodes of 15 ticks end within the 60 cycles.
@pytest.mark.parametrize("options", [{}, {"deeds": True}, {"longest": 15}], ids=str)
def test_pettingzoo_finds_no_fault_in_the_environment(options):
    parallel_api_test(parallel_env(SMALL, LEARNED, **options), num_cycles=60)


def test_pettingzoo_finds_that_seeds_are_followed():
    parallel_seed_test(lambda: parallel_env(SMALL, LEARNED, deeds=True), num_cycles=40)


# Gymnasium would have actions from -1 to 1. Here they are velocities, and a dog runs at 3 m/s.
@pytest.mark.filterwarnings("ignore:.*normalized space")
@pytest.mark.parametrize("name", ["carrier_01", "picker_01", "dog_01"])
def test_gymnasium_finds_no_fault_in_the_environment(name):
    check_env(single_env(SMALL, name), skip_render_check=True)


def test_observations_are_in_the_space_while_a_harvest_goes_on():
    env = parallel_env(TINY, [*LEARNED, "tractor_01"])
    observations, infos = env.reset()
    for _ in range(250):
        for name, observation in observations.items():
            assert env.observation_space(name).contains(observation), (name, observation)
            assert env.action_space(name).contains(infos[name]["scripted"].astype(np.float32))
        observations, *_, infos = env.step({name: infos[name]["scripted"] for name in env.agents})


def test_scripted_velocities_give_the_hash_of_local_mode():
    """The harvest is a whole one: three bins are delivered, and each picker picks 20 m."""
    earned = []
    env = parallel_env(
        TINY,
        ["carrier_01", "picker_02", "cat_01"],
        reward=lambda moment: earned.append(moment) or 0.0,
        is_hashed=True,
    )
    local = Local(TINY)
    (_, infos) = env.reset()
    while env.agents:
        assert not local.engine.over
        *_, terminated, truncated, infos = env.step(
            {name: infos[name]["scripted"] for name in env.agents}
        )
        local.tick()
    assert local.engine.over
    assert all(terminated.values())
    assert not any(truncated.values())
    assert env.local.engine.hash == local.engine.hash
    moments = {
        name: [moment for moment in earned if moment.after.name == name]
        for name in env.possible_agents
    }
    assert sum(map(REWARDS["delivery"], moments["carrier_01"])) == 3.0
    assert sum(map(REWARDS["picking"], moments["picker_02"])) == pytest.approx(20.0)
    # A carrier couples full bins, and that does not count as picking.
    assert sum(map(REWARDS["picking"], moments["carrier_01"])) == 0.0


def test_where_a_picker_begins_to_pick_is_no_deed_of_an_action():
    """The picker's agent also says from where it picks (PickFrom). The environment does that by
    itself, where velocity and the deed to couple or uncouple are given.
    """
    many = with_changes(
        TINY, pickers=2, carriers=3, bins_per_row=2, order_in_row="outward", picking_speed=0.3
    )
    env = parallel_env(many, ["picker_01"], deeds=True)
    local = Local(many)
    env.reset()
    numbers = {Couple: 1, Uncouple: 2}
    while env.agents:
        # What the picker's agent wants in this tick. If it was not asked, its last action stands.
        action = env._looks["picker_01"].action
        answer = env._answers.get("picker_01") or action
        deed = 0
        for wanted in answer.deeds:
            if not isinstance(wanted, PickFrom):
                deed = numbers[type(wanted)]
        # Forward and turning; there is no sideways velocity.
        velocity = (action.twist.x, action.twist.yaw)
        env.step({"picker_01": {"velocity": velocity, "deed": deed}})
        local.tick()
    assert local.engine.over


def test_bodies_without_an_action_follow_their_agents():
    env = parallel_env(SMALL, LEARNED, is_hashed=True)
    local = Local(SMALL)
    env.reset()
    for _ in range(100):
        env.step({})
        local.tick()
    assert env.local.engine.hash == local.engine.hash


@pytest.mark.parametrize("name", ["carrier_01", "picker_02"])
def test_other_velocities_give_the_motion_of_local_mode(name):
    """Velocities other than those of the agent, by `command`: in local mode `Driven` gives them."""
    env = single_env(TINY, name, is_hashed=True)
    local = Local(TINY)
    _, info = env.reset()
    local.play(name, Driven(local.agents[name]))
    for tick in range(600):
        *_, info = env.step(command(tick, *info["scripted"].tolist()))
        local.tick()
    assert np.array_equal(env.local.engine.world.pose, local.engine.world.pose)
    assert env.local.engine.hash == local.engine.hash


def test_a_run_that_is_not_hashed_moves_alike():
    """It moves by 100 random velocities."""
    envs = [single_env(SMALL, "carrier_01", is_hashed=hashed) for hashed in (True, False)]
    for env in envs:
        env.reset(seed=5)
        for velocity in np.random.default_rng(4).uniform(-0.4, 0.4, (100, 2)):
            env.step(velocity)
    assert np.array_equal(envs[0].local.engine.world.pose, envs[1].local.engine.world.pose)
    assert len(envs[0].local.engine.hash) == 64
    assert envs[1].local.engine.hash == ""


def command(tick, forward, turn):
    """Return a velocity, m/s and rad/s, that differs from that of the agent in half of each 6 s.

    The body stands, drives at half the speed, drives slowly ahead, or turns a little in one tick,
    which the agent then has to put right. Turns of the agent are left as they are.
    """
    part = tick % 60
    if part < 30 or turn:
        return forward, turn
    if part < 36:
        return 0.0, 0.0
    if part < 46:
        return forward / 2, 0.0
    if part < 49:
        return 0.02, 0.0
    return forward, 0.01 * (part == 50)


class Driven:
    """An agent that keeps its plan, its mail and its deeds, but moves by `command`."""

    def __init__(self, agent):
        self.agent = agent
        self.Memory = agent.Memory

    def tick(self, seen, mail, memory):
        action = self.agent.tick(seen, mail, memory)
        forward, turn = command(seen.tick, action.twist.x, action.twist.yaw)
        action.memory.moving = (forward, turn) != (0.0, 0.0)
        return replace(action, twist=Twist(forward, 0.0, turn))


def test_unseeded_episodes_differ_and_follow_the_last_seed():

    def seeds(env):
        """Return the seeds of five episodes, of which the third is asked for."""
        drawn = []
        for seed in (None, None, 7, None, None):
            env.reset(seed=seed)
            drawn.append(env.local.engine.layout.scenario.seed)
        return drawn

    first = seeds(single_env(SMALL, "carrier_01"))
    assert first == seeds(single_env(SMALL, "carrier_01"))
    assert len(set(first)) == 5
    assert first[0] == SMALL.seed
    assert first[2] == 7


@pytest.mark.parametrize("make", MAKERS)
def test_a_seed_that_cannot_be_changes_no_later_episode(make):
    """It is refused, and the next seed is as if it had not been given. A seed may be numpy's."""

    def seed_of(env):
        if isinstance(env, DispatchEnv):
            return env.harvest.layout.scenario.seed
        return env.local.engine.layout.scenario.seed

    env = make()
    other = make()
    for wrong in (-1, 2**70, 2.5, "7"):
        with pytest.raises((ScenarioError, gymnasium.error.Error)):
            env.reset(seed=wrong)
    env.reset()
    assert seed_of(env) == SMALL.seed
    for each, seed in ((env, np.int64(7)), (other, 7)):
        each.reset(seed=seed)
        each.reset()
    assert seed_of(env) == seed_of(other)


def test_a_curriculum_changes_the_scenario_of_one_episode():
    """The next episode has the scenario of the environment again."""
    env = single_env(SMALL, "carrier_01")
    observation, _ = env.reset(seed=3, options={"scenario": {"rows": 4, "people.workers": 3}})
    assert env.local.engine.layout.scenario.rows == 4
    assert env.observation_space.contains(observation)
    env.reset(seed=9)
    assert env.local.engine.layout.scenario == with_changes(SMALL, seed=9)


def test_an_episode_is_truncated_and_needs_a_reset_first():
    """It is cut after `longest` ticks. Before the first reset there is no step either."""
    with pytest.raises(ResetNeeded):
        single_env(SMALL, "carrier_01").step(np.zeros(2))
    env = parallel_env(SMALL, LEARNED, longest=3)
    env.reset()
    ends = [env.step({})[2:4] for _ in range(3)]
    assert [any(terminated.values()) for terminated, _ in ends] == [False, False, False]
    assert [all(truncated.values()) for _, truncated in ends] == [False, False, True]
    assert env.agents == []
    with pytest.raises(ResetNeeded):
        env.step({})


def test_masked_deeds_couple_and_others_do_nothing():
    """Deeds are 0: none, 1: couple, 2: uncouple. The carrier begins with a bin coupled. `bars`:
    whether one is coupled after each step. `masks`: which deeds were allowed before it.
    """
    env = single_env(SMALL, "carrier_01", deeds=True)
    _, info = env.reset()
    assert all(
        env.action_space.sample(mask=info["action_mask"])["deed"] in (0, 2) for _ in range(20)
    )
    bars = []
    masks = []
    # The first one, to couple, is not allowed, and does nothing.
    for deed in (1, 2, 0, 1, 0):
        observation, *_, after = env.step({"velocity": np.zeros(2), "deed": deed})
        bars.append(float(observation["bar"][0]))
        masks.append(info["action_mask"]["deed"].tolist())
        info = after
    assert bars == [1.0, 0.0, 0.0, 1.0, 1.0]
    assert masks == [[1, 0, 1], [1, 0, 1], [1, 1, 0], [1, 1, 0], [1, 0, 1]]


def test_odometry_that_measures_too_much_is_within_the_space():
    """Odometry has an error of 10 %, and the space has room for it beyond 1 m/s."""
    env = single_env(with_changes(SMALL, **{"sensors.odometry.distance": 0.1}), "picker_01")
    _, info = env.reset()
    measured = []
    for _ in range(50):
        observed, *_, info = env.step(info["scripted"])
        assert env.observation_space["velocity"].contains(observed["velocity"])
        measured.append(abs(float(observed["velocity"][0])))
    assert max(measured) not in (0.0, 1.0), "neither still nor exact: it drives at 1 m/s"


def test_a_copy_goes_on_alike_and_apart():
    """A copy goes on as the environment does, and neither changes the other."""
    env = single_env(TINY, "carrier_01", is_hashed=True)
    env.reset(seed=3)

    def drive(env, ticks):
        """Drive on a winding way. Return the hash."""
        for number in range(ticks):
            env.step([0.5, 0.1 * (number % 5)])
        return env.local.engine.hash

    drive(env, 60)
    copy = deepcopy(env)
    shorter = drive(deepcopy(env), 10)
    after = drive(copy, 100)
    assert shorter != after
    assert drive(env, 100) == after
    assert copy.local.engine.asked_share == env.local.engine.asked_share


def test_gymnasium_wrappers_fit():
    flat = gymnasium.wrappers.FlattenObservation(single_env(SMALL, "carrier_01"))
    env = gymnasium.wrappers.RescaleAction(flat, np.float32(-1.0), np.float32(1.0))
    observation, _ = env.reset(seed=1)
    # scan, pose, velocity, bar, fill, goal and mail: see the head of orchard/gym/spaces.py.
    assert observation.shape == (180 + 4 + 2 + 1 + 1 + 3 + 4,)
    env.step(np.zeros(2))


def test_many_at_once_are_each_what_one_is():
    seeds = [11, 12]
    together = gymnasium.vector.SyncVectorEnv([lambda: single_env(TINY, "picker_01")] * 2)
    observations, _ = together.reset(seed=seeds)
    for _ in range(3):
        observations, *_ = together.step(np.full((2, 2), 0.25, np.float32))
    for number, seed in enumerate(seeds):
        alone = single_env(TINY, "picker_01")
        alone.reset(seed=seed)
        for _ in range(3):
            observation, *_ = alone.step(np.full(2, 0.25))
        assert np.array_equal(observations["scan"][number], observation["scan"])
