"""The environments with Stable-Baselines3: its own check, and PPO, which learns to pick and to dispatch. One thread, fixed seeds."""

import numpy as np
import pytest
import torch
from gymnasium.wrappers import FilterObservation, FlattenObservation, RescaleAction
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env

from orchard import Scenario
from orchard.gym import dispatch_env, single_env

ALONE = Scenario(rows=3, people={"workers": 0, "visitors": 0}, animals={"dogs": 0, "cats": 0}, weeds=0, tractor=False)
SEEDS = (101, 102, 103)


@pytest.fixture(autouse=True)
def one_thread():
    """Sums of floats then have one order, so that a seed gives the same policy again."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)


def mean_return(env, choose):
    """The mean return of the episodes of SEEDS."""
    total = 0.0
    for seed in SEEDS:
        observation, ended = env.reset(seed=seed)[0], False
        while not ended:
            observation, reward, terminated, truncated, _ = env.step(choose(observation))
            total, ended = total + reward, terminated or truncated
    return total / len(SEEDS)


@pytest.mark.parametrize("name", ["carrier_01", "picker_01"])
def test_check_env(name):
    check_env(RescaleAction(single_env(ALONE, name), np.float32(-1.0), np.float32(1.0)))


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized")  # it recommends what RescaleAction makes
def test_check_env_with_velocities_in_metres_and_radians():
    check_env(single_env(ALONE, "carrier_01"))


def test_check_env_of_dispatch():
    check_env(dispatch_env(ALONE))


def picking(longest=150):
    """A picker at the head of its row. It has to find out that driving along the row picks."""
    env = FilterObservation(single_env(ALONE, "picker_01", reward="picking", longest=longest), ["goal", "velocity"])
    return RescaleAction(FlattenObservation(env), np.float32(-1.0), np.float32(1.0))


def test_ppo_learns_to_pick():
    """At most 15 m can be picked in 150 ticks; a policy of random velocities picks less than 1 m."""
    env, exam = picking(), picking()
    model = PPO("MlpPolicy", env, n_steps=512, batch_size=128, learning_rate=1e-3, gamma=0.95, seed=1, device="cpu").learn(4096)
    exam.action_space.seed(1)
    learned = mean_return(exam, lambda seen: model.predict(seen, deterministic=True)[0])
    random = mean_return(exam, lambda seen: exam.action_space.sample())
    assert learned > random + 3.0, (learned, random)
