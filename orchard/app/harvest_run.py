"""A harvest from the page: its controls, the command `orchard` that does it, what it says, and its
picture.
"""

import contextlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.charts import Course, course_of
from orchard.app.command import Files, Latest, PageCommand
from orchard.app.draft import number_of, number_problem, shown, span
from orchard.app.picture import ViewerPanel
from orchard.app.runs_view import Record
from orchard.app.what_if import Fork
from orchard.field.scenario import Scenario
from orchard.report.metrics import SAMPLED
from orchard.report.summary import Headline

MODES = {
    "lockstep": "processes over Zenoh, as on separate machines",
    "local": "all in one process, without a network",
    "realtime": "processes by the wall clock; physics does not wait for late agents",
}
SPEEDS = (0.1, 1000)  # limits, both included: x real time
DURATIONS = (1, 1_000_000)  # limits, both included: s, simulated


@dataclass(frozen=True)
class RunSettings:
    """How a run is to go, as a user entered it."""

    mode: str = "lockstep"
    speed: str = "8"  # x real time
    duration: str = ""  # '': the whole harvest
    as_fast_as_it_goes: bool = False  # overrides the speed, except in realtime
    live: bool = True  # whether to serve the live picture

    @property
    def is_by_the_clock(self) -> bool:
        """Whether the wall clock sets the pace, so that the fastest speed is not available."""
        return self.mode == "realtime"

    @property
    def is_fastest(self) -> bool:
        return self.as_fast_as_it_goes and not self.is_by_the_clock

    @cached_property
    def problems(self) -> dict[str, str]:
        clock = (
            "; the wall clock sets the pace, so it cannot be max" if self.is_by_the_clock else ""
        )
        told = {
            "speed": (
                ""
                if self.is_fastest
                else number_problem(self.speed, SPEEDS, also=f"; 1 is real time{clock}")
            ),
            "duration": (
                number_problem(self.duration, DURATIONS, also="; empty: the whole harvest")
                if self.duration.strip()
                else ""
            ),
        }
        return {name: words for name, words in told.items() if words}


def command(
    settings: RunSettings, files: Files, web_port: int, fork: Fork | None = None
) -> list[str]:
    """Return the command line of a run.

    The live picture is at `web_port`, its data at the next port.
    """
    what = [str(files.scenario)] if fork is None else ["fork", *fork.words]
    speed = "max" if settings.is_fastest else shown(float(settings.speed))
    duration = ["--duration", shown(float(settings.duration))] if settings.duration.strip() else []
    live = ["--web", str(web_port)] if settings.live else []
    where = ["--record", str(files.recording), "--summary", str(files.summary)]
    program = [sys.executable, "-u", "-P", "-m", "orchard"]
    return [
        *program,
        *what,
        "--mode",
        settings.mode,
        "--progress",
        "json",
        "--speed",
        speed,
        *duration,
        *live,
        *where,
    ]


FASTEST = 50  # x real time, the maximum of the slider; the text field accepts more


