"""What a laser sees: which of its beams end in a box, and which side is freer.

Agents use it to decide, and physics uses it for holds (`Hold` of orchard/contract/agent.py). Both
compute it to the same bit.
"""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from orchard.contract.messages import Metres
from orchard.field import repeatable
from orchard.field.kinds import KINDS, Laser, kind_of

# A beam with a smaller cosine to an axis counts as at a right angle to it. It is above the error of
# a computed cosine of 90 degrees, some 1e-16, and below that of the next beam, which is 1 degree
# away or more.
ACROSS = 1e-12


class Zone(NamedTuple):
    """A box in the frame of a body's laser, m: x ahead of the laser, y to its left.

    >>> ahead = Zone(x_min=0.0, x_max=2.0, y_min=-0.5, y_max=0.5)
    """

    x_min: Metres
    x_max: Metres
    y_min: Metres
    y_max: Metres

    def is_occupied(self, seen: Any) -> bool:
        """Whether a return of an observation's scan lies in the zone."""
        return bool(np.count_nonzero(in_zone(seen.scan, KINDS[kind_of(seen.name)].laser, self)))


# There is one laser for each kind of body.
@cache
def beams(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of each beam's angle to the front, (beams,) each."""
    pairs = [repeatable.sin_cos(laser.first + i * laser.increment) for i in range(laser.beams)]
    sines, cosines = np.array(pairs).T.copy()
    return cosines, sines


# There are a few zones for each kind of body. A quotient may overflow to infinity, which is right
# here, so numpy's warnings are off, whatever a user's program sets.
@lru_cache(maxsize=256)
@np.errstate(all="ignore")
def spans(laser: Laser, zone: Zone) -> np.ndarray:
    """Return the ranges at which each beam enters and leaves a zone, (2, beams) float32, m.

    The zone is cut out of each beam as out of a ray that meets a box: it is inside while it is
    between both bounds of x and both bounds of y. If the beam misses the zone, the range at which
    it enters is the greater one.

    Both are rounded up to float32, so comparing a float32 range with them is as exact as with the
    float64 values.
    """
    cosines, sines = beams(laser)
    enter_x, leave_x = _slab(cosines, zone.x_min, zone.x_max)
    enter_y, leave_y = _slab(sines, zone.y_min, zone.y_max)
    enter = np.maximum(np.maximum(enter_x, enter_y), 0.0)
    leave = np.minimum(leave_x, leave_y)
    exact = np.stack([enter, leave])
    nearest = exact.astype(np.float32)
    return np.where(nearest < exact, np.nextafter(nearest, np.float32(np.inf)), nearest)


def _slab(cosines: np.ndarray, least: float, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ranges between which each beam is from `least` to `most` along an axis, m.

    `cosines`: of the beams to that axis, (beams,). A beam across the axis stays at 0 on it: it is
    always inside if 0 is, else never, which an infinite `enter` and a negative `leave` say.
    """
    is_across = np.abs(cosines) < ACROSS
    divisors = np.where(is_across, 1.0, cosines)
    at_least = least / divisors
    at_most = most / divisors
    far = np.inf if least <= 0.0 <= most else -np.inf
    enter = np.where(is_across, -far, np.minimum(at_least, at_most))
    leave = np.where(is_across, far, np.maximum(at_least, at_most))
    return enter, leave


def in_zone(scan: np.ndarray, laser: Laser, zone: Zone) -> np.ndarray:
    """Whether each return of a scan, (beams,) m, lies in a zone."""
    enter, leave = spans(laser, zone)
    inside: np.ndarray = (scan >= enter) & (scan < leave)
    return inside


def is_left_freer(scan: np.ndarray, reach: float) -> bool:
    """Whether the left half of a scan is at least as free as the right half.

    A half is freer if fewer of its beams return within `reach`, m.
    """
    near = scan < np.float32(reach)
    # The beams of a laser that looks ahead go from right to left.
    half = len(near) // 2
    return bool(np.count_nonzero(near[half:]) <= np.count_nonzero(near[:half]))
