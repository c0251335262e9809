"""The settings of a run, and the credentials with which its processes are started."""

import os
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.options import HarvestOptions
from orchard.launch.supervisor import free_port
from orchard.security.identity import Identity, Keyring
from orchard.sim.snapshot import Snapshot

if TYPE_CHECKING:
    from orchard.bags.velocities import BagVelocities


@dataclass(frozen=True)
class RunRequest:
    """A run to start: its options, and what follows from them."""

    options: HarvestOptions
    scenario: Scenario
    # The file of the recording; None: the run is not recorded.
    recording: Path | None
    # The folder for snapshots.
    snapshots: Path
    # The snapshot from which the run goes on.
    resumed: Snapshot | None = None
    # Of a fork: the id of the run that it was forked from, and the moment, s.
    forked_from: dict[str, Any] | None = None
    # The folder for the note with which `orchard stop` finds the run. None: no note.
    notes: Path | None = None
    velocities: "BagVelocities | None" = None  # of the bag that drives robots

    @cached_property
    def data_port(self) -> int:
        """The port of the live data: the port after that of the web viewer, or a free one."""
        if self.options.web is None:
            return free_port()
        return self.options.web + 1

    @cached_property
    def run_id(self) -> str:
        """The id of the run: that of its snapshot, or a new one."""
        known = self.resumed.run if self.resumed else ""
        return known or uuid.uuid4().hex[:16]

    @property
    def uri(self) -> str:
        """The address of the live data, for viewers on this machine."""
        return f"rerun+http://127.0.0.1:{self.data_port}/proxy"


# (name of an agent process, the agents that it hosts).
Shares = list[tuple[str, Sequence[str]]]


class Credentials:
    """What the processes of a run need to connect, and which process hosts which agents.

    A secured run has a keyring: certificates for roles, which also say which agents belong to which
    process. An open run has none.
    """

    def __init__(self, options: HarvestOptions) -> None:
        """Raises ValueError if the directory of a secured run has no roles."""
        self.options = options
        self.keyring = Keyring.load(options.secure) if options.secure else None

    def identity(self, role: str) -> Identity | None:
        """Return the identity of a role; None for an open run. Raises ValueError."""
        if self.keyring:
            return self.keyring.of(role)
        return None

    def only_identity(self) -> Identity | None:
        """Return the identity of a directory with one role; None for an open run.

        Raises ValueError for a directory with several roles.
        """
        if self.keyring is None:
            return None
        roles = list(self.keyring.roles)
        if len(roles) > 1:
            raise ValueError(
                f"{self.keyring.folder}: it has {len(roles)} roles; "
                "with --only choose one of them: DIR/<role>"
            )
        return self.keyring.of(roles[0])

    def folder(self, role: str) -> str | None:
        """Return the folder of a role's certificate, for the options of a process."""
        identity = self.identity(role)
        if identity is None:
            return None
        return str(identity.folder)

    def shares(self, names: Sequence[str], all_names: Sequence[str]) -> Shares:
        """Share agents among processes, by the roles of a secured run.

        `names`: the agents to host. `all_names`: those of the run.
        """
        if self.keyring is None:
            return shares(names, self.options.hosts)
        return list(self.keyring.hosts(names, all_names).items())


def agent_names(scenario: Scenario) -> list[str]:
    """Return the names of all agents of a run, sorted. Raises ScenarioError."""
    return sorted(lay_out(scenario).agents)


def shares(names: Sequence[str], hosts: int | None) -> Shares:
    """Share agents among processes: with n processes, each gets every n-th agent.

    `hosts`: how many processes; 0: one per agent; None: one per core, at most 4.
    """
    if hosts == 0:
        return [(name, [name]) for name in names]
    count = min(len(names), hosts or min(4, os.cpu_count() or 1))
    return [(f"agents {number + 1}", names[number::count]) for number in range(count)]
