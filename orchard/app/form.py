"""The form: a control for each value of a scenario, and what is wrong there; and the user's own
classes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from orchard.app.draft import Draft, Entry, entries, flat, number_of, shown, words_of
from orchard.app.elements import button, heading, note
from orchard.app.own_classes import AGENTS
from orchard.field.scenario import Scenario

FIGURES = 4  # significant digits of a number that the program works out


class Control:
    """A labelled value, its limits and its problem: a switch, a choice, or a number, perhaps with a
    slider.
    """

    def __init__(self, entry: Entry, draft: Draft, where: str = "") -> None:
        """`where`: goes before its name for tests."""
        self.entry, self._draft, name = entry, draft, where + entry.path
        self._slider: ui.slider | None = None
        self._automatic: ui.checkbox | None = None
        with ui.element("div").classes("field") as self.box:
            with ui.element("div").classes("field-head") as head:
                head.props["title"] = entry.words
                ui.label(entry.label).classes("field-label")
                ui.label(entry.limits).classes("field-limits")
            with ui.element("div").classes("field-body"):
                self._value: Any = (
                    self._switch()
                    if entry.kind is bool
                    else self._choice()
                    if entry.choices
                    else self._number()
                )
                self._value.props(f'data-field={name} aria-label="{entry.label}"')
            if entry.optional:
                self._automatic = ui.checkbox(entry.none, on_change=self._entered).classes(
                    "field-more"
                )
                self._automatic.props(
                    f'dense size=sm data-field={name}-automatic aria-label="{entry.label}:'
                    f' {entry.none}"'
                )
            self._problem = note(f"data-problem={name} role=alert")
            self._meaning = note(f"data-meaning={name}", "field-mark")
            self._mark = note(f"data-mark={name}", "field-mark")

    def _switch(self) -> ui.switch:
        self.box.classes("inline")
        return ui.switch(on_change=self._entered).props("dense")

    def _choice(self) -> ui.select:
        return (
            ui.select([*self.entry.choices], on_change=self._entered)
            .classes("grow")
            .props("dense outlined options-dense")
        )

    def _number(self) -> ui.input:
        entry = self.entry
        if entry.has_slider:
            self._slider = ui.slider(
                min=entry.low, max=entry.high, step=entry.step, value=entry.low
            ).classes("grow")
            self._slider.props(f'aria-label="{entry.label}"')
            self._slider.on(
                "update:model-value", lambda event: self.show(event.args), throttle=0.05
            )
        text = ui.input(on_change=self._entered).classes("number" if entry.has_slider else "grow")
        return text.props("dense outlined autocomplete=off inputmode=decimal input-class=figure")

    def show(self, value: Any) -> None:
        if self._automatic is not None:
            self._automatic.set_value(value is None)
        if self.entry.choices:
            self._value.set_options([*dict.fromkeys([*self.entry.choices, value])], value=value)
        elif self.entry.kind is bool:
            self._value.set_value(value is True)  # other values stay in the draft, as problems
        elif value is not None:
            self._value.set_value(shown(value) if self.entry.kind in (int, float) else value)

    def show_chosen(self, number: float) -> None:
        if self._automatic is not None and self._automatic.value:
            self._value.set_value(shown(float(f"{number:.{FIGURES}g}")))

    def explain(self, meaning: str) -> None:
        self._meaning.set_text(meaning)

    def complain(self, problem: str) -> None:
        self._problem.set_text(problem)
        self.box.classes(add="wrong" if problem else "", remove="" if problem else "wrong")

    def mark(self, running: str) -> None:
        self._mark.set_text(f"the harvest that runs has {running}" if running else "")

    def _entered(self) -> None:
        value = bool(self._value.value) if self.entry.kind is bool else self._value.value or ""
        automatic = self._automatic is not None and bool(self._automatic.value)
        self._value.set_enabled(not automatic)
        if self._slider is not None:
            self._slider.set_enabled(not automatic)
            number = number_of(str(value))
            if not isinstance(number, str):
                self._slider.set_value(min(max(number, self.entry.low), self.entry.high))
        self._draft.enter({self.entry.path: None if automatic else value})


GROUPS = {
    "Orchard": ("rows", "row_length", "bins_per_row", "row_width", "seed"),
    "Robots": ("pickers", "picking_rate", "carriers", "dispatch", "rows_to_pickers", "route"),
    "Picking": (
        "picking.spread.distribution",
        "picking.spread.cv",
        "picking.failure.mean_between",
        "picking.failure.mean_repair",
    ),
    "Carriers": (
        *(
            "carrying.failure.mean_between",
            "carrying.failure.mean_repair",
            "chargers",
            "carrying.battery.hours",
        ),
        *(
            "carrying.battery.standing",
            "carrying.battery.hours_to_charge",
            "carrying.battery.reserve",
        ),
    ),
    "People and animals": ("people.workers", "people.visitors", "animals.dogs", "animals.cats"),
    "Surroundings": ("weeds", "tractor"),
    "Prices": (
        "prices.picker_per_hour",
        "prices.carrier_per_hour",
        "prices.overhead_per_hour",
        "prices.per_bin",
    ),
}
FOR_EXPERTS = {
    "Fruit and speed": (
        "metres_per_bin",
        "crop.tonnes_per_hectare",
        "crop.kilograms_per_bin",
        "order_in_row",
        "picking_speed",
    ),
    "Sensors": (
        *("laser.noise", "sensors.gnss.white", "sensors.gnss.bias", "sensors.gnss.bias_time"),
        *("sensors.odometry.distance", "sensors.odometry.heading"),
    ),
}
_BASIC = [*AGENTS, *(path for paths in GROUPS.values() for path in paths)]


class Form:
    """All controls of a draft, those for experts folded away, and the user's own classes, if there
    are any.
    """

    def __init__(self, draft: Draft) -> None:
        self._draft = draft
        self._controls: dict[str, Control] = {}
        self._add(GROUPS)
        with (
            ui.expansion("For experts")
            .classes("experts")
            .props("data-view=experts") as self._experts
        ):
            self._add(FOR_EXPERTS)
            self._add({"More": tuple(path for path in entries() if path not in self._controls)})
        with _group("Own classes") as self._classes:
            self._names = ui.label().classes("classes").props("data-view=classes")
            self._problem = note("data-problem=agents role=alert")
            button(
                "Use the built-in classes", draft.drop_classes, "drop-classes", props="flat dense"
            )
        self._classes.set_visibility(False)

    def _add(self, groups: Mapping[str, Sequence[str]]) -> None:
        for title, paths in groups.items():
            with _group(title):
                self._controls |= {path: Control(entries()[path], self._draft) for path in paths}

    def show(self) -> None:
        for path, value in self._draft.values.items():
            self._controls[path].show(value)

    def follow(self, running: Scenario | None) -> None:
        """Show what is wrong, what the program has chosen, and how the scenario that runs
        differs.
        """
        draft = self._draft
        other = (
            {}
            if running is None
            else {
                path: value for path, value in flat(running).items() if value != draft.values[path]
            }
        )
        for path, control in self._controls.items():
            control.complain(draft.problems.get(path, ""))
            control.mark(words_of(path, other[path]) if path in other else "")
        if draft.scenario is not None:
            chosen = draft.scenario.chosen
            for path, number in chosen.items():
                self._controls[path].show_chosen(number)
            self._controls["bins_per_row"].explain(
                f"a bin fills in {chosen['metres_per_bin']:.{FIGURES}g} m of row"
            )
            self._controls["picking_rate"].explain(
                f"a picker goes {chosen['picking_speed']:.{FIGURES}g} m/s"
            )
        if any(path not in _BASIC for path in draft.problems):
            self._experts.open()
        self._classes.set_visibility(bool(draft.classes))
        self._names.set_text("\n".join(f"{word}: {path}" for word, path in draft.classes.items()))
        problems = [words for path, words in draft.problems.items() if path.split(".")[0] in AGENTS]
        self._problem.set_text("\n".join(problems))


def _group(title: str) -> ui.element:
    with ui.element("section").classes("group") as group:
        heading(2, title).classes("group-title")
    return group
