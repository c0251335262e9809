"""Makes a directory with all that a secured run takes: an authority, and for each role a directory that can be carried elsewhere.

DIR/authority/   the authority's own key: who has it can make certificates for anybody
DIR/<role>/      role.json, certificate.pem, key.pem, authority.pem; the router's and physics' also access.json
"""

import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

from orchard.field.kinds import select_agents
from orchard.security.identity import ACCESS, ROLE, certificates
from orchard.security.roles import CERTIFICATE, SERVANTS, Role, access_control
from orchard.wire.keys import PREFIX, Keys

HOME = "authority"  # the authority's own directory
LOCAL = ("127.0.0.1", "::1", "localhost")  # by which a machine always reaches itself
_NAME = re.compile(r"[a-z][a-z0-9_-]{0,31}")


def make(folder: Path, hosts: Iterable[Role], addresses: Sequence[str], days: float, anew: bool = False) -> list[Role]:
    """Write everything; the roles. Raises ValueError where there is an authority already, unless it shall be made anew."""
    known = certificates()
    roles = [*SERVANTS, *hosts]
    _check_names(roles)
    for text in addresses:
        known.address(text)
    _make_room(folder, anew)
    authority = known.Authority.begin(days)
    authority.write(folder / HOME)
    rules = json.dumps(access_control(roles, Keys(PREFIX)), indent=1)
    for role in roles:
        serves = role.duty in ("physics", "router")
        authority.vouch(role.name, folder / role.name, (*LOCAL, *addresses) if serves else ())
        (folder / role.name / ROLE).write_text(json.dumps(asdict(role) | {"session": role.session}, indent=1))
        if serves:
            (folder / role.name / ACCESS).write_text(rules)
    return roles


Shares = Callable[[Sequence[str]], Iterable[tuple[str, Sequence[str]]]]


def host_roles(names: Sequence[str], wishes: Iterable[str], shares: Shares) -> list[Role]:
    """Those wished for, each as NAME=KIND|AGENT,...; and one for each share of the names that are left."""
    roles: list[Role] = []
    for wish in wishes:
        name, _, words = wish.partition("=")
        if not words:
            raise ValueError(f"{wish}: wanted is NAME=KIND|AGENT,...; like shed=carrier,bin_01")
        roles.append(Role(name, "host", tuple(select_agents(names, words.split(","), []))))
    taken = {name for role in roles for name in role.names}
    rest = [name for name in names if name not in taken]
    return roles + [Role(title.replace(" ", "_"), "host", tuple(share)) for title, share in shares(rest) if share]


def _check_names(roles: Sequence[Role]) -> None:
    """Each role has a name of its own, which is a file's name as well, and each agent is in one host's hands."""
    for role in roles:
        if not _NAME.fullmatch(role.name) or role.name == HOME:
            raise ValueError(f"{role.name}: not a name for a role; letters a to z, digits, _ and -, and a letter first")
    _refuse_repeats([role.name for role in roles], "is the name of two roles")
    _refuse_repeats([name for role in roles for name in role.names], "is in two roles; one agent has one host")


def _refuse_repeats(words: Sequence[str], why: str) -> None:
    for word, times in Counter(words).items():
        if times > 1:
            raise ValueError(f"{word} {why}")


def _make_room(folder: Path, anew: bool) -> None:
    """An empty directory for the owner's eyes only; `anew` takes away what an earlier call made there."""
    made = [path for path in folder.glob("*/") if _is_ours(path)] if folder.is_dir() else []
    if made and not anew:
        raise ValueError(f"{folder}: there is an authority already; --anew makes another, and its certificates worthless")
    if folder.exists() and not set(folder.iterdir()) <= set(made):
        raise ValueError(f"{folder}: there is something else in it; wanted is a directory that is empty or not there yet")
    for path in made:
        shutil.rmtree(path)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)


def _is_ours(path: Path) -> bool:
    return (path / ROLE).is_file() or (path.name == HOME and (path / CERTIFICATE).is_file())
