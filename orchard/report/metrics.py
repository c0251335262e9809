"""Figures of a harvest, from events and states: how good it is, and whether it still makes
progress.

A run (the physics process, or a run in one process) updates `HarvestFigures` and `History` at each
tick, and asks `harvest_figures` for the part of its summary that a repetition would have too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from orchard.contract.agent import STATES, WAITING_STATES, Action
from orchard.contract.events import Event
from orchard.field.kinds import ANIMALS, DISPATCH, HAULERS, PEOPLE, ROBOTS, kind_of
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.scenario import TIME_STEP
from orchard.report.bounds import Bounds, schedule_seconds
from orchard.report.days import work_days
from orchard.report.limits import delivered_full_bins
from orchard.sim import physics
from orchard.sim.state_times import StateTimes
from orchard.sim.world import World

# A run is jammed if for this many simulated seconds no metre was picked and no step of work was
# finished. The longest step is a carrier's drive home past all rows: 300 s in an orchard of
# JAM_METRES from north to south, at JAM_SPEED in m/s. In a longer orchard, or with slower robots, a
# run is jammed later, in proportion.
JAM_SECONDS = 600.0
JAM_METRES = 300.0
JAM_SPEED = 1.0


@dataclass
class HarvestFigures:
    """The figures of a run, updated at each tick. All of it is plain data, for snapshots."""

    #: For each bin that was exchanged: s for which the picker stood before it coupled an empty bin,
    #: since the moment at which its bin was full and it last moved.
    waits: list[float] = field(default_factory=list)
    #: Picker that has filled its bin -> tick since which it stands, or at which the bin was full.
    waiting_since: dict[str, int] = field(default_factory=dict)
    #: Ticks of all carriers together: so many at each tick as there are carriers.
    carrier_ticks: int = 0
    #: Of these, outside the queue, or away at the load-out.
    busy_ticks: int = 0
    #: Of these, at a charger; and with a flat battery.
    charging_ticks: int = 0
    flat_ticks: int = 0
    #: In which a full bin stood in the bay, and the bay could not take it.
    bay_waiting_ticks: int = 0
    weeds_flattened: int = 0
    #: Agent -> tick at which it first was broken.
    broken: dict[str, int] = field(default_factory=dict)
    #: Decisions of the dispatch policy that the dispatcher refused, as they could not be carried
    #: out.
    orders_refused: int = 0
    #: Picker or carrier -> steps of its plan that it has finished.
    steps: dict[str, int] = field(default_factory=dict)
    #: Tick of the last progress: something was picked, a step of work was done, a battery was
    #: charged, a carrier was away at the load-out, or a robot was stopped.
    progress_tick: int = 0

    def update(
        self, world: World, events: list[Event], answers: Mapping[str, Action | None]
    ) -> None:
        """Account for the tick that has just ended. `answers`: of the agents that were asked."""
        for event in events:
            self._count(event)
        # A wait begins anew as long as the picker still moves.
        for name in self.waiting_since:
            if world.twist[world.layout.index[name]].any():
                self.waiting_since[name] = world.tick
        for name, action in answers.items():
            if action is not None and action.state == "broken":
                # The answer was given before the tick was counted.
                self.broken.setdefault(name, world.tick - 1)
        queue = world.layout.queue.area
        self.carrier_ticks += len(world.fixed.carriers)
        carriers = world.fixed.carriers
        are_hauling = (world.hauling[carriers] > 0).tolist()
        for (x, y, _), is_hauling in zip(world.pose[carriers].tolist(), are_hauling, strict=True):
            self.busy_ticks += is_hauling or not queue.contains(x, y)
        if world.layout.first_charging:
            self.charging_ticks += int(np.count_nonzero(world.plugged))
            self.flat_ticks += int(np.count_nonzero(world.charge <= 0.0))
        self.bay_waiting_ticks += physics.keeps_a_bin_waiting(world)
        self.watch(world, answers)

    def watch(self, world: World, answers: Mapping[str, Action | None]) -> None:
        """Account for what decides whether a run goes on at a tick: progress, and orders refused.

        A program that needs no other figure calls this in place of `update`. `answers`: as there.
        """
        self.orders_refused += orders_refused(answers)
        has_progress = world.has_picked or world.is_any_stopped or world.is_any_plugged
        has_progress |= physics.is_anything_coming(world)
        for name, action in answers.items():
            # An agent that gave no action has done no step.
            if action is None or action.steps_done == self.steps.get(name, 0):
                continue
            # Only steps of pickers and carriers are progress. A bin counts messages in the same
            # field, and an agent of the user's own may count anything.
            if kind_of(name) in HAULERS:
                self.steps[name] = action.steps_done
                has_progress = True
        if has_progress:
            self.progress_tick = world.tick

    def watched(self) -> dict[str, Any]:
        """Return what `watch` keeps, as plain data for a snapshot."""
        return {
            "orders_refused": self.orders_refused,
            "steps": dict(self.steps),
            "progress_tick": self.progress_tick,
        }

    def _count(self, event: Event) -> None:
        """Account for an event: pickers that begin and end to wait, and weeds."""
        if event.what == "bin full":
            self.waiting_since[event.whom] = event.tick
        elif event.what == "coupled" and event.who in self.waiting_since:
            self.waits.append((event.tick - self.waiting_since.pop(event.who)) * TIME_STEP)
        elif event.what == "weed flattened":
            self.weeds_flattened += 1

    def jammed(self, world: World) -> bool:
        """Whether there was no progress for JAM_SECONDS, longer in large orchards."""
        return self._has_stood(world, 1)

    def stuck(self, world: World) -> bool:
        """Whether there was no progress for twice the time after which a run is jammed."""
        return self._has_stood(world, 2)

    def _has_stood(self, world: World, times: int) -> bool:
        """Whether there was no progress for so many times the time after which a run is jammed."""
        seconds = (world.tick - self.progress_tick) * TIME_STEP / times
        # Most ticks end here: the layout's size takes longer to compute.
        if seconds < JAM_SECONDS:
            return False
        metres = world.layout.top - world.layout.bottom
        slowest = min(world.layout.machines[kind].speed for kind in HAULERS)
        by_speed = max(1.0, JAM_SPEED / slowest)
        by_size = max(1.0, metres / JAM_METRES)
        return seconds >= JAM_SECONDS * by_speed * by_size


def orders_refused(answers: Mapping[str, Action | None]) -> int:
    """Return the number of decisions of the dispatch policy that were refused at a tick: 0 or 1."""
    dispatcher = answers.get(DISPATCH)
    return int(dispatcher is not None and dispatcher.state == "broken")


def lines_of_waits(actions: Mapping[str, Action]) -> list[str]:
    """Return a line for each robot that waits for something, or has failed: its name, what it does,
    and what it waits for.
    """
    lines = []
    for name, action in sorted(actions.items()):
        if kind_of(name) not in ROBOTS:
            continue
        line = f"{name} ({action.doing})"
        if action.waits_for:
            lines.append(f"{line} waits for {action.waits_for}")
        elif action.state == "failed":
            lines.append(line)
    return lines


def collisions(world: World, kinds: tuple[str, ...] = ROBOTS) -> int:
    """Return the number of collisions that bodies of these kinds began.

    A body begins one when its step meets an obstacle; there is an event for each.
    """
    count = 0
    for name, i in world.layout.index.items():
        if kind_of(name) in kinds:
            count += int(world.collisions[i])
    return count


@lru_cache(maxsize=KEPT_LAYOUTS)
def _ideals(layout: Layout) -> tuple[Bounds, float]:
    """Return what an orchard allows without traffic: its limits, and its schedule's length, s."""
    return Bounds(layout), schedule_seconds(layout)


