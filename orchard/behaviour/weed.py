"""The weed: detects motion within a metre of itself, and asks to be flattened.

A weed is a body with a laser that looks around (60 beams). Its "silhouette" is one number for all
that is near; when that changes, something moves there. A flat weed is out of the harvest's way, and
its laser measures nothing.
"""

import math

import msgspec
import numpy as np

from orchard.contract.agent import Action, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Flatten
from orchard.contract.zone import Zone
from orchard.field import repeatable
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout

# It looks for motion up to so many m from its centre: 1 m from its farthest point, a corner at
# 0.354 m.
NEAR = 1.36
AROUND_IT = Zone(-NEAR, NEAR, -NEAR, NEAR)
# It asks to be flattened if a return is at most so many m from its edge. Physics decides by 1 m to
# the body, and a corner of the body may lie between two beams, nearer than both of their returns.
REACH = 1.05
# Standard deviations of the lasers' noise by which the silhouette must change.
SURE = 5.0

_LASER = KINDS["weed"].laser
# (60, 2): sine and cosine of each beam.
_SIN_COS = np.array(
    [repeatable.sin_cos(_LASER.first + k * _LASER.increment) for k in range(_LASER.beams)]
)


class WeedMemory(msgspec.Struct):
    """What a weed saw when something last moved.

    So it notices after some time what moves so slowly that noise hides each step.
    """

    # The sum over the beams of the distance from each return out to NEAR, mm.
    silhouette: int = 0


class Weed:
    """Asks to be flattened by what moves beside it."""

    Memory = WeedMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.noise = layout.scenario.laser.noise

    def tick(self, seen: Observation, mail: Mail, memory: WeedMemory | None) -> Action:
        """Compare the silhouette with that in the memory."""
        now, beams = silhouette(seen.scan)
        memory = memory or self.Memory(now)
        action = Action(memory=memory, doing="growing", state="resting")
        # mm. Noise of `beams` beams, m each, adds up by the square root.
        change = abs(now - memory.silhouette)
        if change <= 1000 * SURE * self.noise * math.sqrt(beams):
            action.hold = Hold(LAST_TICK, still=(AROUND_IT,))
            return action
        memory.silhouette = now
        # What has just left is out of reach. A flat weed sees nothing, and asks for nothing more.
        if is_within_reach(seen.scan):
            action.deeds.append(Flatten())
        return action


def silhouette(scan: np.ndarray) -> tuple[int, int]:
    """Return a number for all that is near, and the number of beams.

    Whole millimetres make sums exact.
    """
    near = scan[scan < NEAR]
    return int(((NEAR - near) * 1000).astype(np.int64).sum()), near.size


def is_within_reach(scan: np.ndarray) -> bool:
    """Whether a return is within REACH of the weed's edge. `scan`: ranges, m, (60,)."""
    near = scan < NEAR
    # (near beams, 2): y and x of each return, from the weed's centre, m.
    sides = scan[near, None] * _SIN_COS[near]
    half = KINDS["weed"].length / 2
    y, x = np.maximum(np.abs(sides) - half, 0.0).T
    return bool((x * x + y * y <= REACH * REACH).any())
