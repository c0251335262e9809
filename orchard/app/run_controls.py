"""The controls in the card "The run": how a run is to go."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from orchard.app.elements import NO_TAB_STOP, mark_wrong
from orchard.app.harvest_run import DURATIONS, MODES, SPEEDS, SUCH_AS, RunSettings
from orchard.app.typed_numbers import number_of, shown, span

# The fastest speed of the slider, x real time. The text field takes more.
FASTEST = 50
NO_FASTEST = "the wall clock sets the pace; fastest is not available"


class RunControls:
    """Mode, speed, duration and live picture. `settings`: what is entered."""

    def __init__(self, last: RunSettings) -> None:
        """`last`: what was entered in this browser before."""
        self.settings = last
        self._problems: dict[str, ui.label] = {}
        with ui.element("div").classes("wishes") as self.box:
            self._build_mode()
            self._build_speed()
            self._build_duration()
            live = ui.switch("Live picture", value=last.live, on_change=self._enters("live"))
            live.props("dense data-field=live")
        self._update()

    # -- layout

    def _build_mode(self) -> None:
        with self._setting("Mode", "mode"):
            mode = ui.toggle(list(MODES), value=self.settings.mode, on_change=self._enters("mode"))
            mode.props("dense no-caps unelevated data-field=mode")

    def _build_speed(self) -> None:
        with self._setting("Speed", "speed"):
            self._slider = ui.slider(min=1, max=FASTEST, step=1, value=1).classes("speed-slider")
            self._slider.props(f"aria-label=Speed {NO_TAB_STOP}")
            self._speed = _number_field(self.settings.speed, "x", self._enters("speed"))
            self._speed.classes("number")
            self._speed.props("data-field=speed aria-label=Speed")
            self._speed.props(f'title="times real time, {span(SPEEDS)}"')
            self._slider.on("update:model-value", self._slid, throttle=0.05)
            self._fastest = ui.checkbox(
                "fastest",
                value=self.settings.is_fastest,
                on_change=self._enters("as_fast_as_it_goes"),
            )
            self._fastest.props("dense data-field=fastest")
            self._fastest.props('title="as fast as this machine can"')

    def _slid(self, event: GenericEventArguments) -> None:
        """Take the speed to which the user has moved the slider."""
        self._speed.set_value(shown(event.args))

    def _build_duration(self) -> None:
        with self._setting("End after", "duration"):
            duration = _number_field(self.settings.duration, "", self._enters("duration"))
            duration.classes("number wide")
            duration.props('clearable placeholder="all rows" data-field=duration')
            title = f"simulated seconds, {span(DURATIONS)}, {SUCH_AS}; empty: the whole harvest"
            duration.props(f'aria-label="End after" title="{title}"')

    def _setting(self, name: str, path: str) -> ui.element:
        """Add a label, and below it a line for words. Return the place for the control."""
        with ui.element("div").classes("wish"):
            ui.label(name).classes("field-label")
            place = ui.element("div").classes("wish-body")
            words = ui.label().classes("wish-words")
            self._problems[path] = words.props(f"data-problem={path} role=status")
        return place

    # -- user actions

    def _enters(self, name: str) -> Callable[[ValueChangeEventArguments[Any]], None]:
        """Return a function that enters what a user has changed. `name`: of a setting."""

        def enter(event: ValueChangeEventArguments[Any]) -> None:
            changed: dict[str, Any] = {name: "" if event.value is None else event.value}
            self.settings = replace(self.settings, **changed)
            self._update()

        return enter

    def _update(self) -> None:
        """Show what follows from the settings: what cannot be entered, and what is wrong."""
        settings = self.settings
        self._fastest.set_visibility(not settings.is_by_the_clock)
        for element in (self._slider, self._speed):
            element.set_enabled(not settings.is_fastest)
        speed = number_of(settings.speed)
        if not isinstance(speed, str):
            self._slider.set_value(min(max(speed, 1), FASTEST))
        hints = {
            "mode": MODES[settings.mode],
            "speed": NO_FASTEST if settings.is_by_the_clock else "",
            "duration": settings.end,
        }
        for path, label in self._problems.items():
            problem = settings.problems.get(path, "")
            label.set_text(problem or hints.get(path, ""))
            mark_wrong(label, is_wrong=bool(problem))


def _number_field(
    value: str, unit: str, enter: Callable[[ValueChangeEventArguments[Any]], None]
) -> ui.input:
    """Add a text field for a number."""
    field = ui.input(value=value, suffix=unit, on_change=enter)
    return field.props("dense outlined inputmode=decimal autocomplete=off input-class=figure")
