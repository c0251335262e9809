"""The environments in which bodies of a harvest learn: the interfaces' own checks, the same motion
as local mode, rewards, mistakes.
"""

import math
from copy import deepcopy
from functools import partial

import gymnasium
import numpy as np
import pytest
from command_line import python
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from pettingzoo.test import parallel_api_test, parallel_seed_test

from orchard.behaviour.carrier import CarrierMemory
from orchard.contract.messages import Couple, PickFrom, Uncouple
from orchard.field.geometry import STILL, Twist
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.gym import REWARDS, DispatchEnv, Moment, dispatch_env, parallel_env, single_env
from orchard.gym.spaces import goal_of
from orchard.local import Local
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo

SMALL = Scenario(
    rows=3, people={"workers": 1, "visitors": 0}, animals={"dogs": 1, "cats": 0}, weeds=2
)
TINY = Scenario(
    rows=3,
    pickers=3,
    row_length=20.0,
    people={"workers": 0, "visitors": 0},
    animals={"dogs": 0, "cats": 1},
    weeds=0,
)
LEARNED = ["carrier_01", "picker_02"]
MAKERS = [
    lambda: single_env(SMALL, "carrier_01"),
    lambda: parallel_env(SMALL, LEARNED),
    lambda: dispatch_env(SMALL),
]


@pytest.mark.parametrize(
    "options", [{}, {"deeds": True}, {"longest": 15}]
)  # the last one: to the end of episodes
def test_pettingzoo(options):
    parallel_api_test(parallel_env(SMALL, LEARNED, **options), num_cycles=60)


def test_seeds_by_pettingzoo():
    parallel_seed_test(lambda: parallel_env(SMALL, LEARNED, deeds=True), num_cycles=40)


@pytest.mark.filterwarnings("ignore:.*normalized space")  # a dog's 3 m/s; velocities are SI
@pytest.mark.parametrize("name", ["carrier_01", "picker_01", "dog_01"])
def test_gymnasium(name):
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
    """Scripted velocities give the harvest of local mode to its hash.

    A whole harvest, and what it earns.
    """
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
    assert local.engine.over and all(terminated.values()) and not any(truncated.values())
    assert env.local.engine.hash == local.engine.hash
    of = {
        name: [moment for moment in earned if moment.after.name == name]
        for name in env.possible_agents
    }
    assert sum(map(REWARDS["delivery"], of["carrier_01"])) == 3.0
    assert sum(map(REWARDS["picking"], of["picker_02"])) == pytest.approx(20.0)
    assert (
        sum(map(REWARDS["picking"], of["carrier_01"])) == 0.0
    )  # a bin that is coupled full is not picked


def test_where_a_picker_begins_to_pick_is_no_deed_of_an_action():
    many = with_changes(
        TINY, pickers=2, carriers=3, bins_per_row=2, order_in_row="outward", picking_speed=0.3
    )
    env = parallel_env(many, ["picker_01"], deeds=True)
    local = Local(many)
    env.reset()
    while env.agents:
        action = env._looks["picker_01"].action
        did = [
            type(deed)
            for deed in (env._answers.get("picker_01") or action).deeds
            if not isinstance(deed, PickFrom)
        ]
        env.step(
            {
                "picker_01": {
                    "velocity": action.twist[::2],
                    "deed": {Couple: 1, Uncouple: 2}[did[0]] if did else 0,
                }
            }
        )
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
    """Other velocities give the motion that they give in local mode.

    In local mode an agent that is asked at every tick gives them.
    """
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
    envs = [single_env(SMALL, "carrier_01", is_hashed=hashed) for hashed in (True, False)]
    for env in envs:
        env.reset(seed=5)
        for velocity in np.random.default_rng(4).uniform(-0.4, 0.4, (100, 2)):
            env.step(velocity)
    assert np.array_equal(envs[0].local.engine.world.pose, envs[1].local.engine.world.pose)
    assert (len(envs[0].local.engine.hash), envs[1].local.engine.hash) == (64, "")


