"""The layout of an orchard, made from a scenario: `lay_out` returns it.

It tells all that stays as it is during a harvest: rows, fences, queue, bay, and where each body
starts. Physics and all agents read it. Metres, in the frame `map`: x east, y north. Figures of the
manual are listed in docs/reference.md.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from statistics import fmean
from types import MappingProxyType
from typing import Any

import numpy as np

from orchard.field.geometry import EAST, WEST, Pose, Rect
from orchard.field.kinds import KINDS, Kind, name_of
from orchard.field.lanes import ROW_WEST, Lane, TreeLine, alike, surveyed
from orchard.field.machines import Machine, machine_of
from orchard.field.passes import UNKNOWN, Pass, passes_in
from orchard.field.picking import bin_speed_of, picking_speed_of
from orchard.field.placement import Start, guests
from orchard.field.plugins import load_plugin
from orchard.field.problems import Problem, ScenarioError
from orchard.field.queue import (
    BAY_STOP,
    CLOSED_UP,
    ONE_WAY,
    QUEUES,
    USUAL_ROW,
    Queue,
    lack_of_room,
    queue_of,
)
from orchard.field.rows import Block, rows_to_pickers
from orchard.field.scenario import Scenario
from orchard.field.walls import FENCE_THICKNESS, walls_of

# Layouts in the cache of `lay_out`. Other caches of what follows from a layout are as large.
KEPT_LAYOUTS = 8

# All that follows is in metres, in the frame `map`, and from the manual where nothing else is said.
# The figures of the east side are for rows of USUAL_ROW: `Layout.shift` is added for longer ones.
# x of the fences' centre lines.
X_WEST = -50.0
X_EAST = 50.0
# y of the top fence's centre line, unless the queue reaches further north.
TOP = 34.0
# From the northernmost line of the queue to the top fence's centre line.
ABOVE_QUEUE = 3.5
# From the last tree line to the bottom fence's centre line.
BELOW_ROWS = 21.0
# x of a picker that starts at an east end: where pickers wait for bins, off both roads.
EAST_START = 41.0
# 30 by 10 m about its centre.
DRIVEWAY = Rect(-34.67 - 15.0, 28.51 - 5.0, -34.67 + 15.0, 28.51 + 5.0)
TRACTOR_START = Pose(-45.0, 29.0, EAST)
# x of the middle between the west and the east roads of the routes.
MIDDLE = -1.5

# The bay at its usual place, at the driveway's south edge. A full bin at rest in it is unloaded.
BAY = Rect(-34.5, 23.6, -29.5, 25.4)
# m. A carrier that is held up unloads only if its bin is so far inside the bay by the pose that the
# carrier measures, because a measured pose has errors.
INTO_BAY = 0.5


@dataclass(frozen=True, eq=False)
class Layout:
    """All properties of an orchard that do not change during the harvest.

    All agents of a process and physics share it: it is read-only.
    """

    scenario: Scenario
    lanes: tuple[Lane, ...]
    #: The lines of trees, from the top: one more than lanes, and two where rows are missing.
    lines: tuple[TreeLine, ...]
    #: Picker -> its rows, in the order in which it picks them, and the end at which it starts.
    blocks: Mapping[str, Block]
    #: The start of each body, in body order. In this order bodies move: robots by name, people and
    #: animals by name, weeds.
    starts: tuple[Start, ...]
    #: (n, 4), m: x, y, half length along x, half width along y of each fence, trunk and post;
    #: fences first.
    walls: np.ndarray

    @property
    def row_length(self) -> float:
        """Length of the rows, m.

        In a surveyed orchard it is that from the westernmost end of a row to the easternmost one.
        """
        return self.scenario.row_length

    @property
    def metres_per_bin(self) -> float:
        """Metres of row that fill a bin.

        If each row fills one, they are metres of a row of the full length.
        """
        return self.scenario.bin_metres or self.row_length

    def passes(self, block: Block) -> list[Pass]:
        """Return the passes of a picker through its rows.

        Raises ScenarioError for an order of the user's own that cannot be.
        """
        return passes_in(self.scenario, [(lane.west, lane.east) for lane in self.lanes], block)

    @cached_property
    def machines(self) -> Mapping[str, Machine]:
        """Kind -> what its machines can."""
        return MappingProxyType({kind: machine_of(self.scenario, kind) for kind in KINDS})

    @cached_property
    def bins(self) -> int:
        """The number of bins that a harvest fills.

        The last bin of each picker may be part full.
        """
        count = 0
        for block in self.blocks.values():
            count += sum(drive.leaves_bin for drive in self.passes(block))
        return count

    @property
    def rows_differ(self) -> bool:
        """Whether a row is picked at another speed than others, or has its ends elsewhere."""
        return len({(lane.picking_speed, lane.west, lane.length) for lane in self.lanes}) > 1

    @property
    def is_picked_again(self) -> bool:
        """Whether pickers pick rows more than once, as in the long run."""
        return any(len(set(block.rows)) < len(block.rows) for block in self.blocks.values())

    @property
    def mean_length(self) -> float:
        """Mean length of the picked parts of the rows, m."""
        if self.scenario.survey is None:
            return self.row_length
        return fmean(lane.length for lane in self.lanes)

    @property
    def row_east(self) -> float:
        """x of the easternmost end of the picked part of a row, m."""
        return ROW_WEST + self.row_length

    @property
    def shift(self) -> float:
        """How much further east the east side lies than with rows of the usual length, m."""
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
        return MIDDLE + self.shift / 2

    @cached_property
    def bay(self) -> Rect:
        """The unloading bay, with all its places.

        Each place beyond the first one lies further west: a carrier unloads there where it
        stands behind another one.
        """
        scenario = self.scenario
        west = BAY.west + scenario.bay - CLOSED_UP * (scenario.bays - 1)
        return BAY._replace(west=west, east=BAY.east + scenario.bay)

    @property
    def bay_edges(self) -> tuple[float, ...]:
        """x of each edge between two places of the bay, from the east, m."""
        first = BAY.west + self.scenario.bay
        return tuple(first - CLOSED_UP * number for number in range(self.scenario.bays - 1))

    @property
    def bay_stop(self) -> float:
        """x of a carrier that unloads at the first place, m: its bin stands 1.9 m west of it."""
        return BAY_STOP + self.scenario.bay

    @property
    def unloads_from(self) -> float:
        """x from which on a carrier that is held up on its way to `bay_stop` unloads where it
        stands, m.
        """
        return self.bay.west + KINDS["carrier"].tows + INTO_BAY

    @cached_property
    def queue(self) -> Queue:
        """Where carriers wait: the queue of the scenario's route.

        Raises ScenarioError if there is no room for it.
        """
        scenario = self.scenario
        name = self._queue_name()
        wanted = (
            name,
            scenario.row_length,
            scenario.bay,
            scenario.queue_carriers,
            scenario.has_batteries,
        )
        queue = queue_of(*wanted)
        if queue is None:
            carriers = str(scenario.queue_carriers)
            raise ScenarioError([Problem("scenario", lack_of_room(*wanted), "carriers", carriers)])
        return queue

    def _queue_name(self) -> str:
        """Return the built-in route whose queue is used.

        A route of a user's own names one in its attribute `QUEUE`. Raises ScenarioError if that is
        no built-in route.
        """
        route = self.scenario.route
        if route in QUEUES:
            return route
        name: str = getattr(load_plugin("route", route), "QUEUE", ONE_WAY)
        # A list, because `name` may be anything, also what a map cannot look up.
        if name not in [*QUEUES]:
            text = f"its QUEUE is {name!r}; must be {' or '.join(QUEUES)}"
            raise ScenarioError([Problem("scenario", text, "route", route)])
        return name

    @cached_property
    def first_charging(self) -> int:
        """The number of the first place at which carriers charge; 0 without batteries.

        Carriers wait in the lines with smaller numbers, and charge in as many lines after them.
        """
        if not self.scenario.has_batteries:
            return 0
        return self.queue.whole_lines(self.scenario.queue_carriers)

    @property
    def queue_places(self) -> int:
        """The number of places of the queue that are in use.

        With batteries these are those to wait at and as many to charge at.
        """
        if self.scenario.has_batteries:
            return 2 * self.first_charging
        return self.scenario.queue_carriers

    @cached_property
    def charging_lines(self) -> tuple[float, ...]:
        """y of each line in which carriers charge, m."""
        if not self.first_charging:
            return ()
        waiting = self.queue.used(self.first_charging)
        both = self.queue.used(self.queue_places)
        return tuple(both[len(waiting) :])

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
    def kinds(self) -> tuple[Kind, ...]:
        """The kind of each body, in body order."""
        return tuple(KINDS[start.kind] for start in self.starts)

    def names_of(self, *kinds: str) -> list[str]:
        """Return the names of the bodies of some kinds, in body order."""
        return [start.name for start in self.starts if start.kind in kinds]

    def indices_of(self, *kinds: str) -> list[int]:
        """Return the indices of the bodies of some kinds, in body order."""
        return [self.index[name] for name in self.names_of(*kinds)]

    def names_at(self, bodies: Iterable[int]) -> list[str]:
        """Return the names of bodies. `bodies`: their indices."""
        names = self.names
        return [names[body] for body in bodies]

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

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make the same layout again, for pickle: from the scenario alone."""
        return lay_out, (self.scenario,)

    def lane(self, number: int) -> Lane:
        """Return a row's lane. Rows count from 1 at the top."""
        return self.lanes[number - 1]

    def picker_of(self, row: int) -> str:
        """Return the picker that picks a row."""
        return self._pickers[row]

    @cached_property
    def _pickers(self) -> Mapping[int, str]:
        """The picker of each row."""
        pickers: dict[int, str] = {}
        for name, block in self.blocks.items():
            pickers |= dict.fromkeys(block.rows, name)
        return pickers

    def beyond(self, row: int, side: str) -> float:
        """Return the metres from a row's end to the outermost end of all rows on the same side.

        `side`: 'east' or 'west'. 0 if all rows are alike.
        """
        lane = self.lane(row)
        if side == "east":
            return self.row_east - lane.east
        return lane.west - ROW_WEST

    def speed_on(self, current: Pass) -> float:
        """Return the speed at which a picker picks on one of its passes, m/s."""
        of_row = self.lane(current.row).picking_speed
        if current.bin_number == UNKNOWN:
            return of_row
        picker = self.picker_of(current.row)
        return bin_speed_of(self.scenario, picker, current.bin_number, of_row)

    def picking_seconds(self, row: int, metres: float) -> float:
        """Return the mean time that a picker needs for some metres of a row, s.

        It includes the mean time for which the picker stands because it failed.
        """
        return metres / self.lane(row).picking_speed * self._with_failures

    def seconds_on(self, current: Pass) -> float:
        """Return the time for which a picker works on one of its passes, s.

        It has the mean time for which the picker stands because it failed.
        """
        return current.metres / self.speed_on(current) * self._with_failures

    @property
    def _with_failures(self) -> float:
        """How many times as long picking takes with failures."""
        return 1.0 + self.scenario.picking.failure.share


