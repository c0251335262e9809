"""Dispatch in many orchards at once: the same episodes as single environments have, Gymnasium's
rules for vectors, copies, and names by which Gymnasium makes environments.

A vector steps all its orchards by one compiled loop. A single environment, `dispatch_env`, does the
same in Python; so each is a test of the other one. `action_mask` has a row for each orchard, with 1
for each action that can be done.
"""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from orchard.event_model import columns
from orchard.event_model.batch import harvests
from orchard.event_model.draws import FIRST, draws
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.gym import dispatch_env, dispatch_vec_env

# `predictive` and `longest-waiting` decide fast in Python, which the single environments ask.
SMALL = Scenario(rows=4, pickers=2, carriers=2, dispatch="predictive")
EVENTFUL: dict[str, Any] = {
    "rows": 5,
    "pickers": 3,
    "carriers": 3,
    "dispatch": "longest-waiting",
    "route": "one-way",
    "metres_per_bin": 30.0,
    "picking_speed": 0.5,
    "picking": {
        "spread": {"distribution": "lognormal", "cv": 0.1},
        "failure": {"mean_between": 100.0, "mean_repair": 60.0},
    },
    "carrying": {
        "failure": {"mean_between": 300.0, "mean_repair": 60.0},
        "battery": {"hours": 0.4, "hours_to_charge": 0.1, "reserve": 0.6},
    },
    "people": {"workers": 3, "visitors": 1},
}
SCENARIOS = {
    "people": SMALL,
    "nobody": with_changes(
        SMALL, people={"workers": 0, "visitors": 0}, animals={"dogs": 0, "cats": 0}
    ),
    "what else happens": Scenario(**EVENTFUL),
    "trailers": with_changes(
        SMALL, load_out={"seconds_away": 90.0, "trailers": {"count": 1, "bins": 2}}
    ),
}
# The arrays of an observation.
TOLD = ("bins", "carriers", "seconds")


def chosen(random, masks):
    """Return an action of each orchard, drawn from its mask.

    In one of ten calls the first orchard gets its last action, whether that can be done or not.
    """
    actions = [int(random.choice(np.flatnonzero(mask))) for mask in masks]
    if random.random() < 0.1:
        actions[0] = len(masks[0]) - 1
    return np.array(actions)


def assert_same(observations, others):
    """Assert that two observations are equal to the last bit."""
    for key in TOLD:
        np.testing.assert_array_equal(observations[key], others[key], key)


def assert_goes_on_alike(env, other, infos, steps):
    """Do the same random steps in two vectors, and assert that they answer the same.

    `infos`: those of the last step. Return how many episodes ended.
    """
    random = np.random.default_rng(3)
    ended = 0
    for _ in range(steps):
        actions = chosen(random, infos["action_mask"])
        observations, rewards, terminated, truncated, infos = env.step(actions)
        others = other.step(actions)
        assert_same(observations, others[0])
        np.testing.assert_array_equal(rewards, others[1])
        np.testing.assert_array_equal(terminated, others[2])
        np.testing.assert_array_equal(truncated, others[3])
        np.testing.assert_array_equal(infos["action_mask"], others[4]["action_mask"])
        ended += int((terminated | truncated).sum())
    return ended


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_vector_of_one_has_the_episode_of_the_single_one(name):
    """Both do the same random actions, and answer the same to the end of the harvest."""
    env = dispatch_vec_env(SCENARIOS[name], 1, reward="waiting")
    alone = dispatch_env(SCENARIOS[name], reward="waiting")
    observations, infos = env.reset(seed=5)
    observed, info = alone.reset(seed=5)
    random = np.random.default_rng(1)
    is_over = False
    while not is_over:
        assert_same({key: observations[key][0] for key in TOLD}, observed)
        np.testing.assert_array_equal(infos["action_mask"][0], info["action_mask"])
        actions = chosen(random, infos["action_mask"])
        observations, rewards, terminated, truncated, infos = env.step(actions)
        observed, reward, is_finished, is_cut, info = alone.step(int(actions[0]))
        assert (rewards[0], terminated[0], truncated[0]) == (reward, is_finished, is_cut)
        is_over = is_finished or is_cut
    assert is_finished
    assert infos["seconds"][0] == alone.harvest.seconds


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_many_orchards_are_as_many_single_ones(mode):
    """Gymnasium's own vector of single environments does the same, over several episodes.

    In both modes an orchard whose episode is over begins the next one by itself: in the next step,
    or in the same one.
    """
    env = dispatch_vec_env(SMALL, 3, autoreset_mode=mode)
    singles = SyncVectorEnv([lambda: dispatch_env(SMALL)] * 3, autoreset_mode=mode)
    observations, infos = env.reset(seed=7)
    assert_same(observations, singles.reset(seed=7)[0])
    assert env.metadata["autoreset_mode"] == mode
    assert env.observation_space == singles.observation_space
    assert env.action_space == singles.action_space
    assert assert_goes_on_alike(env, singles, infos, 24) > 3