def command(tick, forward, turn):
    """Our agent's velocity, and now and then standing, half of it, a little ahead, or a turn, which
    the agent has to put right.
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
    """An agent that keeps its plan, its mail and its deeds, but moves as it is told."""

    def __init__(self, agent):
        self.agent = agent
        self.Memory = agent.Memory

    def tick(self, seen, mail, memory):
        action = self.agent.tick(seen, mail, memory)
        forward, turn = command(seen.tick, action.twist.x, action.twist.yaw)
        action.memory.moving = (forward, turn) != (0.0, 0.0)
        return replace(action, twist=Twist(forward, 0.0, turn))


def test_unseeded_episodes_differ_and_follow_the_last_seed():
    """Episodes without a seed differ and follow from the last seed."""

    def seeds(env):
        found = []
        for seed in (None, None, 7, None, None):
            env.reset(seed=seed)
            found.append(env.local.engine.layout.scenario.seed)
        return found

    first = seeds(single_env(SMALL, "carrier_01"))
    assert first == seeds(single_env(SMALL, "carrier_01")) and len(set(first)) == 5
    assert (first[0], first[2]) == (SMALL.seed, 7)


@pytest.mark.parametrize("make", MAKERS)
def test_a_seed_that_cannot_be_changes_no_later_episode(make):
    """A seed that cannot be changes no later episode and numpy's numbers are numbers."""

    def seed_of(env):
        return (
            env.harvest.layout if isinstance(env, DispatchEnv) else env.local.engine.layout
        ).scenario.seed

    env = make()
    other = make()
    for wrong in (-1, 2**70, 2.5, "7"):
        with pytest.raises((ScenarioError, gymnasium.error.Error)):
            env.reset(seed=wrong)
    env.reset()
    assert seed_of(env) == SMALL.seed
    for one, seed in ((env, np.int64(7)), (other, 7)):
        one.reset(seed=seed)
        one.reset()
    assert seed_of(env) == seed_of(other)


def test_a_curriculum_changes_the_scenario_of_one_episode():
    env = single_env(SMALL, "carrier_01")
    observation, _ = env.reset(seed=3, options={"scenario": {"rows": 4, "people.workers": 3}})
    assert env.local.engine.layout.scenario.rows == 4 and env.observation_space.contains(
        observation
    )
    env.reset(seed=9)
    assert env.local.engine.layout.scenario == with_changes(SMALL, seed=9)


def test_an_episode_is_truncated_and_needs_a_reset_first():
    """An episode is truncated and there is no step before a reset."""
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
    """A bin is uncoupled and coupled by deeds that the mask allows and others do nothing."""
    env = single_env(SMALL, "carrier_01", deeds=True)
    _, info = env.reset()
    assert all(
        env.action_space.sample(mask=info["action_mask"])["deed"] in (0, 2) for _ in range(20)
    )
    bars = []
    masks = []
    for deed in (1, 2, 0, 1, 0):  # the first one is not allowed
        observation, *_, after = env.step({"velocity": np.zeros(2), "deed": deed})
        bars.append(float(observation["bar"][0]))
        masks.append(info["action_mask"]["deed"].tolist())
        info = after
    assert bars == [1.0, 0.0, 0.0, 1.0, 1.0]
    assert masks == [[1, 0, 1], [1, 0, 1], [1, 1, 0], [1, 1, 0], [1, 0, 1]]


def follow(reward, name, ticks, command=lambda info: info["scripted"], scenario=SMALL):
    env = single_env(scenario, name, reward=reward)
    _, info = env.reset()
    rewards = []
    for _ in range(ticks):
        _, reward_, *_, info = env.step(command(info))
        rewards.append(reward_)
    return rewards, env.local.engine.world


COUNTED = [  # reward -> what it counts, and the least that it comes to
    ("picking", "picker_01", 300, lambda world, i: world.fill[world.coupled[i]], 20.0),
    ("goal", "tractor_01", 100, lambda world, i: world.distance[i], 5.0),
]


