"""The settings of a run, and the credentials with which its processes are started."""

import os
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from orchard.field.scenario import Scenario
from orchard.launch.bag_velocities import BagVelocities
from orchard.launch.options import HarvestOptions
from orchard.launch.supervisor import free_port
from orchard.security.identity import Identity, Keyring
from orchard.sim.snapshot import Snapshot


@dataclass(frozen=True)
class RunRequest:
    """A run to start: its options, and what follows from them."""

    options: HarvestOptions
    scenario: Scenario
    recording: Path | None
    snapshots: Path  # the folder for snapshots
    resumed: Snapshot | None = None  # the snapshot from which the run is resumed
    forked_from: dict[str, Any] | None = None  # of a fork, the name of the run and the moment, s
    notes: Path | None = (
        None  # folder for the note with which `run.py stop` finds the run; None: no note
    )
    velocities: BagVelocities | None = None  # those of the bag that drives robots, if there is one

    @cached_property
    def data_port(self) -> int:
        """The port of the live data: the port after that of the web viewer, or a free one."""
        return free_port() if self.options.web is None else self.options.web + 1

    @cached_property
    def run_id(self) -> str:
        return (self.resumed.run if self.resumed else "") or uuid.uuid4().hex[:16]

    @property
    def uri(self) -> str:
        return f"rerun+http://127.0.0.1:{self.data_port}/proxy"


Shares = list[tuple[str, Sequence[str]]]  # (name of an agent process, the agents that it hosts)


class Credentials:
    """What the processes of a run need to connect, and how agents are shared. An open run has no keyring."""

    def __init__(self, options: HarvestOptions) -> None:
        """Raises ValueError if the directory of a secured run has no roles."""
        self.options = options
        self.keyring = Keyring.load(options.secure) if options.secure else None

    def identity(self, role: str) -> Identity | None:
        return self.keyring.of(role) if self.keyring else None

    def only_identity(self) -> Identity | None:
        """Return the identity of a directory with one role; None for an open run. Raises ValueError."""
        if self.keyring is None:
            return None
        roles = list(self.keyring.roles)
        if len(roles) > 1:
            raise ValueError(
                f"{self.keyring.folder}: it has {len(roles)} roles; with --only choose one of them: DIR/<role>"
            )
        return self.keyring.of(roles[0])

    def folder(self, role: str) -> str | None:
        identity = self.identity(role)
        return None if identity is None else str(identity.folder)

    def shares(self, names: Sequence[str], all_names: Sequence[str]) -> Shares:
        return (
            list(self.keyring.hosts(names, all_names).items())
            if self.keyring
            else shares(names, self.options.hosts)
        )


def shares(names: Sequence[str], hosts: int | None) -> Shares:
    """Share agents among processes. `hosts`: how many; 0: one per agent; None: one per core, at most 4."""
    if hosts == 0:
        return [(name, [name]) for name in names]
    count = min(len(names), hosts or min(4, os.cpu_count() or 1))
    return [(f"agents {i + 1}", names[i::count]) for i in range(count)]