def test_the_end_of_an_episode_is_told_in_the_same_step():
    """In this mode the observation is already that of the next episode, so the last one of the
    episode before stands in the infos.
    """
    env = dispatch_vec_env(SMALL, 2, autoreset_mode="SameStep")
    singles = SyncVectorEnv(
        [lambda: dispatch_env(SMALL)] * 2, autoreset_mode=AutoresetMode.SAME_STEP
    )
    _, infos = env.reset(seed=7)
    singles.reset(seed=7)
    random = np.random.default_rng(2)
    ended = np.zeros(2, np.bool_)
    while not ended.any():
        actions = chosen(random, infos["action_mask"])
        _, _, terminated, truncated, infos = env.step(actions)
        others = singles.step(actions)[4]
        ended = terminated | truncated
    # An underscore names the mask of a value: for which orchards it is there.
    np.testing.assert_array_equal(infos["_final_obs"], others["_final_obs"])
    number = int(np.flatnonzero(ended)[0])
    assert_same(infos["final_obs"][number], others["final_obs"][number])
    assert infos["final_info"]["seconds"][number] > 0.0
    assert infos["final_info"]["_seconds"][number]


def test_a_mask_names_the_orchards_that_begin_anew():
    """Episodes are cut at tick 3,000, and do not begin anew by themselves. Of two that are over
    only the second one is reset.
    """
    env = dispatch_vec_env(SMALL, 2, longest=3000, autoreset_mode="Disabled")
    env.reset(seed=[3, 4])
    ended = np.zeros(2, np.bool_)
    while not ended.all():
        observations, _, terminated, truncated, _ = env.step(np.zeros(2, int))
        ended = terminated | truncated
    with pytest.raises(ResetNeeded, match="orchard 0: its episode is over"):
        env.step(np.zeros(2, int))
    begun, infos = env.reset(seed=[3, 4], options={"reset_mask": np.array([False, True])})
    assert begun["seconds"][0] == observations["seconds"][0]
    assert begun["seconds"][1] < observations["seconds"][1]
    assert infos["_action_mask"].tolist() == [False, True]


@pytest.mark.parametrize("reward", ["time", "delivery", lambda happened: 2.0 * happened.delivered])
def test_rewards_are_those_of_single_environments(reward):
    env = dispatch_vec_env(SMALL, 2, reward=reward)
    singles = SyncVectorEnv([lambda: dispatch_env(SMALL, reward=reward)] * 2)
    _, infos = env.reset(seed=1)
    singles.reset(seed=1)
    assert_goes_on_alike(env, singles, infos, 12)


def test_a_reward_that_is_no_number_is_an_error():
    env = dispatch_vec_env(SMALL, 2, reward=lambda happened: None)
    env.reset(seed=1)
    with pytest.raises(TypeError, match="float"):
        env.step(np.zeros(2, np.int64))


