"""How a run shall go: mode, speed, how long, and whether to watch."""

from collections.abc import Callable

from nicegui import ui

from orchard.app.order import MODES, Order
from orchard.config import Scenario

FASTEST = 50  # of the slider; the field takes more
AT_FIRST = 8.0


class Wishes:
    """The controls above the stage."""

    def __init__(self, change: Callable[[], None], last: Order | None) -> None:
        """They begin with those of the last run, if there was one."""
        with ui.element("div").classes("wish"):
            ui.label("Mode").classes("field-label")
            self._mode = ui.toggle(list(MODES), value="lockstep").props("dense no-caps unelevated data-field=mode")
            for mode, words in MODES.items():
                ui.tooltip(f"{mode}: {words}").bind_visibility_from(self._mode, "value", value=mode)
        self._speeds(change)
        with ui.element("div").classes("wish"):
            ui.label("End after").classes("field-label")
            self._duration = ui.number(placeholder="all rows", suffix="s", step=10, on_change=change).classes("number wide")
            self._duration.props("dense outlined clearable data-field=duration input-class=figure")
            self._duration.tooltip("simulated seconds; empty: the whole harvest")
        self._live = ui.switch("Live picture", value=True).props("dense data-field=live")
        if last is not None:
            self._show(last)

    def _show(self, order: Order) -> None:
        self._mode.set_value(order.mode)
        self._fastest.set_value(order.speed is None)
        self._speed.set_value(order.speed or AT_FIRST)
        self._duration.set_value(order.duration)
        self._live.set_value(order.live)

    def _speeds(self, change: Callable[[], None]) -> None:
        with ui.element("div").classes("wish"):
            ui.label("Speed").classes("field-label")
            self._slider = ui.slider(min=1, max=FASTEST, step=1, value=AT_FIRST).classes("speed-slider")
            self._slider.on("update:model-value", lambda event: self._speed.set_value(event.args), throttle=0.05)
            self._speed = ui.number(value=AT_FIRST, step=1, suffix="x", on_change=change).classes("number")
            self._speed.props("dense outlined data-field=speed input-class=figure").on_value_change(self._follow)
            self._fastest = ui.checkbox("fastest", on_change=change).props("dense data-field=fastest")
            self._fastest.tooltip("as fast as this machine can")
            for element in (self._slider, self._speed):
                element.bind_enabled_from(self._fastest, "value", backward=lambda fastest: not fastest)

    def _follow(self) -> None:
        if self._speed.value is not None:
            self._slider.set_value(min(max(self._speed.value, 1), FASTEST))

    @property
    def problem(self) -> str:
        """What is wrong with them; '' when nothing is."""
        if not self._fastest.value and not (self._speed.value or 0) > 0:
            return "Speed must be a number above 0; 1 is real time"
        if self._duration.value is not None and not self._duration.value > 0:
            return "End after must be a number of simulated seconds above 0, or empty"
        return ""

    def order(self, scenario: Scenario) -> Order:
        speed = None if self._fastest.value else float(self._speed.value)
        return Order(scenario, self._mode.value, speed, self._duration.value, bool(self._live.value))
