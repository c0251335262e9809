"""The environment in which dispatch is learned: the interface's checks, the same harvest as the
event model, use in the simulator.

An episode is a harvest of the event model, which stops where a carrier can be sent. An action is a
number: 0 sends none, the others send a free carrier to a bin. `info` has what the scenario's own
policy would do (`scripted`), and which actions can be done (`action_mask`).
"""

from pathlib import Path
from typing import Any

import numpy as np
import own_policies
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from msgspec.structs import replace
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
BIN = BinReport(
    "bin_02",
    lane=3,
    side="east",
    picker="picker_02",
    since=20,
    metres=50.0,
    seconds_to_full=4.0,
    seconds_to_reach=60.0,
)


def played(env, choose, seed=None):
    """Play an episode. `choose`: returns an action for an info.

    Return the sum of the rewards, and whether the harvest was ended (else the episode was cut).
    """
    _, info = env.reset(seed=seed)
    total = 0.0
    ended = (False, False)
    while not any(ended):
        _, reward, *ended, info = env.step(choose(info))
        total += reward
    return total, ended[0]


def scripted(info):
    """Choose as the scenario's own policy."""
    return info["scripted"]


def test_gymnasium_finds_no_fault_in_the_environment():
    check_env(dispatch_env(SMALL), skip_render_check=True)


@pytest.mark.parametrize("policy", ["predictive", "farthest-first", "longest-waiting"])
@pytest.mark.parametrize("metres_per_bin", [None, 30.0])
def test_scripted_actions_give_the_harvest_of_the_fast_model(policy, metres_per_bin):
    """The fast model is the event model, in which the same policy decides by itself."""
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
    assert terminated
    assert env.harvest.deliveries == model.deliveries
    assert env.harvest.seconds == model.seconds
    # The reward of a step is minus its seconds. Those before the first decision belong to no step.
    assert -model.seconds <= total < 0.0


def test_an_episode_goes_on_while_all_carriers_charge():
    """The only carrier charges for longer than makes a jam, and the episode is not cut."""
    scenario = empty_orchard(
        rows=4,
        pickers=2,
        carriers=1,
        dispatch="predictive",
        carrying={"battery": {"hours": 0.25, "reserve": 0.6}},
    )
    env = dispatch_env(scenario)
    _, terminated = played(env, scripted)
    assert terminated
    assert env.harvest.seconds == DiscreteHarvest(lay_out(scenario)).run().seconds


def earned(reward, choose=scripted):
    """Return the sum of a reward over an episode."""
    total, _ = played(dispatch_env(SMALL, reward=reward), choose)
    return total


def test_rewards_count_bins_and_waits_or_what_a_function_says():
    model = DiscreteHarvest(lay_out(SMALL)).run()
    assert model.delivered == SMALL.rows
    assert earned("delivery") == SMALL.rows
    assert earned("waiting") == pytest.approx(-model.waited_seconds)
    assert earned("waiting", lambda info: 0) < -1200.0, (
        "two pickers, which wait for 600 s until it is a jam"
    )
    assert earned(lambda interval: 2.0 * interval.delivered) == 2.0 * SMALL.rows


def test_masked_random_actions_finish_and_are_repeatable():

    def deliveries():
        """Return when bins are delivered in an episode of random actions."""
        env = dispatch_env(SMALL)
        rng = np.random.default_rng(1)
        _, terminated = played(
            env, lambda info: rng.choice(np.flatnonzero(info["action_mask"])), seed=4
        )
        assert terminated
        return env.harvest.deliveries

    assert deliveries() == deliveries()


@pytest.mark.parametrize(
    ("longest", "until"),
    [(5, 5), (5000, 5000), (LONGEST, 12_000)],
    ids=["before the first decision", "after so many ticks", "as a jam"],
)
def test_an_episode_without_any_carrier_sent_is_truncated(longest, until):
    """`longest`: ticks that an episode may last. `until`: the tick by which it is cut. A jam is
    told 600 s after both pickers have begun to wait.
    """
    env = dispatch_env(SMALL, longest=longest)
    _, terminated = played(env, lambda info: 0)
    assert not terminated
    assert env.harvest.delivered == 0
    assert env.harvest.now <= until
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_an_action_that_the_mask_forbids_sends_no_carrier():
    env = dispatch_env(SMALL)
    _, info = env.reset()
    forbidden = int(np.flatnonzero(info["action_mask"] == 0)[0])
    _, reward, *_ = env.step(forbidden)
    # It is asked again after 10 ticks, 1 s.
    assert reward == -1.0
    assert env.harvest.delivered == 0


