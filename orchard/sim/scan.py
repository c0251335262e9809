"""The laser, and what physics lets each body observe.

The scan plane is 0.2 m above the ground. Fences, trunks, posts and all solid bodies return; weeds do not, and no body returns to
itself. The ranges are exact against oriented boxes: kernels/laser.py says how. Figures: docs/reference.md, "The laser".
"""

import hashlib

import numpy as np

from orchard.contract.agent import Hitch
from orchard.contract.observations import Observations
from orchard.field import repeatable
from orchard.field.geometry import Twist
from orchard.field.kinds import AROUND, KINDS, LASER_RANGE, Laser
from orchard.field.layout import ROW_LENGTH, Layout
from orchard.sim.kernels.boxes import RADIUS, boxes_of, frame_of, grid_of
from orchard.sim.kernels.laser import STEPS, add_noise, cast_all
from orchard.sim.kernels.move import quaternions
from orchard.sim.world import World, half_sizes

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
    beams = np.array([repeatable.sin_cos(beam_angle(laser, k))[::-1] for k in range(laser.beams)]).T.copy()
    quarter, share = np.divmod(np.arange(4 * STEPS + 2) / STEPS, 1.0)
    angles = [q * repeatable.QUARTER + repeatable.atan2(s, 1.0 - s) for q, s in zip(quarter.tolist(), share.tolist(), strict=True)]
    return beams, np.array(angles) / laser.increment


def _noise_key(seed: int, name: str) -> int:
    digest = hashlib.blake2b(f"{seed}/laser/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


def observe(world: World, scans: list[np.ndarray]) -> Observations:
    """What all bodies see now, in body order; scans as the scanner gives them."""
    names = world.layout.names
    states = np.concatenate((world.pose[:, :2], quaternions(world.pose), world.twist), axis=1)
    coupled = np.flatnonzero(world.coupled >= 0).tolist()
    robots = world.bodies.tows > 0.0
    hitches = {names[i]: _hitch(world, states, scans, int(world.coupled[i]), bool(robots[i])) for i in coupled}
    fills = {names[i]: float(world.fill[i]) for i in np.flatnonzero(world.fill).tolist()}
    return Observations(world.tick, names, states, scans, hitches, fills, {name for name, fill in fills.items() if fill >= ROW_LENGTH})


def _hitch(world: World, states: np.ndarray, scans: list[np.ndarray], other: int, tows: bool) -> Hitch:
    """The other end of a body's bar, with its scan if the body tows it."""
    x, y, z, w, vx, vy, turn = states[other].tolist()
    return Hitch(world.layout.names[other], x, y, (z, w), Twist(vx, vy, turn), scans[other] if tows else None)
