"""A copy of an environment goes on as the environment itself, by deepcopy and by pickle, before and
after its first reset.

Environments are copied to search from a state, and pickled to other processes. A reward that is a
lambda has no name, so cloudpickle must carry it.
"""

import copy
import pickle
import threading
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="gymnasium is missing: pip install 'orchard-sim[gym]'")

from orchard.field.scenario import Scenario
from orchard.gym import dispatch_env, parallel_env, single_env

SMALL = Scenario(rows=3)
CARRIER = "carrier_01"


def seconds_less(moment, weight):
    """A reward of dispatch and of robots alike: minus what the moment has, times a weight."""
    return -weight * len(moment)


# Each kind of environment and of reward -> a function that makes it.
MAKERS = {
    "parallel": lambda: parallel_env(SMALL, [CARRIER]),
    "parallel with deeds and a hash": lambda: parallel_env(
        SMALL, [CARRIER], deeds=True, is_hashed=True, reward="care"
    ),
    "single": lambda: single_env(SMALL, CARRIER, reward="imitation"),
    "parallel with a lambda": lambda: parallel_env(SMALL, [CARRIER], reward=lambda moment: 2.5),
    "single with a part of a lambda": lambda: single_env(
        SMALL, CARRIER, reward=partial(lambda moment, weight: weight * moment.filled, weight=0.5)
    ),
    "dispatch with a lambda": lambda: dispatch_env(SMALL, reward=lambda moment: -len(moment)),
    "single with a part of a function": lambda: single_env(
        SMALL, CARRIER, reward=partial(seconds_less, weight=0.5)
    ),
    "dispatch": lambda: dispatch_env(SMALL, reward="waiting"),
}
COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}


def steps(env, infos, count):
    """Let an environment do some steps as the built-in agents would. Return what it answers, as
    text of all bits, and the infos of the last step.
    """
    answers = []
    for _ in range(count):
        # An environment of one robot has the info itself, one of several a map of them.
        info = infos.get(CARRIER, infos)
        action = info["scripted"]
        if "action_mask" in info and isinstance(info["action_mask"], dict):
            action = {"velocity": action, "deed": 0}
        several = hasattr(env, "possible_agents")
        answered = env.step({CARRIER: action} if several else action)
        infos = answered[-1]
        answers.append(repr(answered[:-1]))
    return answers, infos


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("made", MAKERS)
def test_a_copy_goes_on_as_the_environment_does(made, how):
    """`unused` is copied before the first reset, `twin` in the middle of an episode."""
    np.set_printoptions(floatmode="unique", threshold=10_000)
    env: Any = MAKERS[made]()
    unused = COPIES[how](env)
    _, infos = env.reset(seed=5)
    _, others = unused.reset(seed=5)
    count = 3 if made.startswith("dispatch") else 40
    begun, infos = steps(env, infos, count)
    assert steps(unused, others, count)[0] == begun
    twin = COPIES[how](env)
    expected, _ = steps(env, infos, count)
    assert steps(twin, infos, count)[0] == expected
    if made == "parallel with deeds and a hash":
        assert twin.local.engine.hash == env.local.engine.hash


def test_a_reward_that_cannot_be_pickled_is_refused_in_words():
    lock = threading.Lock()
    env = single_env(SMALL, CARRIER, reward=lambda moment: float(lock.locked()))
    with pytest.raises(pickle.PicklingError, match=r"the reward <function .* cannot be pickled: "):
        pickle.dumps(env)