@pytest.mark.parametrize(("reward", "name", "ticks", "counted", "least"), COUNTED)
def test_picking_counts_own_metres_and_goal_those_on_the_way(reward, name, ticks, counted, least):
    """Picking counts the metres in the own bin and goal those on the way."""
    rewards, world = follow(reward, name, ticks)
    assert sum(rewards) == pytest.approx(counted(world, world.index[name])) and sum(rewards) > least


@pytest.mark.parametrize(
    ("gate_at", "reserved", "end"), [(15.0, [], 15.0), (15.0, ["F"], 20.0), (5.0, [], 20.0)]
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
    before = replace(env.local.seen["picker_01"], orientation=(0.0, 1.0))
    after = replace(before, orientation=(math.sin(yaw / 2), math.cos(yaw / 2)))
    goal = (before.x, before.y, 1.0)
    moment = Moment(before, after, goal, velocity=STILL, scripted=STILL, filled=0.0, events=[])
    assert REWARDS["goal"](moment) == pytest.approx(reward)


def test_imitation_is_best_for_our_agent():
    assert set(follow("imitation", "picker_01", 20)[0]) == {0.0}
    assert max(follow("imitation", "picker_01", 20, lambda info: np.array([-1.0, 0.0]))[0]) < 0.0


def test_care_counts_collisions():
    rewards, world = follow("care", "picker_01", 200, lambda info: np.array([1.0, 0.3]))
    assert sum(rewards) == -world.collisions[world.index["picker_01"]] < 0


def test_a_function_of_ones_own():
    rewards, _ = follow(
        lambda moment: moment.after.x - moment.before.x,
        "picker_01",
        10,
        lambda info: np.array([1.0, 0.0]),
    )
    assert rewards == pytest.approx([0.1] * 10)


def test_odometry_that_measures_too_much_is_within_the_space():
    env = single_env(with_changes(SMALL, **{"sensors.odometry.distance": 0.1}), "picker_01")
    _, info = env.reset()
    measured = []
    for _ in range(50):
        observed, *_, info = env.step(info["scripted"])
        assert env.observation_space["velocity"].contains(observed["velocity"])
        measured.append(abs(float(observed["velocity"][0])))
    assert max(measured) not in (0.0, 1.0)


HALF = {"velocity": np.zeros(2)}  # of an action with a deed
NO_DEEDS = (3, -1, 0.5, 1.0, 1j, True, "x", None)
NO_VELOCITIES = [
    [np.nan, 0.0],
    [0.0, np.inf],
    [1.0],
    [1.0, 2.0, 3.0],
    [1.0, [2.0]],
    "ab",
    None,
    [True, False],
    ["1", "0"],
    [1j, 0.0],
]


NO_ENVIRONMENTS = [
    (
        lambda: parallel_env(SMALL, ["carrier_9", "bin_01"]),
        "carrier_9: no such .*; bin_01: no such .*; there are carrier_01",
    ),
    (lambda: parallel_env(SMALL, ["picker_01", "picker_01"]), "picker_01: given twice"),
    (lambda: parallel_env(SMALL, []), "learned: empty"),
    *(
        (partial(parallel_env, SMALL, learned), "learned = .*: must be a list")
        for learned in ("picker_01", {"picker_01"}, None)
    ),
    (lambda: parallel_env(SMALL, LEARNED, longest=0), "longest = 0: must be at least 1 tick"),
    (lambda: parallel_env("my.yaml", LEARNED), r"scenario = 'my\.yaml': must be a Scenario"),
    (
        lambda: single_env(SMALL, "carrier_01", reward="speed"),
        f"reward 'speed': there is none .*; there are {', '.join(REWARDS)}",
    ),
]


@pytest.mark.parametrize(("make", "words"), NO_ENVIRONMENTS)
def test_what_is_no_environment(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


@pytest.mark.parametrize(
    "action", [*NO_VELOCITIES, *(np.array(action) for action in NO_VELOCITIES[-2:])]
)
def test_an_action_that_is_no_velocity(action):
    env = single_env(SMALL, "carrier_01")
    env.reset()
    with pytest.raises(ValueError, match="carrier_01: action"):
        env.step(action)


@pytest.mark.parametrize(
    "action", [np.zeros(2), HALF, {"deed": 0}, *(HALF | {"deed": deed} for deed in NO_DEEDS)]
)
def test_an_action_that_is_no_deed(action):
    env = single_env(TINY, "carrier_01", deeds=True)
    env.reset()
    with pytest.raises(
        ValueError,
        match=r"carrier_01: action .*; it must be {'velocity': two numbers, 'deed': 0, 1 to couple",
    ):
        env.step(action)


def test_a_step_that_is_refused_leaves_the_run_as_it_was():
    """The first action is one; the second is not."""
    envs = [parallel_env(SMALL, LEARNED, is_hashed=True) for _ in range(2)]
    for env in envs:
        env.reset()
    for wrong in (
        {"carrier_01": [0.4, 0.1], "picker_02": [np.nan, 0.0]},
        {"carrier_01": [0.4, 0.1], "picker_01": [0.0, 0.0]},
    ):
        with pytest.raises(ValueError, match="picker_0"):
            envs[0].step(wrong)
    for env in envs:
        for _ in range(20):
            env.step({})
    assert envs[0].local.engine.hash == envs[1].local.engine.hash


def test_an_action_for_another_body():
    env = parallel_env(SMALL, LEARNED)
    env.reset()
    with pytest.raises(
        ValueError, match="actions for picker_01, which do not learn here; carrier_01, picker_02 do"
    ):
        env.step({"picker_01": np.zeros(2)})


NO_CURRICULA = [
    ({"carriers": 1}, "carrier_02"),
    ({"rows": 400}, "rows = 400"),
    ({"carrying.speed": 2.0}, "carrier_02: its speed, turning and handling stay those"),
    (3, "options: scenario = 3: must be a map"),
]


@pytest.mark.parametrize(("changes", "words"), NO_CURRICULA)
def test_what_is_no_curriculum(changes, words):
    with pytest.raises((ValueError, ScenarioError), match=words):
        single_env(SMALL, "carrier_02").reset(options={"scenario": changes})


IMPORTS = [
    (
        "sys.modules['pettingzoo'] = None; import orchard.gym",
        "orchard.gym needs the extra gym: pip install 'orchard-sim[gym]'",
    ),
    ("import orchard.gym; sys.exit(str({'zenoh', 'rerun'} & set(sys.modules)))", "set()"),
]


@pytest.mark.parametrize(("program", "words"), IMPORTS)
def test_the_import_says_what_to_install(program, words):
    """The import says what to install and loads neither Zenoh nor Rerun."""
    assert words in python("-c", f"import sys; {program}", code=1).stderr


@settings(max_examples=15)
@given(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 2), min_size=1, max_size=20))
def test_whatever_is_commanded_a_body_keeps_its_limits(velocities):
    env = single_env(SMALL, "carrier_01")
    observation, _ = env.reset()
    for velocity in velocities:
        observation, reward, *_ = env.step(np.array(velocity))
        assert env.observation_space.contains(observation) and np.isfinite(reward)


def test_a_copy_goes_on_alike_and_apart():
    """A copy goes on as the environment does and neither changes the other."""
    env = single_env(TINY, "carrier_01", is_hashed=True)
    env.reset(seed=3)

    def drive(env, ticks):
        for number in range(ticks):
            env.step([0.5, 0.1 * (number % 5)])
        return env.local.engine.hash

    drive(env, 60)
    copy = deepcopy(env)
    assert drive(deepcopy(env), 10) != (after := drive(copy, 100))
    assert drive(env, 100) == after
    assert copy.local.engine.asked_share == env.local.engine.asked_share


def test_gymnasium_wrappers_fit():
    flat = gymnasium.wrappers.FlattenObservation(single_env(SMALL, "carrier_01"))
    env = gymnasium.wrappers.RescaleAction(flat, np.float32(-1.0), np.float32(1.0))
    observation, _ = env.reset(seed=1)
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
