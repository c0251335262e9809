"""What is to be run, and the command line that does it."""

import sys
from dataclasses import dataclass
from pathlib import Path

from orchard.config import Scenario

ROOT = Path(__file__).parent.parent.parent
MODES = {"lockstep": "processes over Zenoh, as on separate machines", "local": "all in one process, without a network"}


@dataclass(frozen=True)
class Order:
    """A run that somebody has asked for."""

    scenario: Scenario
    mode: str = "lockstep"
    speed: float | None = None  # simulated seconds to a second; None: as fast as it goes
    duration: float | None = None  # s, simulated; None: the whole harvest
    live: bool = True  # whether it is watched while it runs


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
    speed = "max" if order.speed is None else f"{order.speed:g}"
    duration = [] if order.duration is None else ["--duration", f"{order.duration:g}"]
    live = ["--web", str(web_port)] if order.live else []
    where = ["--record", str(files.recording), "--summary", str(files.summary)]
    program = [sys.executable, "-u", str(ROOT / "run.py"), str(files.scenario)]
    return [*program, "--mode", order.mode, "--speed", speed, *duration, *live, *where]
