"""A control of the form: a labelled value, its limits, and what is wrong with it.

An entry (entries.py) is a value of the scenario that a user can set; a control shows it, and enters
what the user types into a draft (draft.py). An entry may be left to the program: such a control has
a box to tick, "automatic", and shows the number that the program has chosen.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orchard.app.draft import Draft
from orchard.app.elements import NO_TAB_STOP, mark_wrong, note
from orchard.app.entries import MEASURES, Entry
from orchard.app.typed_field import TypedField
from orchard.app.typed_numbers import number_of, shown

# Significant digits of a number that the program works out.
FIGURES = 4
# How a field for a text looks.
TEXT = "dense outlined autocomplete=off input-class=figure"
# JavaScript of a field for a number: typing in it replaces the number. A click comes after the
# focus, and would drop what is selected.
SELECT_ON_FOCUS = "(event) => { event.target.select(); event.target.dataset.fresh = 1 }"
SELECT_ON_FIRST_CLICK = (
    "(event) => { if (event.target.dataset.fresh) { event.target.select();"
    " delete event.target.dataset.fresh } }"
)


class Control:
    """A switch, a choice, or a number, which may have a slider."""

    def __init__(self, entry: Entry, draft: Draft, where: str = "") -> None:
        """`draft`: takes what is entered. `where`: goes before the control's name for tests."""
        self.entry = entry
        self._draft = draft
        name = where + entry.path
        self._slider: ui.slider | None = None
        self._automatic: ui.checkbox | None = None
        # Whether the program writes into the text field now, and not the user.
        self._is_program_writing = False
        with ui.element("div").classes("field") as self.box:
            with ui.element("div").classes("field-head") as head:
                head.props["title"] = entry.words
                ui.label(entry.label).classes("field-label")
                ui.label(entry.limits).classes("field-limits")
            with ui.element("div").classes("field-body"):
                self._value = self._build_value()
                self._value.props(f'data-field={name} aria-label="{entry.label}"')
            if entry.optional:
                self._automatic = self._build_automatic(name)
            self._problem = note(f"data-problem={name} role=alert")
            self._mark = note(f"data-mark={name}", "field-mark")

    # -- layout

    def _build_value(self) -> Any:
        """Add the element that fits the kind of value."""
        if self.entry.kind is bool:
            return self._build_switch()
        if self.entry.choices:
            return self._build_choice()
        if self.entry.kind not in (int, float):
            return self._build_text()
        return self._build_number()

    def _build_switch(self) -> ui.switch:
        self.box.classes("inline")
        return ui.switch(on_change=self._entered).props("dense")

    def _build_choice(self) -> ui.select:
        choice = ui.select([*self.entry.choices], on_change=self._entered)
        return choice.classes("grow").props("dense outlined options-dense")

    def _build_text(self) -> TypedField:
        """Add a field for a text, such as a time of day."""
        return TypedField(self._typed).classes("grow").props(TEXT)

    def _build_number(self) -> TypedField:
        """Add a text field; with a slider before it, if the range is known."""
        if self.entry.has_slider:
            self._slider = self._build_slider()
        text = TypedField(self._typed)
        text.on("focus", js_handler=SELECT_ON_FOCUS)
        text.on("click", js_handler=SELECT_ON_FIRST_CLICK)
        text.classes("grow" if self._slider is None else "number")
        return text.props(f"{TEXT} inputmode=decimal")

    def _build_slider(self) -> ui.slider:
        entry = self.entry
        slider = ui.slider(min=entry.low, max=entry.high, step=entry.step, value=entry.low)
        slider.classes("grow").props(f'aria-label="{entry.label}" {NO_TAB_STOP}')
        slider.on("update:model-value", self._slid, throttle=0.05)
        return slider

    def _build_automatic(self, name: str) -> ui.checkbox:
        """Add a box to tick for no value. `name`: of the control, for tests."""
        none = self.entry.none
        automatic = ui.checkbox(none, on_change=self._ticked).classes("field-more")
        automatic.props(f'dense size=sm aria-label="{self.entry.label}: {none}"')
        return automatic.props(f"data-field={name}-automatic")

    # -- what it shows

    def show(self, value: Any) -> None:
        """Show a value of the draft, also one that is invalid there."""
        with self._written_by_program():
            self._show(value)

    def _show(self, value: Any) -> None:
        entry = self.entry
        if self._automatic is not None:
            self._automatic.set_value(value is None)
        if entry.choices:
            self._value.set_options([*dict.fromkeys([*entry.choices, value])], value=value)
        elif entry.kind is bool:
            # Any other value stays in the draft, as a problem.
            self._value.set_value(value is True)
        elif entry.kind in (int, float):
            self._value.set_value("" if value is None else shown(entry.to_page(value)))
        elif entry.kind in (tuple, dict):
            self._value.set_value(entry.as_typed(value))
        else:
            self._value.set_value(value or "")

    def show_chosen(self, number: float) -> None:
        """Show the number that the program has worked out, if the user leaves it to it."""
        if self._is_automatic:
            with self._written_by_program():
                self._value.set_value(shown(float(f"{number:.{FIGURES}g}")))

    def follow(self, value: Any) -> None:
        """Follow the draft where another entry has left this one to the program."""
        if value is None and not self._is_automatic:
            self.show(None)

    @contextmanager
    def _written_by_program(self) -> Iterator[None]:
        """Within this, what the elements show is of the program, and enters nothing."""
        self._is_program_writing = True
        try:
            yield
        finally:
            self._is_program_writing = False

    def complain(self) -> None:
        """Show what is wrong with the value in the draft, if anything."""
        problem = self._draft.told.get(self.entry.path, "")
        self._problem.set_text(problem)
        mark_wrong(self.box, is_wrong=bool(problem))

    def mark(self, running: str) -> None:
        """Show the value of the harvest that runs; '' if it is the same, or if none runs."""
        self._mark.set_text(f"the harvest that runs has {running}" if running else "")

    # -- what is entered

    @property
    def _is_automatic(self) -> bool:
        """Whether the user leaves the value to the program."""
        return self._automatic is not None and bool(self._automatic.value)

    def _typed(self) -> None:
        """Take a text. A typed number is not left to the program any more."""
        if not self._is_program_writing:
            self._leave_automatic()
        self._entered()

    def _ticked(self) -> None:
        """Take whether the program chooses the value. The number that was there goes."""
        if self._is_automatic and not self._is_program_writing:
            self.show(None)
        self._entered()

    def _slid(self, event: GenericEventArguments) -> None:
        """Take the number to which the user has moved the slider."""
        self._leave_automatic()
        self._value.set_value(shown(event.args))

    def _leave_automatic(self) -> None:
        if self._automatic is not None:
            with self._written_by_program():
                self._automatic.set_value(False)

    def _entered(self) -> None:
        """Show what follows, and take what the user has entered into the draft."""
        typed = self._value.value
        # An empty field holds None, and stands for an empty text.
        value: Any = typed or ""
        if self.entry.kind is bool:
            value = bool(typed)
        if self._slider is not None:
            self._move_slider(self._slider, value)
        if self._is_program_writing:
            return
        # Only such an entry needs its number here; the draft reads all other texts by itself.
        if self.entry.path in MEASURES:
            value = self.entry.from_page(number_of(value))
        self._draft.enter({self.entry.path: None if self._is_automatic else value})

    def _move_slider(self, slider: ui.slider, value: object) -> None:
        """Move the slider to a number, as far as it goes. It stays where it is for all else."""
        number = number_of(str(value))
        if not isinstance(number, str):
            slider.set_value(min(max(number, self.entry.low), self.entry.high))
