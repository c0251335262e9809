"""One control for each kind of value: slider with number field, text, switch. Each shows its own problem."""

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orchard.app.entries import Entry
from orchard.app.numbers import number_of, shown

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
        self.box.classes(add="wrong" if problem else "", remove="" if problem else "wrong")

    def _tell(self, value: Any) -> None:
        self._change(self.entry.path, value)

    @property
    def _name(self) -> str:
        """What tests and screen readers call it."""
        return f'data-field={self.entry.path} aria-label="{self.entry.label}"'


class TextControl(Control):
    """A number in a field in which one may type anything; a browser's own number fields would drop letters and commas in silence."""

    def _build(self) -> None:
        self._text = ui.input(on_change=self._entered).classes("grow")
        self._text.props(f"dense outlined autocomplete=off inputmode=decimal input-class=figure {self._name}")

    def show(self, value: Any) -> None:
        self._text.set_value(shown(value))

    def _entered(self) -> None:
        self._tell(self._text.value or "")


class NumberControl(TextControl):
    """The same, and a slider within the limits."""

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
        """Bring the slider to where the number is, or nearest to it."""
        number = number_of(self._text.value or "")
        if not isinstance(number, str):
            self._slider.set_value(min(max(number, self.entry.low), self.entry.high))


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
            self._text.set_value(shown(number))

    def _entered(self) -> None:
        automatic = bool(self._automatic.value)
        for element in (self._slider, self._text):
            element.set_enabled(not automatic)
        self._follow()
        self._tell(None if automatic else self._text.value or "")


class SwitchControl(Control):
    """Yes or no."""

    def _build(self) -> None:
        self._switch = ui.switch(on_change=self._entered).props(f"dense {self._name}")
        self.box.classes("inline")

    def show(self, value: Any) -> None:
        self._switch.set_value(bool(value))

    def _entered(self) -> None:
        self._tell(bool(self._switch.value))


def control(entry: Entry, change: Change) -> Control:
    """The control that suits an entry."""
    if entry.kind is bool:
        return SwitchControl(entry, change)
    if not entry.has_slider:
        return TextControl(entry, change)
    return (AutomaticControl if entry.optional else NumberControl)(entry, change)
