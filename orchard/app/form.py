"""The form: a control for every value of a scenario, in groups."""

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from orchard.app.controls import AutomaticControl, Change, Control, control
from orchard.app.draft import Draft
from orchard.app.entries import entries
from orchard.field.scenario import Scenario

GROUPS = {
    "Orchard": ("rows", "row_width", "seed"),
    "Robots": ("pickers", "carriers", "picking_speed", "laser.noise"),
    "People and animals": ("people.workers", "people.visitors", "animals.dogs", "animals.cats"),
    "Surroundings": ("weeds", "tractor"),
}


class Form:
    """All controls; `change` hears of every change."""

    def __init__(self, change: Change) -> None:
        self._controls: dict[str, Control] = {}
        known = [path for paths in GROUPS.values() for path in paths]
        rest = tuple(path for path in entries() if path not in known)
        for title, paths in (GROUPS | {"More": rest}).items():
            if paths:
                self._group(title, paths, change)

    def _group(self, title: str, paths: tuple[str, ...], change: Change) -> None:
        with ui.element("section").classes("group"):
            ui.label(title).classes("group-title")
            for path in paths:
                self._controls[path] = control(entries()[path], change)

    def show(self, values: Mapping[str, Any]) -> None:
        """Bring every control to its value."""
        for path, value in values.items():
            self._controls[path].show(value)

    def follow(self, draft: Draft) -> None:
        """Say at each field what is wrong with it."""
        for path, one in self._controls.items():
            one.complain(draft.problems.get(path, ""))
        if draft.scenario is not None:
            self._chosen(draft.scenario)

    def _chosen(self, scenario: Scenario) -> None:
        for one in self._controls.values():
            if isinstance(one, AutomaticControl):
                one.show_chosen(scenario.carrier_count)
