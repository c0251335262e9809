"""The figures of a run, while it runs and for its summary."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from orchard.contract.agent import state_of
from orchard.contract.events import Event
from orchard.field.scenario import TIME_STEP
from orchard.report.ending import fault_of, jam_of
from orchard.report.losses import lost_seconds
from orchard.report.metrics import HarvestFigures, History, harvest_figures, sample_of
from orchard.sim.engine import Engine
from orchard.sim.snapshot import SnapshotError
from orchard.sim.stops import as_shown
from orchard.wire import messages

# s of wall time; the limit, 32 years, refuses what a spoiled snapshot may hold.
Seconds = Annotated[float, Meta(ge=0.0, le=1e9)]
FIGURES_SECONDS = 0.5  # s of wall time between two messages with figures


class RunFigures:
    """Counts the figures of one run, for observers and for the summary."""

    def __init__(
        self, engine: Engine, clock: Callable[[], float], before: Mapping[str, Any] | None = None
    ) -> None:
        """`clock`: s of wall time, without pauses.

        `before`: what `as_data` returned, for a run that is resumed. Raises SnapshotError if it is
        malformed.
        """
        self._engine = engine
        self._world = engine.world
        self._clock = clock
        before = before or {}
        harvest = before.get("harvest", {"progress_tick": engine.tick})
        try:
            self._figures = msgspec.convert(harvest, HarvestFigures)
            self._history = msgspec.convert(before.get("history", {}), History)
            self._wall_before = msgspec.convert(before.get("wall_seconds", 0.0), Seconds)
            # Whether a fork has changed the scenario under way.
            self._is_changed = msgspec.convert(before.get("is_changed", False), bool)
        except ValueError as error:
            raise SnapshotError(f"the figures in the snapshot are malformed: {error}") from error
        self._begun = self._reported = self._clock()

    def as_data(self) -> dict[str, Any]:
        """Return the figures as plain data, for a snapshot."""
        return {
            "harvest": msgspec.to_builtins(self._figures),
            "history": msgspec.to_builtins(self._history),
            "wall_seconds": self._wall(),
            "is_changed": self._is_changed,
            **self._engine.figures_as_data(),
        }

    def _wall(self) -> float:
        """Return the wall time of the run, s, without pauses and interruptions."""
        return self._wall_before + self._clock() - self._begun

    def begin(self) -> None:
        """Begin to count wall time: the first tick is about to be published."""
        self._begun = self._reported = self._clock()

    def update(self, events: list[Event]) -> None:
        """Count the step that has just been done, with its events."""
        self._figures.update(self._world, events, self._engine.answers)
        self._history.update(self._world, self._engine.states, self._figures.busy_ticks)

    @property
    def jam(self) -> list[str]:
        """Which robot waits for what, one line each, if the run is jammed; else empty.

        A run is jammed if there was no progress for ten simulated minutes.
        """
        return jam_of(self._engine, self._figures)

    @property
    def fault(self) -> str:
        """Why the run must end before the harvest is done; '' if it goes on.

        It is 'jammed', or, if the scenario ends runs for these faults, 'broken' or 'refused'.
        """
        return fault_of(self._engine, self._figures)

    def figures(self) -> dict[str, Any]:
        """Return the figures so far."""
        wall = self._wall()
        times = self._world.tick * TIME_STEP / wall if wall else 0.0
        return {
            **harvest_figures(self._world, self._figures),
            **self._engine.states.figures(),
            "asked_share": self._engine.asked_share,
            "wall_seconds": round(wall, 3),
            "times_real_time": round(times, 1),
        }

    def summary(self) -> dict[str, Any]:
        """Return the figures of the whole run, its scenario, and its course over time."""
        states = self._engine.states
        # Lost seconds are differences to harvests of the event model of the same scenario. So they
        # are known only if the scenario alone has led to this end: no stop by a user, no fork.
        was_stopped = any(states.counts.stopped.values())
        lost = {}
        if self._engine.over and not self._is_changed and not was_stopped:
            lost = lost_seconds(self._world.layout, self._world.seconds)
        now = sample_of(self._world, states, self._figures.busy_ticks)
        figures = self.figures()
        # This figure is the length of the harvest without traffic, an estimate. It cannot be below
        # the optimum, which is proven.
        least = max(figures["schedule_sim_seconds"], lost.get("optimum", 0.0))
        return figures | {
            "schedule_sim_seconds": least,
            "lost_seconds": lost,
            "scenario": self._engine.scenario.model_dump(),
            "history": self._history.until(now),
        }

    def message(self, run: str, refused: dict[str, int]) -> messages.Figures:
        """Return the figures so far, and what each robot does.

        `refused`: reason -> number of refused messages.
        """
        doing = {}
        states = {}
        waits_for = {}
        for name, action in as_shown(self._world, self._engine.actions).items():
            if action.doing or action.state:
                doing[name] = action.doing or state_of(action)
                states[name] = state_of(action)
            if action.waits_for:
                waits_for[name] = action.waits_for
        return messages.Figures(
            run=run,
            tick=self._world.tick,
            figures=self.figures(),
            doing=doing,
            waits_for=waits_for,
            messages_refused=refused,
            states=states,
        )

    def is_due(self) -> bool:
        """Whether FIGURES_SECONDS have passed since this last returned True."""
        now = self._clock()
        if now - self._reported < FIGURES_SECONDS:
            return False
        self._reported = now
        return True
