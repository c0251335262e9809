"""The layout of an orchard, made from a scenario. Figures: docs/reference.md. Metres, in the frame `map`: x east, y north."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np

from orchard.field.geometry import EAST, Pose, Rect
from orchard.field.kinds import KINDS, name_of
from orchard.field.placement import Start, guests
from orchard.field.plugins import MISTAKES, load_plugin, unusable
from orchard.field.scenario import MANUAL, Scenario

KEPT_LAYOUTS = 8
X_MAX = 50.0  # the fences' centre lines, west and east
TOP = 34.0  # the top fence's centre line
FENCE_THICKNESS = 1.0
FENCE_HEIGHT = 2.5
TREE_TOP_LINE = 13.5
TREES_X = tuple(-34.5 + 6.0 * i for i in range(12))
POSTS_X = tuple(-31.5 + 6.0 * i for i in range(11))
TRUNK = 0.5  # m square; posts too
ROW_WEST, ROW_EAST = -35.5, 34.5  # x of the ends of the picked part of a row
ROW_LENGTH = ROW_EAST - ROW_WEST
DRIVEWAY = Rect(-34.67 - 15.0, 28.51 - 5.0, -34.67 + 15.0, 28.51 + 5.0)

BAY = Rect(-34.5, 23.6, -29.5, 25.4)  # at the driveway's south edge: a full bin at rest in it is unloaded
UNLOADING_SECONDS = 5.0  # s at rest in the bay (docs/reference.md)
BAY_STOP = -30.0  # x of a carrier that unloads: its bin stands 1.9 m west of it
TOP_ROAD = 24.5  # y of the road through the bay to the queue
QUEUE_LINES = (24.5, 21.5, 18.5, 27.5)  # y of the queue's lines, in the order in which they fill
QUEUE_HEAD = 35.4  # x of a line's first carrier
QUEUE_PITCH = 4.0  # m from one waiting carrier to the next
QUEUE_LINE_PLACES = 12
QUEUE = Rect(-18.0, min(QUEUE_LINES) - 0.75, QUEUE_HEAD + 0.9, max(QUEUE_LINES) + 0.75)  # contains all waiting carriers


@dataclass(frozen=True)
class Lane:
    """A row that is picked, between two tree lines. Rows count from 1 at the top."""

    number: int
    y: float  #: its centre line


@dataclass(frozen=True, eq=False)
class Layout:
    """All properties of an orchard that do not change during the harvest. All agents of a process and physics share it: it is read-only."""

    scenario: Scenario
    lanes: tuple[Lane, ...]
    blocks: Mapping[str, tuple[int, ...]]  #: picker -> the numbers of its rows, in the order in which it picks them
    starts: tuple[Start, ...]  #: in the order in which bodies move: robots by name, people and animals by name, weeds
    walls: np.ndarray  #: (n, 4), m: x, y, half length along x, half width along y of each fence, trunk and post; fences first

    @property
    def pitch(self) -> float:
        """Distance from one tree line to the next, m."""
        return self.scenario.row_width + TRUNK

    @property
    def bottom(self) -> float:
        """y of the bottom fence's centre line, m."""
        return TOP - (self.scenario.row_width * self.scenario.rows + 0.5 * (self.scenario.rows + 1) + 41.0)

    @property
    def tree_lines(self) -> tuple[float, ...]:
        """y of each line of trees, from the top, m."""
        return tuple(TREE_TOP_LINE - i * self.pitch for i in range(self.scenario.rows + 1))

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


def lay_out(scenario: Scenario) -> Layout:
    """Return the layout of a scenario. Solid bodies do not overlap, and the same scenario and seed give the same layout.

    The last layouts are kept, because their parts are read-only: a second run of a scenario begins at once.
    """
    return _laid_out(scenario.model_dump_json())