def test_the_highest_seeds_are_seeds():
    """The second orchard has the seed after that of the first, and 2**63 is no seed."""
    env = dispatch_vec_env(with_changes(SMALL, seed=2**63 - 1), 2)
    env.reset()
    with pytest.raises(ValueError, match=f"seed {2**63 - 1}: must be a whole number from 0 to"):
        env.reset(seed=2**63 - 1)
    env.reset(seed=2**63 - 2)


def test_episodes_without_any_carrier_sent_are_truncated():
    env = dispatch_vec_env(SMALL, 2)
    singles = SyncVectorEnv([lambda: dispatch_env(SMALL)] * 2)
    env.reset(seed=1)
    singles.reset(seed=1)
    ended = False
    while not ended:
        _, rewards, _, truncated, _ = env.step(np.zeros(2, int))
        _, others, _, cut, _ = singles.step(np.zeros(2, int))
        np.testing.assert_array_equal(rewards, others)
        np.testing.assert_array_equal(truncated, cut)
        ended = truncated.any()


@pytest.mark.parametrize(
    "made",
    [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))],
    ids=["deepcopy", "pickle"],
)
def test_a_copy_goes_on_as_the_vector_does(made):
    """`unused` is copied before the first reset, `twin` in the middle of an episode."""
    env = dispatch_vec_env(Scenario(**EVENTFUL), 3, reward=lambda happened: -len(happened))
    unused = made(env)
    _, infos = env.reset(seed=2)
    unused.reset(seed=2)
    assert_goes_on_alike(env, unused, infos, 5)
    twin = made(env)
    masks = {"action_mask": env.action_masks()}
    assert assert_goes_on_alike(env, twin, masks, 60) > 0


@pytest.mark.parametrize("seed", [0, 9, 12345678901234567, 2**63 - 1])
def test_compiled_draws_are_those_of_python(seed):
    """Also after room was made for more of them (64).

    `draws` of Python draws four numbers of each kind for each robot. In the arrays of the batch
    orchard 1, the second, has `count` of them for each robot, one robot after the other.
    """
    env = dispatch_vec_env(Scenario(**EVENTFUL), 2)
    env.reset(seed=[1, seed])
    batch = env._batch
    names = sorted(start.name for start in lay_out(env.scenario).starts)
    names = [name for name in names if name.startswith(("carrier_", "picker_"))]
    layout = lay_out(with_changes(env.scenario, seed=seed))
    batch._widen(64)
    for name, drawn in draws(layout, names, dict.fromkeys(FIRST, 4), seed).items():
        assert batch.arrays["episodes"][name][1] >= 4
        count = batch.arrays["episodes"][name][1]
        of_robots = batch.arrays[name][1, : count * len(names)].reshape(len(names), count)
        np.testing.assert_array_equal(of_robots[:, :4], drawn.view(np.ndarray), name)


def test_more_draws_than_there_is_room_for_are_made_room_for(monkeypatch):
    """At first there is room for 4 draws for each of the four robots, in `roomy` for 64."""
    monkeypatch.setattr(harvests, "ROOM", 4)
    env = dispatch_vec_env(SMALL, 2)
    roomy = dispatch_vec_env(SMALL, 2)
    roomy._batch._widen(64)
    _, infos = env.reset(seed=1)
    roomy.reset(seed=1)
    assert assert_goes_on_alike(env, roomy, infos, 30) > 2
    room = env._batch.arrays["looks"].shape[1]
    assert 4 * 4 < room < 64 * 4


