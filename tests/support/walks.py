"""Plans that are driven without an obstacle: where robots may stand, what they must find free, and
what they sweep.

tests/plans/test_standing_places.py and `sweeps` use it: robots that obey their plans must neither
collide nor wait for each other for ever. A walk follows the plan of one picker, or a carrier's job
for one bin, step by step, and notes areas. Places are those of the roads that a robot asks the
traffic desk for (docs/traffic.md). Coordinates are in the frame of the orchard: x to the east, y to
the north, m.

A stage says how far a picker's work is. In its pass number n, from 0, through a row it is in stage
2 n + 2 until it has left the bin, and then in stage 2 n + 3 while it goes on to its next pass. The
job of a carrier for the bin of this pass has the stage 2 n + 3: in it both meet.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.plans.robot import Step
from orchard.plans.routes import route_of
from orchard.plans.sense import SIDE_MARGIN, STOP_DISTANCE, Box
from orchard.plans.steps import (
    Alone,
    Confirmed,
    Deliver,
    DriveTo,
    Face,
    FetchEmpty,
    Free,
    LeaveBin,
    Need,
    TakeBin,
    Unload,
)


@cache
def outline(kind: str, x: float = 0.0) -> np.ndarray:
    """Return points on the four sides of a body that faces east at (x, 0): (points, 2) m.

    They are 2 cm apart.
    """
    ahead = KINDS[kind].length / 2
    aside = KINDS[kind].width / 2
    # `arange` leaves its end out. The 1 cm more is less than a step, and lets the corner be in it.
    along = np.arange(-ahead, ahead + 0.01, 0.02)
    across = np.arange(-aside, aside + 0.01, 0.02)
    sides = [np.stack([along, np.full(len(along), y)], axis=1) for y in (-aside, aside)]
    ends = [np.stack([np.full(len(across), end), across], axis=1) for end in (-ahead, ahead)]
    return np.concatenate([*sides, *ends]) + np.array([x, 0.0])


@cache
def train(kind: str) -> np.ndarray:
    """Return the points of `outline` of a robot at (0, 0), and of the bin that it tows."""
    return np.concatenate([outline(kind), outline("bin", -KINDS[kind].tows)])


# Heading -> the step of 1 m in x and y.
UNIT = {"EAST": (1, 0), "NORTH": (0, 1), "WEST": (-1, 0), "SOUTH": (0, -1)}
# Steps in which a robot may have to wait where it stands.
WAITS = (Need, Alone, Deliver, FetchEmpty, LeaveBin, TakeBin, Unload, Confirmed)


class Area(NamedTuple):
    """A rectangle along the axes, m: where a robot or bin may stand, or which it must find free."""

    x: float
    y: float
    half_x: float
    half_y: float
    robot: str
    # The picker for which a carrier works; a picker itself; '' for a carrier in the queue.
    picker: str
    # See the head of this module.
    stage: int
    # The heading of the robot or of its bin; '' for a bin that is left.
    heading: str
    # The places that the robot holds.
    places: frozenset[str]
    # Of a drive: where it ends, m.
    end: tuple[float, float] = (np.nan, np.nan)
    # What the robot expects there and does not stop for, such as the bin that it comes to couple.
    blind_to: tuple[Box, ...] = ()


# Where a robot turns; the points of its outline in its own frame, (points, 2) m; the heading to
# which it turns.
Turn = tuple[Area, np.ndarray, str]


class Walk:
    """A plan, driven without an obstacle: where its robot may stand, and what it must find free."""

    def __init__(
        self, robot: str, picker: str, x: float, y: float, stage: int = 0, heading: str = "EAST"
    ) -> None:
        # The row of the present pass, or of the job; 0 before the first one.
        self.row = 0
        self.robot = robot
        self.picker = picker
        self.x = x
        self.y = y
        self.stage = stage
        self.kind = KINDS["picker" if robot == picker else "carrier"]
        self.heading = heading
        # Each robot begins with an empty bin behind it.
        self.tows = True
        self.places = frozenset[str]()
        self.stands: list[Area] = []
        self.drives: list[Area] = []
        self.turns: list[Turn] = []
        self.stand()

    def stand(self) -> None:
        """Note that the robot, with its bin, may stand here."""
        self.stands.append(
            self.area(self.x, self.y, self.kind.length, self.kind.width, self.heading)
        )
        if self.tows:
            self.stands.append(self.bin_behind(self.heading))

    def area(self, x: float, y: float, length: float, width: float, heading: str) -> Area:
        """Return an area around (x, y) of a length along a heading and a width across it, m."""
        half = (width / 2, length / 2) if heading in ("NORTH", "SOUTH") else (length / 2, width / 2)
        return Area(x, y, *half, self.robot, self.picker, self.stage, heading, self.places)

    def outline(self) -> np.ndarray:
        """Return the points of the robot's outline in its own frame, with the bin that it tows."""
        kind = "picker" if self.robot == self.picker else "carrier"
        return train(kind) if self.tows else outline(kind)

    def bin_behind(self, heading: str) -> Area:
        """Return the area of a bin behind the robot, 1 m square. `heading`: '' if it is left."""
        ux, uy = UNIT[self.heading]
        return self.area(
            self.x - ux * self.kind.tows, self.y - uy * self.kind.tows, 1.0, 1.0, heading
        )

    def follow(self, steps: list[Step]) -> None:
        for step in steps:
            self.take(step)
        self.stand()

    def take(self, step: Step) -> None:
        """Do a step, and note what it covers."""
        if isinstance(step, WAITS):
            self.stand()
        match step:
            case DriveTo():
                self.drive(step)
            case Face():
                self.turn(step)
                self.heading = step.heading
            case Need():
                self.places |= set(step.places)
            case Free():
                self.places -= set(step.places)
            case LeaveBin() | Deliver():
                self.tows = False
                self.stands.append(self.bin_behind(""))
            case FetchEmpty():
                self.tows = True
                self.places = self.places | {step.place}
            case TakeBin():
                self.tows = True

    def turn(self, step: Face) -> None:
        here = self.area(self.x, self.y, 0.0, 0.0, self.heading)
        here = here._replace(blind_to=tuple(step.blind_to))
        self.turns.append((here, self.outline(), step.heading))

    def drive(self, step: DriveTo) -> None:
        """Drive from gate to gate. Before a gate the robot may stand until it holds the places."""
        # 1 if the coordinate along the road grows on the way, -1 if it falls.
        ahead = sum(UNIT[self.heading])
        target = self.along(step)
        needs = {
            gate.at: [
                place for other in step.needs if other.at == gate.at for place in other.places
            ]
            for gate in step.needs
        }
        # (coordinate along the road, whether places are needed or else freed there, the places).
        gates = [(at, True, places) for at, places in needs.items()] + [
            (gate.at, False, gate.places) for gate in step.frees
        ]
        start = self.y if step.x is None else self.x
        for at, needed, places in sorted(gates, key=lambda gate: (ahead * gate[0], gate[1])):
            here = self.y if step.x is None else self.x
            if ahead * at > ahead * target:
                break
            # A robot asks for nothing at a gate that is behind it when its drive begins. Gates and
            # positions are sums of lengths: they are equal but for their last bits, so 1 nm counts
            # as nothing.
            if needed and ahead * at < ahead * start - 1e-9:
                continue
            # Where it waits for a place, it may as well stand a little earlier.
            wanted = frozenset(places if needed else ())
            self.leg(step, max(here, at) if ahead > 0 else min(here, at), ahead, wanted)
            if needed:
                self.stand()
            self.places = self.places | wanted if needed else self.places - set(places)
        self.leg(step, target, ahead)

    def along(self, step: DriveTo) -> float:
        """Return the coordinate to which a drive goes: y on roads to north or south, else x, m."""
        return float(step.y if step.x is None else step.x)

    def leg(
        self, step: DriveTo, to: float, ahead: int, wanted: frozenset[str] = frozenset()
    ) -> None:
        """Drive a part of a step, up to the coordinate `to`, and note what must be free for it.

        `ahead`: 1 or -1, as in `drive`. `wanted`: places that the robot gets before it is there.
        """
        here = self.y if step.x is None else self.x
        # It must be free from the robot's front now to STOP_DISTANCE ahead of its front at the end.
        length = abs(to - here) + STOP_DISTANCE
        middle = (here + to + ahead * (STOP_DISTANCE + self.kind.length)) / 2
        at = (self.x, middle) if step.x is None else (middle, self.y)
        self.x, self.y = (self.x, to) if step.x is None else (to, self.y)
        if to != here:
            area = self.area(*at, length, self.kind.width + 2 * SIDE_MARGIN, self.heading)
            self.drives.append(
                area._replace(
                    places=self.places | wanted, end=(self.x, self.y), blind_to=tuple(step.blind_to)
                )
            )