@lru_cache(maxsize=KEPT_LAYOUTS)
def _laid_out(text: str) -> Layout:
    scenario = Scenario.model_validate_json(text)
    lanes = tuple(Lane(i + 1, TREE_TOP_LINE - (i + 0.5) * (scenario.row_width + TRUNK)) for i in range(scenario.rows))
    bare = Layout(scenario, lanes, MappingProxyType(rows_to_pickers(scenario)), starts=(), walls=np.empty((0, 4)))
    walls, machines, half = np.array(_fences(bare) + _trunks_and_posts(bare)), _machines(bare), FENCE_THICKNESS / 2
    inside = Rect(-X_MAX + half, bare.bottom + half, X_MAX - half, TOP - half)
    rows = Rect(ROW_WEST, bare.tree_lines[-1], ROW_EAST, TREE_TOP_LINE)
    starts = machines + guests(scenario, machines, walls, inside, rows, keep_off=queue_in_use(scenario.carrier_count))
    starts.sort(key=lambda start: (not KINDS[start.kind].robot, not KINDS[start.kind].solid, start.name))
    walls.setflags(write=False)
    return replace(bare, starts=tuple(starts), walls=walls)


def _fences(layout: Layout) -> list[tuple[float, float, float, float]]:
    low, half = layout.bottom, FENCE_THICKNESS / 2
    middle, half_height = (TOP + low) / 2, (TOP - low) / 2 + half
    return [(0.0, y, X_MAX + half, half) for y in (TOP, low)] + [(x, middle, half, half_height) for x in (-X_MAX, X_MAX)]


def _trunks_and_posts(layout: Layout) -> list[tuple[float, float, float, float]]:
    return [(x, y, TRUNK / 2, TRUNK / 2) for y in layout.tree_lines for x in sorted(TREES_X + POSTS_X)]


def rows_to_pickers(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    """Return the rows of each picker, in the order in which it picks them, by the rule that the scenario names: a function.

    Raises ScenarioError if the rule cannot be used, or does not give each row to exactly one picker and each picker at least one row.
    """
    if scenario.rows_to_pickers == MANUAL:
        return manual_rows(scenario)
    key, path = "rows_to_pickers", scenario.rows_to_pickers
    rule = load_plugin(key, path)
    try:
        blocks = {name: tuple(int(row) for row in rule(scenario)[name]) for name in _pickers(scenario)}
        if sorted(row for rows in blocks.values() for row in rows) != list(range(1, scenario.rows + 1)) or not all(blocks.values()):
            raise ValueError(f"{blocks}: each row of 1 to {scenario.rows} must go to one picker, and each picker must get at least one")
        if any(rows != tuple(range(rows[0], rows[-1] + 1)) for rows in blocks.values()):
            raise ValueError(f"{blocks}: the rows of a picker must be neighbours, in their order from north to south")
    except MISTAKES as error:
        raise unusable(key, path, error, "a function of the scenario that returns {picker: rows}") from error
    return blocks


def manual_rows(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    """Return rows by the manual's rule: rows // pickers neighbouring rows for each picker; the last one gets the remainder too."""
    share, names = scenario.rows // scenario.pickers, _pickers(scenario)
    ends = [*(i * share for i in range(scenario.pickers)), scenario.rows]
    return {name: tuple(range(ends[i] + 1, ends[i + 1] + 1)) for i, name in enumerate(names)}


def _pickers(scenario: Scenario) -> list[str]:
    return [name_of("picker", i + 1) for i in range(scenario.pickers)]


def queue_place(number: int) -> Pose:
    """Return the start of a carrier, counted from 0: the queue fills line by line, each from its head."""
    line, place = divmod(number, QUEUE_LINE_PLACES)
    return Pose(QUEUE_HEAD - place * QUEUE_PITCH, QUEUE_LINES[line], EAST)


def queue_in_use(carriers: int) -> Rect:
    """Return the part of the queue with the lines of this many carriers."""
    lines = [queue_place(number).y for number in range(carriers)]
    return QUEUE._replace(south=min(lines) - 0.75, north=max(lines) + 0.75)


def _machines(layout: Layout) -> list[Start]:
    robots = [("picker", name, Pose(ROW_WEST, layout.lane(rows[0]).y, EAST)) for name, rows in layout.blocks.items()]
    robots += [("carrier", name_of("carrier", i + 1), queue_place(i)) for i in range(layout.scenario.carrier_count)]
    starts = []
    for number, (kind, name, pose) in enumerate(robots, start=1):
        bin_name = name_of("bin", number)
        starts.append(Start(name, kind, pose, bin_name))
        starts.append(Start(bin_name, "bin", Pose(pose.x - KINDS[kind].tows, pose.y, EAST)))
    return starts + ([Start(name_of("tractor", 1), "tractor", Pose(-45.0, 29.0, EAST))] if layout.scenario.tractor else [])
