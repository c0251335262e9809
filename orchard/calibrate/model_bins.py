"""The bins that a harvest of the event model would write into a log, with the same events as in a
user's log.

The same is measured in these bins as in those of the user. In the model the picking rate and the
speed are known. So it is known how much of a time is something else, such as a picker's way out of
its row, or a carrier that waits at the bay. See `orchard.calibrate.fit`.

The model notes in its log at which tick a robot begins each op. An op is a step of a robot, as the
event model has it (`orchard.event_model.codes`).
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from math import ceil
from statistics import fmean

import numpy as np

from orchard.calibrate.bins import LoggedBin
from orchard.discrete.harvest import Jam, picked_again
from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.picker_plans import SIDES
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.plans.jobs import TimedStep, timed_steps
from orchard.plans.routes import route_of
from orchard.plans.steps import DriveTo, TakeBin, Unload

# The day of all bins of a model: any day does.
DAY = date(2000, 1, 1)


def model_bins(scenario: Scenario) -> list[LoggedBin]:
    """Return the bins of a harvest in the order in which they are full.

    A bin that is part full at the end is left out. Raises Jam if the harvest does not end,
    and what `EventHarvest` raises.
    """
    harvest = EventHarvest(lay_out(scenario), is_logged=True).run()
    if not harvest.is_over:
        raise jam_of(harvest)
    return _bins_of(harvest)


def first_model_bins(scenario: Scenario, count: int) -> list[LoggedBin]:
    """Return so many bins, in the order in which they are full, of pickers that pick their rows
    again and again. Raises as `model_bins` does.
    """
    layout = lay_out(scenario)
    # So many rows that one picker could fill all of them.
    rows_each = ceil(count * scenario.chosen["metres_per_bin"] / layout.mean_length) + 1
    harvest = EventHarvest(picked_again(layout, rows_each), is_logged=True)
    # Some more than are wanted, so that most of the wanted ones are delivered too: at any time each
    # picker and each carrier may have a full bin that is not.
    enough = count + scenario.pickers + scenario.carrier_count
    harvest.run(lambda: harvest.delivered < enough)
    bins = _bins_of(harvest)
    if len(bins) < count:
        raise jam_of(harvest)
    return bins[:count]


def jam_of(harvest: EventHarvest) -> Jam:
    """Return why a harvest did not end."""
    return Jam(
        f"a harvest of the model stops at {harvest.delivered} bins: some robots wait for ever"
    )


def _bins_of(harvest: EventHarvest) -> list[LoggedBin]:
    """Return the bins that are full so far, in the order in which they were."""
    trips_of: dict[int, list[_Trip]] = {}
    for trip in sorted(_trips(harvest), key=lambda trip: trip.fetched):
        trips_of.setdefault(trip.row, []).append(trip)
    bins = []
    for picker, row, tick in _full_bins(harvest):
        # One bin of a row is full at a time, so the next trip to the row fetches it. Without one
        # the bin is not fetched yet.
        trip = _Trip(row)
        for later in trips_of.get(row, []):
            if later.fetched > tick:
                trip = later
                break
        bins.append(
            LoggedBin(
                picker=picker,
                row=str(row),
                carrier=trip.carrier,
                day=DAY,
                full=tick * TIME_STEP,
                fetched=_seconds(trip.fetched),
                unloaded=_seconds(trip.unloaded),
            )
        )
    return bins


def _seconds(tick: int) -> float | None:
    """Return the time of a tick, s; None for the tick NONE."""
    if tick == c.NONE:
        return None
    return tick * TIME_STEP


@dataclass(frozen=True)
class _Trip:
    """A carrier's way with the full bin of a row. Times in ticks; NONE: not yet."""

    row: int
    carrier: str = ""
    fetched: int = c.NONE
    unloaded: int = c.NONE


def _full_bins(harvest: EventHarvest) -> list[tuple[str, int, int]]:
    """Return the picker, the row (from 1) and the tick of each full bin, in the order of ticks."""
    model = harvest.model
    bins = []
    # Only the first `logged` entries of the array are in use.
    for entry in model.log[: model.desk[0].logged]:
        op = model.ops[entry.op]
        if op.kind == c.END_ROW:
            drive = model.passes[op.arg]
            if drive.leaves_bin and drive.is_full:
                picker = harvest.names[entry.robot]
                bins.append((picker, int(drive.row) + 1, int(entry.tick)))
    return bins


def _trips(harvest: EventHarvest) -> Iterator[_Trip]:
    """Yield the ways of carriers with full bins, of each carrier in their order."""
    model = harvest.model
    jobs = _jobs_in_order(harvest)
    log = model.log[: model.desk[0].logged]
    for robot, name in enumerate(harvest.names):
        own = log[log.robot == robot]
        kinds = model.ops.kind[own.op]
        # An op is done when the next one begins. The last one of the log goes on.
        unloads = np.flatnonzero(kinds[:-1] == c.UNLOAD)
        for number in np.flatnonzero(kinds[:-1] == c.TAKE_BIN):
            row = _row_of(int(own.op[number]), jobs)
            after = unloads[unloads > number]
            unloaded = c.NONE
            if len(after):
                unloaded = int(own.tick[after[0] + 1])
            yield _Trip(row, name, int(own.tick[number + 1]), unloaded)


def _jobs_in_order(harvest: EventHarvest) -> list[tuple[int, int]]:
    """Return the number of the first op of each job, and the job's row (from 1), in order.

    A job is made of ops when a carrier first needs it, so not all jobs have any.
    """
    jobs = []
    for of_line in harvest.program.jobs.tolist():
        for end, first in enumerate(of_line):
            if first != c.NONE:
                # Two ends a row, as `Program.end_number` counts them from 0.
                jobs.append((first, end // len(SIDES) + 1))
    return sorted(jobs)


def _row_of(op: int, jobs: Sequence[tuple[int, int]]) -> int:
    """Return the row of the job to which an op belongs. `jobs`: as `_jobs_in_order` has them."""
    number = bisect_right(jobs, op, key=lambda job: job[0])
    return jobs[number - 1][1]


def metres_to_bay(layout: Layout) -> dict[str, float]:
    """Return how far a carrier drives with a full bin to the bay: row -> m, the mean over its bins.

    The bins of a row may be fetched at either end.
    """
    route = route_of(layout)
    carrier = layout.machines["carrier"]
    metres: dict[str, list[float]] = {}
    for block in layout.blocks.values():
        for drive in layout.passes(block):
            if drive.leaves_bin:
                # Any carrier, picker and bin: the way is the same.
                job = route.fetch(1, drive.row, route.sides[drive.end], "", "")
                steps = list(timed_steps(job, route.queue.place(0), carrier))
                metres.setdefault(str(drive.row), []).append(_driven(steps))
    return {row: fmean(of_row) for row, of_row in metres.items()}


def _driven(job: Sequence[TimedStep]) -> float:
    """Return the metres that a carrier drives from the full bin to the bay."""
    metres = 0.0
    has_bin = False
    for timed in job:
        if isinstance(timed.step, TakeBin):
            has_bin = True
        elif isinstance(timed.step, Unload):
            break
        elif has_bin and isinstance(timed.step, DriveTo):
            metres += timed.speed * (timed.ends - timed.begins)
    return metres