class RunControls:
    """The controls above the stage."""

    def __init__(self, last: RunSettings) -> None:
        self.settings = last
        self._problems: dict[str, ui.label] = {}
        with ui.element("div").classes("wishes") as self.box:
            self._build_mode()
            self._build_speed()
            self._build_duration()
            ui.switch("Live picture", value=last.live, on_change=self._enters("live")).props(
                "dense data-field=live"
            )
        self._update()

    # -- layout

    def _build_mode(self) -> None:
        with self._setting("Mode", "mode"):
            mode = ui.toggle(list(MODES), value=self.settings.mode, on_change=self._enters("mode"))
            mode.props("dense no-caps unelevated data-field=mode")

    def _build_speed(self) -> None:
        with self._setting("Speed", "speed"):
            self._slider = (
                ui.slider(min=1, max=FASTEST, step=1, value=1)
                .classes("speed-slider")
                .props("aria-label=Speed")
            )
            self._speed = ui.input(
                value=self.settings.speed, suffix="x", on_change=self._enters("speed")
            ).classes("number")
            self._speed.props(
                "dense outlined inputmode=decimal autocomplete=off data-field=speed"
                " aria-label=Speed input-class=figure"
            )
            self._speed.props(f'title="times real time, {span(SPEEDS)}"')
            self._slider.on(
                "update:model-value",
                lambda event: self._speed.set_value(shown(event.args)),
                throttle=0.05,
            )
            self._fastest = ui.checkbox(
                "fastest",
                value=self.settings.is_fastest,
                on_change=self._enters("as_fast_as_it_goes"),
            )
            self._fastest.props("dense data-field=fastest")
            self._fastest.props('title="as fast as this machine can"')

    def _build_duration(self) -> None:
        with self._setting("End after", "duration"):
            duration = ui.input(
                value=self.settings.duration,
                placeholder="all rows",
                suffix="s",
                on_change=self._enters("duration"),
            )
            duration.props(
                "dense outlined clearable inputmode=decimal autocomplete=off data-field=duration"
                " input-class=figure"
            )
            duration.props(
                f'aria-label="End after" title="simulated seconds, {span(DURATIONS)}; empty: the'
                ' whole harvest"'
            )
            duration.classes("number wide")

    def _setting(self, name: str, path: str) -> ui.element:
        with ui.element("div").classes("wish"):
            ui.label(name).classes("field-label")
            place = ui.element("div").classes("wish-body")
            self._problems[path] = (
                ui.label().classes("wish-words").props(f"data-problem={path} role=status")
            )
        return place

    # -- user actions

    def _enters(self, name: str) -> Callable[[ValueChangeEventArguments[Any]], None]:
        def enter(event: ValueChangeEventArguments[Any]) -> None:
            changed: dict[str, Any] = {name: "" if event.value is None else event.value}
            self.settings = replace(self.settings, **changed)
            self._update()

        return enter

    def _update(self) -> None:
        settings = self.settings
        self._fastest.set_visibility(not settings.is_by_the_clock)
        for element in (self._slider, self._speed):
            element.set_enabled(not settings.is_fastest)
        if not isinstance(speed := number_of(settings.speed), str):
            self._slider.set_value(min(max(speed, 1), FASTEST))
        clock = (
            "the wall clock sets the pace; fastest is not available"
            if settings.is_by_the_clock
            else ""
        )
        notes = {"mode": MODES[settings.mode], "speed": clock}
        for path, label in self._problems.items():
            problem = settings.problems.get(path, "")
            label.set_text(problem or notes.get(path, ""))
            label.classes(add="wrong" if problem else "", remove="" if problem else "wrong")


class HarvestCommand(PageCommand):
    """One run, perhaps a fork of another one."""

    def __init__(
        self, scenario: Scenario, settings: RunSettings, files: Files, fork: Fork | None = None
    ) -> None:
        self.settings, self.fork = settings, fork
        self.picture = ViewerPanel(scenario, files)
        self.headline: Headline | None = None
        self.summary: dict[str, Any] | None = None
        self._course = {
            name: [*fork.history[name]] if fork else [] for name in SAMPLED
        }  # and what the lines of progress say
        super().__init__(scenario, files, command(settings, files, self.picture.port, fork))

    def words_of(self, line: str) -> str | None:
        words = super().words_of(line)
        with contextlib.suppress(ValueError, KeyError, RecursionError):  # any other line
            self.headline = msgspec.json.decode(line, type=dict[str, Headline])["progress"]
            words, self.has_begun = self.headline.line(), True
            self._add_to_course(self.headline)
        return words

    def _add_to_course(self, now: Headline) -> None:
        busy = now.carrier_utilisation * now.sim_seconds * self.scenario.carrier_count
        sample = now.sim_seconds, now.bins_delivered, now.pickers_waited_seconds, busy
        for name, value in zip(SAMPLED, sample, strict=True):
            self._course[name].append(value)

    def finish(self) -> None:
        """Read the summary and serve the recording. Both are ready before the run is over."""
        if (record := self.read(self.files.summary, Record)) is not None:
            self.headline, self.summary = record, self.read(self.files.summary, dict[str, Any])
        if self.files.recording.exists():
            self.picture.play()

    @property
    def course(self) -> Course:
        known = self._course if self.summary is None else self.summary["history"]
        since = self.fork.seconds if self.fork else 0.0
        return course_of(
            {name: list(values) for name, values in known.items()}, self.scenario, since
        )

    @property
    def is_complete(self) -> bool:
        return self.summary is not None and bool(self.summary["finished"] or not self.asked_to_stop)

    def close(self) -> None:
        super().close()
        self.picture.close()


Harvests = Latest[HarvestCommand]
