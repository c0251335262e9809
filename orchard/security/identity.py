"""A role's directory: how it is made, and what identity a process has with it.

`orchard secure` makes a directory for each role of a run (`make`). A process loads its own one
(`identity_in`), and `orchard --secure` loads all (`Keyring`). `why_no_trust` tells why two
processes cannot connect.
"""

import importlib
import json
import logging
import re
import socket
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from orchard.field.kinds import select_agents
from orchard.folders import regular
from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY, SERVANTS, Duty, Role, access_control
from orchard.wire.keys import PREFIX, Keys

log = logging.getLogger("orchard")

# A role's files: what it is, and, of a router, what it lets through.
ROLE = "role.json"
ACCESS = "access.json"
# The word for what a bridge may control beside robots: pause, steps and reset of the simulation.
SIMULATION = "simulation"
# The authority's own directory.
HOME = "authority"
# All that is in these directories.
FILES = (ROLE, ACCESS, CERTIFICATE, KEY, AUTHORITY)
# Addresses by which each machine reaches itself.
LOCAL = ("127.0.0.1", "::1", "localhost")
# s that the other side has for each step, when a process finds out why it cannot connect.
SECONDS = 3.0
# At most 64 characters, as the name of an agent and as a name in a certificate.
_NAME = re.compile(r"[a-z][a-z0-9_-]{0,63}")


@dataclass(frozen=True)
class Identity:
    """A role in a secured run, and the directory of the files that prove it."""

    role: Role
    folder: Path

    @classmethod
    def load(cls, folder: Path) -> "Identity":
        """Load a role's directory.

        Raises ValueError, with the reason, if its files are not valid.
        """
        identity = cls(role_in(folder), folder.resolve())
        certificates().check(folder, identity.role)
        _check_mode(identity.folder / KEY, (folder / KEY).stat().st_mode & 0o777)
        return identity

    def rules(self) -> Any:
        """Return what a router lets through, as Zenoh's setting `access_control`.

        Raises ValueError if this role may not listen, or if its file would let all through.
        """
        if not (self.folder / ACCESS).is_file():
            raise ValueError(
                f"{self.folder}: the role {self.role.name} may not listen; only physics and "
                "router may"
            )
        path = self.folder / ACCESS
        try:
            rules = json.loads(regular(path).read_text())
            denies = (
                rules["enabled"] is True
                and rules["default_permission"] == "deny"
                and bool(rules["subjects"])
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path}: not as `orchard secure` wrote it: {type(error).__name__}: {error}"
            ) from error
        if not denies:
            raise ValueError(
                f"{path}: these rules let all sessions do all things; `orchard secure --anew` "
                "makes new ones"
            )
        return rules


# Its cache lets it log each key once.
@cache
def _check_mode(key: Path, mode: int) -> None:
    """Log that other users can read a private key, if they can. `mode`: that of its file."""
    if mode & 0o077:
        log.warning(
            "%s: other users can read this private key (mode %03o), and so take the role; run: "
            "chmod 600 %s",
            key,
            mode,
            key,
        )


def identity_in(folder: str | None, prefix: str) -> Identity | None:
    """Return the identity in a directory; None without one.

    Raises ValueError if it is not valid.
    """
    if folder is None:
        return None
    if prefix != PREFIX:
        raise ValueError(
            f"prefix {prefix}: the rules of a secured run are for {PREFIX}, the default"
        )
    return Identity.load(Path(folder))


def certificates() -> ModuleType:
    """Return the module `certificates`.

    Raises ValueError if the package that it needs is missing: only secured runs need that.
    """
    try:
        return importlib.import_module("orchard.security.certificates")
    except ImportError as error:
        raise ValueError(
            f"{error.name} is missing; certificates need it: pip install 'orchard-sim[secure]'"
        ) from error


def role_in(folder: Path) -> Role:
    """Return the role of a directory.

    Raises ValueError if the directory has no role, or a malformed one.
    """
    path = folder / ROLE
    try:
        data = json.loads(regular(path).read_text())
        return Role(data["name"], data["duty"], tuple(data["names"]))
    except FileNotFoundError:
        makes = "`orchard secure DIR` makes them, as DIR/<role>"
        raise ValueError(
            f"{folder}: not the directory of a role: no {ROLE} in it; {makes}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: not as `orchard secure` wrote it: {error}") from error


