"""What bodies see at one tick, as arrays: physics makes it of the world, it travels to a host in one piece, and agents are told of it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchard.contract.agent import Hitch, Observation
from orchard.field.geometry import Twist

STATE = 7  # numbers in a body's state


@dataclass(slots=True)
class Observations:
    """Of n bodies."""

    tick: int
    names: Sequence[str]
    states: np.ndarray  # (n, 7) float64: x, y (m), the quaternion's z, w, and the last step's linear x, y (m/s), angular z (rad/s)
    scans: Sequence[np.ndarray]  # n sweeps, m: (180,) or, of bins and weeds, (60,) float32
    hitches: Mapping[str, Hitch]  # of those that are coupled
    fills: Mapping[str, float]  # m of row, of bins that are not empty
    full: Collection[str]  # bins

    def observations(self) -> dict[str, Observation]:
        """Name -> what that body's agent is told."""
        rows = zip(self.names, self.states.tolist(), self.scans, strict=True)
        return {name: self._observation(name, state, scan) for name, state, scan in rows}

    def _observation(self, name: str, state: Sequence[float], scan: np.ndarray) -> Observation:
        return observation_of(name, self.tick, state, scan, self.hitches.get(name), self.fills.get(name, 0.0), name in self.full)

    def __getitem__(self, name: str) -> Observation:
        """What the agent of one body is told. Raises ValueError for a name that is not there."""
        body = self.names.index(name)
        return self._observation(name, self.states[body].tolist(), self.scans[body])


def observation_of(
    name: str, tick: int, state: Sequence[float], scan: np.ndarray, hitch: Hitch | None, fill: float, full: bool
) -> Observation:
    """What the agent of one body is told; of its seven numbers."""
    x, y, z, w, vx, vy, turn = state
    return Observation(name, tick, x, y, (z, w), Twist(vx, vy, turn), scan, hitch, fill, full)