def test_what_is_no_environment_or_no_action_is_told():
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


# A policy of tests/support/own_policies.py, its fault, and the line of that file which is named.
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
    source = Path(own_policies.__file__).read_text().splitlines()
    number = 1 + [text.strip() for text in source].index(line)
    with pytest.raises(RuntimeError) as told:
        dispatch_env(with_changes(SMALL, dispatch=f"tests.support.own_policies.{policy}")).reset()
    words = str(told.value)
    assert words.startswith(f"dispatch policy tests.support.own_policies.{policy}, tick ")
    assert fault in words
    assert words.endswith(f"({own_policies.__file__}, line {number})")


# The small orchard has four bins: each picker and each of two carriers begins with one.
VIEW = Dispatching(lay_out(SMALL))
# A free one, and one at work.
CARRIERS = [
    CarrierReport("carrier_01", "", True, 0.0),
    CarrierReport("carrier_02", "bin_01", False, 70.0),
]


def test_what_a_policy_is_told_becomes_arrays():
    """It is tick 120, 12 s. Of four bins only bin_02 wants a carrier."""
    observation = VIEW.observation(120, [BIN], CARRIERS)
    assert VIEW.observation_space.contains(observation)
    # Of each bin: 1 if it wants a carrier, lane, for how long it has wanted one (s: from tick 20 to
    # tick 120), seconds_to_full, seconds_to_reach, metres.
    assert observation["bins"].reshape(4, 6).tolist() == [
        [0.0] * 6,
        [1.0, 3.0, 10.0, 4.0, 60.0, 50.0],
        [0.0] * 6,
        [0.0] * 6,
    ]
    # Of each carrier: 1 if it can be sent, and its metres to the head of its line.
    assert observation["carriers"].tolist() == [1.0, 0.0, 0.0, 70.0]
    assert observation["seconds"].tolist() == [12.0]


def test_actions_are_orders():
    actions = range(VIEW.action_space.n)
    assert [VIEW.action(VIEW.order(action)) for action in actions] == list(actions)
    free = np.flatnonzero(VIEW.mask([BIN], CARRIERS)).tolist()
    assert [VIEW.order(action) for action in free] == [None, ("bin_02", "carrier_01")]


def test_what_has_learned_is_the_policy_of_the_simulator():
    """Here a policy has learned what `predictive` does."""
    own = Predictive(lay_out(SMALL))
    full = replace(BIN, seconds_to_full=0.0)

    def choose(observation, mask):
        # Action 0 sends none. So this sends a carrier where it can.
        return max(np.flatnonzero(mask))

    assert VIEW.orders(choose, 120, [full], CARRIERS) == own.assign(
        120, [full], CARRIERS, own.Memory()
    )
    assert VIEW.orders(lambda observation, mask: 0, 120, [full], CARRIERS) == []
    assert VIEW.orders(choose, 120, [], CARRIERS) == []


def test_the_examples_choices_suffice_for_a_good_harvest():
    """What the learned policy of examples/learned_dispatch.py can choose suffices for a harvest
    that takes about as long as with the scenario's own policy.

    Here it sends a carrier (action 1) to the first bin that it sees as soon as that is due: it will
    be full at most 5 s after a carrier could be there. That is about what `predictive` does.
    """
    env = AnyOrchard()
    ended = False
    seen, _ = env.reset(seed=1)
    while not ended:
        # The second number that it sees is the slack of the first bin, as a share of SCALE[1] s.
        slack_seconds = seen[1] * SCALE[1]
        can_send = env.action_masks()[1]
        seen, _, *ends, _ = env.step(int(can_send and slack_seconds <= 5.0))
        ended = any(ends)
    assert env.env.harvest.is_over
    assert env.env.harvest.seconds == pytest.approx(
        DiscreteHarvest(lay_out(env.env.scenario)).run().seconds, rel=0.1
    )
