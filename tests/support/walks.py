"""Plans that are driven without an obstacle: where robots may stand, what they must find free, and
what they sweep.
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
    """Return points on the sides of a body, 2 cm apart, (k, 2) m: `x` ahead of where it stands."""
    ahead = KINDS[kind].length / 2
    aside = KINDS[kind].width / 2
    # The 1 cm more is less than a step, and lets the last corner be a point too.
    along = np.arange(-ahead, ahead + 0.01, 0.02)
    across = np.arange(-aside, aside + 0.01, 0.02)
    sides = [np.stack([along, np.full(len(along), y)], axis=1) for y in (-aside, aside)]
    ends = [np.stack([np.full(len(across), end), across], axis=1) for end in (-ahead, ahead)]
    return np.concatenate([*sides, *ends]) + np.array([x, 0.0])


@cache
def train(kind: str) -> np.ndarray:
    """Return such points of a robot and the bin that it tows."""
    return np.concatenate([outline(kind), outline("bin", -KINDS[kind].tows)])


UNIT = {"EAST": (1, 0), "NORTH": (0, 1), "WEST": (-1, 0), "SOUTH": (0, -1)}
WAITS = (Need, Alone, Deliver, FetchEmpty, LeaveBin, TakeBin, Unload, Confirmed)


class Area(NamedTuple):
    """A rectangle along the axes, m: where a robot or bin may stand, or which it must find free."""

    x: float
    y: float
    half_x: float
    half_y: float
    robot: str
    # A carrier's: for which it works.
    picker: str
    # Even while its picker picks and leaves the bin, then one more: a job for that bin has that
    # number.
    stage: int
    # Of a robot or its bin; '' for a bin that is left.
    heading: str
    # That the robot holds.
    places: frozenset[str]
    # Of a drive: where the robot turns onto the next road.
    end: tuple[float, float] = (np.nan, np.nan)
    blind_to: tuple[Box, ...] = ()


# Where a robot turns; its outline in its own frame, m; the heading to which it turns.
Turn = tuple[Area, np.ndarray, str]


class Walk:
    """A plan, driven without an obstacle: where its robot may stand, and what it must find free."""

    def __init__(
        self, robot: str, picker: str, x: float, y: float, stage: int = 0, heading: str = "EAST"
    ) -> None:
        # Of the present pass, or of the job.
        self.row = 0
        self.robot = robot
        self.picker = picker
        self.x = x
        self.y = y
        self.stage = stage
        self.kind = KINDS["picker" if robot == picker else "carrier"]
        self.heading = heading
        self.tows = True
        self.places = frozenset[str]()
        self.stands: list[Area] = []
        self.drives: list[Area] = []
        self.turns: list[Turn] = []
        self.stand()

    def stand(self) -> None:
        self.stands.append(
            self.area(self.x, self.y, self.kind.length, self.kind.width, self.heading)
        )
        if self.tows:
            self.stands.append(self.bin_behind(self.heading))

    def area(self, x: float, y: float, length: float, width: float, heading: str) -> Area:
        half = (width / 2, length / 2) if heading in ("NORTH", "SOUTH") else (length / 2, width / 2)
        return Area(x, y, *half, self.robot, self.picker, self.stage, heading, self.places)

    def outline(self) -> np.ndarray:
        kind = "picker" if self.robot == self.picker else "carrier"
        return train(kind) if self.tows else outline(kind)

    def bin_behind(self, heading: str) -> Area:
        ux, uy = UNIT[self.heading]
        return self.area(
            self.x - ux * self.kind.tows, self.y - uy * self.kind.tows, 1.0, 1.0, heading
        )

    def follow(self, steps: list[Step]) -> None:
        for step in steps:
            self.take(step)
        self.stand()

    def take(self, step: Step) -> None:
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
        ahead = sum(UNIT[self.heading])
        target = self.along(step)
        needs = {
            gate.at: [
                place for other in step.needs if other.at == gate.at for place in other.places
            ]
            for gate in step.needs
        }
        gates = [(at, True, places) for at, places in needs.items()] + [
            (gate.at, False, gate.places) for gate in step.frees
        ]
        start = self.y if step.x is None else self.x
        for at, needed, places in sorted(gates, key=lambda gate: (ahead * gate[0], gate[1])):
            here = self.y if step.x is None else self.x
            if ahead * at > ahead * target:
                break
            # A robot asks for nothing at a gate that is behind it when its drive begins.
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
        return float(step.y if step.x is None else step.x)

    def leg(
        self, step: DriveTo, to: float, ahead: int, wanted: frozenset[str] = frozenset()
    ) -> None:
        here = self.y if step.x is None else self.x
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
    """Yield the work of every picker, and each job of a carrier.

    There is a job for each bin that is left and each line of the queue; and the other carriers
    stand in the queue.
    """
    route = route_of(layout)
    carriers = range(1, layout.scenario.carrier_count + 1)
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
    """Return the heads of the lines from which carriers come to a row: to the first row, all."""
    return heads if row == 1 else [heads[row % len(heads)]]
