"""The lasers, 0.2 m above the ground, and the observations of all bodies.

A laser sees fences, trunks, posts and all solid bodies, but neither weeds nor its own body. The
ranges to oriented boxes are exact. Figures: docs/reference.md, "The laser". There are two kinds of
lasers: those of vehicles, people and animals look forward (180 beams), those of bins and weeds look
around (60). The computation is in orchard/sim/kernels/laser.py.
"""

import hashlib
from collections.abc import Iterator, Mapping
from copy import copy
from functools import cache

import numpy as np

from orchard.contract.agent import STATE, Hitch, Observations, Scans
from orchard.field import repeatable
from orchard.field.geometry import Twist
from orchard.field.kinds import AROUND, KINDS, LASER_RANGE, Laser
from orchard.field.layout import Layout
from orchard.sim.kernels.boxes import RADIUS
from orchard.sim.kernels.grid import frame_of, space_for
from orchard.sim.kernels.jit import in_order
from orchard.sim.kernels.laser import STEPS, add_noise, cast_all
from orchard.sim.kernels.move import quaternions
from orchard.sim.world import NONE, World

# A laser that looks forward. Those of other kinds differ in where they are mounted, and not in
# their beams.
_FORWARD = KINDS["picker"].laser


class Scanner:
    """All lasers of an orchard, one for each body."""

    def __init__(self, world: World) -> None:
        scenario = world.layout.scenario
        lasers = [kind.laser for kind in world.layout.kinds]
        # (n + 1,): the ranges of body i are begin[i] to begin[i + 1].
        self.begin = np.cumsum([0] + [laser.beams for laser in lasers], dtype=np.int64)
        self._begin = self.begin.tolist()
        # The ranges of all bodies, m, and the same in the precision that agents get.
        self._ranges = np.empty(self.begin[-1])
        self._rounded = np.empty(self.begin[-1], dtype="<f4")
        # The arguments of `cast_all` after those that change from tick to tick.
        self._constant = in_order(cast_all, _constants(world, lasers, self.begin), skip=4)
        self._noise = scenario.laser.noise
        # (n,) uint64: a key for the noise of each body's laser.
        digests = [_digest(f"{scenario.seed}/laser/{name}") for name in world.layout.names]
        self._keys = np.frombuffer(b"".join(digests), "<u8").astype(np.uint64)

    def scan(self, world: World) -> Scans:
        """Return the ranges of each body now, (180,) or (60,) float32, m, +inf without a return.

        They are new, read-only views of bytes.
        """
        self.ranges(world)
        return Scans(np.frombuffer(self._rounded.tobytes(), "<f4"), self._begin)

    def ranges(self, world: World) -> np.ndarray:
        """Return the ranges of all bodies in one array, (all beams,) float64, m, not rounded.

        The next call overwrites it.
        """
        cast_all(world.pose, world.alive, self._ranges, self._rounded, *self._constant)
        if self._noise > 0.0:
            add_noise(self._keys, world.tick, self._noise, self.begin, self._ranges, self._rounded)
        return self._ranges


def _constants(world: World, lasers: list[Laser], begin: np.ndarray) -> dict[str, object]:
    """Return the arguments of `cast_all` that stay the same during a run, by name."""
    fixed = world.fixed
    # `cast_all` writes in it where the bodies are.
    bodies = fixed.shapes.copy()
    largest_radius = float(bodies[:, RADIUS].max(initial=0.0))
    # In such cells all bodies that a laser can reach are in its own cell and those beside it.
    frame = frame_of(fixed.walls, cell=LASER_RANGE + largest_radius)
    cells, cell_begin, cell_members = space_for(len(bodies), frame)
    front_beams, front_table = _fan(_FORWARD)
    round_beams, round_table = _fan(AROUND)
    return {
        "bodies": bodies,
        "solid": fixed.solid,
        "walls": fixed.walls,
        "wall_frame": fixed.walls_in_sight.frame,
        "wall_begin": fixed.walls_in_sight.begin,
        "wall_members": fixed.walls_in_sight.members,
        "body_frame": frame,
        "cells": cells,
        "cell_begin": cell_begin,
        "cell_members": cell_members,
        "ahead": np.array([laser.ahead for laser in lasers], dtype=np.float64),
        "around": np.array([laser is AROUND for laser in lasers], dtype=np.bool_),
        "begin": begin,
        "front_beams": front_beams,
        "front_table": front_table,
        "round_beams": round_beams,
        "round_table": round_table,
    }


