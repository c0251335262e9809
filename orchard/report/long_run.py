"""The long-run rate of an orchard, bins an hour, from a harvest of the event model that goes on.

`orchard study` asks for it. Pickers pick their rows again and again until enough is measured.
Terms: an exchange is the moment at which a picker gets an empty bin for a full one. A plan is what
a picker or a carrier does without traffic, with its times. A round of a picker is the fewest rows
after which it has the same rows before it again (`orchard.field.rounds`).

The rate is not a count of bins. A run ends somewhere, and a count has the bins that it happened to
fill by then: perhaps one more of a fast row, or one more at the nearer end of a row. So a count may
exceed the limit (`Bounds`) a little. Instead two ratios are measured, and the means of the limit
are multiplied by them.

1. How fast was each picker, as a share of its plan? Between two exchanges no picker needs less time
   than its plan takes for them on free roads. So over any exchanges the time by the plan is at most
   the time that passed. Their ratio, at most 1, times the picker's rate in the limit is its rate x.
   So the sum of all x is at most the limit of the pickers. Where the seed draws how fast rows are
   picked, the plan has the drawn times of the run's rows, and the limit has mean times.
2. How long was a carrier busy for a bin, as a multiple of its plan? No job takes less than its
   plan. That ratio, at least 1, times the mean time C of the picker's bins in the limit is the time
   d that a carrier needs for one bin. So the sum of all x * d is the number of carriers that are
   needed, and that is at most the number c of carriers. It may come out higher, because pickers are
   measured over different parts of the run, and one was served more in its part. Then all rates are
   lowered until the sum is c. Because d is at least C, the sum of all x * C is at most c. That is
   the limit of the carriers if pickers fill equally many bins. Chargers are treated in the same
   way, and so is the bay: there a bin takes at least the time between the two deliveries of the run
   that were closest together.

A job that begins before the measured part, or is not done at the run's end, does not count at all.
Every other one counts with all of its time.

The rate may still exceed the limit in two ways. Repairs are drawn, and the limit has their mean: in
a run with few repairs robots are faster. And pickers may fill unequal numbers of bins. If those
near the queue fill most of them, all together can fill more than by the mean of C. A policy that
serves the picker that has waited for longest does not do so where carriers have no time left. A
policy that goes to the nearest bin does: for it `Bounds` raises the limit as far as LEAST_SHARE
allows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, inf
from statistics import fmean

from orchard.discrete.harvest import DiscreteFigures, DiscreteHarvest, Jam
from orchard.event_model.results import Exchange
from orchard.field.layout import Layout
from orchard.field.rounds import Round, round_of
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.report.bounds import LEAST_SHARE, Bounds

# How long a run is: these numbers were chosen, as a compromise between accuracy and time. How sure
# a rate is, a study tells from several runs.
# Bins that the fastest picker fills at least.
LEAST_BINS = 24
# How often the picker with most rows picks all of its rows at least, if a row fills one bin; less
# often if it fills several.
LEAST_ROUNDS = 3
# How often each carrier charges at least in the measured part, on average.
CHARGES = 6.0
# Share of its time. For the number of charges a carrier counts as busy for at least this share: one
# that is less busy would need a very long run, and charges while it waits anyway.
LEAST_BUSY = 0.25
# Share of the bins, at a run's begin, that is not measured: robots begin in their places, not as in
# the middle of a harvest.
BEGINNING = 0.4


def long_run(
    layout: Layout,
    rows_each: int | None = None,
    bounds: Bounds | None = None,
    limit: Bounds | None = None,
) -> DiscreteFigures:
    """Let all pickers pick their rows again and again, and measure.

    `rows_each`: how many rows the fastest picker picks at least; None: as many as a good figure
    needs. `bounds`: of the layout, if they are computed already. `limit`: the limit whose means the
    rate has, as of the same orchard in which rows take their mean times; None: `bounds`.

    Raises ValueError as `DiscreteHarvest` does, and Jam if robots wait for each other. It raises
    Jam too if a policy leaves a picker out: the rate would be that of the others' rows.
    """
    bounds = bounds or Bounds(layout)
    limit = limit or bounds
    bin_metres = layout.scenario.bin_metres
    most_rows = max(len(block.rows) for block in layout.blocks.values())
    # Without `bin_metres` each row fills one bin.
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
    # The run was too short to say how often carriers charge. Do it again, long enough for CHARGES:
    # the first one says how long a row takes.
    busy = max(LEAST_BUSY, figures.carrier_utilisation)
    # From the begin of one charge to the begin of the next one.
    charge_seconds = (
        3600.0 * (1.0 - battery.reserve) * (battery.hours / busy + battery.hours_to_charge)
    )
    needed = ceil(least * CHARGES * charge_seconds * (1.0 - BEGINNING) / figures.sim_seconds)
    if needed <= least:
        return figures
    return _LongRun(layout, bounds, limit, needed).figures()


@dataclass(frozen=True)
class _PickerFigures:
    """The rate of a picker in its whole rounds, and the time that carriers need for a bin of it."""

    #: In bins/s, if carriers have the time for it.
    rate: float
    #: How long a carrier is busy with one bin, charging included.
    carrier_seconds: float
    #: How long a charger is busy with it.
    charger_seconds: float


class _LongRun:
    """A harvest in which pickers pick their rows again and again, until each has done whole
    rounds.
    """

    def __init__(self, layout: Layout, bounds: Bounds, limit: Bounds, least_rows: int) -> None:
        """`bounds`, `limit`: as in `long_run`. `least_rows`: how many rows the fastest picker picks
        at least.
        """
        self.layout = layout
        self.bounds = bounds
        self.limit = limit
        self.rounds = {name: round_of(layout, block) for name, block in layout.blocks.items()}
        self.least_rows = least_rows
        longest = max(whole.least_rows for whole in self.rounds.values())
        # The harvest must have so many rows that no picker is done before all have their rounds.
        # While the slowest picker picks the rows of its rounds, the fastest one picks more: by the
        # ratio of their times for a row, and by how much less often a picker may be served.
        seconds = [self._row_seconds(block) for block in layout.blocks.values()]
        rows_meanwhile = ceil(longest * max(seconds) / (LEAST_SHARE * min(seconds)))
        self.harvest = DiscreteHarvest(layout, _rounded_up(least_rows + rows_meanwhile))
        self.harvest.spread_charges()
        self.battery = layout.scenario.carrying.battery
        self.pickers = list(layout.blocks)
        # The bins that are filled while each picker picks one row.
        bins_a_row = 0.0
        for whole in self.rounds.values():
            bins_a_row += whole.bins / whole.rows
        # The index of the delivery from which on it is measured.
        self.first_bin = int(BEGINNING * least_rows * bins_a_row)

    def figures(self) -> DiscreteFigures:
        """Do the run, and return its figures. Raises Jam."""
        harvest = self.harvest.run(self._goes_on)
        is_measured = self._is_measured
        if not is_measured and self._picks:
            # The harvest stopped though it should go on: robots wait for each other.
            raise harvest.jam()
        self._demand_that_all_are_served()
        if not is_measured:
            # A picker was done with all its rows before another one had its rounds.
            raise Jam("some pickers fill too few bins for a rate: too few carriers come to them")
        since = self.since
        until = harvest.deliveries[-1]
        return DiscreteFigures(
            bins_per_hour=3600.0 * self._bins_a_second(),
            picker_waiting_seconds=harvest.picker_waiting_seconds(since, until),
            carrier_utilisation=harvest.carrier_utilisation(since, until),
            sim_seconds=until - since,
            # The delivery at `since` begins the time, and is not in it.
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
        """Whether the harvest is not long enough yet, and can still be."""
        return self._picks and not self._is_measured

    @property
    def _picks(self) -> bool:
        """Whether each picker still has rows to pick."""
        return all(self.harvest.share_done(name) < 1.0 for name in self.pickers)

    @property
    def _is_measured(self) -> bool:
        """Whether the fastest picker has done its least rows, and each one its whole rounds."""
        # Nothing is measured yet. To read all exchanges takes longer than to see that.
        if self.harvest.delivered <= self.first_bin:
            return False
        if not self._has_least_rows():
            return False
        # Finished or not: to count them is quicker than to read them.
        for name, count in self.harvest.exchange_counts(self.since).items():
            if not self.rounds[name].suffice(count):
                return False
        return all(map(self._has_rounds, self.pickers))

    def _has_least_rows(self) -> bool:
        """Whether a picker has filled as many bins as the least number of rows fills."""
        for name, count in self.harvest.exchange_counts().items():
            whole = self.rounds[name]
            if count >= self.least_rows * whole.bins / whole.rows:
                return True
        return False

    # -- the rate

    def _bins_a_second(self) -> float:
        """Return the rate of all pickers, bins/s, for which carriers, chargers and the bay have
        time.
        """
        scenario = self.layout.scenario
        rate = 0.0
        # How many carriers and chargers all pickers would keep busy at these rates.
        needed_carriers = 0.0
        needed_chargers = 0.0
        for name in self.pickers:
            figures = self._picker_figures(name)
            rate += figures.rate
            needed_carriers += figures.rate * figures.carrier_seconds
            needed_chargers += figures.rate * figures.charger_seconds
        loads = [
            needed_carriers / scenario.carrier_count,
            needed_chargers / max(1, scenario.chargers),
            rate * self._least_bay_seconds(),
            rate / self.limit.terms.get("trailers", inf),
            rate / self.limit.terms.get("truck", inf),
        ]
        # Each load is what these rates ask of a part of the orchard, as a share of what it can do.
        # Where one is above 1, the rates are lowered until the largest one is 1.
        return rate / max(1.0, *loads)

    def _least_bay_seconds(self) -> float:
        """Return the time for a bin in which the bay took bins fastest, s.

        `scenario.bays` bins may be unloaded together. So each delivery is compared with the one
        that many later.
        """
        deliveries = self.harvest.deliveries
        bays = self.layout.scenario.bays
        least = inf
        for before, after in zip(deliveries, deliveries[bays:], strict=False):
            least = min(least, (after - before) / bays)
        return least

    def _picker_figures(self, name: str) -> _PickerFigures:
        """Return what was measured in the last whole rounds of a picker. It must have done them."""
        whole = self.rounds[name]
        exchanges = self._measured(name)
        plan = self._plan(name, len(exchanges))
        to_charge = 3600.0 * self.battery.hours_to_charge
        run = _Needs()
        for exchange in exchanges:
            charging = exchange.battery_used * to_charge
            busy = (exchange.carrier_ticks or 0.0) * TIME_STEP
            # An exchange has the time of the run, so no seconds of the picker are added up.
            run.add(seconds=0.0, carrier_seconds=busy + charging, charger_seconds=charging)
            run.exchange(exchange.tick * TIME_STEP)
        limit = self.limit.of_pickers[name]
        # The first is at most 1, the others are at least 1: see the head of this module.
        share_of_plan = _ratio(whole, plan.exchanged, run.exchanged)
        multiple_of_job = _ratio(whole, run.carriers, plan.carriers)
        multiple_of_charge = 0.0
        if limit.charging:
            multiple_of_charge = _ratio(whole, run.chargers, plan.chargers)
        return _PickerFigures(
            rate=share_of_plan / limit.of_picker,
            carrier_seconds=multiple_of_job * (limit.cycle + limit.charging),
            charger_seconds=multiple_of_charge * limit.charging,
        )

    def _measured(self, name: str) -> list[Exchange]:
        """Return the finished exchanges of a picker in the measured part of the run."""
        measured = list[Exchange]()
        since = self.since
        for exchange in self._finished(name):
            if exchange.tick * TIME_STEP >= since:
                measured.append(exchange)
        return measured

    def _finished(self, name: str) -> list[Exchange]:
        """Return the exchanges of a picker before the first one whose carrier is still out."""
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
        """Return what the last `count` finished exchanges of a picker take by the plans."""
        # Exchanges are numbered from the harvest's begin, from 0.
        last = len(self._finished(name)) - 1
        first = last + 1 - count
        passes = self.layout.passes(self.harvest.layout.blocks[name])
        plan = _Needs()
        number = 0
        # A pass is one drive of a picker through a row. The plan of a pass depends on the next one.
        for current, after in pairwise((*passes, passes[0])):
            if number >= first:
                times = self.bounds.pass_times.of(current, after)
                plan.add(
                    seconds=times.of_picker,
                    carrier_seconds=times.cycle + times.charging,
                    charger_seconds=times.charging,
                )
            if current.leaves_bin:
                if number >= first:
                    # A pass ends at the head of the next row, so its exchange was earlier.
                    plan.exchange(-self.bounds.pass_times.going_on(current, after))
                number += 1
            if number > last:
                break
        return plan

    # -- whether it is a rate of all pickers

    def _demand_that_all_are_served(self) -> None:
        """Raise Jam if a picker did less than LEAST_SHARE of what another one did.

        It counts as served if its share of its rows or its time at work is large enough: a picker
        of slow rows does fewer rows in the same time.
        """
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
        share, least_served = min(shares)
        if share < LEAST_SHARE:
            raise Jam(
                f"{least_served} has done {100.0 * share:.0f} % of its rows when another picker has"
                " done all: too few carriers come to it"
            )

    def _row_seconds(self, block: Block) -> float:
        """Return the mean time that picking a row of a block takes, s."""
        return fmean(
            self.layout.picking_seconds(row, self.layout.lane(row).length) for row in block.rows
        )


def _rounded_up(rows: int) -> int:
    """Return at least as many rows, at most a fourth more.

    Seeds draw how fast rows are, and so need unlike numbers of them. With the same number they
    share the program of the event model.
    """
    step = 1 << max(0, rows.bit_length() - 3)
    return step * ceil(rows / step)


@dataclass
class _Needs:
    """The time that a picker needs for its bins, and that carriers and chargers need for them.

    Each list has one value for each exchange, s: the sum from the first counted pass, or exchange,
    up to this exchange.
    """

    #: When the picker gets the empty bin.
    exchanged: list[float] = field(default_factory=list)
    #: How long carriers are busy.
    carriers: list[float] = field(default_factory=list)
    #: How long they charge, as a part of that.
    chargers: list[float] = field(default_factory=list)
    _seconds: float = 0.0
    _carrier_seconds: float = 0.0
    _charger_seconds: float = 0.0

    def add(self, seconds: float, carrier_seconds: float, charger_seconds: float) -> None:
        """Count the times of a pass through a row, or of an exchange, s."""
        self._seconds += seconds
        self._carrier_seconds += carrier_seconds
        self._charger_seconds += charger_seconds

    def exchange(self, later: float) -> None:
        """End a bin, with an exchange that is so much later than all that was counted, s."""
        self.exchanged.append(self._seconds + later)
        self.carriers.append(self._carrier_seconds)
        self.chargers.append(self._charger_seconds)


def _ratio(whole: Round, seconds: Sequence[float], others: Sequence[float]) -> float:
    """Return the ratio of `seconds` to `others` over the same whole rounds.

    Both have a value for each exchange, as in `_Needs`, and enough exchanges for whole rounds.
    """
    bins_a_second = whole.rate(seconds)
    bins_in_others = whole.rate(others)
    assert bins_a_second is not None and bins_in_others is not None
    # Bins for each second: the longer time has the smaller rate.
    return bins_in_others / bins_a_second
