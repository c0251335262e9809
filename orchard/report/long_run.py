"""The long run of the fast model: a harvest that goes on, beside what it could be without traffic.

A run ends, and its figures are those of the bins that it happened to fill: one more of a fast row,
or at the nearer end of a row. So a plain count of bins may exceed any limit a little. The run is
therefore asked for two shares only, and the limit's own means, which `Bounds` has, do the rest.

1. How fast was each picker, as a share of its plan? Between two exchanges no picker needs less time
   than its plan takes for them on free roads. So over any exchanges the time by the plan is at most
   the time that passed. Their ratio, at most 1, times the picker's rate in the limit is its rate x.
   So the sum of all x is at most the limit of the pickers. Where the seed draws how fast rows are
   picked, the plan is that of its own rows, and the limit that of rows which take their mean times.
2. How long was a carrier busy for a bin, as a multiple of its plan? No job takes less than its
   plan. That ratio, at least 1, times the mean time C of the picker's bins in the limit is the time
   d that a carrier needs for one. All carriers together have the time of c carriers, so the sum of
   all x * d is at most c. Where the windows of pickers are of different times, it may come out
   higher: some pickers were served in the one part of the run, and others in the other. Then all
   rates are lowered until carriers have as much to do as they can. So the sum of all x * C is at
   most c, which is the limit of the carriers if pickers fill as many bins each. The same holds for
   chargers, and for the bay, at which bins came at least as far apart as the two closest ones.

So no job that is cut by the begin or the end of a run counts for more than it is: a job counts
whole, with all of its time, or not at all.

Three things are beyond this argument. Repairs are drawn, and the limit has their mean: in a run
with few of them robots are faster. If pickers fill unequal numbers of bins, those near the queue
most of them, all could fill more than by the mean of C. A policy that serves the picker that has
waited for longest does not do so where carriers have no time left. A policy that goes to the
nearest bin does: there `Bounds` counts as much more as a long run allows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, inf
from statistics import fmean

from orchard.discrete.harvest import DiscreteFigures, DiscreteHarvest, Jam
from orchard.event_model.results import Exchange
from orchard.field.layout import Layout
from orchard.field.passes import Pass
from orchard.field.rounds import Round, round_of
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.plans.jobs import begin_of
from orchard.plans.route import OneWay
from orchard.plans.routes import route_of
from orchard.plans.steps import FetchEmpty
from orchard.report.bounds import LEAST_SHARE, Bounds, plan_of_pass

# Bins that each picker fills at least.
LEAST_BINS = 24
# How often those with most rows pick theirs, if each fills a bin.
LEAST_ROUNDS = 3
# That each carrier charges, by the mean, if it is busy for that share; others charge while they
# wait.
CHARGES = 6.0
LEAST_BUSY = 0.25
# Share of the bins that is left out.
BEGINNING = 0.4


def long_run(
    layout: Layout,
    rows_each: int | None = None,
    bounds: Bounds | None = None,
    limit: Bounds | None = None,
) -> DiscreteFigures:
    """Let all pickers pick their rows again and again, and measure.

    `rows_each`: how many rows each picker picks at least; None: as many as a good figure needs.
    `bounds`: those of the layout, if they are known already. `limit`: that of the same orchard, for
    which the rate is told, such as one in which rows take their mean times; None: `bounds`.
    Raises ValueError as `DiscreteHarvest` does, and Jam. It raises Jam too if a policy leaves a
    picker out: the rate would be that of the others' rows.
    """
    bounds = bounds or Bounds(layout)
    limit = limit or bounds
    bin_metres = layout.scenario.bin_metres
    most_rows = max(len(block.rows) for block in layout.blocks.values())
    bins_a_row = 1.0
    if bin_metres:
        bins_a_row = layout.mean_length / bin_metres
    rows_for_bins = ceil(LEAST_BINS / bins_a_row)
    rows_for_rounds = ceil(LEAST_ROUNDS / max(1.0, bins_a_row)) * most_rows
    least = rows_each or max(rows_for_bins, rows_for_rounds)
    run = _LongRun(layout, bounds, limit, least)
    figures = run.figures()
    battery = run.battery
    if rows_each or not battery.hours:
        return figures
    busy = max(LEAST_BUSY, figures.carrier_utilisation)
    # From one charge to the next.
    charge_seconds = (
        3600.0 * (1.0 - battery.reserve) * (battery.hours / busy + battery.hours_to_charge)
    )
    needed = ceil(least * CHARGES * charge_seconds * (1.0 - BEGINNING) / figures.sim_seconds)
    if needed <= least:
        return figures
    return _LongRun(layout, bounds, limit, needed).figures()


@dataclass(frozen=True)
class _PickerFigures:
    """What the whole rounds of a picker tell."""

    rate: float  #: bins/s, if carriers have the time for it
    carrier_seconds: float  #: for which a carrier is busy for one bin, charging included
    charger_seconds: float  #: of it, for which it charges


class _LongRun:
    """A harvest in which pickers pick their rows again and again, until each has done whole
    rounds.
    """

    def __init__(self, layout: Layout, bounds: Bounds, limit: Bounds, least_rows: int) -> None:
        """`bounds`: those of the layout; `limit`: that for which the rate is told. `least_rows`:
        that the fastest picker picks at least.
        """
        self.layout = layout
        self.bounds = bounds
        self.limit = limit
        self.rounds = {name: round_of(layout, block) for name, block in layout.blocks.items()}
        self.least_rows = least_rows
        longest = max(whole.least_rows for whole in self.rounds.values())
        # A picker of slow rows needs longer for its rounds, and the others go on until then.
        seconds = [self._row_seconds(block) for block in layout.blocks.values()]
        others_rows = ceil(longest * max(seconds) / (LEAST_SHARE * min(seconds)))
        self.harvest = DiscreteHarvest(layout, least_rows + others_rows)
        self.harvest.spread_charges()
        self.battery = layout.scenario.carrying.battery
        self.pickers = list(layout.blocks)
        bins_a_row = 0.0
        for whole in self.rounds.values():
            bins_a_row += whole.bins / whole.rows
        # The bins of the beginning are left out.
        self.first_bin = int(BEGINNING * least_rows * bins_a_row)

    def figures(self) -> DiscreteFigures:
        """Do the run, and return its figures. Raises Jam."""
        harvest = self.harvest.run(self._goes_on)
        is_measured = self._is_measured
        if not is_measured and self._picks:
            raise harvest.jam()
        self._demand_that_all_are_served()
        if not is_measured:
            raise Jam("some pickers fill too few bins for a rate: too few carriers come to them")
        since = self.since
        until = harvest.deliveries[-1]
        return DiscreteFigures(
            bins_per_hour=3600.0 * self._bins_a_second(),
            picker_waiting_seconds=harvest.picker_waiting_seconds(since, until),
            carrier_utilisation=harvest.carrier_utilisation(since, until),
            sim_seconds=until - since,
            bins=harvest.delivered - self.first_bin - 1,
        )

    @property
    def since(self) -> float:
        """The time from which on the harvest is measured, s; infinity if it is not yet."""
        deliveries = self.harvest.deliveries
        if len(deliveries) <= self.first_bin:
            return inf
        return deliveries[self.first_bin]

    def _goes_on(self) -> bool:
        return self._picks and not self._is_measured

    @property
    def _picks(self) -> bool:
        """Whether no picker is done yet."""
        return all(self.harvest.share_done(name) < 1.0 for name in self.pickers)

    @property
    def _is_measured(self) -> bool:
        """Whether the fastest picker has done its least rows, and each one its whole rounds."""
        return any(map(self._has_least_rows, self.pickers)) and all(
            map(self._has_rounds, self.pickers)
        )

    def _has_least_rows(self, name: str) -> bool:
        """Whether a picker has done its least rows."""
        whole = self.rounds[name]
        least_bins = self.least_rows * whole.bins / whole.rows
        return len(self.harvest.exchanges[name]) >= least_bins

    # -- the rate

    def _bins_a_second(self) -> float:
        """Return the rate of all pickers, bins/s, for which carriers, chargers and the bay have
        time.
        """
        scenario = self.layout.scenario
        rate = 0.0
        carriers = 0.0
        chargers = 0.0
        for name in self.pickers:
            figures = self._picker_figures(name)
            rate += figures.rate
            carriers += figures.rate * figures.carrier_seconds
            chargers += figures.rate * figures.charger_seconds
        closest = inf
        deliveries = self.harvest.deliveries
        bays = scenario.bays
        for before, after in zip(deliveries, deliveries[bays:], strict=False):
            closest = min(closest, (after - before) / bays)
        # How many times as much as each part can do these rates ask for.
        excess = [
            carriers / scenario.carrier_count,
            chargers / max(1, scenario.chargers),
            rate * closest,
            rate / self.limit.terms.get("trailers", inf),
            rate / self.limit.terms.get("truck", inf),
        ]
        return rate / max(1.0, *excess)

    def _picker_figures(self, name: str) -> _PickerFigures:
        """Return what the last whole rounds of a picker tell, which it must have done."""
        whole = self.rounds[name]
        exchanges = self._measured(name)
        plan = self._plan(name, len(exchanges))
        to_charge = 3600.0 * self.battery.hours_to_charge
        run = _Needs()
        for exchange in exchanges:
            charging = exchange.battery_used * to_charge
            busy = (exchange.carrier_ticks or 0.0) * TIME_STEP
            run.add(0.0, busy + charging, charging)
            run.exchange(exchange.tick * TIME_STEP)
        limit = self.limit.of_pickers[name]
        share = _ratio(whole, plan.exchanged, run.exchanged)
        carriers = _ratio(whole, run.carriers, plan.carriers)
        chargers = 0.0
        if limit.charging:
            chargers = _ratio(whole, run.chargers, plan.chargers)
        return _PickerFigures(
            rate=share / (limit.picking + limit.crossing + limit.waiting),
            carrier_seconds=carriers * (limit.cycle + limit.charging),
            charger_seconds=chargers * limit.charging,
        )

    def _measured(self, name: str) -> list[Exchange]:
        """Return the exchanges of a picker since the beginning, up to the first unfinished job."""
        measured = list[Exchange]()
        since = self.since
        for exchange in self._finished(name):
            if exchange.tick * TIME_STEP >= since:
                measured.append(exchange)
        return measured

    def _finished(self, name: str) -> list[Exchange]:
        """Return the exchanges of a picker up to the first one of which the carrier is
        still out.
        """
        finished = list[Exchange]()
        for exchange in self.harvest.exchanges[name]:
            if exchange.carrier_ticks is None:
                break
            finished.append(exchange)
        return finished

    def _has_rounds(self, name: str) -> bool:
        """Whether the rounds suffice that a picker has done."""
        return self.rounds[name].suffice(len(self._measured(name)))

    def _plan(self, name: str, count: int) -> "_Needs":
        """Return what the plans say of the last finished exchanges of a picker, so many of them."""
        last = len(self._finished(name)) - 1
        first = last + 1 - count
        passes = self.layout.passes(self.harvest.layout.blocks[name])
        route = route_of(self.layout)
        plan = _Needs()
        number = 0
        for current, after in pairwise((*passes, passes[0])):
            if number >= first:
                times = self.bounds.pass_times(current, after)
                plan.add(
                    seconds=times.picking + times.crossing + times.waiting,
                    carrier_seconds=times.cycle + times.charging,
                    charger_seconds=times.charging,
                )
            if current.leaves_bin:
                if number >= first:
                    plan.exchange(-_going_on(route, current, after))
                number += 1
            if number > last:
                break
        return plan

    # -- whether it is a rate of all pickers

    def _demand_that_all_are_served(self) -> None:
        """Raise Jam if a picker did far less than the others, by its rows and by its work."""
        done = {}
        work = {}
        for name in self.pickers:
            done[name] = self.harvest.share_done(name)
            work[name] = done[name] * self._row_seconds(self.layout.blocks[name])
        most_done = max(done.values())
        most_work = max(work.values())
        shares = []
        for name in self.pickers:
            shares.append((max(done[name] / most_done, work[name] / most_work), name))
        share, last = min(shares)
        if share < LEAST_SHARE:
            raise Jam(
                f"{last} has done {100.0 * share:.0f} % of its rows when another picker has"
                " done all: too few carriers come to it"
            )

    def _row_seconds(self, block: Block) -> float:
        """Return the mean time that picking a row of a block takes, s."""
        return fmean(
            self.layout.picking_seconds(row, self.layout.lane(row).length) for row in block.rows
        )


@dataclass
class _Needs:
    """What a picker needs for its bins, and what carriers and chargers do for it, cumulated, s.

    Each list has one time for each exchange.
    """

    exchanged: list[float] = field(default_factory=list)  #: when the picker has the empty bin
    carriers: list[float] = field(default_factory=list)  #: for which carriers are busy
    chargers: list[float] = field(default_factory=list)  #: of it, for which they charge
    _seconds: float = 0.0
    _carrier_seconds: float = 0.0
    _charger_seconds: float = 0.0

    def add(self, seconds: float, carrier_seconds: float, charger_seconds: float) -> None:
        """Count the times of a pass through a row, or of an exchange."""
        self._seconds += seconds
        self._carrier_seconds += carrier_seconds
        self._charger_seconds += charger_seconds

    def exchange(self, later: float) -> None:
        """End a bin, with an exchange that is so much later than all that was counted, s."""
        self.exchanged.append(self._seconds + later)
        self.carriers.append(self._carrier_seconds)
        self.chargers.append(self._charger_seconds)


def _going_on(route: OneWay, current: Pass, after: Pass) -> float:
    """Return for how long a picker drives after an exchange to the head of its next row, s."""
    plan = plan_of_pass(route, current, after)
    return plan[-1].ends - begin_of(FetchEmpty, plan)


def _ratio(whole: Round, seconds: Sequence[float], others: Sequence[float]) -> float:
    """Return the ratio of two times over the same whole rounds. Both are cumulated, by exchange."""
    rate = whole.rate(seconds)
    other_rate = whole.rate(others)
    assert rate is not None and other_rate is not None
    return other_rate / rate