@dataclass(frozen=True)
class Keyring:
    """The roles that have a directory on this machine: all roles of a run, or a single one."""

    folder: Path
    # Name of a role -> its directory.
    roles: dict[str, Path]

    @classmethod
    def load(cls, folder: Path) -> "Keyring":
        """Load the directory that `orchard secure` made, or that of one role.

        Raises ValueError if it is neither.
        """
        if (folder / ROLE).is_file():
            return cls(folder, {role_in(folder).name: folder})
        roles = {path.parent.name: path.parent for path in sorted(folder.glob(f"*/{ROLE}"))}
        if not roles:
            raise ValueError(f"{folder}: no roles there; `orchard secure {folder}` makes them")
        return cls(folder, roles)

    def of(self, name: str) -> Identity:
        """Return the identity of a role.

        Raises ValueError if there is no such role, or its files are not valid.
        """
        if name not in self.roles:
            raise ValueError(
                f"{self.folder}: the role {name} is not in it; it has {', '.join(self.roles)}"
            )
        return Identity.load(self.roles[name])

    def hosts(self, names: Iterable[str], agents: Iterable[str]) -> dict[str, list[str]]:
        """Return role -> the agents that it hosts, of those that are hosted here.

        `names`: the agents that are hosted here. `agents`: all of the run. Raises ValueError if an
        agent has no role, or if `names` has only some of a role's agents.
        """
        wanted = set(names)
        known = set(agents)
        hosts = {}
        for name, folder in self.roles.items():
            role = role_in(folder)
            of_role = sorted(set(role.names) & known)
            if role.duty == "host" and wanted & set(of_role):
                hosts[name] = of_role
        for name, of_role in hosts.items():
            elsewhere = sorted(set(of_role) - wanted)
            if elsewhere:
                raise ValueError(
                    f"{name} is the role of {', '.join(of_role)}: one process hosts them all, here "
                    "or on another machine; "
                    f"`orchard secure --role NAME={','.join(elsewhere)}` gives "
                    "the others a role of their own"
                )
        left = sorted(wanted.difference(*hosts.values()))
        if left:
            raise ValueError(
                f"{self.folder}: no role for {', '.join(left)}; was it made for another "
                "scenario? See `orchard secure --help`"
            )
        return hosts


def why_no_trust(endpoint: str, folder: Path) -> str:
    """Return why this process and the one that listens at tls/host:port do not accept each other.

    It connects by TLS alone, without Zenoh, to find out. It returns '' for other faults. `folder`:
    the directory of this process's role.
    """
    # It is imported here, because it takes a tenth of a process's start.
    import ssl

    host, _, port = endpoint.partition("/")[2].rpartition(":")
    trust = ssl.create_default_context(cafile=folder / AUTHORITY)
    trust.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    host = host.strip("[]")
    try:
        with (
            socket.create_connection((host, int(port)), SECONDS) as plain,
            trust.wrap_socket(plain, server_hostname=host) as secured,
        ):
            try:
                # The other side reports on this side's certificate only after the handshake.
                secured.recv(1)
            except TimeoutError:
                return (
                    "the session is refused, although the certificates are valid; does another "
                    "process use this role already?"
                )
    except ssl.SSLCertVerificationError as error:
        return (
            f"{folder / AUTHORITY} does not verify the certificate of the process that listens "
            f"there: {error.verify_message}"
        )
    except ssl.SSLError as error:
        reason = (error.reason or str(error)).replace("_", " ").lower()
        return (
            "the process that listens there does not speak TLS, or does not accept the "
            f"certificate in {folder}: {reason}"
        )
    except (OSError, ValueError):
        pass
    return ""


def make(
    folder: Path, clients: Iterable[Role], addresses: Sequence[str], days: float, anew: bool = False
) -> list[Role]:
    """Write the authority and all roles, valid for `days` days. Return the roles.

    `clients`: the roles of hosts and bridges. `addresses`: at which physics or a router listens,
    beside those of this machine to itself.

    Raises ValueError for a malformed name or address, for a directory with other files, and for one
    with an authority unless `anew`.
    """
    known = certificates()
    roles = [*SERVANTS, *clients]
    _check_names(roles)
    for text in addresses:
        known.address(text)
    _make_room(folder, anew)
    authority = known.Authority.begin(days)
    authority.write(folder / HOME)
    rules = json.dumps(access_control(roles, Keys(PREFIX)), indent=1)
    for role in roles:
        serves = role.duty in ("physics", "router")
        own_addresses: Sequence[str] = ()
        if serves:
            own_addresses = (*LOCAL, *addresses)
        authority.vouch(role, folder / role.name, own_addresses)
        (folder / role.name / ROLE).write_text(
            json.dumps(asdict(role) | {"session": role.session}, indent=1)
        )
        if serves:
            (folder / role.name / ACCESS).write_text(rules)
    return roles


