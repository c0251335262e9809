"""What a laser sees: which of its beams end in a box, and which side is freer. Agents and physics compute both to the same bit."""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from orchard.contract.messages import Metres
from orchard.field import repeatable
from orchard.field.kinds import KINDS, Laser, kind_of

ACROSS = 1e-12  # a beam with a smaller cosine to an axis counts as at a right angle to it


class Zone(NamedTuple):
    """A box in the frame of a body's laser, m: x ahead of the laser, y to its left."""

    x_min: Metres
    x_max: Metres
    y_min: Metres
    y_max: Metres

    def is_occupied(self, seen: Any) -> bool:
        """Whether a return of an observation's scan lies in the zone."""
        return bool(np.count_nonzero(in_zone(seen.scan, KINDS[kind_of(seen.name)].laser, self)))


@cache  # there is one laser for each kind of body
def beams(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of each beam's angle to the front, (beams,) each."""
    pairs = [repeatable.sin_cos(laser.first + i * laser.increment) for i in range(laser.beams)]
    return np.array([c for _, c in pairs]), np.array([s for s, _ in pairs])


@lru_cache(maxsize=256)  # there are a few for each kind of body
@np.errstate(all="ignore")  # whatever a user's program sets
def spans(laser: Laser, zone: Zone) -> np.ndarray:
    """Return the ranges, rounded up, at which each beam enters and leaves a zone, (2, beams) float32, m; reversed if it misses."""
    cosines, sines = beams(laser)
    along, across = _slab(cosines, zone.x_min, zone.x_max), _slab(sines, zone.y_min, zone.y_max)
    exact = np.stack(
        [np.maximum(np.maximum(along[0], across[0]), 0.0), np.minimum(along[1], across[1])]
    )
    nearest = exact.astype(np.float32)
    return np.where(nearest < exact, np.nextafter(nearest, np.float32(np.inf)), nearest)


def _slab(direction: np.ndarray, least: float, most: float) -> tuple[np.ndarray, np.ndarray]:
    """The ranges between which each beam is from `least` to `most` along an axis; `direction`: the beams' cosines to it."""
    across = np.abs(direction) < ACROSS
    one, other = least / np.where(across, 1.0, direction), most / np.where(across, 1.0, direction)
    far = np.inf if least <= 0.0 <= most else -np.inf
    return np.where(across, -far, np.minimum(one, other)), np.where(
        across, far, np.maximum(one, other)
    )


def in_zone(scan: np.ndarray, laser: Laser, zone: Zone) -> np.ndarray:
    """Whether each return of a scan, (beams,) m, lies in a zone."""
    enter, leave = spans(laser, zone)
    inside: np.ndarray = (scan >= enter) & (scan < leave)
    return inside


def is_left_freer(scan: np.ndarray, reach: float) -> bool:
    """Whether no more beams of the left half of a scan than of the right half return within a reach, m."""
    near = scan < np.float32(reach)
    half = len(near) // 2
    return bool(np.count_nonzero(near[half:]) <= np.count_nonzero(near[:half]))
