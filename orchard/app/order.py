"""What is to be run, and the command line that does it."""

import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from orchard.app.numbers import hint, number_of, shown
from orchard.field.scenario import Scenario

ROOT = Path(__file__).parent.parent.parent
MODES = {
    "lockstep": "processes over Zenoh, as on separate machines",
    "local": "all in one process, without a network",
    "realtime": "processes by the wall clock, which wait for nobody",
}


@dataclass(frozen=True)
class Order:
    """A run that somebody has asked for."""

    scenario: Scenario
    mode: str = "lockstep"
    speed: float | None = None  # simulated seconds to a second; None: as fast as it goes
    duration: float | None = None  # s, simulated; None: the whole harvest
    live: bool = True  # whether it is watched while it runs


@dataclass(frozen=True)
class Limits:
    """From where to where a wish may go."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:.0f}"

    def problem(self, text: str, also: str) -> str:
        """What is wrong with a text; '' if it is a number within the limits."""
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
    as_fast_as_it_goes: bool = False  # whatever the speed says

    @property
    def is_by_the_clock(self) -> bool:
        """Whether the wall clock sets the pace, so that there is no fastest."""
        return self.mode == "realtime"

    @property
    def is_fastest(self) -> bool:
        return self.as_fast_as_it_goes and not self.is_by_the_clock

    @cached_property
    def problems(self) -> dict[str, str]:
        """What is wrong with each of them."""
        clock = "; the wall clock sets the pace, so it cannot be max" if self.is_by_the_clock else ""
        told = {
            "speed": "" if self.is_fastest else SPEEDS.problem(self.speed, f"; 1 is real time{clock}"),
            "duration": "" if self._is_whole else DURATIONS.problem(self.duration, "; empty: the whole harvest"),
        }
        return {name: words for name, words in told.items() if words}

    @property
    def _is_whole(self) -> bool:
        return not self.duration.strip()

    def order(self, scenario: Scenario, live: bool) -> Order:
        """Raises ValueError while there are problems."""
        if self.problems:
            raise ValueError("; ".join(f"{name} {words}" for name, words in self.problems.items()))
        speed, duration = None if self.is_fastest else float(self.speed), None if self._is_whole else float(self.duration)
        return Order(scenario, self.mode, speed, duration, live)


@dataclass(frozen=True)
class Files:
    """Where a run's things lie: side by side, under one name."""

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


def command(order: Order, files: Files, web_port: int) -> list[str]:
    """`run.py` and its options; the live picture is served on `web_port`, its data on the next one."""
    speed = "max" if order.speed is None else shown(order.speed)
    duration = [] if order.duration is None else ["--duration", shown(order.duration)]
    live = ["--web", str(web_port)] if order.live else []
    where = ["--record", str(files.recording), "--summary", str(files.summary)]
    program = [sys.executable, "-u", str(ROOT / "run.py"), str(files.scenario)]
    return [*program, "--mode", order.mode, "--speed", speed, *duration, *live, *where]
