"""One control for each kind of value: slider with number field, text, switch. Each shows its own problem."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from orchard.app.entries import Entry

Change = Callable[[str, Any], None]  # path, new value


class Control:
    """A labelled value with its limits, and room for what is wrong with it."""

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
        """What stands below."""

    def show(self, value: Any) -> None:
        """Bring the control to a value."""
        raise NotImplementedError

    def complain(self, problem: str) -> None:
        """Tell what is wrong with the value; '' when nothing is."""
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        self.box.classes(**{"add" if problem else "remove": "wrong"})

    def _tell(self, value: Any) -> None:
        self._change(self.entry.path, value)


class NumberControl(Control):
    """A slider within the limits, and a field in which one may type anything."""

    def _build(self) -> None:
        entry = self.entry
        self._slider = ui.slider(min=entry.low, max=entry.high, step=entry.step).classes("grow")
        self._slider.on("update:model-value", lambda event: self.number.set_value(event.args), throttle=0.05)
        self.number = ui.number(step=entry.step, on_change=self._entered).classes("number")
        self.number.props(f"dense outlined input-class=figure data-field={entry.path}")

    def show(self, value: Any) -> None:
        self.number.set_value(value)

    def _entered(self) -> None:
        value = self.number.value
        if value is not None:
            self._slider.set_value(min(max(value, self.entry.low), self.entry.high))
        self._tell(value)


class AutomaticControl(NumberControl):
    """A number that may be left to the program."""

    def _build_more(self) -> None:
        self._automatic = ui.checkbox("automatic", on_change=self._entered).classes("field-more")
        self._automatic.props(f"dense size=sm data-field={self.entry.path}-automatic")

    def show(self, value: Any) -> None:
        self._automatic.set_value(value is None)
        if value is not None:
            super().show(value)

    def show_chosen(self, number: int) -> None:
        """What the program has chosen, where it is left to it."""
        if self._automatic.value:
            self.number.set_value(number)

    def _entered(self) -> None:
        automatic = bool(self._automatic.value)
        for element in (self._slider, self.number):
            element.set_enabled(not automatic)
        if self.number.value is not None:
            self._slider.set_value(min(max(self.number.value, self.entry.low), self.entry.high))
        self._tell(None if automatic else self.number.value)


class TextControl(Control):
    """A whole number too large for a browser's numbers."""

    def _build(self) -> None:
        self._text = ui.input(on_change=lambda: self._tell(self._text.value)).classes("grow")
        self._text.props(f"dense outlined inputmode=numeric input-class=figure data-field={self.entry.path}")

    def show(self, value: Any) -> None:
        self._text.set_value(str(value))


class SwitchControl(Control):
    """Yes or no."""

    def _build(self) -> None:
        self._switch = ui.switch(on_change=lambda: self._tell(self._switch.value)).props(f"dense data-field={self.entry.path}")
        self.box.classes("inline")

    def show(self, value: Any) -> None:
        self._switch.set_value(bool(value))


def control(entry: Entry, change: Change) -> Control:
    """The control that suits an entry."""
    if entry.kind is bool:
        return SwitchControl(entry, change)
    if not entry.has_slider:
        return TextControl(entry, change)
    return (AutomaticControl if entry.optional else NumberControl)(entry, change)
