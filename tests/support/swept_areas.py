"""The areas that turns sweep, as points."""

import numpy as np

from orchard.field.kinds import KINDS


def outline(kind: str, x: float = 0.0) -> np.ndarray:
    """Return points on the sides of a box with its centre at (x, 0), (m, 2), 2 cm apart."""
    length, width = KINDS[kind].length / 2, KINDS[kind].width / 2
    along, across = np.arange(-length, length + 0.01, 0.02), np.arange(-width, width + 0.01, 0.02)
    sides = [np.stack([along, np.full(len(along), y)], axis=1) for y in (-width, width)]
    ends = [np.stack([np.full(len(across), end), across], axis=1) for end in (-length, length)]
    return np.concatenate([*sides, *ends]) + np.array([x, 0.0])


def train(kind: str) -> np.ndarray:
    """Return the outline of a robot with its bin, (m, 2)."""
    return np.concatenate([outline(kind), outline("bin", -KINDS[kind].tows)])


def swept(shape: np.ndarray, x: float, y: float, start: float, turn: float) -> np.ndarray:
    """Return all points that a shape passes while it turns on the spot, in steps of half a degree."""
    angles = start + np.linspace(0.0, turn, 181)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    px, py = shape[:, 0], shape[:, 1]
    return np.stack([x + c * px - s * py, y + s * px + c * py], axis=-1).reshape(-1, 2)
