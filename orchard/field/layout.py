"""The layout of an orchard, made from a scenario. Figures: docs/reference.md. Metres, in the frame `map`: x east, y north."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil
from statistics import fmean
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from orchard.field.geometry import EAST, WEST, Pose, Rect
from orchard.field.kinds import KINDS, name_of
from orchard.field.passes import Pass, passes_in
from orchard.field.picking import picking_speed_of
from orchard.field.placement import Start, guests
from orchard.field.plugins import load_plugin
from orchard.field.problems import Problem, ScenarioError
from orchard.field.queue import BAY_STOP, ONE_WAY, QUEUES, USUAL_ROW, Queue, lack_of_room, queue_of
from orchard.field.rows import Block, rows_to_pickers
from orchard.field.scenario import Scenario
from orchard.field.survey import TRUNK, Survey, SurveyedRow

KEPT_LAYOUTS = 8  # in the cache

# metres, in the frame `map`
X_WEST, X_EAST = (
    -50.0,
    50.0,
)  # x of the fences' centre lines; the eastern one with rows of the usual length
TOP = 34.0  # y of the top fence's centre line, unless the queue reaches further north
ABOVE_QUEUE = 3.5  # m from the northernmost line of the queue to the top fence's centre line
FENCE_THICKNESS = 1.0
FENCE_HEIGHT = 2.5
TREE_TOP_LINE = 13.5  # y of the northernmost line of trees
FIRST_TREE, TREE_PITCH, LAST_TREE = (
    -34.5,
    6.0,
    3.0,
)  # x of the first; from tree to tree; the last is at least so far from the row's end
BELOW_ROWS = 21.0  # m from the last tree line to the bottom fence's centre line
ROW_WEST = -35.5  # x of the west end of the picked part of a row
EAST_START = 41.0  # x of a picker that starts at an east end: where pickers wait for bins, off both roads; with rows of the usual length
DRIVEWAY = Rect(-34.67 - 15.0, 28.51 - 5.0, -34.67 + 15.0, 28.51 + 5.0)

BAY = Rect(
    -34.5, 23.6, -29.5, 25.4
)  # its usual place, at the driveway's south edge: a full bin at rest in it is unloaded
UNLOADING_SECONDS = 5.0  # s at rest in the bay (docs/reference.md)


@dataclass(frozen=True)
class Lane:
    """A row that is picked, between two tree lines. Rows count from 1 at the top."""

    number: int
    y: float  #: its centre line
    picking_speed: float  #: m/s, from end to end
    west: float  #: x of the west end of its picked part
    length: float  #: of its picked part
    width: (
        float  #: between its trees; twice the nearer side, if its centre line is not in the middle
    )

    @property
    def east(self) -> float:
        """x of the east end of its picked part, m."""
        return self.west + self.length


class TreeLine(NamedTuple):
    """A line of trees: y, and the x from and up to which it has rows beside it, m."""

    y: float
    west: float
    east: float

    @property
    def trees_x(self) -> tuple[float, ...]:
        """x of each tree, m. Trees of all lines stand in one grid, for the wires across."""
        first = ceil((self.west - ROW_WEST) / TREE_PITCH - 1e-9)
        last = int((self.east - LAST_TREE - FIRST_TREE) / TREE_PITCH + 1e-9)
        return tuple(FIRST_TREE + TREE_PITCH * i for i in range(first, last + 1))

    @property
    def posts_x(self) -> tuple[float, ...]:
        """x of each post, m: halfway between two trees."""
        return tuple(x + TREE_PITCH / 2 for x in self.trees_x[:-1])


@dataclass(frozen=True, eq=False)
class Layout:
    """All properties of an orchard that do not change during the harvest. All agents of a process and physics share it: it is read-only."""

    scenario: Scenario
    lanes: tuple[Lane, ...]
    lines: tuple[TreeLine, ...]  #: the lines of trees, from the top; one more than lanes
    blocks: Mapping[
        str, Block
    ]  #: picker -> its rows, in the order in which it picks them, and the end at which it starts
    starts: tuple[
        Start, ...
    ]  #: in the order in which bodies move: robots by name, people and animals by name, weeds
    walls: np.ndarray  #: (n, 4), m: x, y, half length along x, half width along y of each fence, trunk and post; fences first

    @property
    def row_length(self) -> float:
        """Length of the rows, m; in a surveyed orchard from the westernmost end of a row to the easternmost one."""
        return self.scenario.row_length

    @property
    def metres_per_bin(self) -> float:
        """Metres of row that fill a bin. If each row fills one, they are metres of a row of the full length."""
        return self.scenario.bin_metres or self.row_length

    def passes(self, block: Block) -> list[Pass]:
        """Return the passes of a picker through its rows. Raises ScenarioError for an order of the user's own that cannot be."""
        return passes_in(self.scenario, [(lane.west, lane.east) for lane in self.lanes], block)

    @cached_property
    def bins(self) -> int:
        """The number of bins that a harvest fills; of each picker's the last one may be part full."""
        return sum(one.leaves_bin for block in self.blocks.values() for one in self.passes(block))

    @property
    def is_picked_again(self) -> bool:
        """Whether pickers pick rows more than once, as in the long run."""
        return any(len(set(block.rows)) < len(block.rows) for block in self.blocks.values())

    @property
    def mean_length(self) -> float:
        """Mean length of the picked parts of the rows, m."""
        return (
            fmean(lane.length for lane in self.lanes) if self.scenario.survey else self.row_length
        )

    @property
    def row_east(self) -> float:
        """x of the easternmost end of the picked part of a row, m."""
        return ROW_WEST + self.row_length

    @property
    def shift(self) -> float:
        """How much further east all of the east side lies than with rows of the usual length, m."""
        return self.row_length - USUAL_ROW

    @property
    def east(self) -> float:
        """x of the east fence's centre line, m."""
        return X_EAST + self.shift

    @cached_property
    def top(self) -> float:
        """y of the top fence's centre line, m."""
        return max(TOP, max(self.queue.lines) + ABOVE_QUEUE)

    @property
    def middle(self) -> float:
        """x of the middle between the roads of both sides, m."""
        return -1.5 + self.shift / 2

    @cached_property
    def bay(self) -> Rect:
        """The unloading bay."""
        return BAY._replace(west=BAY.west + self.scenario.bay, east=BAY.east + self.scenario.bay)

    @property
    def bay_stop(self) -> float:
        """x of a carrier that unloads, m: its bin stands 1.9 m west of it."""
        return BAY_STOP + self.scenario.bay

    @cached_property
    def queue(self) -> Queue:
        """Where carriers wait: the queue of the scenario's route. Raises ScenarioError if there is no room for it."""
        scenario = self.scenario
        name = (
            scenario.route
            if scenario.route in QUEUES
            else getattr(load_plugin("route", scenario.route), "QUEUE", ONE_WAY)
        )
        if name not in [*QUEUES]:
            raise ScenarioError(
                [
                    Problem(
                        "scenario",
                        f"its QUEUE is {name!r}; must be {' or '.join(QUEUES)}",
                        "route",
                        scenario.route,
                    )
                ]
            )
        wanted = (
            name,
            scenario.row_length,
            scenario.bay,
            scenario.queue_carriers,
            scenario.has_batteries,
        )
        queue = queue_of(*wanted)
        if queue is None:
            text = lack_of_room(*wanted)
            raise ScenarioError(
                [Problem("scenario", text, "carriers", str(scenario.queue_carriers))]
            )
        return queue

    @cached_property
    def first_charging(self) -> int:
        """The number of places of the lines in which carriers wait: beyond them are those in which they charge. 0 without batteries."""
        return (
            self.queue.whole_lines(self.scenario.queue_carriers)
            if self.scenario.has_batteries
            else 0
        )

    @property
    def queue_places(self) -> int:
        """The places of the queue that are in use."""
        return 2 * self.first_charging or self.scenario.queue_carriers

    @cached_property
    def charging_lines(self) -> tuple[float, ...]:
        """y of each line in which carriers charge, m."""
        return (
            tuple(self.queue.used(self.queue_places)[len(self.queue.used(self.first_charging)) :])
            if self.first_charging
            else ()
        )

    @property
    def bottom(self) -> float:
        """y of the bottom fence's centre line, m."""
        return self.tree_lines[-1] - BELOW_ROWS

    @property
    def tree_lines(self) -> tuple[float, ...]:
        """y of each line of trees, from the top, m."""
        return tuple(line.y for line in self.lines)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all bodies, in body order."""
        return tuple(start.name for start in self.starts)

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """The names of all agents: those of the bodies, then those without a body."""
        return (*self.names, *self.scenario.bodiless_agents)

    @cached_property
    def index(self) -> Mapping[str, int]:
        """Name -> index of the body in the world's arrays."""
        return MappingProxyType({name: i for i, name in enumerate(self.names)})

    def __deepcopy__(self, memo: object) -> "Layout":
        return self  # it is read-only

    def lane(self, number: int) -> Lane:
        return self.lanes[number - 1]

    def beyond(self, row: int, side: str) -> float:
        """Return the metres from the end of a row to the furthest end of a row on that side, 'east' or 'west'."""
        lane = self.lane(row)
        return self.row_east - lane.east if side == "east" else lane.west - ROW_WEST

    def picking_seconds(self, row: int, metres: float) -> float:
        """Return the time for which a picker works at some metres of a row, with the mean time for which it stands because it failed, s."""
        return metres / self.lane(row).picking_speed * (1.0 + self.scenario.picking.failure.share)