def test_seeds_are_those_of_gymnasium():
    """A seed 4 of three orchards is 4, 5 and 6. The episodes after that follow from it."""
    env = dispatch_vec_env(SMALL, 3)
    first, _ = env.reset(seed=4)
    listed, _ = env.reset(seed=[4, 5, 6])
    assert_same(first, listed)
    second, _ = env.reset()
    again = dispatch_vec_env(SMALL, 3)
    again.reset(seed=4)
    assert_same(second, again.reset()[0])
    # Without a seed the first orchard has that of the scenario, and the others have others.
    unseeded, _ = dispatch_vec_env(SMALL, 3).reset()
    assert_same(unseeded, dispatch_vec_env(SMALL, 3).reset(seed=SMALL.seed)[0])


def test_observations_are_in_their_space():
    env = dispatch_vec_env(Scenario(**EVENTFUL), 2)
    observations, infos = env.reset(seed=1)
    random = np.random.default_rng(1)
    for _ in range(40):
        assert env.observation_space.contains(observations)
        observations, _, _, _, infos = env.step(chosen(random, infos["action_mask"]))


def test_gymnasium_makes_environments_by_their_names():
    check_env(
        gymnasium.make("orchard/Dispatch-v1", scenario=SMALL).unwrapped, skip_render_check=True
    )
    robot = gymnasium.make("orchard/Robot-v1", scenario=SMALL, robot="picker_01")
    # x, y, cosine and sine of the yaw.
    assert robot.reset(seed=1)[0]["pose"].shape == (4,)
    many = gymnasium.make_vec("orchard/Dispatch-v1", num_envs=3, scenario=SMALL, reward="waiting")
    assert type(many.unwrapped).__name__ == "DispatchVecEnv"
    assert many.reset(seed=1)[0]["seconds"].shape == (3, 1)
    usual: Any = gymnasium.make("orchard/Dispatch-v1").unwrapped
    assert usual.scenario == Scenario()


def test_wrappers_of_gymnasium_work():
    env = RecordEpisodeStatistics(dispatch_vec_env(SMALL, 2))
    _, infos = env.reset(seed=1)
    random = np.random.default_rng(1)
    while "episode" not in infos:
        *_, infos = env.step(chosen(random, infos["action_mask"]))
    assert infos["episode"]["l"].max() > 3


def test_mistakes_are_told():
    with pytest.raises(ValueError, match="num_envs = 0: must be at least 1"):
        dispatch_vec_env(SMALL, 0)
    own = Scenario(rows=3, route="examples.seams.signalled_route.SignalledRoute")
    with pytest.raises(ValueError, match=r"route = examples\..*: a batch of harvests knows"):
        dispatch_vec_env(own)
    with pytest.raises(ValueError, match="reward 'speed'"):
        dispatch_vec_env(SMALL, reward="speed")
    env: Any = dispatch_vec_env(SMALL, 2)
    with pytest.raises(ResetNeeded, match="none has begun"):
        env.step(np.zeros(2, int))
    for wrong in ("5", -1, 1.5, [1], [1, 2, 3], [-1, 0]):
        with pytest.raises(ValueError, match="seed"):
            env.reset(seed=wrong)
    with pytest.raises(ValueError, match="options scenario: unknown"):
        env.reset(options={"scenario": {}})
    with pytest.raises(ValueError, match="options reset_mask: must be 2 times"):
        env.reset(options={"reset_mask": np.zeros(2, np.bool_)})
    env.reset(seed=1)
    for actions in (0, [0], [0, 0.5], [0, 99], [-1, 0], None):
        with pytest.raises(ValueError, match="must be 2 whole numbers from 0 to"):
            env.step(actions)


def test_the_machine_reads_as_many_draws_as_there_are():
    """The machine gets the address of each array and its lengths, as words. Word 2 is the length of
    the second axis: of draws, how many there are of each robot.
    """
    env = dispatch_vec_env(SMALL, 2)
    env.reset(seed=1)
    words = env._batch.arrays["addresses"].reshape(2, len(columns.ARRAYS), -1)
    for name in ("encounters", "looks", "failures"):
        lengths = words[:, [*columns.ARRAYS].index(name), 2]
        assert lengths.tolist() == env._batch.arrays["episodes"][name].tolist()
