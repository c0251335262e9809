"""How a run shall go: mode, speed, how long, and whether to watch."""

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from orchard.app.numbers import number_of, shown
from orchard.app.order import DURATIONS, MODES, SPEEDS, Order, Pace
from orchard.field.scenario import Scenario

FASTEST = 50  # of the slider; the field takes more
AT_FIRST = 8.0


class RunControls:
    """The controls above the stage."""

    def __init__(self, change: Callable[[], None], last: Order | None) -> None:
        """They begin with those of the last run, if there was one."""
        self._change = change
        self._problems: dict[str, ui.label] = {}
        self._build_mode()
        self._build_speed()
        self._build_duration()
        self._live = ui.switch("Live picture", value=True).props("dense data-field=live")
        if last is not None:
            self._show(last)
        self._tell()

    @property
    def pace(self) -> Pace:
        """What is entered, good or bad."""
        return Pace(str(self._mode.value), self._speed.value or "", self._duration.value or "", bool(self._fastest.value))

    def order(self, scenario: Scenario) -> Order:
        """Raises ValueError while there are problems."""
        return self.pace.order(scenario, bool(self._live.value))

    # -- how it looks

    def _build_mode(self) -> None:
        with self._wish("Mode", "mode"):
            self._mode = ui.toggle(list(MODES), value="lockstep", on_change=self._tell).props("dense no-caps unelevated data-field=mode")

    def _build_speed(self) -> None:
        with self._wish("Speed", "speed"):
            self._slider = ui.slider(min=1, max=FASTEST, step=1, value=AT_FIRST).classes("speed-slider").props("aria-label=Speed")
            self._slider.on("update:model-value", self._slid, throttle=0.05)
            self._speed = ui.input(value=shown(AT_FIRST), suffix="x", on_change=self._entered).classes("number")
            self._speed.props("dense outlined inputmode=decimal autocomplete=off data-field=speed aria-label=Speed input-class=figure")
            self._speed.tooltip(f"times real time, {SPEEDS}")
            self._fastest = ui.checkbox("fastest", on_change=self._tell).props("dense data-field=fastest")
            self._fastest.tooltip("as fast as this machine can")

    def _build_duration(self) -> None:
        with self._wish("End after", "duration"):
            self._duration = ui.input(placeholder="all rows", suffix="s", on_change=self._tell).classes("number wide")
            self._duration.props("dense outlined clearable inputmode=decimal autocomplete=off data-field=duration input-class=figure")
            self._duration.props('aria-label="End after"')
            self._duration.tooltip(f"simulated seconds, {DURATIONS}; empty: the whole harvest")

    def _wish(self, name: str, path: str) -> ui.element:
        """Where the controls of one wish go; below them is what is wrong with it, or to be known."""
        with ui.element("div").classes("wish"):
            ui.label(name).classes("field-label")
            place = ui.element("div").classes("wish-body")
            self._problems[path] = ui.label().classes("wish-words").props(f"data-problem={path} role=status")
        return place

    # -- what the user does

    def _show(self, order: Order) -> None:
        self._mode.set_value(order.mode)
        self._fastest.set_value(order.speed is None)
        self._speed.set_value(shown(order.speed or AT_FIRST))
        self._duration.set_value("" if order.duration is None else shown(order.duration))
        self._live.set_value(order.live)

    def _slid(self, event: GenericEventArguments) -> None:
        self._speed.set_value(shown(event.args))

    def _entered(self) -> None:
        speed = number_of(self._speed.value or "")
        if not isinstance(speed, str):
            self._slider.set_value(min(max(speed, 1), FASTEST))
        self._tell()

    def _tell(self) -> None:
        """Say at each wish what is wrong with it, or what it means."""
        pace = self.pace
        self._fastest.set_visibility(not pace.is_by_the_clock)
        for element in (self._slider, self._speed):
            element.set_enabled(not pace.is_fastest)
        said = {"mode": MODES[pace.mode], "speed": "the wall clock sets the pace: no fastest" if pace.is_by_the_clock else ""}
        for path, label in self._problems.items():
            problem = pace.problems.get(path, "")
            label.set_text(problem or said.get(path, ""))
            label.classes(add="wrong" if problem else "", remove="" if problem else "wrong")
        self._change()
