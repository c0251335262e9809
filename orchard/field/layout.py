"""Scenario -> where everything stands: fences, trees, lanes, driveway, queue, and every body's start.

Figures: reference.md, 'The field' and 'The things in it'. Metres; x east, y north.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchard.field.geometry import EAST, Pose, Rect
from orchard.field.kinds import KINDS, name_of
from orchard.field.placement import Placement, Start
from orchard.field.scenario import Scenario

X_MAX = 50.0  # the fences' centre lines, west and east
TOP = 34.0  # the top fence's centre line
FENCE_THICKNESS = 1.0
FENCE_HEIGHT = 2.5
TREE_TOP_LINE = 13.5
TREES_X = tuple(-34.5 + 6.0 * i for i in range(12))
POSTS_X = tuple(-31.5 + 6.0 * i for i in range(11))
TRUNK = 0.5  # m square; posts too
ROW_WEST, ROW_EAST = -35.5, 34.5  # where a row is picked from and to
ROW_LENGTH = ROW_EAST - ROW_WEST
DRIVEWAY = Rect(-34.67 - 15.0, 28.51 - 5.0, -34.67 + 15.0, 28.51 + 5.0)

BAY = Rect(-34.5, 23.6, -29.5, 25.4)  # the driveway's south edge: a bin at rest in here is unloaded
UNLOADING_SECONDS = 5.0  # at rest in it (reference.md)
BAY_STOP = -30.0  # x of a carrier that unloads: its bin stands 1.9 m west of it
TOP_ROAD = 24.5  # y of the road through the bay to the queue
QUEUE_LINES = (24.5, 21.5, 18.5, 27.5)  # y of the queue's lines, in the order in which they are filled
QUEUE_HEAD = 35.4  # x of a line's first carrier
QUEUE_PITCH = 4.0  # m from one waiting carrier to the next
QUEUE_LINE_PLACES = 12
QUEUE = Rect(-18.0, min(QUEUE_LINES) - 0.75, QUEUE_HEAD + 0.9, max(QUEUE_LINES) + 0.75)  # all of the waiting carriers


@dataclass(frozen=True)
class Lane:
    """A row that is picked, between two tree lines. Rows count from 1 at the top."""

    number: int
    y: float  # its centre line


@dataclass(frozen=True)
class Layout:
    """Everything about an orchard that does not change while it is harvested."""

    scenario: Scenario
    lanes: tuple[Lane, ...]
    blocks: dict[str, tuple[int, ...]]  # picker -> the numbers of its rows, in the order in which it picks them
    starts: tuple[Start, ...]  # in the order in which bodies move: robots by name, people and animals by name, weeds
    walls: np.ndarray  # (n, 4): x, y, half length along x, half width along y of every fence, trunk and post

    @property
    def pitch(self) -> float:
        return pitch(self.scenario)

    @property
    def bottom(self) -> float:
        """y of the bottom fence's centre line."""
        return bottom(self.scenario)

    @property
    def tree_lines(self) -> tuple[float, ...]:
        """y of every line of trees, from the top."""
        return tuple(TREE_TOP_LINE - i * self.pitch for i in range(self.scenario.rows + 1))

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(start.name for start in self.starts)

    @cached_property
    def index(self) -> dict[str, int]:
        """Name -> row in the world's arrays."""
        return {name: i for i, name in enumerate(self.names)}

    def lane(self, number: int) -> Lane:
        return self.lanes[number - 1]


def pitch(scenario: Scenario) -> float:
    """Metres from one tree line to the next."""
    return scenario.row_width + TRUNK


def bottom(scenario: Scenario) -> float:
    return TOP - (scenario.row_width * scenario.rows + 0.5 * (scenario.rows + 1) + 41.0)


def lay_out(scenario: Scenario) -> Layout:
    """Lay an orchard out: the same scenario and seed give the same layout, without overlaps."""
    lanes = tuple(Lane(i + 1, TREE_TOP_LINE - (i + 0.5) * pitch(scenario)) for i in range(scenario.rows))
    walls = np.array(_fences(scenario) + _trunks_and_posts(scenario))
    blocks = _blocks(scenario)
    machines = _machines(scenario, lanes, blocks)
    crowd = Placement(walls, inside=_inside(scenario), rows=_rows_area(scenario), keep_off=(QUEUE,))
    return Layout(scenario, lanes, blocks, _in_moving_order(machines + crowd.guests(scenario, machines)), walls)


def _fences(scenario: Scenario) -> list[tuple[float, float, float, float]]:
    low, half = bottom(scenario), FENCE_THICKNESS / 2
    middle, half_height = (TOP + low) / 2, (TOP - low) / 2 + half
    return [
        (0.0, TOP, X_MAX + half, half),
        (0.0, low, X_MAX + half, half),
        (-X_MAX, middle, half, half_height),
        (X_MAX, middle, half, half_height),
    ]


def _trunks_and_posts(scenario: Scenario) -> list[tuple[float, float, float, float]]:
    lines = [TREE_TOP_LINE - i * pitch(scenario) for i in range(scenario.rows + 1)]
    return [(x, y, TRUNK / 2, TRUNK / 2) for y in lines for x in sorted(TREES_X + POSTS_X)]


def _inside(scenario: Scenario) -> Rect:
    half = FENCE_THICKNESS / 2
    return Rect(-X_MAX + half, bottom(scenario) + half, X_MAX - half, TOP - half)


def _rows_area(scenario: Scenario) -> Rect:
    last_line = TREE_TOP_LINE - scenario.rows * pitch(scenario)
    return Rect(ROW_WEST, last_line, ROW_EAST, TREE_TOP_LINE)


def _blocks(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    """rows // pickers neighbouring rows for each picker, the last one the remainder as well."""
    share = scenario.rows // scenario.pickers
    firsts = [1 + i * share for i in range(scenario.pickers)] + [scenario.rows + 1]
    return {
        name_of("picker", i + 1): tuple(range(firsts[i], firsts[i + 1] if i + 1 < scenario.pickers else scenario.rows + 1))
        for i in range(scenario.pickers)
    }


def queue_place(number: int) -> Pose:
    """Where the number-th carrier (from 0) waits at the beginning: line by line, each from its head."""
    line, place = divmod(number, QUEUE_LINE_PLACES)
    return Pose(QUEUE_HEAD - place * QUEUE_PITCH, QUEUE_LINES[line], EAST)


def _machines(scenario: Scenario, lanes: tuple[Lane, ...], blocks: dict[str, tuple[int, ...]]) -> list[Start]:
    robots = [("picker", name, Pose(ROW_WEST, lanes[rows[0] - 1].y, EAST)) for name, rows in blocks.items()]
    robots += [("carrier", name_of("carrier", i + 1), queue_place(i)) for i in range(scenario.carrier_count)]
    starts = []
    for number, (kind, name, pose) in enumerate(robots, start=1):
        bin_name = name_of("bin", number)
        starts.append(Start(name, kind, pose, bin_name))
        starts.append(Start(bin_name, "bin", Pose(pose.x - KINDS[kind].tows, pose.y, EAST)))
    if scenario.tractor:
        starts.append(Start(name_of("tractor", 1), "tractor", Pose(-45.0, 29.0, EAST)))
    return starts


def _in_moving_order(starts: list[Start]) -> tuple[Start, ...]:
    def rank(start: Start) -> tuple[int, str]:
        kind = KINDS[start.kind]
        return (0 if kind.robot else 1 if kind.solid else 2), start.name

    return tuple(sorted(starts, key=rank))