def lay_out(scenario: Scenario) -> Layout:
    """Return the layout of a scenario.

    Solid bodies do not overlap, and the same scenario and seed give the same layout. The last
    layouts are kept, because their parts are read-only: a second run of a scenario begins at once.
    Raises ScenarioError for what only the layout shows, such as a user's rule whose result cannot
    be used.
    """
    return _laid_out(scenario.model_dump_json())


@lru_cache(maxsize=KEPT_LAYOUTS)
def _laid_out(text: str) -> Layout:
    """Return the layout of a scenario, which is given as JSON: a scenario itself is no key.

    Fences, trees and starts are placed by what `Layout` computes from rows and queue, so there is a
    layout without them first.
    """
    scenario = Scenario.model_validate_json(text)
    blocks = rows_to_pickers(scenario)
    speeds = {}
    for picker, block in blocks.items():
        for row in block.rows:
            speeds[row] = picking_speed_of(scenario, row, picker)
    if scenario.survey is None:
        lanes, lines = alike(scenario, speeds)
    else:
        lanes, lines = surveyed(scenario.survey, speeds)
    bare = Layout(
        scenario=scenario,
        lanes=lanes,
        lines=lines,
        blocks=MappingProxyType(blocks),
        starts=(),
        walls=np.empty((0, 4)),
    )
    walls = walls_of(bare.lines, Rect(X_WEST, bare.bottom, bare.east, bare.top))
    machines = _machines(bare)
    half = FENCE_THICKNESS / 2
    inside = Rect(X_WEST + half, bare.bottom + half, bare.east - half, bare.top - half)
    rows = Rect(ROW_WEST, bare.tree_lines[-1], bare.row_east, bare.tree_lines[0])
    keep_off = bare.queue.in_use(bare.queue_places)
    starts = machines + guests(
        scenario, machines, walls=walls, inside=inside, rows=rows, keep_off=keep_off
    )
    starts.sort(key=_moving_order)
    return replace(bare, starts=tuple(starts), walls=walls)


