"""The run in figures, as it goes and when it is over."""

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from msgspec import Meta

from orchard.contract.agent import Action
from orchard.field.scenario import TIME_STEP
from orchard.sim.snapshot import SnapshotError
from orchard.sim.stops import as_shown
from orchard.wire import messages

if TYPE_CHECKING:
    from orchard.contract.events import Event
    from orchard.sim.engine import Engine

Seconds = Annotated[float, Meta(ge=0.0, le=1e9)]
FIGURES_SECONDS = 0.5  # of wall time between two messages with figures


class RunFigures:
    """The run in figures, for those who watch it and for the summary."""

    def __init__(self, engine: "Engine", before: Mapping[str, Any] | None = None) -> None:
        """`before`: what `as_data` gave, of a run that goes on. Raises SnapshotError for what is none."""
        from orchard.report.metrics import HarvestFigures

        self._engine, self._world = engine, engine.world
        before = before or {}
        try:
            self._figures = msgspec.convert(before.get("harvest", {}), HarvestFigures)
            self._wall_before = msgspec.convert(before.get("wall_seconds", 0.0), Seconds)
        except ValueError as error:
            raise SnapshotError(f"the figures of the run before are none: {error}") from error
        self.actions: dict[str, Action] = {}
        self._begun = self._told = time.monotonic()

    def as_data(self) -> dict[str, Any]:
        """All that must be known to go on with it."""
        return {"harvest": msgspec.to_builtins(self._figures), "wall_seconds": self._wall()} | self._engine.figures_as_data()

    def _wall(self) -> float:
        return self._wall_before + time.monotonic() - self._begun

    def begin(self) -> None:
        """The first tick begins now."""
        self._begun = self._told = time.monotonic()

    def update(self, events: "list[Event]", actions: dict[str, Action]) -> None:
        self.actions = actions
        self._figures.update(self._world, events, actions)

    @property
    def jam(self) -> list[str]:
        """Who waits for whom, one line each, when nothing has gone on for ten minutes; else nothing."""
        from orchard.report.metrics import who_waits

        return (who_waits(self.actions) or ["nobody waits for anybody"]) if self._figures.jammed(self._world) else []

    def figures(self) -> dict[str, Any]:
        from orchard.report.metrics import harvest_figures

        wall = self._wall()
        times = self._world.tick * TIME_STEP / wall if wall else 0.0
        speed = {"wall_seconds": round(wall, 3), "times_real_time": round(times, 1)}
        return harvest_figures(self._world, self._figures) | self._engine.states.figures() | speed

    def message(self, run: str, refused: dict[str, int]) -> messages.Figures:
        actions = as_shown(self._world, self.actions)
        doing = {name: action.doing for name, action in actions.items() if action.doing}
        waits = {name: action.waits_for for name, action in actions.items() if action.waits_for}
        return messages.Figures(run, self._world.tick, self.figures(), doing, waits, refused)

    def is_due(self) -> bool:
        """Whether half a second has passed since this last said so."""
        now = time.monotonic()
        if now - self._told < FIGURES_SECONDS:
            return False
        self._told = now
        return True
