"""The environment in which dispatch is learned: the interface's checks, the same harvest as the
fast model, use in the simulator.
"""

from pathlib import Path
from typing import Any

import numpy as np
import own_policies
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from stage import empty_orchard

from examples.learned_dispatch import SCALE, AnyOrchard
from orchard.discrete.harvest import DiscreteHarvest
from orchard.dispatch.policy import BinReport, CarrierReport
from orchard.dispatch.ranking import Predictive
from orchard.event_model.results import LONGEST
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.gym import Dispatching, dispatch_env

SMALL = Scenario(rows=4, pickers=2)
BIN = BinReport("bin_02", 3, "east", "picker_02", 20, 50.0, 4.0, 60.0)


def played(env, choose, seed=None):
    _, info = env.reset(seed=seed)
    total = 0.0
    ended = (False, False)
    while not any(ended):
        _, reward, *ended, info = env.step(choose(info))
        total += reward
    return total, ended[0]


def scripted(info):
    return info["scripted"]


def test_gymnasium():
    check_env(dispatch_env(SMALL), skip_render_check=True)


@pytest.mark.parametrize("policy", ["predictive", "farthest-first", "longest-waiting"])
@pytest.mark.parametrize("metres_per_bin", [None, 30.0])
def test_scripted_actions_give_the_harvest_of_the_fast_model(policy, metres_per_bin):
    scenario = Scenario(
        rows=9,
        pickers=5,
        dispatch=policy,
        metres_per_bin=metres_per_bin,
        picking={"failure": {"mean_between": 300.0}},
    )
    model = DiscreteHarvest(lay_out(scenario)).run()
    env = dispatch_env(scenario)
    total, terminated = played(env, scripted)
    assert (
        terminated
        and env.harvest.deliveries == model.deliveries
        and env.harvest.seconds == model.seconds
    )
    assert -model.seconds <= total < 0.0  # the time before the first decision belongs to no action


def test_an_episode_goes_on_while_all_carriers_charge():
    """An episode goes on while all carriers charge for longer than a jam takes."""
    scenario = empty_orchard(
        rows=4,
        pickers=2,
        carriers=1,
        dispatch="predictive",
        carrying={"battery": {"hours": 0.25, "reserve": 0.6}},
    )
    env = dispatch_env(scenario)
    assert (
        played(env, scripted)[1]
        and env.harvest.seconds == DiscreteHarvest(lay_out(scenario)).run().seconds
    )


def test_rewards():
    model = DiscreteHarvest(lay_out(SMALL)).run()
    assert (
        played(dispatch_env(SMALL, reward="delivery"), scripted)[0] == model.delivered == SMALL.rows
    )
    assert played(dispatch_env(SMALL, reward="waiting"), scripted)[0] == pytest.approx(
        -model.waited_seconds
    )
    assert played(dispatch_env(SMALL, reward="waiting"), lambda info: 0)[0] < -1200.0, (
        "two pickers, which wait for 600 s until it is a jam"
    )
    assert (
        played(dispatch_env(SMALL, reward=lambda interval: 2.0 * interval.delivered), scripted)[0]
        == 2.0 * SMALL.rows
    )


def test_masked_random_actions_finish_and_are_repeatable():
    """Random actions within the mask finish the harvest and are repeatable."""

    def deliveries():
        env = dispatch_env(SMALL)
        rng = np.random.default_rng(1)
        assert played(env, lambda info: rng.choice(np.flatnonzero(info["action_mask"])), seed=4)[1]
        return env.harvest.deliveries

    assert deliveries() == deliveries()


@pytest.mark.parametrize(("longest", "until"), [(5, 5), (5000, 5000), (LONGEST, 12_000)])
def test_who_never_sends_a_carrier_is_truncated(longest, until):
    """Before the first decision; after so many ticks; or 600 s after both pickers have begun to
    wait.
    """
    env = dispatch_env(SMALL, longest=longest)
    assert (
        not played(env, lambda info: 0)[1]
        and env.harvest.delivered == 0
        and env.harvest.now <= until
    )
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_an_action_that_the_mask_forbids_sends_nobody():
    env = dispatch_env(SMALL)
    _, info = env.reset()
    forbidden = int(np.flatnonzero(info["action_mask"] == 0)[0])
    _, reward, *_ = env.step(forbidden)
    assert (
        reward == -1.0 and env.harvest.delivered == 0
    )  # the carriers are asked again after 10 ticks