def harvest_figures(world: World, figures: HarvestFigures) -> dict[str, Any]:
    """Return the part of the summary that depends on the simulation only and is the same in every
    repetition.
    """
    hours = world.tick * TIME_STEP / 3600.0
    scenario = world.layout.scenario
    bounds, schedule = _ideals(world.layout)
    waits = figures.waits
    full_bins = delivered_full_bins(world.layout, world.delivered, world.delivered_metres)
    working_day = ""
    days = work_days(scenario, bounds)
    if days is not None:
        working_day = days.words(world.tick * TIME_STEP)
    return {
        "seed": scenario.seed,
        "ticks": world.tick,
        "sim_seconds": round(world.tick * TIME_STEP, 1),
        "working_day": working_day,
        "agents": len(world.layout.starts),
        "rows": scenario.rows,
        "row_length": world.layout.mean_length,
        "rows_picked": int(world.rows_done.sum()),
        "metres_picked": float(sum(world.row_picked.tolist())),
        "bins": world.layout.bins,
        "bins_delivered": world.delivered,
        "bins_per_hour": _ratio(full_bins, hours),
        "limit_bins_per_hour": bounds.bins_per_hour,
        "schedule_sim_seconds": schedule,
        "bottleneck": bounds.bottleneck,
        "collisions": collisions(world),
        "collisions_of_people_and_animals": collisions(world, PEOPLE + ANIMALS),
        "weeds_flattened": figures.weeds_flattened,
        "row_end_seconds": bounds.row_end_seconds,
        "row_end_share": bounds.row_end_share,
        "picker_waiting_seconds": _ratio(sum(waits), len(waits)),
        "carrier_utilisation": _ratio(figures.busy_ticks, figures.carrier_ticks),
        "charging_seconds": round(figures.charging_ticks * TIME_STEP, 1),
        "flat_seconds": round(figures.flat_ticks * TIME_STEP, 1),
        "bay_waiting_seconds": round(figures.bay_waiting_ticks * TIME_STEP, 1),
        "orders_refused": figures.orders_refused,
        "broken_agents": [f"{name}, since tick {tick}" for name, tick in figures.broken.items()],
        "distance_metres": _distances(world),
    }


