"""Who one is in a secured run: a role's directory, or several, as `run.py secure` made them."""

import importlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from orchard.security.roles import Role
from orchard.wire.keys import PREFIX

ROLE, ACCESS = "role.json", "access.json"  # a role's files


@dataclass(frozen=True)
class Identity:
    """Who one is in a secured run, and the files that prove it."""

    role: Role
    folder: Path

    @classmethod
    def load(cls, folder: Path) -> "Identity":
        """A role's directory. Raises ValueError, with what is wrong, where it is of no use."""
        identity = cls(role_in(folder), folder.resolve())
        certificates().check(folder, identity.role.name)
        return identity

    def rules(self) -> Any:
        """What a router lets through: Zenoh's access_control. Raises ValueError where this role is not to route."""
        if not (self.folder / ACCESS).is_file():
            raise ValueError(f"{self.folder}: {self.role.name} is not for listening; that is for the roles physics and router")
        return json.loads((self.folder / ACCESS).read_text())


def identity_in(folder: str | None, prefix: str) -> Identity | None:
    """A role's directory, as an option of a process names it; None without one. Raises ValueError where it is of no use."""
    if folder is None:
        return None
    if prefix != PREFIX:
        raise ValueError(f"prefix {prefix}: the rules of a secured run are about {PREFIX}, the default")
    return Identity.load(Path(folder))


def certificates() -> ModuleType:
    """What knows of certificates. Who runs without security does without the package behind it."""
    try:
        return importlib.import_module("orchard.security.certificates")
    except ImportError as error:
        raise ValueError(f"{error.name} is missing, which certificates take: pip install 'orchard[secure]'") from error


def role_in(folder: Path) -> Role:
    path = folder / ROLE
    try:
        data = json.loads(path.read_text())
        return Role(data["name"], data["duty"], tuple(data["names"]))
    except FileNotFoundError:
        raise ValueError(f"{folder}: not the directory of a role: no {ROLE}; `run.py secure DIR` makes them, as DIR/<role>") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: not as `run.py secure` wrote it: {error}") from error


@dataclass(frozen=True)
class Keyring:
    """The roles whose directories are at hand: all of a run's, or a single one on a machine that has no more."""

    folder: Path
    roles: dict[str, Path]

    @classmethod
    def load(cls, folder: Path) -> "Keyring":
        """From the directory that `run.py secure` made, or from that of one role. Raises ValueError where it is neither."""
        if (folder / ROLE).is_file():
            return cls(folder, {role_in(folder).name: folder})
        roles = {path.parent.name: path.parent for path in sorted(folder.glob(f"*/{ROLE}"))}
        if not roles:
            raise ValueError(f"{folder}: no roles there; `run.py secure {folder}` makes them")
        return cls(folder, roles)

    def of(self, name: str) -> Identity:
        """One role by its name."""
        if name not in self.roles:
            raise ValueError(f"{self.folder}: the role {name} is not in it; there is {', '.join(self.roles)}")
        return Identity.load(self.roles[name])

    def hosts(self, names: Iterable[str], everybody: Iterable[str]) -> dict[str, list[str]]:
        """Role -> which of these agents it hosts. Raises ValueError where some have no role, or a role is to be torn apart."""
        wanted, there = set(names), set(everybody)
        hosts = {name: sorted(set(role_in(folder).names) & there) for name, folder in self.roles.items() if role_in(folder).duty == "host"}
        hosts = {name: its for name, its in hosts.items() if wanted & set(its)}
        for name, its in hosts.items():
            if not wanted >= set(its):
                raise ValueError(f"{name} is the role of {', '.join(its)}: one process hosts them all, or another machine does")
        if left := sorted(wanted.difference(*hosts.values())):
            raise ValueError(f"{self.folder}: no role for {', '.join(left)}; was it made for another scenario? See `run.py secure --help`")
        return hosts
