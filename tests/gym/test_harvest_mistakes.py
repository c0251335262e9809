"""Mistakes of a program that steps environments of a harvest: each is refused in words, and leaves
the run as it was.
"""

from functools import partial

import numpy as np
import pytest
from command_line import python
from hypothesis import given, settings
from hypothesis import strategies as st
from learning_orchards import LEARNED, SMALL, TINY

from orchard.field.problems import ScenarioError
from orchard.gym import REWARDS, parallel_env, single_env

# One half of an action with a deed; the other half is the deed, one of the whole numbers 0, 1, 2.
HALF = {"velocity": np.zeros(2)}

NO_DEEDS = (3, -1, 0.5, 1.0, 1j, True, "x", None)

# A velocity is two numbers.
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

# What makes no environment, and words of the error.
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
def test_what_makes_no_environment_is_told(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


@pytest.mark.parametrize(
    "action", [*NO_VELOCITIES, *(np.array(action) for action in NO_VELOCITIES[-2:])]
)
def test_an_action_that_is_no_velocity_is_refused(action):
    env = single_env(SMALL, "carrier_01")
    env.reset()
    with pytest.raises(ValueError, match="carrier_01: action"):
        env.step(action)


@pytest.mark.parametrize(
    "action", [np.zeros(2), HALF, {"deed": 0}, *(HALF | {"deed": deed} for deed in NO_DEEDS)]
)
def test_an_action_that_is_no_deed_is_refused(action):
    env = single_env(TINY, "carrier_01", deeds=True)
    env.reset()
    with pytest.raises(
        ValueError,
        match=r"carrier_01: action .*; it must be {'velocity': two numbers, 'deed': 0, 1 to couple",
    ):
        env.step(action)


def test_a_step_that_is_refused_leaves_the_run_as_it_was():
    """In each of two steps the first action is right, and the second is not. So the first must not
    be done either.
    """
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


def test_an_action_for_a_body_that_does_not_learn_is_refused():
    env = parallel_env(SMALL, LEARNED)
    env.reset()
    with pytest.raises(
        ValueError, match="actions for picker_01, which do not learn here; carrier_01, picker_02 do"
    ):
        env.step({"picker_01": np.zeros(2)})


# Changes of the scenario of one episode in which carrier_02 learns, and words of the error.
NO_CURRICULA = [
    ({"carriers": 1}, "carrier_02"),
    ({"rows": 400}, "rows = 400"),
    ({"carrying.speed": 2.0}, "carrier_02: its speed, turning and handling stay those"),
    (3, "options: scenario = 3: must be a map"),
]


@pytest.mark.parametrize(("changes", "words"), NO_CURRICULA)
def test_what_is_no_curriculum_is_told(changes, words):
    with pytest.raises((ValueError, ScenarioError), match=words):
        single_env(SMALL, "carrier_02").reset(options={"scenario": changes})


# A program that imports the environments, and words with which it ends.
IMPORTS = [
    (
        "sys.modules['pettingzoo'] = None; import orchard.gym",
        "orchard.gym needs the extra gym: pip install 'orchard-sim[gym]'",
    ),
    ("import orchard.gym; sys.exit(str({'zenoh', 'rerun'} & set(sys.modules)))", "set()"),
]


@pytest.mark.parametrize(("program", "words"), IMPORTS)
def test_the_import_says_what_to_install(program, words):
    """It does so where a package is missing. And it loads neither Zenoh nor Rerun."""
    assert words in python("-c", f"import sys; {program}", code=1).stderr


@settings(max_examples=15)
@given(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 2), min_size=1, max_size=20))
def test_whatever_is_commanded_a_body_keeps_its_limits(velocities):
    env = single_env(SMALL, "carrier_01")
    observation, _ = env.reset()
    for velocity in velocities:
        observation, reward, *_ = env.step(np.array(velocity))
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
