"""Roles and their rights on keys, as rules that a Zenoh router enforces. What is not allowed here is denied.

A role is a kind of process of one run. The router knows it by a session's certificate, and checks each message that comes from the
session (ingress) or goes to it (egress).
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from orchard.field.kinds import kind_of
from orchard.wire.keys import LIVELINESS, LOGGER, PHYSICS, QUERY, TABLE, Keys

CERTIFICATE, KEY, AUTHORITY = "certificate.pem", "key.pem", "authority.pem"  # a role's files

Duty = Literal[
    "physics",
    "router",
    "host",
    "logger",
    "operator",
    "emergency-operator",
    "bridge",
    "operating-bridge",
]

# -- roles


@dataclass(frozen=True)
class Role:
    """What a process with one certificate is for."""

    name: str
    duty: Duty
    names: tuple[
        str, ...
    ] = ()  # in its liveliness tokens: a host's agents; the robots that a bridge may drive

    @property
    def session(self) -> str:
        """The id of its Zenoh session, which some keys contain: hexadecimal, the same in every run."""
        return (
            "a" + hashlib.sha256(self.name.encode()).hexdigest()[:15]
        )  # Zenoh allows no leading 0

    @property
    def digest(self) -> str:
        """What its certificate says beside its name: a role with another duty or names needs another certificate."""
        return hashlib.sha256(" ".join((self.name, self.duty, *self.names)).encode()).hexdigest()


EMERGENCY_OPERATOR = (
    "emergency-operator"  # a role of its own, because run.py already uses the operator's
)
SERVANTS = (
    Role(PHYSICS, "physics", (PHYSICS,)),
    Role("router", "router"),
    Role(LOGGER, "logger", (LOGGER,)),
    Role("operator", "operator"),
    Role(EMERGENCY_OPERATOR, "emergency-operator"),
)

# -- rights


class Party(NamedTuple):
    """The roles with one duty, on all keys of a kind, or (`own`) only on those of their own agents or session."""

    duty: Duty
    own: bool = False


THE_PHYSICS = Party("physics")
OWN_HOST, ANY_HOST = Party("host", own=True), Party("host")
THE_LOGGER, LOGGER_ITSELF = Party("logger"), Party("logger", own=True)
OPERATOR, EMERGENCY = Party("operator"), Party("emergency-operator")
OPERATING_BRIDGE = Party("operating-bridge")
BRIDGES = (Party("bridge"), OPERATING_BRIDGE)  # they see all bodies
OWN_BRIDGES = (Party("bridge", own=True), Party("operating-bridge", own=True))
AUDIENCE = (ANY_HOST, THE_LOGGER, OPERATOR, *BRIDGES)
ALL = (THE_PHYSICS, *AUDIENCE)


class Right(NamedTuple):
    """The parties at both ends of a kind of key. Who hears a key that is also queried may query it."""

    sends: tuple[Party, ...]  # put, query, or declare a token
    hears: tuple[Party, ...]  # subscribe, reply, or watch tokens


_RIGHTS: dict[tuple[str, ...], Right] = {  # by kinds of keys
    ("velocity",): Right(
        (OWN_HOST, *OWN_BRIDGES, THE_PHYSICS), (THE_PHYSICS, THE_LOGGER, *OWN_BRIDGES)
    ),
    ("advice",): Right((OWN_HOST, *OWN_BRIDGES), (THE_PHYSICS,)),
    ("velocities", "left", "join"): Right((OWN_HOST,), (THE_PHYSICS,)),
    ("pose", "odometry", "scan"): Right((THE_PHYSICS,), (OWN_HOST, THE_LOGGER, *BRIDGES)),
    ("truth",): Right((THE_PHYSICS,), (THE_LOGGER, *BRIDGES)),  # no agent can peep
    ("clock", "refusals", "lost", "end"): Right((THE_PHYSICS,), AUDIENCE),
    ("seen",): Right((THE_PHYSICS,), (OWN_HOST,)),
    ("mail",): Right((ANY_HOST,), (OWN_HOST,)),
    ("letters", "picture", "bundle"): Right((THE_PHYSICS,), (THE_LOGGER,)),
    ("recall",): Right((ANY_HOST,), (THE_PHYSICS,)),
    ("state",): Right((OWN_HOST,), (ANY_HOST, THE_LOGGER)),
    ("events",): Right((THE_PHYSICS,), (THE_LOGGER, OPERATOR, *BRIDGES)),
    ("figures",): Right((THE_PHYSICS,), (THE_LOGGER, OPERATOR)),
    ("refused",): Right((OWN_HOST, LOGGER_ITSELF), (THE_PHYSICS,)),  # a count, which moves nothing
    ("scenario",): Right((*AUDIENCE, EMERGENCY), (THE_PHYSICS,)),
    ("layout",): Right(AUDIENCE, (THE_PHYSICS,)),
    ("stop",): Right((OPERATOR, EMERGENCY), (THE_PHYSICS,)),
    ("simulation_state",): Right((THE_PHYSICS,), (*AUDIENCE, EMERGENCY)),
    ("set_simulation_state", "step_simulation"): Right(
        (OPERATOR, EMERGENCY, OPERATING_BRIDGE), (THE_PHYSICS,)
    ),
    ("reset_simulation",): Right((OPERATOR, OPERATING_BRIDGE), (THE_PHYSICS,)),
    ("alive",): Right((OWN_HOST, LOGGER_ITSELF), ALL),
    ("physics",): Right((THE_PHYSICS,), ALL),
}
RIGHTS = {what: right for kinds, right in _RIGHTS.items() for what in kinds}

# -- the Zenoh messages that a router must let through for these rights


class _Passage(NamedTuple):
    """One kind of Zenoh message in one direction, as seen by the router."""

    flow: str
    message: str


_LEARNS_SUBSCRIBERS = _Passage("egress", "declare_subscriber")  # or a publisher sends nothing
_PUTS = (_Passage("ingress", "put"), _LEARNS_SUBSCRIBERS)
_SUBSCRIBES = (_Passage("ingress", "declare_subscriber"), _Passage("egress", "put"))
_ASKS = (_Passage("ingress", "query"), _Passage("egress", "reply"))
_ANSWERS = (
    _Passage("ingress", "declare_queryable"),
    _Passage("egress", "query"),
    _Passage("ingress", "reply"),
)
_LIVES = (_Passage("ingress", "liveliness_token"),)
_WATCHES = (
    _Passage("ingress", "declare_liveliness_subscriber"),
    _Passage("egress", "liveliness_token"),
)


def access_control(roles: Iterable[Role], keys: Keys) -> dict[str, Any]:
    """Return Zenoh's `access_control` for the router of these roles: rights by certificate and session id."""
    rules, subjects, policies = [], [], []
    for role in roles:
        its = [
            _rule(role.name, passage, [*dict.fromkeys(exprs)])
            for passage, exprs in _allowed(role, keys).items()
            if exprs
        ]
        if its:
            rules += its
            subjects.append(
                {"id": role.name, "cert_common_names": [role.name], "zids": [role.session]}
            )
            policies.append({"rules": [rule["id"] for rule in its], "subjects": [role.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(role: str, passage: _Passage, exprs: list[str]) -> dict[str, Any]:
    flow, message = passage
    return {
        "id": f"{role} {flow} {message}",
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": exprs,
    }


def _allowed(role: Role, keys: Keys) -> dict[_Passage, list[str]]:
    allowed: dict[_Passage, list[str]] = defaultdict(list)
    for what, right in RIGHTS.items():
        for parties, passages in zip(right, _ends(what), strict=True):
            for party in parties:
                if party.duty == role.duty:
                    for passage in passages:
                        allowed[passage] += (
                            _exprs(what, party, role, keys)
                            if passage != _LEARNS_SUBSCRIBERS
                            else [keys.of(what)]
                        )
    return allowed


def _ends(what: str) -> tuple[tuple[_Passage, ...], tuple[_Passage, ...]]:
    key = TABLE[what]
    if key.delivery == LIVELINESS:
        return _LIVES, _WATCHES
    if key.delivery == QUERY:
        return _ASKS, _ANSWERS
    return (_PUTS + _ANSWERS, _SUBSCRIBES + _ASKS) if key.replies else (_PUTS, _SUBSCRIBES)


def _exprs(what: str, party: Party, role: Role, keys: Keys) -> list[str]:
    if not party.own:
        return [keys.of(what)]
    session = (
        role.session if role.duty == "host" or what != "alive" else "*"
    )  # the logger's may name the run
    names = [
        name for name in role.names if kind_of(name) == "bin" or "{bin}" not in TABLE[what].template
    ]
    return [keys.of(what, name, session) for name in names]
