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
# What it sees of a bin, each divided by a number of usual size: whether it is there, its slack (s),
# the time until it is full (s), the time since which it calls (s), and the way to it (m). Slack is
# the time until a carrier must leave, so that it is there when the bin is full.
SCALE = np.array([1.0, 300.0, 300.0, 300.0, 300.0])
# Columns of a bin, and of a carrier, in the observation of `orchard.gym.dispatch_env`.
COLUMNS_OF_A_BIN = 6
COLUMNS_OF_A_CARRIER = 2
NOBODY = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "weeds": 0,
}


class Choices:
    """What can be done at a decision, in a size that does not depend on the orchard's.

    A choice is 0, which sends no carrier, or the place from 1 on of one of the bins that are seen,
    to which the nearest free carrier is sent. `features`: what the policy sees. `mask`: which
    choices can be. `actions`: what each choice means for `Dispatching`.
    """

    def __init__(self, observation: dict[str, np.ndarray]) -> None:
        bins = observation["bins"].reshape(-1, COLUMNS_OF_A_BIN)
        carriers = observation["carriers"].reshape(-1, COLUMNS_OF_A_CARRIER)
        calls, _, since, full, reach, metres = bins.T
        slack = full - reach
        # The numbers of the bins that call, the least slack first.
        first = [number for number in np.argsort(slack, kind="stable") if calls[number]][:BINS]
        is_free, distance = carriers.T
        free = np.flatnonzero(is_free)
        self.features = self._features(first, [calls, slack, full, since, metres])
        share_free = len(free) / len(carriers)
        self.features = np.append(self.features, [share_free]).astype(np.float32)
        can_send = len(first) > 0 and len(free) > 0
        # If even the first bin is late, a carrier must leave, or the harvest may never end.
        is_late = can_send and slack[first[0]] < 0.0
        self.mask = np.zeros(1 + BINS, np.bool_)
        self.mask[0] = not is_late
        self.mask[1 : 1 + len(first)] = can_send
        nearest = 0
        if len(free):
            nearest = int(free[np.argmin(distance[free])])
        # `Dispatching` numbers its actions by bin and carrier; 0 sends none.
        self.actions = [0]
        for number in first:
            self.actions.append(1 + int(number) * len(carriers) + nearest)

    def _features(self, first: list[int], columns: list[np.ndarray]) -> np.ndarray:
        """Return what is seen of the first bins, (BINS * columns,); zeros where no bin is."""
        seen = np.zeros((BINS, len(SCALE)))
        seen[: len(first)] = np.stack(columns, axis=1)[first] / SCALE
        return seen.ravel()


class AnyOrchard(gymnasium.Env[np.ndarray, int]):
    """Dispatch in a new random orchard in each episode.

    The reward is minus ten times the time that passes, as a share of what picking takes at least.
    """

    observation_space = spaces.Box(-np.inf, np.inf, (BINS * len(SCALE) + 1,))
    action_space = spaces.Discrete(1 + BINS)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        scenario = random_orchard(self.np_random)
        # s that the picker with most rows picks, without a wait.
        most_rows = math.ceil(scenario.rows / scenario.pickers)
        self.picking = most_rows * scenario.row_length / scenario.mean_picking_speed
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
        # 0.05 to 1 m/s, as often slow as fast.
        picking_speed=float(10 ** random.uniform(-1.3, 0.0)),
        **NOBODY,
    )


class Learned:
    """Name it in a scenario: `dispatch: examples.learned_dispatch.Learned`."""

    Memory = dict
    early = True

    def __init__(self, layout):
        self.dispatching = Dispatching(layout)
        self.model = model()

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
    """Return what was learned, which is read once."""
    return learner().load(MODEL, device="cpu")


def learner() -> Any:
    """Return the class that learns. It is an extra, so it is imported only here."""
    import torch
    from sb3_contrib import MaskablePPO

    # One thread is faster than two with networks this small.
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
    # It goes on as long as the callback returns True; the number of steps is never reached.
    learning.learn(10**9, callback=lambda *_: time.monotonic() < end)
    learning.save(MODEL)
    print(f"{learning.num_timesteps:,} decisions; {MODEL} written")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    learn(**vars(parser.parse_args()))
