"""Dispatch in many orchards at once: Gymnasium's VectorEnv over a batch of the event model.

An orchard is one of the environments here: a harvest of the scenario with a seed of its own. The
batch (`orchard.event_model.batch`) holds the states of all harvests, and its loop is compiled.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from orchard.event_model.batch.columns import OVER
from orchard.event_model.batch.harvests import HarvestBatch
from orchard.event_model.policies import AskedPolicy
from orchard.event_model.results import LONGEST
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.gym.dispatch import REWARDS, Dispatching, Reward, Transition
from orchard.gym.episodes import Episode, plain, refuse_what_is_no_episode
from orchard.gym.rewards import named
from orchard.gym.spaces import Arrays

# Seeds are 0 to MOST_SEED.
SEEDS = 2**63
MOST_SEED = SEEDS - 1
# The key of the options that says in which orchards an episode begins.
RESET_MASK = "reset_mask"

# What a step returns: observations, rewards, terminated, truncated, infos.
Stepped = tuple[Arrays, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]


class DispatchVecEnv(VectorEnv[Arrays, np.ndarray, np.ndarray]):
    """The dispatch of a scenario in many orchards at once: each is what a `DispatchEnv` is, with a
    seed of its own.

    Observations, actions and rewards are those of `DispatchEnv`, with a first dimension more.
    `infos["action_mask"]` says which actions can be, (orchards, actions) int8. Where a harvest has
    ended, `infos["seconds"]` is its length, and `infos["_seconds"]` says where; in the mode
    "SameStep" both are in `infos["final_info"]`. No policy of Python is asked, so there is no
    `scripted`. Whether a policy of one's own hears of bins before they are full is asked once, with
    the scenario's seed.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        scenario: Scenario,
        num_envs: int = 1,
        *,
        reward: str | Reward = "time",
        longest: int = LONGEST,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """`num_envs`: the number of orchards. `reward`, `longest`: as of a `DispatchEnv`; a
        function is called for each orchard. `autoreset_mode`: when an orchard begins anew after
        the end of an episode, as Gymnasium has it: "NextStep", "SameStep", "Disabled".

        Raises as `DispatchEnv` does, and ValueError for a number of orchards below 1, an unknown
        mode, and a route or a rule of one's own, which may do otherwise with each seed.
        """
        refuse_what_is_no_episode(scenario, longest)
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be at least 1")
        self._mode = AutoresetMode(autoreset_mode)
        self._reward = named(reward, REWARDS)
        # A function of the user's own is called for each orchard.
        self._takes_arrays = isinstance(reward, str)
        layout = lay_out(scenario)
        self.scenario = scenario
        self.num_envs = num_envs
        self.metadata = type(self).metadata | {"autoreset_mode": self._mode}
        self.dispatching = Dispatching(layout)
        self.single_observation_space = self.dispatching.observation_space
        self.single_action_space = self.dispatching.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._batch = HarvestBatch(
            layout,
            num_envs,
            is_early=AskedPolicy(layout).is_early,
            longest=longest,
            bin_order=self.dispatching.bins,
            carrier_order=self.dispatching.carriers,
        )
        # Without a seed each orchard has another one.
        self._episodes = []
        for number in range(num_envs):
            self._episodes.append(Episode((scenario.seed + number) % SEEDS, -1))
        # For each orchard: whether a first episode has begun, and whether the present one has
        # ended.
        self._has_begun = np.zeros(num_envs, np.bool_)
        self._has_ended = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode in each orchard, and return observations and infos at their first
        decisions.

        `seed`: one for each orchard; or that of the first one, and each further orchard has the
        next number. None: at first as if the scenario's seed were given, and later seeds that are
        drawn. `options`: {"reset_mask": (orchards,) bool}, where to begin; without it everywhere.
        """
        which = self._which(options)
        seeds = self._seeds(seed)
        # Gymnasium's own random numbers, which this environment does not use, take one seed only.
        if not isinstance(seed, (list, tuple, np.ndarray)):
            super().reset(seed=plain(seed))
        for number, own in enumerate(seeds):
            if which[number]:
                self._begin(number, own)
        self._batch.step()
        return self._observed(), self._infos(which)

    def step(self, actions: Any) -> Stepped:
        """Do an action in each orchard, and move on to its next decision if this one is taken.

        Raises ResetNeeded before the first reset, and after the end of an episode in the mode
        "Disabled"; ValueError for what are no actions.
        """
        chosen = self._checked(actions)
        # In the mode "NextStep" an orchard whose episode has ended begins anew, and its action does
        # not count.
        begins = np.zeros(self.num_envs, np.bool_)
        if self._mode == AutoresetMode.NEXT_STEP:
            begins = self._has_ended.copy()
        self._refuse_over(begins)
        for number in np.flatnonzero(begins):
            self._begin(int(number), None)
        self._batch.act(~begins, chosen)
        self._batch.step()
        rewards = self._rewards(begins)
        stages = self._batch.arrays["episodes"]["stage"]
        is_finished = self._batch.arrays["episodes"]["is_finished"]
        self._has_ended = (stages == OVER) & ~begins
        terminated = self._has_ended & is_finished
        truncated = self._has_ended & ~is_finished
        observed = self._observed()
        infos = self._infos(np.ones(self.num_envs, np.bool_))
        if self._mode == AutoresetMode.SAME_STEP and self._has_ended.any():
            observed, infos = self._begun_anew(observed, infos)
        return observed, rewards, terminated, truncated, infos

    def action_masks(self) -> np.ndarray:
        """Return which actions can be, (orchards, actions) bool."""
        masks: np.ndarray = self._batch.arrays["masks"].astype(np.bool_)
        return masks

    # -- checks of arguments

    def _which(self, options: dict[str, Any] | None) -> np.ndarray:
        """Return where to begin, (orchards,) bool. Raises ValueError for unknown options."""
        options = options or {}
        if unknown := ", ".join(str(key) for key in options if key != RESET_MASK):
            raise ValueError(
                f"options {unknown}: unknown; a dispatch_vec_env has {RESET_MASK} only"
            )
        if RESET_MASK not in options:
            return np.ones(self.num_envs, np.bool_)
        mask = np.asarray(options[RESET_MASK])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"options {RESET_MASK}: must be {self.num_envs} times True or False, one of them"
                f" True, not {mask!r}"
            )
        return mask

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Return the seed of each orchard; None: it is drawn. Raises ValueError for what is no
        seed.
        """
        if seed is None:
            return [None] * self.num_envs
        seeds: list[Any] = [seed]
        if isinstance(seed, (list, tuple, np.ndarray)):
            seeds = [plain(own) for own in seed]
        elif isinstance(seed, (int, np.integer)):
            return self._seeds_from(int(seed))
        for own in seeds:
            is_seed = own is None or (isinstance(own, int) and 0 <= own <= MOST_SEED)
            if not is_seed:
                raise ValueError(f"seed {own!r}: must be a whole number from 0 to {MOST_SEED}")
        if len(seeds) != self.num_envs:
            raise ValueError(
                f"seed: {len(seeds)} of them; must be one, or one for each of {self.num_envs}"
            )
        return seeds

    def _seeds_from(self, first: int) -> list[int | None]:
        """Return consecutive seeds for all orchards. Raises ValueError if one is out of bounds."""
        most = MOST_SEED - self.num_envs + 1
        if not 0 <= first <= most:
            raise ValueError(f"seed {first}: must be a whole number from 0 to {most}")
        return list(range(first, first + self.num_envs))

    def _checked(self, actions: Any) -> np.ndarray:
        """Return actions as an array of whole numbers. Raises ValueError for others."""
        chosen = np.asarray(actions)
        most = self.dispatching.action_space.n - 1
        has_form = chosen.shape == (self.num_envs,) and chosen.dtype.kind in "iu"
        if not has_form or chosen.min() < 0 or chosen.max() > most:
            raise ValueError(
                f"actions {actions!r}: must be {self.num_envs} whole numbers from 0 to {most}"
            )
        return chosen.astype(np.int64)

    def _refuse_over(self, begins: np.ndarray) -> None:
        """Raise ResetNeeded if an orchard has no episode that goes on, and none begins there."""
        over = np.flatnonzero(~self._has_begun | (self._has_ended & ~begins))
        if self._mode != AutoresetMode.SAME_STEP and over.size:
            raise ResetNeeded(
                f"orchard {over[0]}: its episode is over, or none has begun: call reset()"
            )
        if not self._has_begun.all():
            raise ResetNeeded("no episode has begun: call reset()")

    # -- what is done

    def _begin(self, number: int, seed: int | None) -> None:
        """Let an orchard begin anew in the next step of the batch."""
        self._episodes[number] = self._episodes[number].after(seed)
        self._batch.begin(number, self._episodes[number].seed)
        self._has_begun[number] = True
        self._has_ended[number] = False

    def _begun_anew(self, observed: Arrays, infos: dict[str, Any]) -> tuple[Arrays, dict[str, Any]]:
        """Begin anew where an episode has ended. Return observations and infos after that.

        `observed`, `infos`: at the end of the episodes. The infos that are returned hold these too,
        under the keys that Gymnasium prescribes for the mode "SameStep".
        """
        ended = self._has_ended.copy()
        final: np.ndarray = np.full(self.num_envs, None, dtype=object)
        for number in np.flatnonzero(ended):
            final[number] = {key: array[number] for key, array in observed.items()}
            self._begin(int(number), None)
        self._batch.step()
        begun = self._infos(np.ones(self.num_envs, np.bool_))
        # Gymnasium's "_key" says in which orchards "key" counts: here only where one has ended.
        final_info = {}
        for key, values in infos.items():
            final_info[key] = values
            if key.startswith("_"):
                final_info[key] = values & ended
        begun |= {
            "final_obs": final,
            "_final_obs": ended,
            "final_info": final_info,
            "_final_info": ended.copy(),
        }
        return self._observed(), begun

    # -- results of a step

    def _rewards(self, begins: np.ndarray) -> np.ndarray:
        """Return the reward in each orchard; 0 where an episode begins."""
        # (orchards, 3): the fields of a Transition.
        happened = self._batch.arrays["happened"]
        rewards: np.ndarray = np.zeros(self.num_envs)
        if self._takes_arrays:
            of_all: Any = Transition(*happened.T)
            rewards[:] = self._reward(of_all)
        else:
            for number in np.flatnonzero(~begins):
                seconds, waited, delivered = happened[number].tolist()
                # float() raises for None, which an array of numpy would take as NaN.
                reward = self._reward(Transition(seconds, waited, int(delivered)))
                rewards[number] = float(reward)
        rewards[begins] = 0.0
        return rewards

    def _observed(self) -> Arrays:
        """Return the observation of each orchard."""
        arrays = self._batch.arrays
        return {
            "bins": arrays["bins_seen"].reshape(self.num_envs, -1).copy(),
            "carriers": arrays["carriers_seen"].reshape(self.num_envs, -1).copy(),
            "seconds": arrays["seconds_seen"].copy(),
        }

    def _infos(self, which: np.ndarray) -> dict[str, Any]:
        """Return the infos. `which`: for which orchards they count, (orchards,) bool."""
        episodes = self._batch.arrays["episodes"]
        has_seconds = which & (episodes["stage"] == OVER) & episodes["is_finished"]
        infos = {"action_mask": self._batch.arrays["masks"].copy(), "_action_mask": which.copy()}
        if has_seconds.any():
            infos["seconds"] = np.where(has_seconds, episodes["seconds"], 0.0)
            infos["_seconds"] = has_seconds
        return infos


dispatch_vec_env = DispatchVecEnv