def _ratio(amount: float, whole: float) -> float:
    """Return an amount for each one of a whole: a rate, a mean or a share. 0 if the whole is 0."""
    if not whole:
        return 0.0
    return amount / whole


def _distances(world: World) -> dict[str, float]:
    """Return how far all bodies of a kind have moved together, m. Weeds do not move."""
    distances: dict[str, float] = {}
    for name, i in world.layout.index.items():
        kind = kind_of(name)
        if kind != "weed":
            distances[kind] = distances.get(kind, 0.0) + float(world.distance[i])
    return dict(sorted(distances.items()))


FIRST_STEP = 100  # ticks between two samples at first: 10 s
# As soon as there are this many samples, every second one is dropped, and the step doubles. Chosen:
# enough points for a graph.
MOST_SAMPLES = 400
# Places of the waiting states in a list with an element for each of STATES.
WAITING = [STATES.index(state) for state in WAITING_STATES]

# The columns of a history: s since the start; bins; s for which all pickers together have waited; s
# for which all carriers together have been outside the queue.
SAMPLED = ("seconds", "bins_delivered", "pickers_waited_seconds", "carriers_busy_seconds")
# Totals since the start of the run, in the order of SAMPLED.
Sample = tuple[float, int, float, float]


@dataclass
class History:
    """Samples of a run, as plain data. A long run has no more samples than a short one."""

    step: int = FIRST_STEP  # ticks between two samples
    samples: list[Sample] = field(default_factory=list)

    def update(self, world: World, states: StateTimes, busy_ticks: int) -> None:
        """Add a sample if one is due at this tick."""
        if world.tick % self.step:
            return
        self.samples.append(sample_of(world, states, busy_ticks))
        if len(self.samples) >= MOST_SAMPLES:
            self.step *= 2
            self.samples = self.samples[1::2]

    def until(self, now: Sample) -> dict[str, list[float]]:
        """Return all samples and that of now, for the summary: name -> values."""
        samples = list(self.samples)
        if samples[-1:] != [now]:
            samples.append(now)
        columns = zip(*samples, strict=True)
        return {name: list(values) for name, values in zip(SAMPLED, columns, strict=True)}


def sample_of(world: World, states: StateTimes, busy_ticks: int) -> Sample:
    """Return the totals up to this tick.

    `busy_ticks`: for which carriers were outside the queue, all carriers together.
    """
    waiting = 0
    for name, ticks in states.counts.ticks.items():
        if kind_of(name) == "picker":
            waiting += sum(ticks[state] for state in WAITING)
    return (
        round(world.tick * TIME_STEP, 1),
        world.delivered,
        round(waiting * TIME_STEP, 1),
        round(busy_ticks * TIME_STEP, 1),
    )


def shares(history: Mapping[str, Sequence[float]], name: str, robots: int) -> list[float]:
    """Return for each sample of a history the share of their time that robots spent in something
    since the sample before: 0 to 1.

    `name`: the column of SAMPLED that has the time spent, in s of all robots together. `robots`:
    how many these are.
    """
    times = pairwise([0.0, *history["seconds"]])
    totals = pairwise([0.0, *history[name]])
    shares_of_time = []
    for (since, until), (before, after) in zip(times, totals, strict=True):
        shares_of_time.append(_ratio(after - before, robots * (until - since)))
    return shares_of_time