def test_mistakes():
    with pytest.raises(ValueError, match="reward 'speed'"):
        dispatch_env(SMALL, reward="speed")
    with pytest.raises(ValueError, match="built-in agents only"):
        dispatch_env(Scenario(agents={"picker": "mine.Picker"}))
    env: Any = dispatch_env(SMALL)
    env.reset()
    with pytest.raises(
        ValueError, match=f"action 99: must be a number from 0 to {env.action_space.n - 1}"
    ):
        env.step(99)
    for wrong in (None, 1.5, True, "1", [0, 1]):
        with pytest.raises(ValueError, match="must be a number from 0 to"):
            env.step(wrong)
    env.step(np.array([0]))
    with pytest.raises(ValueError, match="options scenario: unknown"):
        env.reset(options={"scenario": {"rows": 4}})
    with pytest.raises(TypeError, match=r"scenario = 'my\.yaml': must be a Scenario"):
        dispatch_env("my.yaml")


FAULTS = [
    ("Raising", "LookupError: no such bin here", 'raise LookupError("no such bin here")'),
    (
        "Inventing",
        "ValueError: the dispatch policy assigns bin bin_77, which is not available",
        "class Inventing(Own):",
    ),
    ("Silent", "TypeError: assign returned None", "class Silent(Own):"),
]


@pytest.mark.parametrize(("policy", "fault", "line"), FAULTS)
def test_a_fault_of_an_own_policy_is_told_with_its_place(policy, fault, line):
    number = 1 + [
        text.strip() for text in Path(own_policies.__file__).read_text().splitlines()
    ].index(line)
    with pytest.raises(RuntimeError) as told:
        dispatch_env(with_changes(SMALL, dispatch=f"tests.support.own_policies.{policy}")).reset()
    words = str(told.value)
    assert (
        words.startswith(f"dispatch policy tests.support.own_policies.{policy}, tick ")
        and fault in words
    )
    assert words.endswith(f"({own_policies.__file__}, line {number})")


VIEW = Dispatching(lay_out(SMALL))
CARRIERS = [
    CarrierReport("carrier_01", "", True, 0.0),
    CarrierReport("carrier_02", "bin_01", False, 70.0),
]


def test_what_a_policy_is_told_becomes_arrays():
    observation = VIEW.observation(120, [BIN], CARRIERS)
    assert VIEW.observation_space.contains(observation)
    assert observation["bins"].reshape(4, 6).tolist() == [
        [0.0] * 6,
        [1.0, 3.0, 10.0, 4.0, 60.0, 50.0],
        [0.0] * 6,
        [0.0] * 6,
    ]
    assert observation["carriers"].tolist() == [1.0, 0.0, 0.0, 70.0] and observation[
        "seconds"
    ].tolist() == [12.0]


def test_actions_are_orders():
    actions = range(VIEW.action_space.n)
    assert [VIEW.action(VIEW.order(action)) for action in actions] == list(actions)
    free = np.flatnonzero(VIEW.mask([BIN], CARRIERS)).tolist()
    assert [VIEW.order(action) for action in free] == [None, ("bin_02", "carrier_01")]


def test_what_has_learned_is_the_policy_of_the_simulator():
    """Here a policy has learned what `predictive` does."""
    own = Predictive(lay_out(SMALL))
    told = BinReport("bin_02", 3, "east", "picker_02", 20, 50.0, 0.0, 60.0)

    def choose(observation, mask):
        return max(np.flatnonzero(mask))

    assert VIEW.orders(choose, 120, [told], CARRIERS) == own.assign(
        120, [told], CARRIERS, own.Memory()
    )
    assert VIEW.orders(lambda observation, mask: 0, 120, [told], CARRIERS) == []
    assert VIEW.orders(choose, 120, [], CARRIERS) == []


def test_the_examples_choices_suffice_for_a_good_harvest():
    """What the learned policy of the example can choose is enough for a good harvest.

    It sends a carrier to the first bin that it sees as soon as that is due, which is about what
    `predictive` does.
    """
    env = AnyOrchard()
    ended = False
    seen, _ = env.reset(seed=1)
    while not ended:
        seen, _, *ends, _ = env.step(int(env.action_masks()[1] and seen[1] * SCALE[1] <= 5.0))
        ended = any(ends)
    assert env.env.harvest.is_over
    assert env.env.harvest.seconds == pytest.approx(
        DiscreteHarvest(lay_out(env.env.scenario)).run().seconds, rel=0.1
    )
