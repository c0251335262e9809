"""One learned body of a harvest as a Gymnasium Env."""

from typing import Any

import gymnasium
from gymnasium import spaces

from orchard.field.scenario import Scenario
from orchard.gym.episodes import plain
from orchard.gym.harvest import HarvestEnv
from orchard.gym.spaces import Arrays
from orchard.local import Local


class SingleEnv(gymnasium.Env[Arrays, Any]):
    """A harvest in which one body learns; all others follow our agents. `harvest` is the HarvestEnv whose only learned body it is."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, scenario: Scenario, robot: str, **options: Any) -> None:
        """`options`: reward, deeds, longest and is_hashed, as for `HarvestEnv`. Raises as it does."""
        self.robot, self.harvest = robot, HarvestEnv(scenario, [robot], **options)
        self.observation_space: spaces.Space[Any] = self.harvest.observation_space(robot)
        self.action_space: spaces.Space[Any] = self.harvest.action_space(robot)

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


single_env = SingleEnv
