"""The lasers, 0.2 m above the ground, and the observations of all bodies. Figures: docs/reference.md, "The laser".

A laser sees fences, trunks, posts and all solid bodies, but neither weeds nor its own body. The ranges to oriented boxes are exact.
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
from orchard.sim.kernels.boxes import RADIUS
from orchard.sim.kernels.grid import frame_of, space_for
from orchard.sim.kernels.jit import in_order
from orchard.sim.kernels.laser import STEPS, add_noise, cast_all
from orchard.sim.kernels.move import quaternions
from orchard.sim.world import NONE, World

_FORWARD = KINDS["picker"].laser


class Scanner:
    """All lasers of an orchard, one for each body."""

    def __init__(self, world: World) -> None:
        layout, fixed, bodies = world.layout, world.fixed, world.fixed.shapes.copy()
        frame = frame_of(fixed.walls, LASER_RANGE + float(bodies[:, RADIUS].max(initial=0.0)))
        cells, cell_begin, cell_members = space_for(len(bodies), frame)
        lasers = [KINDS[start.kind].laser for start in layout.starts]
        begin = np.cumsum([0] + [laser.beams for laser in lasers], dtype=np.int64)
        (front_beams, front_table), (round_beams, round_table) = _fan(_FORWARD), _fan(AROUND)
        constant = {
            "bodies": bodies,
            "solid": fixed.solid,
            "walls": fixed.walls,
            **{f"wall_{name}": array for name, array in fixed.walls_in_sight._asdict().items()},
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
        self._ranges, self._rounded = np.empty(begin[-1]), np.empty(begin[-1], dtype="<f4")
        self._constant = in_order(cast_all, constant, skip=4)
        self.begin, self._begin = begin, begin.tolist()
        self._noise = layout.scenario.laser.noise
        keys = (
            hashlib.blake2b(f"{layout.scenario.seed}/laser/{name}".encode(), digest_size=8).digest()
            for name in layout.names
        )
        self._keys = np.frombuffer(b"".join(keys), "<u8").astype(np.uint64)

    def scan(self, world: World) -> Scans:
        """Return the ranges of each body now, (180,) or (60,) float32, m, +inf without a return: new, read-only views of bytes."""
        self.ranges(world)
        return Scans(np.frombuffer(self._rounded.tobytes(), "<f4"), self._begin)

    def ranges(self, world: World) -> np.ndarray:
        """Return the ranges of all bodies in one array, (all beams,) float64, m, before they are rounded. The next call overwrites it."""
        cast_all(world.pose, world.alive, self._ranges, self._rounded, *self._constant)
        if self._noise > 0.0:
            add_noise(self._keys, world.tick, self._noise, self.begin, self._ranges, self._rounded)
        return self._ranges


@cache
def _fan(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """The beams' cosines and sines, (2, beams), and the fractional beam index at each step of the diamond, (4 STEPS + 2,)."""
    beams = np.array(
        [repeatable.sin_cos(laser.first + k * laser.increment)[::-1] for k in range(laser.beams)]
    ).T.copy()
    quarter, share = np.divmod(np.arange(4 * STEPS + 2) / STEPS, 1.0)
    angles = [
        q * repeatable.QUARTER + repeatable.atan2(s, 1.0 - s)
        for q, s in zip(quarter.tolist(), share.tolist(), strict=True)
    ]
    return beams, np.array(angles) / laser.increment


def observe(world: World, scans: Scans) -> Observations:
    """Return the observations of all bodies now, in body order; scans: as `Scanner.scan` returns them."""
    names = world.layout.names
    states = np.empty((len(names), STATE))
    states[:, :2], states[:, 2:4], states[:, 4:] = (
        world.pose[:, :2],
        quaternions(world.pose),
        world.twist,
    )
    fills = {names[i]: float(world.fill[i]) for i in world.fill.nonzero()[0].tolist()}
    full = {names[i] for i in world.full.nonzero()[0].tolist()}
    carriers = world.fixed.carriers.tolist() if world.layout.first_charging else []
    charges = {names[i]: float(world.charge[i]) for i in carriers}
    return Observations(
        world.tick,
        world.layout.index,
        states,
        scans,
        Hitches(world, states, scans),
        fills,
        full,
        charges=charges,
    )


class Hitches(Mapping[str, Hitch]):
    """Coupled body -> the body at the other end of the bar, with its scan if it is towed; each is made when it is asked for."""

    def __init__(self, world: World, states: np.ndarray, scans: Scans) -> None:
        self._layout, self._tows, self._coupled = (
            world.layout,
            world.fixed.tows,
            world.coupled.copy(),
        )
        self._states, self._scans = states, scans
        self._errors: Mapping[str, np.ndarray] = {}

    def shifted(self, errors: Mapping[str, np.ndarray]) -> "Hitches":
        """Return the same for bodies that take themselves to be elsewhere, m: the bar itself measures without errors."""
        other = copy(self)
        other._errors = errors
        return other

    def __getitem__(self, name: str) -> Hitch:
        i = self._layout.index[name]
        other = self._coupled.item(i)
        if other == NONE:
            raise KeyError(name)
        x, y, z, w, vx, vy, turn = self._states[other].tolist()
        if name in self._errors:
            x, y = x + self._errors[name].item(0), y + self._errors[name].item(1)
        return Hitch(
            self._layout.names[other],
            x,
            y,
            (z, w),
            Twist(vx, vy, turn),
            self._scans[other] if self._tows[i] > 0.0 else None,
        )

    def __iter__(self) -> Iterator[str]:
        return (self._layout.names[i] for i in np.flatnonzero(self._coupled != NONE).tolist())

    def __len__(self) -> int:
        return int(np.count_nonzero(self._coupled != NONE))
