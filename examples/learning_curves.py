"""How well a dispatch policy learns: MaskablePPO of sb3-contrib in the benchmark's orchards for
learning, scored in those for the test.

    python examples/learning_curves.py --minutes 10 --seeds 5

It writes what docs/benchmark.md shows into docs/learning.json, after each score, and the policy of
the last seed into learned_dispatch.zip, which learned_dispatch.py can use. Minutes are those of the
processor, of one core; scoring is not counted.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

sys.path.insert(0, str(Path(__file__).parents[1]))

from examples.learned_dispatch import (
    BINS,
    COLUMNS_OF_A_BIN,
    COLUMNS_OF_A_CARRIER,
    MODEL,
    SCALE,
    learner,
)
from orchard import with_changes
from orchard.gym import dispatch_vec_env
from orchard.study.benchmark.instances import Instance, instances

TARGET = Path("docs/learning.json")
# Harvests at once of each orchard for learning.
HARVESTS = 8
# A harvest that takes so many times its proven time is given up: its score is 0.
PATIENCE = 4.0
# Minutes of learning after which it is scored, as shares of all; the last one is the end.
SCORED = (0.0, 0.05, 0.15, 0.4, 1.0)
# Columns of what an orchard's observation says of a bin: whether it calls, the time since it calls,
# until it is full and to reach it, s, and the way to it, m.
CALLS, SINCE, FULL, REACH, METRES = 0, 2, 3, 4, 5
# The return of a harvest that takes its proven time is minus this.
RETURN = 10.0


class OneOrchard:
    """Harvests of one orchard at once, as `Choices` of learned_dispatch.py shows them: the bins for
    which a carrier must leave first.
    """

    def __init__(self, instance: Instance, harvests: int) -> None:
        early = with_changes(instance.whole_scenario, dispatch="predictive")
        proven = [draw.proven_seconds for draw in instance.draws]
        self.proven = np.array(proven)
        self.size = harvests
        self.envs = dispatch_vec_env(
            early,
            harvests,
            # In ticks, ten a second.
            longest=round(10.0 * PATIENCE * max(proven)),
            autoreset_mode="SameStep",
        )

    def see(self, observed: dict[str, np.ndarray]) -> None:
        """Take an observation: of it, what a policy sees, what it may do, and what that means."""
        # Shapes (harvests, bins, 6) and (harvests, carriers, 2): free or not, and the way, m.
        bins = observed["bins"].reshape(self.size, -1, COLUMNS_OF_A_BIN)
        carriers = observed["carriers"].reshape(self.size, -1, COLUMNS_OF_A_CARRIER)
        calls = bins[:, :, CALLS] > 0.0
        slack = bins[:, :, FULL] - bins[:, :, REACH]
        # The numbers of the bins that call, the least slack first; then others, which are masked.
        first = np.argsort(np.where(calls, slack, np.inf), axis=1, kind="stable")[:, :BINS]
        is_seen = np.take_along_axis(calls, first, 1)
        columns = [bins[:, :, CALLS], slack, *bins[:, :, [FULL, SINCE, METRES]].transpose(2, 0, 1)]
        features = np.zeros((self.size, BINS, len(SCALE)))
        for number, column in enumerate(columns):
            shown = np.take_along_axis(column, first, 1) * is_seen
            features[:, : first.shape[1], number] = shown / SCALE[number]
        is_free = carriers[:, :, 0] > 0.0
        share = is_free.mean(axis=1, keepdims=True)
        self.features = np.hstack([features.reshape(self.size, -1), share]).astype(np.float32)
        can_send = is_seen & is_free.any(axis=1, keepdims=True)
        self.masks = np.zeros((self.size, 1 + BINS), np.bool_)
        self.masks[:, 1 : 1 + first.shape[1]] = can_send
        # Where a carrier is late one must leave, or the harvest may never end.
        is_late = can_send[:, 0] & (np.take_along_axis(slack, first[:, :1], 1)[:, 0] < 0.0)
        self.masks[:, 0] = ~is_late
        nearest = np.where(is_free, carriers[:, :, 1], np.inf).argmin(axis=1)
        self.actions = np.zeros((self.size, 1 + BINS), np.int64)
        sends = 1 + first * carriers.shape[1] + nearest[:, None]
        self.actions[:, 1 : 1 + first.shape[1]] = sends

    def step(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Return rewards, where a harvest has ended, where it was given up, and infos."""
        actions = self.actions[np.arange(self.size), chosen]
        observed, rewards, terminated, truncated, infos = self.envs.step(actions)
        self.see(observed)
        return RETURN * rewards / self.proven.mean(), terminated, truncated, infos


