"""Rewards of a `HarvestEnv`, by name. A reward is any function from a `Moment` to a number.

`named` also serves the rewards of dispatch, which get a `Transition` (`orchard.gym.dispatch`). "Our
agent" is the built-in agent of a body, beside which the body learns.
"""

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from functools import partial
from types import FunctionType
from typing import Any, Generic, NamedTuple, TypeVar

import cloudpickle

from orchard.contract.agent import Observation
from orchard.contract.events import Event
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of


class Moment(NamedTuple):
    """One step of a learned body, for a reward."""

    #: What it observed before the step.
    before: Observation
    #: What it observes now.
    after: Observation
    #: What its plan asked for before the step: x, y (m, in the frame `map`), turn (rad).
    goal: tuple[float, float, float]
    #: With which it was to move.
    velocity: Twist
    #: With which our agent would have moved.
    scripted: Twist
    #: m of row that came into its bin.
    filled: float
    #: Of all bodies in this step.
    events: Sequence[Event]


Reward = Callable[[Moment], float]
# What a reward is given: a Moment, or a Transition of dispatch.
Happened = TypeVar("Happened")


def imitation(moment: Moment) -> float:
    """Minus the squared distance to our agent's velocity.

    Speed is measured in the greatest speed that a body of this kind has by default, and turning in
    its greatest yaw rate.
    """
    kind = KINDS[kind_of(moment.after.name)]
    forward = (moment.velocity.x - moment.scripted.x) / kind.speed
    turn = (moment.velocity.yaw - moment.scripted.yaw) / kind.turn
    return -(forward * forward) - turn * turn


def goal(moment: Moment) -> float:
    """How far the body came towards what its plan asked for before the step: metres, plus radians
    of a turn.
    """
    x, y, turn = moment.goal
    before = moment.before
    after = moment.after
    distance_before = math.hypot(x - before.x, y - before.y)
    distance_after = math.hypot(x - after.x, y - after.y)
    progress = distance_before - distance_after
    if turn:
        # What was to turn, less what still is.
        turned = after.pose.yaw - before.pose.yaw
        progress += abs(turn)
        progress -= abs(math.remainder(turn - turned, math.tau))
    return progress


def picking(moment: Moment) -> float:
    """Metres of row that came into the body's bin."""
    return moment.filled


def delivery(moment: Moment) -> float:
    """Bins that were unloaded, whichever carrier brought them."""
    return float(sum(event.what == "unloaded" for event in moment.events))


def care(moment: Moment) -> float:
    """Minus the collisions that the body began."""
    count = 0
    for event in moment.events:
        if event.what == "collision" and event.who == moment.after.name:
            count += 1
    return -float(count)


# Functions with names: an environment can be pickled with them.
REWARDS: Mapping[str, Reward] = {
    "imitation": imitation,
    "goal": goal,
    "picking": picking,
    "delivery": delivery,
    "care": care,
}


def named(
    reward: str | Callable[[Happened], float], rewards: Mapping[str, Callable[[Happened], float]]
) -> Callable[[Happened], float]:
    """Return a reward by its name, or the function itself.

    Raises ValueError for an unknown name.
    """
    if not isinstance(reward, str):
        if _is_nameless(reward):
            return NamelessReward(reward)
        return reward
    if reward not in rewards:
        raise ValueError(
            f"reward {reward!r}: there is none of that name; there are {', '.join(rewards)}, and"
            " functions of your own"
        )
    return rewards[reward]


class NamelessReward(Generic[Happened]):
    """A reward that Python cannot find by a name, such as a lambda.

    Unlike that function it can be pickled, so that an environment can be sent to another process.
    """

    def __init__(self, function: Callable[[Happened], float]) -> None:
        self._function = function

    def __call__(self, happened: Happened) -> float:
        """Return the reward for what has happened."""
        return self._function(happened)

    def __deepcopy__(self, memo: dict[int, Any]) -> "NamelessReward[Happened]":
        """Return a reward with a copy of the function."""
        return NamelessReward(deepcopy(self._function, memo))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how pickle makes it again.

        Raises PicklingError if the function holds what cannot be pickled.
        """
        try:
            code = cloudpickle.dumps(self._function)
        except Exception as error:
            raise pickle.PicklingError(
                f"the reward {self._function} cannot be pickled: {error}; expected a function at"
                " the top of a module, or one that uses nothing but data"
            ) from error
        return _from_code, (code,)


def _from_code(code: bytes) -> NamelessReward[Any]:
    """Return the reward that NamelessReward has pickled."""
    return NamelessReward(cloudpickle.loads(code))


def _is_nameless(function: Callable[..., float]) -> bool:
    """Whether Python cannot find a function by a name: a lambda, a function within one, a part of
    these.
    """
    while isinstance(function, partial):
        function = function.func
    # As "<lambda>", or "make_reward.<locals>.reward".
    return isinstance(function, FunctionType) and "<" in function.__qualname__
