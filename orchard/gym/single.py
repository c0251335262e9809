"""One learned body of a harvest as a Gymnasium Env."""

from typing import Any

import gymnasium
from gymnasium import spaces

from orchard.field.scenario import Scenario
from orchard.gym.episodes import plain
from orchard.gym.harvest import LONGEST, HarvestEnv, parallel_env
from orchard.gym.rewards import Reward
from orchard.gym.spaces import Arrays
from orchard.local import Local


def single_env(
    scenario: Scenario,
    robot: str,
    *,
    reward: str | Reward = "delivery",
    deeds: bool = False,
    longest: int = LONGEST,
    is_hashed: bool = False,
) -> "SingleEnv":
    """Return a harvest in which one body learns, as a Gymnasium Env; all others follow our agents. For the rest see `parallel_env`."""
    return SingleEnv(parallel_env(scenario, [robot], reward=reward, deeds=deeds, longest=longest, is_hashed=is_hashed))


class SingleEnv(gymnasium.Env[Arrays, Any]):
    """The view of the only learned body of a HarvestEnv."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, harvest: HarvestEnv) -> None:
        """Raises ValueError unless exactly one body learns."""
        (self.robot,) = harvest.possible_agents
        self.harvest = harvest
        self.observation_space: spaces.Space[Any] = harvest.observation_space(self.robot)
        self.action_space: spaces.Space[Any] = harvest.action_space(self.robot)

    @property
    def local(self) -> Local:
        """The run."""
        return self.harvest.local

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode, as `HarvestEnv.reset` does. Return observation and info."""
        super().reset(seed=plain(seed))
        observations, infos = self.harvest.reset(seed, options)
        return observations[self.robot], infos[self.robot]

    def step(self, action: Any) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        """Move on by a tick, 0.1 s. Return observation, reward, terminated, truncated and info. Raises as `HarvestEnv.step` does."""
        observations, rewards, terminated, truncated, infos = self.harvest.step({self.robot: action})
        name = self.robot
        return observations[name], rewards[name], terminated[name], truncated[name], infos[name]
