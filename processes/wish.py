"""What a user of run.py asks for."""

from dataclasses import dataclass
from pathlib import Path

from orchard.config import Scenario


@dataclass(frozen=True)
class Wish:
    """How a run shall be run."""

    scenario: Scenario
    mode: str
    speed: float  # simulated seconds to a second; infinity: as fast as it goes
    hosts: int | None  # agent processes; 0: one each; None: a sensible few
    duration: float | None  # s, simulated
    recording: Path | None
    view: bool
    listen: str | None = None  # the endpoint at which others may join; None: a free port of 127.0.0.1
    connect: str | None = None  # that of a router elsewhere, through which all talk
    without: tuple[str, ...] = ()  # kinds and names that others run