def lay_out(scenario: Scenario) -> Layout:
    """Return the layout of a scenario. Solid bodies do not overlap, and the same scenario and seed give the same layout.

    The last layouts are kept, because their parts are read-only: a second run of a scenario begins at once.
    """
    return _laid_out(scenario.model_dump_json())


@lru_cache(maxsize=KEPT_LAYOUTS)
def _laid_out(text: str) -> Layout:
    scenario = Scenario.model_validate_json(text)
    lanes, lines = (
        _alike(scenario) if scenario.survey is None else _surveyed(scenario, scenario.survey)
    )
    bare = Layout(
        scenario,
        lanes,
        lines,
        MappingProxyType(rows_to_pickers(scenario)),
        starts=(),
        walls=np.empty((0, 4)),
    )
    trunks_and_posts = [
        (x, line.y, TRUNK / 2, TRUNK / 2)
        for line in lines
        for x in sorted(line.trees_x + line.posts_x)
    ]
    walls, machines, half = (
        np.array(_fences(bare) + trunks_and_posts),
        _machines(bare),
        FENCE_THICKNESS / 2,
    )
    inside = Rect(X_WEST + half, bare.bottom + half, bare.east - half, bare.top - half)
    rows = Rect(ROW_WEST, bare.tree_lines[-1], bare.row_east, TREE_TOP_LINE)
    starts = machines + guests(
        scenario, machines, walls, inside, rows, keep_off=bare.queue.in_use(bare.queue_places)
    )
    starts.sort(
        key=lambda start: (not KINDS[start.kind].robot, not KINDS[start.kind].solid, start.name)
    )
    walls.setflags(write=False)
    return replace(bare, starts=tuple(starts), walls=walls)


