"""How a run is to go: the controls for mode, speed, duration and live picture, and the command line that they stand for."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from nicegui import ui
from nicegui.events import GenericEventArguments

from orchard.app.draft import hint, number_of, shown
from orchard.field.scenario import Scenario

ROOT = Path(__file__).parent.parent.parent
MODES = {
    "lockstep": "processes over Zenoh, as on separate machines",
    "local": "all in one process, without a network",
    "realtime": "processes by the wall clock; physics does not wait for late agents",
}


@dataclass(frozen=True)
class RunSettings:
    """The settings of a run that a user has requested."""

    scenario: Scenario
    mode: str = "lockstep"
    speed: float | None = None  # x real time; None: as fast as possible
    duration: float | None = None  # s, simulated; None: the whole harvest
    live: bool = True  # whether to serve the live picture


@dataclass(frozen=True)
class Limits:
    """The limits of a setting, both included."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:.0f}"

    def problem(self, text: str, also: str) -> str:
        """Return the problem of a text; '' if it is a number within the limits. `also` is added to the message."""
        number = number_of(text)
        good = not isinstance(number, str) and self.low <= number <= self.high
        return "" if good else f"must be a number from {self}{also}{hint(text)}"


SPEEDS = Limits(0.1, 1000)  # x real time
DURATIONS = Limits(1, 1_000_000)  # s, simulated


@dataclass(frozen=True)
class Pace:
    """Mode, speed and duration as a user entered them."""

    mode: str
    speed: str
    duration: str = ""  # '': the whole harvest
    as_fast_as_it_goes: bool = False  # overrides the speed, except in realtime

    @property
    def is_by_the_clock(self) -> bool:
        """Whether the wall clock sets the pace, so that the fastest speed is not available."""
        return self.mode == "realtime"

    @property
    def is_fastest(self) -> bool:
        return self.as_fast_as_it_goes and not self.is_by_the_clock

    @cached_property
    def problems(self) -> dict[str, str]:
        """Messages for the invalid settings, by name."""
        clock = "; the wall clock sets the pace, so it cannot be max" if self.is_by_the_clock else ""
        told = {
            "speed": "" if self.is_fastest else SPEEDS.problem(self.speed, f"; 1 is real time{clock}"),
            "duration": "" if self._is_whole else DURATIONS.problem(self.duration, "; empty: the whole harvest"),
        }
        return {name: words for name, words in told.items() if words}

    @property
    def _is_whole(self) -> bool:
        return not self.duration.strip()

    def order(self, scenario: Scenario, live: bool) -> RunSettings:
        """Return the order to run a scenario. Raises ValueError if a setting is invalid."""
        if self.problems:
            raise ValueError("; ".join(f"{name} {words}" for name, words in self.problems.items()))
        speed, duration = None if self.is_fastest else float(self.speed), None if self._is_whole else float(self.duration)
        return RunSettings(scenario, self.mode, speed, duration, live)


@dataclass(frozen=True)
class Files:
    """The files of a run: in one folder, under one name."""

    folder: Path
    name: str

    @property
    def scenario(self) -> Path:
        return self.folder / f"{self.name}.yaml"

    @property
    def recording(self) -> Path:
        return self.folder / f"{self.name}.rrd"

    @property
    def summary(self) -> Path:
        return self.folder / f"{self.name}.json"


def command(order: RunSettings, files: Files, web_port: int) -> list[str]:
    """Return the command line of `run.py`. It serves the live picture on `web_port` and its data on the next port."""
    speed = "max" if order.speed is None else shown(order.speed)
    duration = [] if order.duration is None else ["--duration", shown(order.duration)]
    live = ["--web", str(web_port)] if order.live else []
    where = ["--record", str(files.recording), "--summary", str(files.summary)]
    program = [sys.executable, "-u", str(ROOT / "run.py"), str(files.scenario)]
    return [*program, "--mode", order.mode, "--progress", "json", "--speed", speed, *duration, *live, *where]


FASTEST = 50  # x real time, the maximum of the slider; the text field accepts more
AT_FIRST = 8.0  # x real time


class RunControls:
    """The controls above the stage."""

    def __init__(self, change: Callable[[], None], last: RunSettings | None) -> None:
        """Start with the settings of the last run, if there is one. `change()` is called when a setting changes."""
        self._change = change
        self._problems: dict[str, ui.label] = {}
        self._build_mode()
        self._build_speed()
        self._build_duration()
        self._live = ui.switch("Live picture", value=True).props("dense data-field=live")
        if last is not None:
            self._show(last)
        self._update()

    @property
    def pace(self) -> Pace:
        """The settings as entered, valid or not."""
        return Pace(str(self._mode.value), self._speed.value or "", self._duration.value or "", bool(self._fastest.value))

    def order(self, scenario: Scenario) -> RunSettings:
        """Return the order to run a scenario. Raises ValueError if a setting is invalid."""
        return self.pace.order(scenario, bool(self._live.value))

    # -- layout

    def _build_mode(self) -> None:
        with self._setting("Mode", "mode"):
            self._mode = ui.toggle(list(MODES), value="lockstep", on_change=self._update).props("dense no-caps unelevated data-field=mode")

    def _build_speed(self) -> None:
        with self._setting("Speed", "speed"):
            self._slider = ui.slider(min=1, max=FASTEST, step=1, value=AT_FIRST).classes("speed-slider").props("aria-label=Speed")
            self._slider.on("update:model-value", self._slid, throttle=0.05)
            self._speed = ui.input(value=shown(AT_FIRST), suffix="x", on_change=self._entered).classes("number")
            self._speed.props("dense outlined inputmode=decimal autocomplete=off data-field=speed aria-label=Speed input-class=figure")
            self._speed.tooltip(f"times real time, {SPEEDS}")
            self._fastest = ui.checkbox("fastest", on_change=self._update).props("dense data-field=fastest")
            self._fastest.tooltip("as fast as this machine can")

    def _build_duration(self) -> None:
        with self._setting("End after", "duration"):
            self._duration = ui.input(placeholder="all rows", suffix="s", on_change=self._update).classes("number wide")
            self._duration.props("dense outlined clearable inputmode=decimal autocomplete=off data-field=duration input-class=figure")
            self._duration.props('aria-label="End after"')
            self._duration.tooltip(f"simulated seconds, {DURATIONS}; empty: the whole harvest")

    def _setting(self, name: str, path: str) -> ui.element:
        """Return the container for the controls of a setting. Its problem or explanation is shown below."""
        with ui.element("div").classes("wish"):
            ui.label(name).classes("field-label")
            place = ui.element("div").classes("wish-body")
            self._problems[path] = ui.label().classes("wish-words").props(f"data-problem={path} role=status")
        return place

    # -- user actions

    def _show(self, order: RunSettings) -> None:
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
        self._update()

    def _update(self) -> None:
        """Show the problem or the explanation of each setting, and report the change."""
        pace = self.pace
        self._fastest.set_visibility(not pace.is_by_the_clock)
        for element in (self._slider, self._speed):
            element.set_enabled(not pace.is_fastest)
        notes = {
            "mode": MODES[pace.mode],
            "speed": "the wall clock sets the pace; fastest is not available" if pace.is_by_the_clock else "",
        }
        for path, label in self._problems.items():
            problem = pace.problems.get(path, "")
            label.set_text(problem or notes.get(path, ""))
            label.classes(add="wrong" if problem else "", remove="" if problem else "wrong")
        self._change()
