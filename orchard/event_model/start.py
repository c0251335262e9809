"""The start of a harvest in the event model: the program of an orchard, and the state in which all
harvests of it begin. Both are kept for all its seeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Any

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model import columns
from orchard.event_model.draws import NO_DRAWS, draws
from orchard.event_model.kernel.entry import addressed
from orchard.event_model.known import COMPILED
from orchard.event_model.program import Program
from orchard.field.kinds import DISPATCH, EIGHTH, KINDS
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.layout_key import Geometry
from orchard.field.machines import haul_charge
from orchard.field.picking import absences_of
from orchard.field.placement import Start
from orchard.plans.routes import ROUTES

# Arrays of a model that a harvest changes.
STATE = (
    "robots",
    "sets",
    "scratch",
    "rears",
    "bins",
    "calls",
    "offers",
    "distances",
    "timers",
    "desk",
    "trailers",
    "deliveries",
    "exchanges",
    "trips",
)


@dataclass(frozen=True)
class Prepared:
    """What all seeds of an orchard share."""

    program: Program
    # Pickers and carriers, sorted by name. A robot's number is its index here.
    names: list[str]
    # Bins, sorted by name too, because ties are decided by names.
    bin_names: list[str]
    # At the start of a harvest. Only copies are changed.
    model: columns.Model


def prepare(layout: Layout) -> Prepared:
    """Return the program of an orchard and its state at the start: the same ones for all seeds.

    Raises NotImplementedError for a step that the model does not know.
    """
    # The steps of a route of the user's own may depend on the seed.
    has_seed = layout.scenario.route not in ROUTES
    return _prepared(Geometry.of(layout, has_seed))


@lru_cache(maxsize=KEPT_LAYOUTS)
def _prepared(geometry: Geometry) -> Prepared:
    layout = geometry.layout
    program = Program(layout)
    if layout.scenario.route not in ROUTES:
        # A route of the user's own may have steps that the model does not know in any job.
        program.translate_all()
    starts = [start for start in layout.starts if start.kind in ("picker", "carrier")]
    starts.sort(key=lambda start: start.name)
    bin_names = sorted(start.bin for start in starts)
    names = [start.name for start in starts]
    initial = _initial(layout, program, starts, bin_names)
    return Prepared(program, names, bin_names, addressed(initial))


def _initial(
    layout: Layout, program: Program, starts: Sequence[Start], bin_names: list[str]
) -> columns.Model:
    """Return a model at the start of a harvest, without the speeds of passes and without a log."""
    count = len(starts)
    load_out = layout.scenario.load_out
    bins = np.zeros(len(bin_names), columns.BIN).view(np.recarray)
    bins.taken = c.NEVER
    bins.full = c.NONE
    bins.called = -c.NEVER
    calls = np.zeros(count, columns.CALL).view(np.recarray)
    calls.bin = c.NONE
    calls.carrier = c.NONE
    calls.failed = c.NONE
    calls.measured = c.NONE
    calls.stood_until = c.NONE
    calls.silent_since = c.NEVER
    timers = np.full((c.EVENTS, count), c.NEVER)
    # All robots begin at tick 0.
    timers[c.WAKE] = 0
    # Rows of exchanges and of trips: at most one for each bin, and one more for each robot.
    exchanges = program.bins + count
    return columns.Model(
        ops=program.ops.array,
        needs=program.needs.array,
        frees=program.frees.array,
        places=program.places.array,
        lines=program.lines.array,
        passes=program.passes.array,
        ends=program.ends,
        jobs=program.jobs,
        ways=program.ways,
        speeds=np.zeros(len(program.passes)),
        **draws(layout, [start.name for start in starts], NO_DRAWS, None),
        absences=_absences(layout, [start.name for start in starts]),
        robots=_robots(program, starts, bin_names),
        sets=np.zeros((c.SETS, count, program.places.words), np.uint64),
        scratch=np.zeros((2, program.places.words), np.uint64),
        rears=np.full((1, program.lines.most), c.NONE),
        bins=bins,
        calls=calls,
        offers=np.full((count, len(bins)), c.NEVER),
        distances=np.zeros((count, len(program.ends))),
        timers=timers,
        desk=_desk(layout, program),
        trailers=np.zeros(load_out.trailers.count or 0, columns.TRAILER).view(np.recarray),
        deliveries=np.zeros(program.bins, np.int64),
        exchanges=np.zeros(exchanges, columns.EXCHANGE).view(np.recarray),
        trips=np.zeros(exchanges, columns.TRIP).view(np.recarray),
        log=np.zeros(0, columns.LOG).view(np.recarray),
    )


def _absences(layout: Layout, names: Sequence[str]) -> Any:
    """Return when each robot is away, (r, most). A robot with fewer has some that never are."""
    of_robots = [absences_of(layout.scenario, name) for name in names]
    most = max(map(len, of_robots))
    absences = np.zeros((len(names), most), columns.ABSENCE).view(np.recarray)
    for robot, intervals in enumerate(of_robots):
        for number, (begin, end) in enumerate(intervals):
            absences[robot, number] = (begin, end)
    return absences


def _robots(program: Program, starts: Sequence[Start], bin_names: list[str]) -> Any:
    robots = np.zeros(len(starts), columns.ROBOT).view(np.recarray)
    for column in columns.INDICES:
        robots[column] = c.NONE
    robots.away = c.NEVER
    robots.answered = c.NEVER
    robots.claimed = -c.NEVER
    robots.leg_ended = -c.NEVER
    robots.swings_since = c.NEVER
    robots.charge = 1.0
    robots.parked = c.NEVER
    robots.emptied_next = c.NEVER
    for robot, start in zip(robots, starts, strict=True):
        kind = KINDS[start.kind]
        robot.x = start.pose.x
        robot.y = start.pose.y
        robot.length = kind.length
        robot.width = kind.width
        robot.tows = kind.tows
        robot.bin = bin_names.index(start.bin)
        if start.kind == "picker":
            robot.next_op = program.harvests[start.name]
        else:
            robot.is_free = True
            robot.queue_line = program.queue_line(start.name)
            robot.next_op = program.waiting[robot.queue_line]
    return robots


def _desk(layout: Layout, program: Program) -> Any:
    scenario = layout.scenario
    has_dispatcher = DISPATCH in scenario.bodiless_agents
    desk = np.zeros(1, columns.DESK).view(np.recarray)
    # Without a dispatcher the policy stays 0, BY_CALLS.
    if has_dispatcher:
        desk.policy = COMPILED.get(scenario.dispatch, c.IN_PYTHON)
    desk.asks_ways = program.has_own_measure
    # So long ago that it may ask at once. Half of it, so that sums with it stay within 64 bits.
    desk.asked = -c.NEVER // 2
    desk.horizon = program.horizon
    desk.mean_speed = scenario.mean_picking_speed
    desk.carrier_speed = layout.machines["carrier"].speed
    desk.carrier_turning = layout.machines["carrier"].turn / EIGHTH
    desk.exit = layout.queue.area.east
    desk.bay_west = layout.bay.west
    desk.bay_east = layout.bay.east
    desk.queue_west = layout.queue.area.west
    desk.queue_south = layout.queue.area.south
    desk.queue_north = layout.queue.area.north
    desk.head = layout.queue.head
    battery = scenario.carrying.battery
    desk.battery_hours = battery.hours or inf
    desk.seconds_to_charge = battery.hours_to_charge * 3600.0
    desk.standing = battery.standing
    desk.haul_charge = haul_charge(scenario, layout.machines["carrier"])
    desk.trailer_bins = scenario.load_out.trailers.bins or 0
    desk.trailer_ticks = layout.machines["carrier"].trailer_ticks
    desk.truck_ticks = layout.machines["carrier"].truck_ticks
    desk.truck_bins = scenario.load_out.truck.bins or 0
    desk.bays = scenario.bays
    desk.bay_bins = scenario.load_out.empty_bins or c.NONE
    desk.free_chargers = max(1, scenario.chargers)
    return desk
