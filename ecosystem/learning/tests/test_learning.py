"""The environments with Stable-Baselines3: its own check, and PPO, which learns to pick.

One thread, fixed seeds.
"""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium.wrappers import RescaleAction
from stable_baselines3.common.env_checker import check_env

from orchard import Scenario, lay_out, with_changes
from orchard.discrete.harvest import DiscreteHarvest
from orchard.gym import dispatch_env, single_env

ALONE = Scenario(
    rows=3,
    people={"workers": 0, "visitors": 0},
    animals={"dogs": 0, "cats": 0},
    weeds=0,
    tractor=False,
)
ROOT = Path(__file__).parents[3]
SEEDS = (101, 102, 103)


@pytest.fixture(autouse=True)
def one_thread():
    """Sums of floats then have one order, so that a seed gives the same policy again."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)


def mean_return(env, choose):
    """Return the mean return of the episodes of SEEDS. `choose`: observation -> action."""
    total = 0.0
    for seed in SEEDS:
        observation, _ = env.reset(seed=seed)
        has_ended = False
        while not has_ended:
            observation, reward, terminated, truncated, _ = env.step(choose(observation))
            total += reward
            has_ended = terminated or truncated
    return total / len(SEEDS)


@pytest.mark.parametrize("name", ["carrier_01", "picker_01"])
def test_check_env(name):
    check_env(RescaleAction(single_env(ALONE, name), np.float32(-1.0), np.float32(1.0)))


# The check recommends what RescaleAction makes.
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized")
def test_check_env_with_velocities_in_metres_and_radians():
    check_env(single_env(ALONE, "carrier_01"))


def test_check_env_of_dispatch():
    check_env(dispatch_env(ALONE))


def block(name):
    """The text of a block of code of docs/extending.md."""
    (text,) = re.findall(
        rf"^```python {name}\n(.*?)```$", (ROOT / "docs" / "extending.md").read_text(), re.M | re.S
    )
    return text


def test_ppo_learns_to_pick():
    """The program of docs/extending.md.

    At most 15 m can be picked; a policy of random velocities picks less than 1 m.
    """
    names_of_program = {}
    exec(block("learn"), names_of_program)
    model = names_of_program["model"]
    exam = names_of_program["picking"]()
    exam.action_space.seed(1)
    learned = mean_return(exam, lambda seen: model.predict(seen, deterministic=True)[0])
    random = mean_return(exam, lambda seen: exam.action_space.sample())
    assert learned > random + 3.0, (learned, random)


def test_a_dispatch_policy_learns_and_decides(tmp_path, monkeypatch):
    """examples/learned_dispatch.py for some seconds: what has learned in other orchards decides in
    this one, well or not.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(ROOT)
    learned = import_module("examples.learned_dispatch")
    learned.learn(minutes=0.05, seed=1)
    choose = learned.Learned.choose
    decisions = []

    def noted_choice(*seen):
        decisions.append(choose(*seen))
        return decisions[-1]

    monkeypatch.setattr(learned.Learned, "choose", noted_choice)
    scenario = with_changes(ALONE, rows=5, dispatch="examples.learned_dispatch.Learned")
    DiscreteHarvest(lay_out(scenario)).run()
    assert decisions


def test_many_orchards_show_what_one_shows(monkeypatch):
    """examples/learning_curves.py sees with arrays what examples/learned_dispatch.py sees of one
    orchard: so what has learned in many can decide in one.
    """
    monkeypatch.syspath_prepend(ROOT)
    curves = import_module("examples.learning_curves")
    learned = import_module("examples.learned_dispatch")
    instance = curves.instances()["small-spread-train"]
    orchard = curves.OneOrchard(instance, 2)
    observed, _ = orchard.envs.reset(seed=[1, 2])
    for _ in range(30):
        orchard.see(observed)
        for number in range(orchard.size):
            seen = {name: array[number] for name, array in observed.items()}
            choices = learned.Choices(seen)
            assert np.allclose(choices.features, orchard.features[number])
            assert list(choices.mask) == list(orchard.masks[number])
            # What is masked may differ, because it cannot be chosen.
            for choice, action in enumerate(choices.actions):
                if choices.mask[choice]:
                    assert orchard.actions[number][choice] == action
        # The first choice that can be.
        chosen = orchard.masks.argmax(axis=1)
        observed, *_ = orchard.envs.step(orchard.actions[np.arange(orchard.size), chosen])