# Splits agents among hosts: names -> (role, its agents) of each.
Shares = Callable[[Sequence[str]], Iterable[tuple[str, Sequence[str]]]]


def host_roles(names: Sequence[str], wishes: Iterable[str], shares: Shares) -> list[Role]:
    """Return a role for each wish NAME=KIND|AGENT,..., and for each share of the rest.

    Raises ValueError.
    """
    roles: list[Role] = []
    for wish in wishes:
        name, _, words = wish.partition("=")
        if not words:
            raise ValueError(f"{wish}: expected NAME=KIND|AGENT,..., such as shed=carrier,bin_01")
        roles.append(Role(name, "host", tuple(select_agents(names, words.split(","), []))))
    taken: set[str] = set()
    for role in roles:
        taken.update(role.names)
    rest = [name for name in names if name not in taken]
    for title, share in shares(rest):
        if share:
            roles.append(Role(title.replace(" ", "_"), "host", tuple(share)))
    return roles


def bridge_roles(names: Sequence[str], wishes: Iterable[str]) -> list[Role]:
    """Return a role for each wish NAME[=KIND|AGENT|simulation,...]: the bridge's name, and what it
    may drive.

    Raises ValueError.
    """
    roles = []
    for wish in wishes:
        name, _, words = wish.partition("=")
        listed: list[str] = []
        if words:
            listed = words.split(",")
        roles.append(_bridge_role(names, name, listed))
    return roles


def _bridge_role(names: Sequence[str], name: str, words: Sequence[str]) -> Role:
    """Return the role of a bridge. `words`: kinds, agents or "simulation", which it may drive."""
    robots = [word for word in words if word != SIMULATION]
    if SIMULATION in words:
        duty: Duty = "operating-bridge"
    else:
        duty = "bridge"
    if not robots:
        return Role(name, duty, ())
    return Role(name, duty, tuple(select_agents(names, robots, [])))


def _check_names(roles: Sequence[Role]) -> None:
    """Raise ValueError for a malformed or repeated name, or an agent in two roles of hosts."""
    for role in roles:
        if not _NAME.fullmatch(role.name):
            raise ValueError(
                f"{role.name}: not a name for a role; use up to 64 letters a to z, digits, _ "
                "and -, with a letter first"
            )
        if role.name == HOME:
            raise ValueError(
                f"{HOME}: not a name for a role; the directory of this name is for the "
                "authority's own key"
            )
    _refuse_repeats([role.name for role in roles], "is the name of two roles")
    hosted: list[str] = []
    for role in roles:
        if role.duty == "host":
            hosted += role.names
    _refuse_repeats(hosted, "is in two roles; an agent has one host")


def _refuse_repeats(words: Sequence[str], why: str) -> None:
    """Raise ValueError if a word is repeated. `why`: what is said of it."""
    for word, times in Counter(words).items():
        if times > 1:
            raise ValueError(f"{word} {why}")


def _make_room(folder: Path, anew: bool) -> None:
    """Make an empty directory that only its owner can read.

    With `anew`, remove what an earlier call made there. Raises ValueError if anything else is
    there.
    """
    made = [path for path in folder.glob("*") if _is_made_here(path)]
    if made and not anew:
        raise ValueError(
            f"{folder}: it has an authority already; --anew replaces it, and makes the old "
            "certificates invalid"
        )
    others: list[Path] = []
    if folder.exists():
        others = sorted(set(folder.iterdir()) - set(made))
    if others:
        raise ValueError(
            f"{folder}: it has other files, such as {others[0].name}; "
            "expected a directory that is empty or does not exist yet"
        )
    _refuse_additions(made)
    for path in made:
        for file in path.iterdir():
            file.unlink()
        path.rmdir()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)


def _is_made_here(path: Path) -> bool:
    """Whether a path is the directory of a role, under its own name, or that of an authority."""
    if path.is_symlink() or not path.is_dir():
        return False
    if path.name == HOME:
        return (path / CERTIFICATE).is_file()
    try:
        return role_in(path).name == path.name
    except ValueError:
        return False


def _refuse_additions(directories: Iterable[Path]) -> None:
    """Raise ValueError if these directories hold more than `make` writes."""
    for path in directories:
        for file in sorted(path.iterdir()):
            if file.name not in FILES or not file.is_file():
                raise ValueError(
                    f"{file}: `orchard secure` did not make it, and --anew would remove it; "
                    "move it elsewhere first"
                )
