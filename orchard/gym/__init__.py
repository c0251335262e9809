"""Environments in which a policy learns: PettingZoo and Gymnasium over local mode, and dispatch
over the fast model.

    parallel_env(scenario, learned)   PettingZoo's ParallelEnv: some bodies learn
    single_env(scenario, robot)       the same for one body, as a Gymnasium Env
    dispatch_env(scenario)            a Gymnasium Env of events: which carrier fetches which bin

It needs the extra `gym`. docs/extending.md tells how to use it.
"""

try:
    import gymnasium  # noqa: F401
    import pettingzoo  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"orchard.gym needs the extra gym: pip install 'orchard-sim[gym]' ({error})",
        name=error.name,
    ) from None

from orchard.gym.dispatch import DispatchEnv, Dispatching, dispatch_env
from orchard.gym.harvest import HarvestEnv, SingleEnv, parallel_env, single_env
from orchard.gym.rewards import REWARDS, Moment

__all__ = [
    "REWARDS",
    "DispatchEnv",
    "Dispatching",
    "HarvestEnv",
    "Moment",
    "SingleEnv",
    "dispatch_env",
    "parallel_env",
    "single_env",
]
