"""Events and states -> figures: how good the harvest was, and whether it still goes on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from orchard.contract.agent import Action
from orchard.contract.events import Event
from orchard.field.kinds import ANIMALS, PEOPLE, kind_of
from orchard.field.layout import QUEUE, ROW_LENGTH
from orchard.field.scenario import TIME_STEP
from orchard.report.bounds import bounds_of
from orchard.sim.world import World

JAM_SECONDS = 600.0  # without a metre picked or a step of work finished
WORKERS_OF_THE_HARVEST = ("picker", "carrier", "bin", "tractor")


@dataclass
class HarvestFigures:
    """What a run is judged by, brought up to date tick by tick. All of it is data."""

    waits: list[float] = field(default_factory=list)  # s from a full bin to the next empty one, of pickers
    waiting_since: dict[str, int] = field(default_factory=dict)  # picker -> tick at which its bin was full
    busy_ticks: int = 0  # of all carriers, outside the queue
    weeds_flattened: int = 0
    progress: float = 0.0  # metres picked and steps of work done
    progress_tick: int = 0  # when it last grew, or somebody was stopped

    def update(self, world: World, events: list[Event], actions: Mapping[str, Action]) -> None:
        """Account for the tick that has just ended."""
        for event in events:
            self._count(event)
        self.busy_ticks += sum(not QUEUE.contains(x, y) for x, y, _ in world.pose[world.carriers].tolist())
        steps = sum(actions[name].steps_done for name in world.planners if name in actions)
        progress = steps + sum(world.row_picked.tolist())
        if progress != self.progress or np.count_nonzero(world.stopped):
            self.progress, self.progress_tick = progress, world.tick

    def _count(self, event: Event) -> None:
        if event.what == "row picked":
            self.waiting_since[event.who] = event.tick
        elif event.what == "coupled" and event.who in self.waiting_since:
            self.waits.append((event.tick - self.waiting_since.pop(event.who)) * TIME_STEP)
        elif event.what == "weed flattened":
            self.weeds_flattened += 1

    def jammed(self, world: World) -> bool:
        """Nobody has picked a metre or finished a step of its work for ten minutes, in which no robot was stopped."""
        return (world.tick - self.progress_tick) * TIME_STEP >= JAM_SECONDS


def who_waits(actions: Mapping[str, Action]) -> list[str]:
    """Who waits for whom, one line each."""
    return [
        f"{name} ({action.doing}) waits for {action.waits_for}"
        for name, action in sorted(actions.items())
        if action.waits_for and kind_of(name) in WORKERS_OF_THE_HARVEST
    ]


def collisions(world: World) -> int:
    """Refused steps of pickers, carriers, tractor and towed bins."""
    return _sum_by_kind(world, world.refused, WORKERS_OF_THE_HARVEST)


def refused_moves(world: World) -> int:
    """Refused steps of people and animals."""
    return _sum_by_kind(world, world.refused, PEOPLE + ANIMALS)


def _sum_by_kind(world: World, counts: Any, kinds: tuple[str, ...]) -> int:
    return sum(int(counts[i]) for name, i in world.layout.index.items() if kind_of(name) in kinds)


def rows_picked(world: World) -> int:
    return int((world.row_picked >= ROW_LENGTH).sum())


def harvest_figures(world: World, figures: HarvestFigures) -> dict[str, Any]:
    """The part of the summary that follows from the simulation alone, the same for every repetition."""
    hours = world.tick * TIME_STEP / 3600.0
    carriers = world.layout.scenario.carrier_count
    bounds = bounds_of(world.layout)
    distance: dict[str, float] = {}
    for name, i in world.layout.index.items():
        distance[kind_of(name)] = distance.get(kind_of(name), 0.0) + float(world.distance[i])
    return {
        "seed": world.layout.scenario.seed,
        "ticks": world.tick,
        "sim_seconds": round(world.tick * TIME_STEP, 1),
        "agents": len(world.layout.starts),
        "rows": world.layout.scenario.rows,
        "rows_picked": rows_picked(world),
        "bins_delivered": world.delivered,
        "bins_per_hour": world.delivered / hours if hours else 0.0,
        "bound_bins_per_hour": bounds.bins_per_hour,
        "bound_sim_seconds": bounds.harvest_seconds,
        "bottleneck": bounds.bottleneck,
        "collisions": collisions(world),
        "refused_moves": refused_moves(world),
        "weeds_flattened": figures.weeds_flattened,
        "picker_waiting_seconds": sum(figures.waits) / len(figures.waits) if figures.waits else 0.0,
        "carrier_utilisation": figures.busy_ticks / (world.tick * carriers) if world.tick else 0.0,
        "distance_metres": {kind: metres for kind, metres in sorted(distance.items()) if kind != "weed"},
    }