def walks_of(layout: Layout, walk_of: type[Walk] = Walk) -> Iterator[Walk]:
    """Yield the walks of an orchard: the work of every picker, and the jobs of carriers.

    There is a job for each bin that is left, from the lines of the queue that `jobs_from` says. And
    each carrier stands at its place in the queue. `walk_of`: makes a walk.
    """
    route = route_of(layout)
    carriers = range(1, layout.scenario.carrier_count + 1)
    # The queue has lines of so many places: these carriers are the first of their line.
    heads = carriers[:: layout.queue.places]
    for number in carriers:
        place = layout.queue.place(number - 1)
        yield walk_of(f"carrier {number}", "", place.x, place.y)
    for name, block in layout.blocks.items():
        start = layout.starts[layout.index[name]].pose
        heading = "EAST" if block.start == "west" else "WEST"
        walk = walk_of(name, name, start.x, start.y, heading=heading)
        walk.follow(route.come_in(block))
        passes = layout.passes(block)
        for count, (one, after) in enumerate(zip_longest(passes, passes[1:])):
            side = route.sides[one.end]
            walk.stage = 2 * count + 2
            walk.row = one.row
            walk.follow(route.pick(one, came_over=count > 0 or block.start == "east"))
            walk.stage = 2 * count + 3
            walk.follow(route.go_on(one, after))
            for carrier in jobs_from(heads, one.row) if one.leaves_bin else []:
                place = layout.queue.place(carrier - 1)
                job = walk_of(
                    f"carrier for pass {count} of {name}", name, place.x, place.y, walk.stage
                )
                job.row = one.row
                job.follow(route.fetch(carrier, one.row, side, name, "a bin"))
                yield job
        yield walk


def jobs_from(heads: Sequence[int], row: int) -> Sequence[int]:
    """Return the carriers, of those at the heads of lines, that do a job in a row.

    In row 1 all of them do. In each other row one does, by turns: that is enough, because
    their ways differ only in the queue.
    """
    return heads if row == 1 else [heads[row % len(heads)]]
