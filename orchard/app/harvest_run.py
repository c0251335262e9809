"""A harvest from the page: its settings, the command `orchard` that does it, and its course."""

import sys
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec

from orchard.app.charts import Course, course_of
from orchard.app.command import Files, Latest, PageCommand, RunState
from orchard.app.past_runs import Record
from orchard.app.picture import ViewerPanel
from orchard.app.typed_numbers import in_seconds, number_of, number_problem, with_point
from orchard.app.what_if import Fork
from orchard.field.scenario import Scenario
from orchard.report.metrics import SAMPLED
from orchard.report.summary import Headline, clock

MODES = {
    "lockstep": "processes over Zenoh, as on separate machines",
    "local": "all in one process, without a network",
    "realtime": "processes by the wall clock; physics does not wait for late agents",
}
# Settings that are numbers -> their labels on the page.
SETTINGS = {"speed": "Speed", "duration": "End after"}
# Limits, both included: x real time.
SPEEDS = (0.1, 1000)
# Limits, both included: s, simulated.
DURATIONS = (1, 1_000_000)
SUCH_AS = "or with a unit such as 7.5 h or 90 min"


@dataclass(frozen=True)
class RunSettings:
    """How a run is to go, as a user entered it.

    `speed`: x real time. `duration`: simulated s, or with a unit, such as 7.5 h; '' for the whole
    harvest. `as_fast_as_it_goes`: overrides the speed, except in realtime. `live`: whether to serve
    the live picture.
    """

    mode: str = "lockstep"
    speed: str = "8"
    duration: str = ""
    as_fast_as_it_goes: bool = False
    live: bool = True

    @property
    def is_by_the_clock(self) -> bool:
        """Whether the wall clock sets the pace, so that the fastest speed is not available."""
        return self.mode == "realtime"

    @property
    def is_fastest(self) -> bool:
        """Whether the run goes as fast as the machine can."""
        return self.as_fast_as_it_goes and not self.is_by_the_clock

    @property
    def is_whole_harvest(self) -> bool:
        """Whether the run ends with the harvest, and not after a duration."""
        return not self.duration.strip()

    @cached_property
    def problems(self) -> dict[str, str]:
        """What is wrong with the settings, by name."""
        words_by_name = {}
        if not self.is_fastest:
            words_by_name["speed"] = self._speed_problem()
        if not self.is_whole_harvest:
            words_by_name["duration"] = number_problem(
                self._seconds, DURATIONS, also=f" s, {SUCH_AS}; empty: the whole harvest"
            )
        problems = {}
        for name, problem in words_by_name.items():
            if problem:
                problems[name] = f"{SETTINGS[name]}: {problem}"
        return problems

    @property
    def _seconds(self) -> str:
        """The duration in seconds, as text."""
        return in_seconds(self.duration)

    @property
    def end(self) -> str:
        """When the run ends, for a person; '' for the whole harvest, or if that is invalid."""
        seconds = number_of(self._seconds)
        if isinstance(seconds, str) or "duration" in self.problems:
            return ""
        return f"after {clock(seconds)}, simulated"

    @property
    def duration_option(self) -> str:
        """The duration as the command takes it, s."""
        return with_point(self._seconds)

    def _speed_problem(self) -> str:
        advice = "; 1 is real time"
        if self.is_by_the_clock:
            advice += "; the wall clock sets the pace, so it cannot be max"
        return number_problem(self.speed, SPEEDS, also=advice)


def command(
    settings: RunSettings, files: Files, web_port: int, fork: Fork | None = None
) -> list[str]:
    """Return the command line of a run.

    The live picture is at `web_port`, its data at the next port.
    """
    # -u: each line comes at once. -P: a file in the working directory does not stand in for a
    # module.
    line = [sys.executable, "-u", "-P", "-m", "orchard"]
    if fork is None:
        line.append(str(files.scenario))
    else:
        line += ["fork", *fork.words]
    line += ["--mode", settings.mode, "--progress", "json"]
    line += ["--speed", "max" if settings.is_fastest else with_point(settings.speed)]
    if not settings.is_whole_harvest:
        line += ["--duration", settings.duration_option]
    if settings.live:
        line += ["--web", str(web_port)]
    line += ["--record", str(files.recording), "--summary", str(files.summary)]
    return line


class HarvestCommand(PageCommand):
    """One run, perhaps a fork of another one.

    `headline`: the figures so far; None before the first ones. `summary`: None until the end.
    """

    def __init__(
        self, scenario: Scenario, settings: RunSettings, files: Files, fork: Fork | None = None
    ) -> None:
        """Start the run. Raises OSError."""
        self.settings = settings
        self.fork = fork
        self.picture = ViewerPanel(scenario, files)
        self.headline: Headline | None = None
        self.summary: dict[str, Any] | None = None
        # Begins with what a fork has of its parent. The lines of progress add to it.
        self._history: dict[str, list[float]] = {name: [] for name in SAMPLED}
        if fork is not None:
            self._history = {name: [*fork.history[name]] for name in SAMPLED}
        super().__init__(scenario, files, command(settings, files, self.picture.port, fork))

    def message_of(self, line: str) -> str | None:
        """Take the figures of a line of progress, and return it as words for a person."""
        try:
            headline = msgspec.json.decode(line, type=dict[str, Headline])["progress"]
        except (ValueError, KeyError, RecursionError):
            # It is any other line.
            return super().message_of(line)
        self.headline = headline
        self.has_begun = True
        self._add_to_history(headline)
        return headline.line()

    def _add_to_history(self, now: Headline) -> None:
        carriers_busy_seconds = (
            now.carrier_utilisation * now.sim_seconds * self.scenario.carrier_count
        )
        # In the order of SAMPLED.
        sample = (
            now.sim_seconds,
            now.bins_delivered,
            now.pickers_waited_seconds,
            carriers_busy_seconds,
        )
        for name, value in zip(SAMPLED, sample, strict=True):
            self._history[name].append(value)

    def finish(self) -> None:
        """Read the summary and serve the recording. Both are ready before the run is over."""
        # `Record` checks the figures that the page needs. All others are shown as they are.
        record = self.read(self.files.summary, Record)
        if record is not None:
            self.headline = record
            self.summary = self.read(self.files.summary, dict[str, Any])
        if self.files.recording.exists():
            self.picture.play()

    @property
    def course(self) -> Course:
        """The figures over time, of a fork from its moment on."""
        history = self._history if self.summary is None else self.summary["history"]
        since = self.fork.seconds if self.fork else 0.0
        # The thread that listens may add to the lists meanwhile.
        history = {name: list(values) for name, values in history.items()}
        return course_of(history, self.scenario, since)

    @property
    def state(self) -> RunState:
        """The present state. A run that ended before its harvest was done was cut short."""
        state = super().state
        is_whole = self.summary is None or bool(self.summary["finished"])
        if state is RunState.finished and not is_whole:
            return RunState.cut
        return state

    @property
    def is_complete(self) -> bool:
        """Whether there is a summary, and the run was not stopped before its end."""
        if self.summary is None:
            return False
        return bool(self.summary["finished"]) or not self.asked_to_stop

    def close(self) -> None:
        """Stop the run, and its picture."""
        super().close()
        self.picture.close()


Harvests = Latest[HarvestCommand]
