"""How the processes of a run are let in: as they are, or each with the files of its role."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from orchard.security.identity import Identity, Keyring

Shares = list[tuple[str, Sequence[str]]]  # (name of an agent process, which agents it hosts)


class Credentials(Protocol):
    """What whoever starts the processes must know of it."""

    protocol: str  # with which an endpoint begins

    def identity(self, role: str) -> Identity | None: ...
    def option(self, role: str) -> list[str]: ...
    def shares(self, names: Sequence[str], everybody: Sequence[str]) -> Shares: ...


class OpenRun:
    """Whoever comes is let in."""

    protocol = "tcp"

    def __init__(self, hosts: int | None) -> None:
        self._hosts = hosts

    def identity(self, role: str) -> None:
        return None

    def option(self, role: str) -> list[str]:
        """What a process with this role is told."""
        return []

    def shares(self, names: Sequence[str], everybody: Sequence[str]) -> Shares:
        """The agents of this machine, shared among its agent processes."""
        return shares(names, self._hosts)


class SecuredRun:
    """Who has a role is let in, for what that role may do."""

    protocol = "tls"

    def __init__(self, folder: Path) -> None:
        self._keyring = Keyring.load(folder)

    @property
    def only_role(self) -> str:
        """On a machine that runs one role. Raises ValueError where the directory is that of a whole run."""
        roles = list(self._keyring.roles)
        if len(roles) > 1:
            raise ValueError(f"{self._keyring.folder}: there are {len(roles)} roles in it; with --only name the one to play, as DIR/<role>")
        return roles[0]

    def identity(self, role: str) -> Identity:
        return self._keyring.of(role)

    def option(self, role: str) -> list[str]:
        return ["--secure", str(self.identity(role).folder)]

    def shares(self, names: Sequence[str], everybody: Sequence[str]) -> Shares:
        return list(self._keyring.hosts(names, everybody).items())


def credentials_of(folder: Path | None, hosts: int | None) -> OpenRun | SecuredRun:
    """Those of a directory, if there is one. Raises ValueError where it is of no use."""
    return OpenRun(hosts) if folder is None else SecuredRun(folder)


def shares(names: Sequence[str], hosts: int | None) -> Shares:
    """So many agent processes; 0: one for each agent; None: one a core, at most 4."""
    if hosts == 0:
        return [(name, [name]) for name in names]
    count = min(len(names), hosts or min(4, os.cpu_count() or 1))
    return [(f"agents {i + 1}", names[i::count]) for i in range(count)]
