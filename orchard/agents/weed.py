"""The weed: notices something moving within a metre of itself, and asks to be flattened."""

import msgspec
import numpy as np

from orchard.agent import Action, Mail, Observation
from orchard.layout import Layout
from orchard.messages import Flatten

NEAR = 1.0 + 0.5  # m from its centre: a metre from its edge, and as far again as its corner is from the centre


class WeedMemory(msgspec.Struct):
    """What it saw."""

    silhouette: int = 0  # sum over the beams of how far each reaches into the near ring, mm


class Weed:
    """Grows."""

    Memory = WeedMemory

    def __init__(self, layout: Layout, name: str) -> None:
        pass

    def tick(self, seen: Observation, mail: Mail, memory: WeedMemory | None) -> Action:
        before = memory.silhouette if memory else None
        now = silhouette(seen.scan)
        moving = before is not None and now != before
        return Action(deeds=[Flatten()] if moving else [], memory=WeedMemory(now), doing="growing")


def silhouette(scan: np.ndarray) -> int:
    """A number that changes when something near moves, and is 0 when nothing is near; whole millimetres, so that sums are exact."""
    near = scan[scan < NEAR]
    return int(((NEAR - near) * 1000).astype(np.int64).sum()) if near.size else 0