class AllOrchards(VecEnv):
    """All orchards for learning at once, as Stable-Baselines3 has it."""

    def __init__(self, known: list[Instance], seed: int) -> None:
        self.orchards = [OneOrchard(instance, HARVESTS) for instance in known]
        self.first_seed = seed
        super().__init__(
            HARVESTS * len(known),
            spaces.Box(-np.inf, np.inf, (BINS * len(SCALE) + 1,)),
            spaces.Discrete(1 + BINS),
        )

    def reset(self) -> np.ndarray:
        for number, orchard in enumerate(self.orchards):
            # Each orchard takes HARVESTS seeds from this one on, fewer than ten.
            orchard.see(orchard.envs.reset(seed=1000 * self.first_seed + 10 * number)[0])
        return np.vstack([orchard.features for orchard in self.orchards])

    def step_async(self, actions: np.ndarray) -> None:
        self.chosen = np.split(actions, len(self.orchards))

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        rewards = []
        ended = []
        for orchard, chosen in zip(self.orchards, self.chosen, strict=True):
            earned, terminated, truncated, _ = orchard.step(chosen)
            rewards.append(earned)
            ended.append(terminated | truncated)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for number in np.flatnonzero(np.concatenate(ended)):
            # What is given up has its return so far: it is long, and so bad enough.
            infos[number]["terminal_observation"] = np.zeros(BINS * len(SCALE) + 1, np.float32)
        features = np.vstack([orchard.features for orchard in self.orchards])
        return features, np.concatenate(rewards), np.concatenate(ended), infos

    def env_method(self, name: str, *_: Any, **__: Any) -> list[Any]:
        """Return the masks: nothing else is asked for."""
        assert name == "action_masks"
        return [mask for orchard in self.orchards for mask in orchard.masks]

    def has_attr(self, name: str) -> bool:
        return name == "action_masks"

    def get_attr(self, name: str, indices: Any = None) -> list[Any]:
        return [None] * self.num_envs

    def set_attr(self, name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

    def close(self) -> None:
        pass


def score(model: Any, known: list[Instance]) -> float:
    """Return the score of what was learned, 0 to 1, as `orchard benchmark` has it."""
    scores = []
    for instance in known:
        orchard = OneOrchard(instance, len(instance.draws))
        orchard.see(orchard.envs.reset(seed=[draw.seed for draw in instance.draws])[0])
        took = np.full(orchard.size, np.nan)
        while np.isnan(took).any():
            chosen, _ = model.predict(
                orchard.features, action_masks=orchard.masks, deterministic=True
            )
            _, terminated, truncated, infos = orchard.step(chosen)
            # A harvest that is over begins anew; only its first end counts.
            is_first = np.isnan(took)
            took[truncated & is_first] = np.inf
            if terminated.any():
                seconds = infos["final_info"]["seconds"]
                took[terminated & is_first] = seconds[terminated & is_first]
        scores.append((orchard.proven / took).mean())
    return float(np.mean(scores))


def curve(seed: int, minutes: float) -> list[tuple[float, int, float]]:
    """Let a policy learn. Return a point for each of SCORED: minutes, decisions, score."""
    known = list(instances().values())
    learns_in = [instance for instance in known if instance.split == "train"]
    scored_in = [instance for instance in known if instance.split == "test"]
    model = learner()(
        "MlpPolicy",
        AllOrchards(learns_in, seed),
        n_steps=32,
        batch_size=512,
        n_epochs=6,
        learning_rate=1e-3,
        gamma=1.0,
        seed=seed,
        device="cpu",
    )
    points = []
    learned = 0.0
    for share in SCORED:
        begun = time.process_time()
        left = 60.0 * minutes * share - learned
        if left > 0.0:
            until = begun + left
            model.learn(
                10**9,
                callback=lambda *_, until=until: time.process_time() < until,
                reset_num_timesteps=False,
            )
        learned += time.process_time() - begun
        points.append((learned / 60.0, model.num_timesteps, score(model, scored_in)))
        print(f"seed {seed}: {learned:.0f} s, {model.num_timesteps:,} decisions:", points[-1][2])
    model.save(MODEL)
    return points


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seeds", type=int, default=5)
    chosen = parser.parse_args()
    curves = {}
    for seed in range(1, 1 + chosen.seeds):
        curves[str(seed)] = curve(seed, chosen.minutes)
        TARGET.write_text(json.dumps({"minutes": chosen.minutes, "curves": curves}, indent=1))


if __name__ == "__main__":
    main()
