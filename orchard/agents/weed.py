"""The weed: detects motion within a metre of itself, and asks to be flattened."""

import math

import msgspec
import numpy as np

from orchard.contract.agent import Action, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Flatten
from orchard.contract.zone import Zone
from orchard.field.layout import Layout

NEAR = 1.36  # m from its centre: 1 m from its farthest point, a corner at 0.354 m; physics decides what is near enough
AROUND_IT = Zone(-NEAR, NEAR, -NEAR, NEAR)
SURE = 5.0  # standard deviations of the lasers' noise by which the silhouette must change


class WeedMemory(msgspec.Struct):
    """What a weed saw when something last moved: so what moves so slowly that noise hides each step is noticed after some."""

    silhouette: int = 0  # mm, sum over the beams of the distance from each return out to NEAR


class Weed:
    Memory = WeedMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.noise = layout.scenario.laser.noise

    def tick(self, seen: Observation, mail: Mail, memory: WeedMemory | None) -> Action:
        now, beams = silhouette(seen.scan)
        change = abs(now - memory.silhouette) if memory else 0
        moving = change > 1000 * SURE * self.noise * math.sqrt(beams)
        memory = memory or self.Memory(now)
        if moving:
            memory.silhouette = now
        hold = None if moving else Hold(LAST_TICK, still=(AROUND_IT,))
        return Action(
            deeds=[Flatten()] if moving else [],
            memory=memory,
            doing="growing",
            state="resting",
            hold=hold,
        )


def silhouette(scan: np.ndarray) -> tuple[int, int]:
    """Return a number for all that is near, and the number of beams. Whole millimetres make sums exact."""
    near = scan[scan < NEAR]
    return (int(((NEAR - near) * 1000).astype(np.int64).sum()) if near.size else 0), near.size
