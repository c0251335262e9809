"""How well a harvest could go without traffic: the rate that each part of an orchard allows in the
long run, and the length of one harvest.

The rates, bins/s, follow from geometry and speeds alone: docs/bounds.md derives them. Parts are
pickers, carriers, unloading in the bay, chargers, trailers and the truck.

The length is that of a harvest of the event model in which each robot has the roads to itself
(`schedule_seconds`). In place of a policy of the user's own it takes `nearest`. In place of a route
with steps of the user's own it takes the built-in route with the same queue. Another policy may be
faster: `proven_seconds` is the time that no policy can beat.

A pass is one drive of a picker through a row (`orchard.field.passes`).
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from math import ceil, inf
from statistics import fmean
from typing import TYPE_CHECKING

from orchard.dispatch.policies import POLICIES, dispatch_of
from orchard.dispatch.policy import prefers_near
from orchard.field.kinds import kind_of
from orchard.field.layout import KEPT_LAYOUTS, Layout, lay_out
from orchard.field.queue import CLOSED_UP
from orchard.field.rows import Block
from orchard.field.scenario import NEAREST, TIME_STEP, Scenario
from orchard.plans.jobs import least_headway
from orchard.plans.routes import route_of
from orchard.plans.steps import Unload
from orchard.report.pass_times import BinTimes, PassTimes

if TYPE_CHECKING:
    from orchard.event_model.harvest import EventHarvest

# For the mean times of a bin a picker picks its rows this many times, or a multiple of it. After an
# odd number of passes it begins the second time at the other end; after two times all is as at
# first.
ROUNDS = 2
# Bins that a picker fills at least in that time, where a bin does not fill in one row: a part-full
# bin at the end is left out, and must count for little.
FULL_BINS = 10
# In a long run a picker must fill at least this share of the bins that any other one fills. A rate
# of fewer pickers would not be the orchard's. Chosen.
LEAST_SHARE = 0.5
# How much work the solver may do for a proof, in its own unit: at most about half a second.
PROOF = 0.1


class Bounds:
    """The rates that the parts of one orchard allow, where each picker picks its rows again and
    again.

    `terms`: part -> bins/s. `of_pickers`: picker -> mean times of its bins. The attributes with
    `_seconds` are means over all pickers, s; docs/bounds.md has their symbols.
    """

    def __init__(self, layout: Layout) -> None:
        scenario = layout.scenario
        policy = dispatch_of(layout)
        self.pass_times = PassTimes(layout)
        of_each = [_of_a_bin(layout, block, self.pass_times) for block in layout.blocks.values()]
        self.of_pickers = dict(zip(layout.blocks, of_each, strict=True))
        # Each picker counts as if it delivered as many bins as the others. A field of `means` is
        # the mean of that field over the pickers.
        means = BinTimes(*map(fmean, zip(*of_each, strict=True)))
        self.picking_seconds = means.picking
        self.crossing_seconds = means.crossing
        self.row_end_seconds = means.row_end
        self.wait_seconds = means.waiting
        self.bin_seconds = means.of_picker
        self.cycle_seconds = means.cycle
        carrier = layout.machines["carrier"]
        # t_bay: unloading, and then moving up. Carriers on all places of the bay unload together,
        # so a bin takes its share of that. Then the next ones move up, each for its bin.
        moving_up = least_headway(carrier) / carrier.speed
        self.bay_seconds = Unload().ticks(carrier) * TIME_STEP / scenario.bays + moving_up
        busy = means.cycle + means.charging
        charged = means.charging
        if prefers_near(policy):
            busy = _mean_of_near(times.cycle + times.charging for times in of_each)
            charged = _mean_of_near(times.charging for times in of_each)
        self.terms = {
            # Each picker works at its own rate.
            "pickers": sum(1.0 / times.of_picker for times in of_each),
            "carriers": scenario.carrier_count / busy,
            "unloading": 1.0 / self.bay_seconds,
        }
        if means.charging:
            self.terms["chargers"] = scenario.chargers / charged
        self.terms |= _terms_of_load_out(layout)

    @property
    def row_end_share(self) -> float:
        """The share of a picker's time that bins cost because they fill inside rows, 0 to 1."""
        return self.row_end_seconds / self.bin_seconds

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The bins per hour that all parts allow together, without traffic: the least of them."""
        return 3600.0 * min(self.terms.values())


def _terms_of_load_out(layout: Layout) -> dict[str, float]:
    """Return the bins/s that trailers, or the truck, allow in the long run, by their names."""
    load_out = layout.scenario.load_out
    carrier = layout.machines["carrier"]
    terms = {}
    if load_out.trailers.count is not None and load_out.trailers.bins is not None:
        bins = load_out.trailers.bins
        # A bin goes onto a trailer only while the bay has an empty bin to give for it. So that
        # limits how many trailers can be away together, and how many bins can already be put on a
        # further one meanwhile.
        away = load_out.trailers.count
        early = 0
        if load_out.empty_bins is not None and load_out.empty_bins < away * bins:
            away = load_out.empty_bins // bins
            early = load_out.empty_bins % bins
        # Bins are put on a trailer one after another, or as many together as the bay unloads.
        together = min(layout.scenario.bays, bins)
        ticks = carrier.trailer_ticks + (bins - early) * carrier.unloading_ticks / together
        terms["trailers"] = away * bins / (ticks * TIME_STEP)
    if load_out.truck.bins is not None:
        terms["truck"] = load_out.truck.bins / (carrier.truck_ticks * TIME_STEP)
    return terms


def load_out_seconds(layout: Layout, bins: float) -> dict[str, float]:
    """Return how long trailers, or the truck, let a harvest of so many bins take at least, s.

    Bins for which the bay has empty ones at first need neither: a short harvest may be faster than
    the long run.
    """
    load_out = layout.scenario.load_out
    beyond = max(0.0, bins - (load_out.empty_bins or 0))
    seconds = {}
    for name, rate in _terms_of_load_out(layout).items():
        seconds[name] = beyond / rate
        if load_out.truck.bins is not None:
            comes = ceil(beyond / load_out.truck.bins)
            seconds[name] = comes * layout.machines["carrier"].truck_ticks * TIME_STEP
    return seconds


def _mean_of_near(work: Iterable[float]) -> float:
    """Return the least mean time for a bin, s, if some pickers fill only `LEAST_SHARE` of what
    others do.

    `work`: of each picker the mean time for a bin, s. A policy that prefers near bins may serve the
    pickers less of which the bins take longest, down to that share.
    """
    nearest_first = sorted(work)
    # At first all pickers fill that share of a bin. Then one after another, from the nearest one
    # on, fills a whole one. The least mean of all these cases counts.
    seconds = LEAST_SHARE * sum(nearest_first)
    bins = LEAST_SHARE * len(nearest_first)
    least = inf
    for each in nearest_first:
        seconds += (1.0 - LEAST_SHARE) * each
        bins += 1.0 - LEAST_SHARE
        least = min(least, seconds / bins)
    return least


def _of_a_bin(layout: Layout, block: Block, pass_times: PassTimes) -> BinTimes:
    """Return the mean times of a picker's bin without traffic. A part-full last bin does not
    count.
    """
    metres = sum(layout.lane(row).length for row in block.rows)
    # So often as FULL_BINS need, at least once. Where each row fills a bin, no metres are needed.
    metres_needed = FULL_BINS * (layout.scenario.bin_metres or 0.0)
    repeats = max(1, ceil(metres_needed / (ROUNDS * metres)))
    passes = layout.passes(replace(block, rows=block.rows * ROUNDS * repeats))
    while not passes[-1].is_full:
        passes.pop()
    bins = sum(current.is_full for current in passes)
    following = (*passes[1:], passes[0])
    times = list(map(pass_times.of, passes, following))
    # Field by field: the sum over the passes, for each bin.
    return BinTimes(*(sum(seconds) / bins for seconds in zip(*times, strict=True)))


def undisturbed(scenario: Scenario, **changes: object) -> Scenario:
    """Return a scenario without people, animals, tractor and errors of sensors, and with other
    changes.
    """
    nothing = {
        "people": {"workers": 0, "visitors": 0},
        "animals": {"dogs": 0, "cats": 0},
        "tractor": False,
        "sensors": {},
    }
    return Scenario(**scenario.model_dump() | nothing | changes)


def schedule_seconds(layout: Layout) -> float:
    """Return the time of the harvest with roads that each robot has to itself, s."""
    return seconds_on_free_roads(ideal_of(layout))


def ideal_of(layout: Layout) -> Layout:
    """Return the layout without all that disturbs, and with built-in rules where those of the user
    are not known to the event model.
    """
    scenario = layout.scenario
    dispatch = scenario.dispatch
    if dispatch not in POLICIES:
        dispatch = NEAREST
    route = route_of(layout)
    known_route = scenario.route
    if route.Steps:
        known_route = route.QUEUE
    return lay_out(
        undisturbed(
            scenario, agents={}, agents_without_body={}, dispatch=dispatch, route=known_route
        )
    )


def harvested(layout: Layout, free_roads: bool = False) -> "EventHarvest":
    """Do a harvest in the event model, and return it."""
    # These modules load numba, which takes a second. The limits alone need none of it.
    from orchard.event_model.harvest import EventHarvest
    from orchard.event_model.plain import machine_at_hand

    harvest = EventHarvest(layout, free_roads=free_roads, carry_on=machine_at_hand())
    return harvest.run()


def seconds_on_free_roads(ideal: Layout) -> float:
    """Return the time of a harvest in which each robot has the roads to itself, s: until all robots
    stand in their places, and all trailers are back.

    `ideal`: as `ideal_of` returns it.
    """
    harvest = harvested(ideal, free_roads=True)
    stood = {"picker": 0.0, "carrier": 0.0}
    for name, since in harvest.stood.items():
        stood[kind_of(name)] = max(stood[kind_of(name)], since)
    # With all roads to itself each carrier drove to the head of its line. In truth it stops behind
    # the others there, so the last one drives less far.
    before = min(ideal.scenario.carrier_count, ideal.queue.places) - 1
    metres = before * CLOSED_UP
    parked = stood["carrier"] - metres / ideal.machines["carrier"].speed
    return max(stood["picker"], parked, harvest.trailers_back)


def proven_seconds(layout: Layout) -> float | None:
    """Return the time below which it is proven that no harvest without traffic can be, s.

    None if the extra `optimum` is missing, and for agents, steps and some routes of the user's own.
    """
    return _proven(_of_any_policy(layout))


def proven_seconds_if_present(layout: Layout) -> float | None:
    """Return the same if no picker were ever away, and each had the same rows."""
    return _proven(with_nobody_away(_of_any_policy(layout)))


def _of_any_policy(layout: Layout) -> Layout:
    """Return the layout of a proof, which is the same for each policy. With one name for all it is
    kept once.
    """
    return lay_out(undisturbed(layout.scenario, dispatch=NEAREST))


def with_nobody_away(layout: Layout) -> Layout:
    """Return the same layout, with the same rows for each picker, without absences of pickers."""
    present = layout.scenario.model_copy(update={"picker_absences": {}})
    return replace(layout, scenario=present)


@lru_cache(maxsize=KEPT_LAYOUTS)
def _proven(layout: Layout) -> float | None:
    try:
        # OR-tools is in an extra, and takes half a second to load.
        from orchard.optimum.schedule import optimum
    except ModuleNotFoundError:
        return None
    try:
        return optimum(layout, PROOF, free_roads=True).proven_seconds
    except ValueError:  # NoBound, or a route of the user's own on which robots take no turns
        return None
