"""What a user of run.py asks for."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.net.lockstep import PATIENCE
from orchard.sim.snapshot import Snapshot


@dataclass(frozen=True)
class RunRequest:
    """How a run shall be run."""

    scenario: Scenario
    mode: str
    speed: float  # simulated seconds to a second; infinity: as fast as it goes
    hosts: int | None  # agent processes; 0: one each; None: a sensible few
    duration: float | None  # s, simulated
    recording: Path | None
    view: bool
    snapshots: Path  # the folder for snapshots
    resumed: Snapshot | None = None  # from which a run goes on
    listen: str | None = None  # the endpoint at which others may join; None: a free port of 127.0.0.1
    connect: str | None = None  # that of a router elsewhere, through which all talk
    without: tuple[str, ...] = ()  # kinds and names that others run
    patience: float = PATIENCE  # s of wall time for which lockstep waits for an agent that is silent
    secure: Path | None = None  # the directory of `run.py secure`
    web: int | None = None  # the port at which browsers find the live picture
    notes: Path | None = None  # where a note tells others on this machine how to reach the run

    @property
    def is_live(self) -> bool:
        """Whether anybody watches while it runs."""
        return self.view or self.web is not None

    @cached_property
    def data_port(self) -> int:
        """Where viewers find the data: next to the page's port, or on any free one."""
        return free_port() if self.web is None else self.web + 1

    @property
    def uri(self) -> str:
        """What a viewer is told to open."""
        return f"rerun+http://127.0.0.1:{self.data_port}/proxy"
