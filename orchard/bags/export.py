"""A recording as a bag: for each tick the clock, the transforms, the odometry and the velocities that the robots' agents wanted."""

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from orchard_ros2 import messages, topics
from orchard_ros2.bodies import description
from orchard_ros2.field import grid_of

from orchard.bags.bag import Bag
from orchard.bags.replay import SCENARIO
from orchard.contract.events import Velocities
from orchard.field.kinds import KINDS, LASER_NEAREST, LASER_RANGE, VEHICLES, kind_of, select_agents
from orchard.field.layout import lay_out
from orchard.view.drives import STILL, Drives, State, ranges_of
from orchard.view.recorder import SCAN_BEAMS

Track = Callable[[Iterable[Any], int], Iterable[Any]]  # (ticks, how many) -> the same ticks; shows how far it is


def chosen(drives: Drives, words: Sequence[str]) -> list[str]:
    """Return the bodies with these names or of these kinds, in the layout's order; without any, the robots that drive.

    Raises ValueError for a word that is neither.
    """
    names = select_agents(drives.names, list(words), [])
    return [name for name in names if words or kind_of(name) in VEHICLES]


def export(drives: Drives, robots: Sequence[str], file: Path, track: Track) -> int:
    """Write a bag, and return the number of its messages. Scans are in it if `drives` has them. Raises OSError.

    A velocity has the time at which the step with it begins, all else that of its tick. Of a body that never drove there is no velocity.
    """
    with Bag(file) as bag:
        _begin(bag, drives, robots)
        for tick, poses, velocities in track(drives.ticks(), drives.last + 1 - drives.first):
            if tick > drives.first:
                _commands(bag, tick - 1, velocities, robots)
            _tick(bag, tick, poses, velocities, robots)
            _scans(bag, tick, drives.points.get(tick, {}), robots)
        return bag.count


def _begin(bag: Bag, drives: Drives, robots: Sequence[str]) -> None:
    """Write what never changes, at the first tick: the map, the robots' shapes, and the transforms between their parts."""
    first = drives.first
    bag.write(SCENARIO, "", first, messages.text(drives.scenario.model_dump_json()))
    bag.write(topics.GRID, "", first, grid_of(lay_out(drives.scenario.without_code).walls.tolist()))
    for name in robots:
        kind = KINDS[kind_of(name)]
        shape = description(name, (kind.length, kind.width, kind.height), kind.colour, kind.laser.ahead)
        bag.write(topics.ROBOT_DESCRIPTION, name, first, messages.text(shape))
    lasers = [(name, KINDS[kind_of(name)].laser.ahead) for name in robots]
    bag.write(topics.TF_STATIC, "", first, messages.static_transforms(lasers))


def _commands(bag: Bag, tick: int, velocities: Mapping[str, Velocities], robots: Sequence[str]) -> None:
    for name in robots:
        if name in velocities:
            forward, left, turn = velocities[name][3:]
            bag.write(topics.CMD_VEL, name, tick, messages.velocity(name, tick, forward, turn, left))


def _tick(bag: Bag, tick: int, poses: Mapping[str, State], velocities: Mapping[str, Velocities], robots: Sequence[str]) -> None:
    states = {name: (*poses[name], *velocities.get(name, STILL)[:3]) for name in robots if name in poses}
    bag.write(topics.CLOCK, "", tick, messages.clock(tick))
    bag.write(topics.TF, "", tick, messages.transforms(tick, states))
    for name, state in states.items():
        bag.write(topics.ODOM, name, tick, messages.odometry(name, tick, state))


def _scans(bag: Bag, tick: int, points: Mapping[str, np.ndarray], robots: Sequence[str]) -> None:
    """Write the scans as they are recorded: every second beam, twice a second, to 1/32 m."""
    for name in robots:
        if name in points:
            laser = KINDS[kind_of(name)].laser
            ranges = array("f", ranges_of(points[name], laser, SCAN_BEAMS).tobytes())
            step = laser.increment * SCAN_BEAMS
            bag.write(topics.SCAN, name, tick, messages.scan(name, tick, ranges, laser.first, step, LASER_NEAREST, LASER_RANGE))
