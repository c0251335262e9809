"""The form: a control for each value of a scenario, in groups, with what is wrong at each; and the classes of the user's that it names."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orchard.app.draft import PLUGINS, Draft, Entry, entries, number_of, shown
from orchard.field.scenario import Scenario

Change = Callable[[str, Any], None]  # path, new value


class Control:
    """A labelled value, its limits and its problem."""

    def __init__(self, entry: Entry, change: Change) -> None:
        self.entry, self._change = entry, change
        with ui.element("div").classes("field") as self.box:
            with ui.element("div").classes("field-head"):
                ui.label(entry.label).classes("field-label")
                ui.label(entry.limits).classes("field-limits")
                ui.tooltip(entry.words).props("anchor='center right' self='center left' delay=400")
            with ui.element("div").classes("field-body"):
                self._build()
            self._build_more()
            self._problem = ui.label().classes("field-problem").props(f"data-problem={entry.path} role=alert")
        self.complain("")

    def _build(self) -> None:
        raise NotImplementedError

    def _build_more(self) -> None:
        """Add elements below the value."""

    def show(self, value: Any) -> None:
        """Set the control to a value."""
        raise NotImplementedError

    def complain(self, problem: str) -> None:
        """Show a problem of the value; '' clears it."""
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        self.box.classes(add="wrong" if problem else "", remove="" if problem else "wrong")

    def _report(self, value: Any) -> None:
        self._change(self.entry.path, value)

    @property
    def _name(self) -> str:
        """The properties by which tests and screen readers find the control."""
        return f'data-field={self.entry.path} aria-label="{self.entry.label}"'


class TextControl(Control):
    """A number in a text field. A browser's own number field would silently drop letters and commas."""

    def _build(self) -> None:
        self._text = ui.input(on_change=self._entered).classes("grow")
        self._text.props(f"dense outlined autocomplete=off inputmode=decimal input-class=figure {self._name}")

    def show(self, value: Any) -> None:
        self._text.set_value(shown(value))

    def _entered(self) -> None:
        self._report(self._text.value or "")


class NumberControl(TextControl):
    """A number in a text field, with a slider within the limits."""

    def _build(self) -> None:
        entry = self.entry
        self._slider = ui.slider(min=entry.low, max=entry.high, step=entry.step).classes("grow").props(f'aria-label="{entry.label}"')
        self._slider.on("update:model-value", self._slid, throttle=0.05)
        super()._build()
        self._text.classes("number", remove="grow")

    def _slid(self, event: GenericEventArguments) -> None:
        self.show(event.args)

    def _entered(self) -> None:
        self._follow()
        super()._entered()

    def _follow(self) -> None:
        """Move the slider to the number, clamped to the limits."""
        number = number_of(self._text.value or "")
        if not isinstance(number, str):
            self._slider.set_value(min(max(number, self.entry.low), self.entry.high))


class AutomaticControl(NumberControl):
    """A number that the program can choose."""

    def _build_more(self) -> None:
        self._automatic = ui.checkbox("automatic", on_change=self._entered).classes("field-more")
        self._automatic.props(f"dense size=sm data-field={self.entry.path}-automatic")

    def show(self, value: Any) -> None:
        self._automatic.set_value(value is None)
        if value is not None:
            super().show(value)

    def show_chosen(self, number: int) -> None:
        """Show the number that the program has chosen, if `automatic` is on."""
        if self._automatic.value:
            self._text.set_value(shown(number))

    def _entered(self) -> None:
        automatic = bool(self._automatic.value)
        for element in (self._slider, self._text):
            element.set_enabled(not automatic)
        self._follow()
        self._report(None if automatic else self._text.value or "")


class SwitchControl(Control):
    """A switch for true or false."""

    def _build(self) -> None:
        self._switch = ui.switch(on_change=self._entered).props(f"dense {self._name}")
        self.box.classes("inline")

    def show(self, value: Any) -> None:
        self._switch.set_value(bool(value))

    def _entered(self) -> None:
        self._report(bool(self._switch.value))


def control(entry: Entry, change: Change) -> Control:
    """Return a new control for an entry. It calls `change(path, value)` when the user changes the value."""
    if entry.kind is bool:
        return SwitchControl(entry, change)
    if not entry.has_slider:
        return TextControl(entry, change)
    return (AutomaticControl if entry.optional else NumberControl)(entry, change)


class ClassesView:
    """The user's own classes of the draft, and their problems. Hidden if there are none."""

    def __init__(self, drop: Callable[[], None]) -> None:
        with ui.element("section").classes("group") as self._box:
            ui.label("Own classes").classes("group-title")
            self._names = ui.label().classes("classes").props("data-view=classes")
            self._problem = ui.label().classes("field-problem").props("data-problem=agents role=alert")
            ui.button("Use the built-in classes", on_click=drop).props("flat dense no-caps data-action=drop-classes")
        self._box.set_visibility(False)

    def show(self, draft: Draft) -> None:
        """Show the classes of a draft."""
        self._box.set_visibility(bool(draft.classes))
        self._names.set_text("\n".join(f"{word}: {path}" for word, path in draft.classes.items()))
        problems = [words for path, words in draft.problems.items() if path.split(".")[0] in PLUGINS]
        self._problem.set_text("\n".join(problems))
        self._problem.set_visibility(bool(problems))


GROUPS = {
    "Orchard": ("rows", "row_width", "seed"),
    "Robots": ("pickers", "carriers", "picking_speed", "laser.noise"),
    "People and animals": ("people.workers", "people.visitors", "animals.dogs", "animals.cats"),
    "Surroundings": ("weeds", "tractor"),
}


class Form:
    """All controls. The form calls `change(path, value)` when the user changes a value."""

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
        """Set the controls to values by path."""
        for path, value in values.items():
            self._controls[path].show(value)

    def follow(self, draft: Draft) -> None:
        """Show the problem of each field, and the numbers that the program has chosen."""
        for path, one in self._controls.items():
            one.complain(draft.problems.get(path, ""))
        if draft.scenario is not None:
            self._show_chosen(draft.scenario)

    def _show_chosen(self, scenario: Scenario) -> None:
        for one in self._controls.values():
            if isinstance(one, AutomaticControl):
                one.show_chosen(scenario.carrier_count)
