"""The laser: what every body measures from where it stands.

The scan plane is 0.2 m above the ground: fences, trunks, posts and all solid bodies are seen, weeds are not, and no body
sees itself. Exact against oriented boxes; how is told in laser_kernel.py. Figures: reference.md, 'The laser'.
"""

import hashlib

import numpy as np

from orchard import trig
from orchard.boxes import RADIUS, boxes_of, frame_of, grid_of
from orchard.kinds import AROUND, KINDS, LASER_RANGE, Laser
from orchard.laser_kernel import STEPS, add_noise, cast_all
from orchard.layout import Layout
from orchard.world import World, half_sizes

_FORWARD = KINDS["picker"].laser


class Scanner:
    """All lasers of an orchard."""

    def __init__(self, layout: Layout) -> None:
        kinds = [KINDS[start.kind] for start in layout.starts]
        lasers = [kind.laser for kind in kinds]
        begin = np.cumsum([0] + [laser.beams for laser in lasers], dtype=np.int64)
        walls = boxes_of(layout.walls[:, :2], layout.walls[:, 2:])
        self._bodies = boxes_of(np.zeros((len(kinds), 2)), half_sizes(layout))
        self._solid = np.array([kind.solid for kind in kinds], dtype=np.bool_)
        frame = frame_of(walls, LASER_RANGE + float(self._bodies[:, RADIUS].max(initial=0.0)))
        ahead = np.array([laser.ahead for laser in lasers], dtype=np.float64)
        around = np.array([laser is AROUND for laser in lasers], dtype=np.bool_)
        self._field = (walls, *grid_of(walls, LASER_RANGE), frame)
        self._sensors = (ahead, around, begin, *_fan(_FORWARD), *_fan(AROUND))
        self._begin, self._beams = begin, int(begin[-1])
        self._slices = [slice(*pair) for pair in zip(begin[:-1].tolist(), begin[1:].tolist(), strict=True)]
        self._noise = layout.scenario.laser.noise
        self._keys = np.array([_noise_key(layout.scenario.seed, name) for name in layout.names], dtype=np.uint64)

    def scan(self, world: World) -> list[np.ndarray]:
        """What every body measures now, in body order: (180,) or (60,) float32, metres, +inf where nothing returns.

        The arrays are new at every call; nobody else writes to them.
        """
        ranges = self.ranges(world).astype("<f4")
        return [ranges[part] for part in self._slices]

    def ranges(self, world: World) -> np.ndarray:
        """The same as float64, of all bodies one after another: what `scan` rounds."""
        ranges = np.empty(self._beams)
        cast_all(world.pose, self._bodies, self._solid, world.alive, *self._field, *self._sensors, ranges)
        if self._noise > 0.0:
            add_noise(self._keys, world.tick, self._noise, self._begin, ranges)
        return ranges


def beam_angle(laser: Laser, beam: int) -> float:
    """The direction of a beam in its body's frame, radians."""
    return laser.first + beam * laser.increment


def _fan(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """(2, beams): the beams' cosines and sines; (4 STEPS + 2,): which beam points to each step of the diamond, with fractions."""
    beams = np.array([trig.sin_cos(beam_angle(laser, k))[::-1] for k in range(laser.beams)]).T.copy()
    quarter, share = np.divmod(np.arange(4 * STEPS + 2) / STEPS, 1.0)
    angles = [q * trig.QUARTER + trig.atan2(s, 1.0 - s) for q, s in zip(quarter.tolist(), share.tolist(), strict=True)]
    return beams, np.array(angles) / laser.increment


def _noise_key(seed: int, name: str) -> int:
    digest = hashlib.blake2b(f"{seed}/laser/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")