Rows = tuple[tuple[Lane, ...], tuple[TreeLine, ...]]


def _alike(scenario: Scenario) -> Rows:
    pitch, length, width = scenario.row_width + TRUNK, scenario.row_length, scenario.row_width
    ys = [TREE_TOP_LINE - (i + 0.5) * pitch for i in range(scenario.rows)]
    lanes = [
        Lane(row, y, picking_speed_of(scenario, row), ROW_WEST, length, width)
        for row, y in enumerate(ys, start=1)
    ]
    lines = [
        TreeLine(TREE_TOP_LINE - i * pitch, ROW_WEST, ROW_WEST + length)
        for i in range(scenario.rows + 1)
    ]
    return tuple(lanes), tuple(lines)


def _surveyed(scenario: Scenario, survey: Survey) -> Rows:
    rows, souths = survey.rows, [row.south for row in survey.rows]
    between = [(north + south) / 2 for north, south in pairwise(souths)]
    lines = [2 * souths[0] - between[0], *between, 2 * souths[-1] - between[-1]]
    ys = [TREE_TOP_LINE - (line - lines[0]) for line in lines]
    lanes = [
        _lane(scenario, number, row, row.south - lines[0], ys)
        for number, row in enumerate(rows, start=1)
    ]
    beside = [lanes[max(0, i - 1) : i + 1] for i in range(len(ys))]
    ends = [(min(lane.west for lane in near), max(lane.east for lane in near)) for near in beside]
    return tuple(lanes), tuple(
        TreeLine(y, *west_and_east) for y, west_and_east in zip(ys, ends, strict=True)
    )


def _lane(
    scenario: Scenario, number: int, row: SurveyedRow, south: float, lines: list[float]
) -> Lane:
    """Return the lane of a surveyed row. `south`: how far it lies south of the first line of trees, m; `lines`: y of all lines, m."""
    y = TREE_TOP_LINE - south
    width = 2 * min(lines[number - 1] - y, y - lines[number]) - TRUNK
    return Lane(
        number, y, picking_speed_of(scenario, number), ROW_WEST + row.start, row.length, width
    )


def _fences(layout: Layout) -> list[tuple[float, float, float, float]]:
    low, half = layout.bottom, FENCE_THICKNESS / 2
    middle, half_height = (layout.top + low) / 2, (layout.top - low) / 2 + half
    across, half_width = (X_WEST + layout.east) / 2, (layout.east - X_WEST) / 2 + half
    return [(across, y, half_width, half) for y in (layout.top, low)] + [
        (x, middle, half, half_height) for x in (X_WEST, layout.east)
    ]


def _picker_start(layout: Layout, block: Block) -> Pose:
    """Return the start of a picker: in the west at the head of its first row; in the east off the roads, where its bin stands on none."""
    lane = layout.lane(block.rows[0])
    return (
        Pose(lane.west, lane.y, EAST)
        if block.start == "west"
        else Pose(EAST_START + layout.row_length - USUAL_ROW, lane.y, WEST)
    )


def _machines(layout: Layout) -> list[Start]:
    robots = [
        ("picker", name, _picker_start(layout, block)) for name, block in layout.blocks.items()
    ]
    robots += [
        ("carrier", name_of("carrier", i + 1), layout.queue.place(i))
        for i in range(layout.scenario.carrier_count)
    ]
    starts = []
    for number, (kind, name, pose) in enumerate(robots, start=1):
        bin_name, behind = (
            name_of("bin", number),
            KINDS[kind].tows if pose.yaw == EAST else -KINDS[kind].tows,
        )
        starts.append(Start(name, kind, pose, bin_name))
        starts.append(Start(bin_name, "bin", Pose(pose.x - behind, pose.y, pose.yaw)))
    return starts + (
        [Start(name_of("tractor", 1), "tractor", Pose(-45.0, 29.0, EAST))]
        if layout.scenario.tractor
        else []
    )
