"""The settings of a run, and the credentials with which its processes are started."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.net.lockstep import PATIENCE
from orchard.security.identity import Identity, Keyring
from orchard.sim.snapshot import Snapshot


@dataclass(frozen=True)
class RunRequest:
    """The settings of a run."""

    scenario: Scenario
    mode: str
    speed: float  # simulated s per s of wall time; infinity: as fast as possible
    hosts: int | None  # agent processes; 0: one per agent; None: one per core, at most 4
    duration: float | None  # s, simulated
    recording: Path | None
    view: bool
    snapshots: Path  # the folder for snapshots
    resumed: Snapshot | None = None  # the snapshot from which the run is resumed
    listen: str | None = None  # endpoint at which other processes may join; None: a free port of 127.0.0.1
    connect: str | None = None  # endpoint of another router, which all processes use
    without: tuple[str, ...] = ()  # kinds and names of agents that other processes run
    patience: float = PATIENCE  # s of wall time that lockstep waits for a silent agent
    secure: Path | None = None  # the directory of `run.py secure`
    web: int | None = None  # port of the web viewer
    as_json: bool = False  # whether progress is printed as JSON
    notes: Path | None = None  # folder for the note with which `run.py stop` finds the run; None: no note

    @property
    def is_live(self) -> bool:
        """Whether the run is watched live."""
        return self.view or self.web is not None

    @cached_property
    def data_port(self) -> int:
        """The port of the live data: the port after that of the web viewer, or a free one."""
        return free_port() if self.web is None else self.web + 1

    @property
    def uri(self) -> str:
        """The address of the live data, for a viewer."""
        return f"rerun+http://127.0.0.1:{self.data_port}/proxy"


Shares = list[tuple[str, Sequence[str]]]  # (name of an agent process, the agents that it hosts)


class Credentials(Protocol):
    """What the processes of a run need to connect, and how its agents are shared among processes."""

    protocol: str  # the first part of an endpoint

    def identity(self, role: str) -> Identity | None: ...
    def option(self, role: str) -> list[str]: ...
    def shares(self, names: Sequence[str], all_names: Sequence[str]) -> Shares: ...


class OpenRun:
    """The credentials of an open run, which admits every client."""

    protocol = "tcp"

    def __init__(self, hosts: int | None) -> None:
        self._hosts = hosts

    def identity(self, role: str) -> None:
        return None

    def option(self, role: str) -> list[str]:
        """Return the command line options of a process with this role."""
        return []

    def shares(self, names: Sequence[str], all_names: Sequence[str]) -> Shares:
        """Return the shares of this machine's agent processes."""
        return shares(names, self._hosts)


class SecuredRun:
    """The credentials of a secured run: each client has a role, and may do only what that role allows."""

    protocol = "tls"

    def __init__(self, folder: Path) -> None:
        self._keyring = Keyring.load(folder)

    @property
    def only_role(self) -> str:
        """The role of a directory that has only one. Raises ValueError if it has several."""
        roles = list(self._keyring.roles)
        if len(roles) > 1:
            raise ValueError(f"{self._keyring.folder}: it has {len(roles)} roles; with --only choose one of them: DIR/<role>")
        return roles[0]

    def identity(self, role: str) -> Identity:
        return self._keyring.of(role)

    def option(self, role: str) -> list[str]:
        return ["--secure", str(self.identity(role).folder)]

    def shares(self, names: Sequence[str], all_names: Sequence[str]) -> Shares:
        return list(self._keyring.hosts(names, all_names).items())


def credentials_of(folder: Path | None, hosts: int | None) -> OpenRun | SecuredRun:
    """Return the credentials of a run. `folder`: the directory of a secured run, or None. Raises ValueError if it has no roles."""
    return OpenRun(hosts) if folder is None else SecuredRun(folder)


def shares(names: Sequence[str], hosts: int | None) -> Shares:
    """Share agents among processes. `hosts`: the number of processes; 0: one per agent; None: one per core, at most 4."""
    if hosts == 0:
        return [(name, [name]) for name in names]
    count = min(len(names), hosts or min(4, os.cpu_count() or 1))
    return [(f"agents {i + 1}", names[i::count]) for i in range(count)]
