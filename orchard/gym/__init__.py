"""Environments in which a policy learns: PettingZoo and Gymnasium over local mode, and dispatch
over the fast model.

    parallel_env(scenario, learned)   PettingZoo's ParallelEnv: some bodies learn
    single_env(scenario, robot)       the same for one body, as a Gymnasium Env
    dispatch_env(scenario)            a Gymnasium Env of events: which carrier fetches which bin
    dispatch_vec_env(scenario, 64)    the same in many orchards at once, as a Gymnasium VectorEnv

Gymnasium makes them by id too: `gymnasium.make("orchard/Dispatch-v1", scenario=...)`,
`gymnasium.make_vec("orchard/Dispatch-v1", num_envs=64, scenario=...)`, and
`gymnasium.make("orchard/Robot-v1", scenario=..., robot="carrier_01")`.

It needs the extra `gym`. docs/extending.md tells how to use it.
"""

try:
    import gymnasium
    import pettingzoo  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"orchard.gym needs the extra gym: pip install 'orchard-sim[gym]' ({error})",
        name=error.name,
    ) from None

from orchard.field.scenario import Scenario
from orchard.gym.dispatch import DispatchEnv, Dispatching, dispatch_env
from orchard.gym.harvest import HarvestEnv, SingleEnv, parallel_env, single_env
from orchard.gym.rewards import REWARDS, Moment
from orchard.gym.vector import DispatchVecEnv, dispatch_vec_env

__all__ = [
    "REWARDS",
    "DispatchEnv",
    "DispatchVecEnv",
    "Dispatching",
    "HarvestEnv",
    "Moment",
    "SingleEnv",
    "dispatch_env",
    "dispatch_vec_env",
    "parallel_env",
    "single_env",
]

# Without a scenario an environment has the default orchard.
gymnasium.register(
    id="orchard/Dispatch-v1",
    entry_point="orchard.gym:dispatch_env",
    vector_entry_point="orchard.gym:dispatch_vec_env",
    kwargs={"scenario": Scenario()},
)
gymnasium.register(
    id="orchard/Robot-v1",
    entry_point="orchard.gym:single_env",
    kwargs={"scenario": Scenario(), "robot": "carrier_01"},
)
