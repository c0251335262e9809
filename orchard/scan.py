"""The laser: what every body measures from where it stands.

The scan plane is 0.2 m above the ground: fences, trunks, posts and all solid bodies are seen, weeds are not, and no body
sees itself. Exact against oriented boxes; how is told in laser_kernel.py. Figures: reference.md, 'The laser'.
"""

import hashlib

import numpy as np

from orchard import trig
from orchard.boxes import boxes_of, grid_of, place
from orchard.kinds import AROUND, KINDS, LASER_RANGE, Laser
from orchard.laser_kernel import Fan, Sensors, add_noise, cast_all
from orchard.layout import Layout
from orchard.world import World, half_sizes

_FORWARD = KINDS["picker"].laser


class Scanner:
    """All lasers of an orchard."""

    def __init__(self, layout: Layout) -> None:
        kinds = [KINDS[start.kind] for start in layout.starts]
        self._fans = (_fan(_FORWARD), _fan(AROUND))
        self._sensors = _sensors([kind.laser for kind in kinds])
        self._solid = np.array([kind.solid for kind in kinds], dtype=np.bool_)
        self._walls = boxes_of(layout.walls[:, :2], layout.walls[:, 2:])
        self._grid = grid_of(self._walls, LASER_RANGE)
        self._bodies = boxes_of(np.zeros((len(kinds), 2)), half_sizes(layout))
        self._slices = [slice(*pair) for pair in zip(self._sensors.begin[:-1].tolist(), self._sensors.begin[1:].tolist(), strict=True)]
        self._noise = layout.scenario.laser.noise
        self._keys = np.array([_noise_key(layout.scenario.seed, name) for name in layout.names], dtype=np.uint64)

    def scan(self, world: World) -> list[np.ndarray]:
        """What every body measures now, in body order: (180,) or (60,) float32, metres, +inf where nothing returns.

        The arrays are new at every call; nobody else writes to them.
        """
        ranges = self.ranges(world).astype(np.float32)
        return [ranges[part] for part in self._slices]

    def ranges(self, world: World) -> np.ndarray:
        """The same as float64, of all bodies one after another: what `scan` rounds."""
        ranges = np.empty(int(self._sensors.begin[-1]))
        place(world.pose, self._bodies)
        cast_all(self._bodies, self._solid, world.alive, self._walls, self._grid, self._sensors, self._fans, ranges)
        if self._noise > 0.0:
            add_noise(self._keys, world.tick, self._noise, self._sensors, ranges)
        return ranges


def beam_angle(laser: Laser, beam: int) -> float:
    """The direction of a beam in its body's frame, radians."""
    return laser.first + beam * laser.increment


def _fan(laser: Laser) -> Fan:
    beams = [trig.sin_cos(beam_angle(laser, k)) for k in range(laser.beams)]
    cosine, sine = np.array([c for _, c in beams]), np.array([s for s, _ in beams])
    forward = bool(cosine.min() > -1e-12)
    return Fan(cosine, sine, laser.first, 1.0 / laser.increment, trig.TURN / laser.increment, forward)


def _sensors(lasers: list[Laser]) -> Sensors:
    return Sensors(
        ahead=np.array([laser.ahead for laser in lasers], dtype=np.float64),
        fan=np.array([1 if laser is AROUND else 0 for laser in lasers], dtype=np.int64),
        begin=np.cumsum([0] + [laser.beams for laser in lasers], dtype=np.int64),
    )


def _noise_key(seed: int, name: str) -> int:
    digest = hashlib.blake2b(f"{seed}/laser/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")