def _digest(name: str) -> bytes:
    """Return 8 bytes that depend only on a name."""
    return hashlib.blake2b(name.encode(), digest_size=8).digest()


@cache
def _fan(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """Return the beams of a laser, for the fields of `Fan` in orchard/sim/kernels/laser.py.

    They are cosines and sines, (2, beams), and the fractional beam index at each step of the
    diamond, (4 STEPS + 2,). The diamond is explained there: an angle on it goes from 0 to 4, a
    quarter turn being 1. It is 0 at beam 0.
    """
    cosines_and_sines = []
    for k in range(laser.beams):
        sine, cosine = repeatable.sin_cos(laser.first + k * laser.increment)
        cosines_and_sines.append((cosine, sine))
    beams = np.array(cosines_and_sines).T.copy()
    # One step past the full turn, and one more to interpolate to.
    quarters, shares = np.divmod(np.arange(4 * STEPS + 2) / STEPS, 1.0)
    # rad.
    angles = []
    for quarter, share in zip(quarters.tolist(), shares.tolist(), strict=True):
        angles.append(quarter * repeatable.QUARTER + repeatable.atan2(share, 1.0 - share))
    return beams, np.array(angles) / laser.increment


def observe(world: World, scans: Scans) -> Observations:
    """Return the observations of all bodies now, in body order.

    scans: as `Scanner.scan` returns them.
    """
    layout = world.layout
    # The columns are those of `Observations.states`.
    states = np.empty((len(layout.names), STATE))
    states[:, :2] = world.pose[:, :2]
    states[:, 2:4] = quaternions(world.pose)
    states[:, 4:] = world.twist
    charges = {}
    if layout.first_charging:
        charges = _by_name(layout, world.charge, world.fixed.carriers)
    return Observations(
        tick=world.tick,
        names=layout.index,
        states=states,
        scans=scans,
        hitches=Hitches(world, states, scans),
        fills=_by_name(layout, world.fill, world.fill.nonzero()[0]),
        full=set(layout.names_at(world.full.nonzero()[0].tolist())),
        charges=charges,
    )


def _by_name(layout: Layout, values: np.ndarray, bodies: np.ndarray) -> dict[str, float]:
    """Return the values of some bodies by their names. `values`: (n,); `bodies`: indices."""
    return dict(zip(layout.names_at(bodies.tolist()), values[bodies].tolist(), strict=True))


class Hitches(Mapping[str, Hitch]):
    """Coupled body -> the body at the other end of the bar, with its scan if it is towed.

    Each is made when it is asked for.
    """

    def __init__(self, world: World, states: np.ndarray, scans: Scans) -> None:
        self._layout = world.layout
        self._tows = world.fixed.tows
        self._coupled = world.coupled.copy()
        self._states = states
        self._scans = scans
        self._errors: Mapping[str, np.ndarray] = {}

    def shifted(self, errors: Mapping[str, np.ndarray]) -> "Hitches":
        """Return the same for bodies that take themselves to be elsewhere.

        `errors`: name -> (2,) m, by how much. The bar itself measures without errors.
        """
        other = copy(self)
        other._errors = errors
        return other

    def __getitem__(self, name: str) -> Hitch:
        i = self._layout.index[name]
        partner = self._coupled.item(i)
        if partner == NONE:
            raise KeyError(name)
        x, y, z, w, vx, vy, turn = self._states[partner].tolist()
        if name in self._errors:
            x += self._errors[name].item(0)
            y += self._errors[name].item(1)
        scan = None
        if self._tows[i] > 0.0:
            scan = self._scans[partner]
        twist = Twist(vx, vy, turn)
        return Hitch(self._layout.names[partner], x, y, (z, w), twist=twist, scan=scan)

    def __iter__(self) -> Iterator[str]:
        return iter(self._layout.names_at(np.flatnonzero(self._coupled != NONE).tolist()))

    def __len__(self) -> int:
        return int(np.count_nonzero(self._coupled != NONE))