def _moving_order(start: Start) -> tuple[int, str]:
    """Return the key by which bodies are sorted: the group that moves first has the least number.

    Robots, then people and animals, then weeds. Within a group the name decides.
    """
    kind = KINDS[start.kind]
    if kind.robot:
        return 0, start.name
    if kind.solid:
        return 1, start.name
    return 2, start.name


def _picker_start(layout: Layout, block: Block) -> Pose:
    """Return the start of a picker.

    In the west it is at the head of its first row. In the east it is further out, so that neither
    the picker nor its bin stands on a road.
    """
    lane = layout.lane(block.rows[0])
    if block.start == "west":
        return Pose(lane.west, lane.y, EAST)
    # The sum is not taken with `layout.shift`, which would change its last bits, and so all hashes.
    return Pose(EAST_START + layout.row_length - USUAL_ROW, lane.y, WEST)


def _machines(layout: Layout) -> list[Start]:
    """Return the starts of pickers, carriers and the tractor.

    Behind each picker and each carrier is the start of its bin.
    """
    robots = []
    for name, block in layout.blocks.items():
        robots.append(("picker", name, _picker_start(layout, block)))
    for i in range(layout.scenario.carrier_count):
        robots.append(("carrier", name_of("carrier", i + 1), layout.queue.place(i)))
    starts = []
    for number, (kind, name, pose) in enumerate(robots, start=1):
        bin_name = name_of("bin", number)
        # All face east or west, so the bin lies behind along x.
        behind = KINDS[kind].tows
        if pose.yaw != EAST:
            behind = -behind
        starts.append(Start(name, kind, pose, bin_name))
        starts.append(Start(bin_name, "bin", Pose(pose.x - behind, pose.y, pose.yaw)))
    if layout.scenario.tractor:
        starts.append(Start(name_of("tractor", 1), "tractor", TRACTOR_START))
    return starts
