"""A dispatch policy that learns, by MaskablePPO of sb3-contrib (`pip install sb3-contrib`), for
orchards of any size.

    python examples/learned_dispatch.py --minutes 10
    orchard benchmark examples.learned_dispatch.Learned

The first learns in random orchards, and writes learned_dispatch.zip. The second has its score,
beside those of the built-in policies.

It sees the eight bins for which a carrier must leave first, and sends the next carrier to one of
them, or none.
"""

import argparse
import math
import time
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from orchard import Scenario
from orchard.gym import Dispatching, dispatch_env

MODEL = Path("learned_dispatch.zip")
BINS = 8  # that it sees
SCALE = np.array(
    [1.0, 300.0, 300.0, 300.0, 300.0]
)  # of what it sees of a bin: it is there, slack (s), to full (s), since (s), way (m)
NOBODY = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "weeds": 0,
}


class Choices:
    """What can be done at a decision, in a size that does not depend on the orchard's."""

    def __init__(self, observation: dict[str, np.ndarray]) -> None:
        bins, carriers = observation["bins"].reshape(-1, 6), observation["carriers"].reshape(-1, 2)
        calls, _, since, full, reach, metres = bins.T
        first = [i for i in np.argsort(full - reach, kind="stable") if calls[i]][:BINS]
        free = np.flatnonzero(carriers[:, 0])
        seen = np.zeros((BINS, len(SCALE)))
        seen[: len(first)] = (
            np.stack([calls, full - reach, full, since, metres], axis=1)[first] / SCALE
        )
        self.features = np.append(seen.ravel(), [len(free) / len(carriers)]).astype(np.float32)
        is_late = (
            bool(first) and len(free) > 0 and full[first[0]] < reach[first[0]]
        )  # then one must leave, or the harvest may never end
        self.mask = np.array(
            [not is_late, *(i < len(first) and len(free) > 0 for i in range(BINS))]
        )
        carrier = free[np.argmin(carriers[free, 1])] if len(free) else 0
        self.actions = [
            0,
            *(1 + int(i) * len(carriers) + int(carrier) for i in first),
        ]  # of `Dispatching`


class AnyOrchard(gymnasium.Env[np.ndarray, int]):
    """Dispatch in a new random orchard in each episode.

    The reward is the time that passes, as a share of what picking takes at least.
    """

    observation_space = spaces.Box(-np.inf, np.inf, (BINS * len(SCALE) + 1,))
    action_space = spaces.Discrete(1 + BINS)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        scenario = random_orchard(self.np_random)
        self.picking = (
            math.ceil(scenario.rows / scenario.pickers)
            * scenario.row_length
            / scenario.mean_picking_speed
        )
        self.env = dispatch_env(scenario)
        return self._seen(self.env.reset()[0]), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, _ = self.env.step(
            self.choices.actions[int(action)]
        )
        return self._seen(observation), 10.0 * reward / self.picking, terminated, truncated, {}

    def action_masks(self) -> np.ndarray:
        return self.choices.mask

    def _seen(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        self.choices = Choices(observation)
        return self.choices.features


def random_orchard(random: np.random.Generator) -> Scenario:
    """Return an orchard of 6 to 24 rows in which nothing but its sizes is random; none of the
    benchmark's.
    """
    rows = int(random.integers(6, 25))
    pickers = int(random.integers(2, max(3, rows // 2 + 1)))
    sizes = {
        "rows": rows,
        "pickers": pickers,
        "carriers": int(random.integers(max(1, pickers // 3), pickers + 1)),
    }
    rules = {
        "route": random.choice(["one-way", "two-way"]),
        "rows_to_pickers": random.choice(["balanced", "balanced-ends"]),
    }
    return Scenario(
        **sizes,
        **{key: str(value) for key, value in rules.items()},
        picking_speed=float(10 ** random.uniform(-1.3, 0.0)),
        **NOBODY,
    )


class Learned:
    """Name it in a scenario: `dispatch: examples.learned_dispatch.Learned`."""

    Memory = dict
    early = True

    def __init__(self, layout):
        self.dispatching, self.model = Dispatching(layout), model()

    def choose(self, observation, mask):
        choices = Choices(observation)
        action, _ = self.model.predict(
            choices.features, action_masks=choices.mask, deterministic=True
        )
        return choices.actions[int(action)]

    def assign(self, now, bins, carriers, memory):
        return self.dispatching.orders(self.choose, now, bins, carriers)


@cache
def model() -> Any:
    return learner().load(MODEL, device="cpu")


def learner() -> Any:
    """The class that learns. One thread is faster than two with networks this small."""
    import torch
    from sb3_contrib import MaskablePPO

    torch.set_num_threads(1)
    return MaskablePPO


def learn(minutes: float, seed: int) -> None:
    """Learn for some minutes, and write what was learned."""
    learning = learner()(
        "MlpPolicy",
        AnyOrchard(),
        n_steps=1024,
        batch_size=256,
        learning_rate=1e-3,
        gamma=1.0,
        seed=seed,
    )
    end = time.monotonic() + 60.0 * minutes
    learning.learn(10**9, callback=lambda *_: time.monotonic() < end)
    learning.save(MODEL)
    print(f"{learning.num_timesteps:,} decisions; {MODEL} written")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    learn(**vars(parser.parse_args()))
