"""Roles and their rights on keys, as rules that a Zenoh router enforces.

What is not allowed here is denied.

A role is what a process of one run may do, such as to host some agents. The router knows the role
by the certificate of a session, and checks each message that comes from the session (ingress) or
goes to it (egress). orchard/wire/keys.py has the kinds of keys.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, NamedTuple

from orchard.field.kinds import kind_of
from orchard.wire.keys import LIVELINESS, LOGGER, PHYSICS, QUERY, TABLE, Keys

# A role's files.
CERTIFICATE = "certificate.pem"
KEY = "key.pem"
AUTHORITY = "authority.pem"

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
    # The agents of a host, or the robots that a bridge may drive. They stand in its liveliness
    # tokens.
    names: tuple[str, ...] = ()

    @property
    def session(self) -> str:
        """The id of its Zenoh session, which some keys contain.

        It is hexadecimal, and the same in every run.
        """
        # 16 digits are an id of Zenoh, which has no leading 0.
        return "a" + hashlib.sha256(self.name.encode()).hexdigest()[:15]

    @property
    def digest(self) -> str:
        """A checksum of the role, which its certificate contains.

        So a role whose duty or names are changed in its file needs another certificate.
        """
        return hashlib.sha256(" ".join((self.name, self.duty, *self.names)).encode()).hexdigest()


# `orchard stop` has a role of its own. A session id belongs to a role, and run.py, which runs at
# the same time, uses that of the operator.
EMERGENCY_OPERATOR = "emergency-operator"
SERVANTS = (
    Role(PHYSICS, "physics", (PHYSICS,)),
    Role("router", "router"),
    Role(LOGGER, "logger", (LOGGER,)),
    Role("operator", "operator"),
    Role(EMERGENCY_OPERATOR, "emergency-operator"),
)

# -- rights


class Party(NamedTuple):
    """The roles with one duty.

    They have a right on all keys of a kind, or (`own`) only on those of their own agents or
    session.
    """

    duty: Duty
    own: bool = False


THE_PHYSICS = Party("physics")
OWN_HOST = Party("host", own=True)
ANY_HOST = Party("host")
THE_LOGGER = Party("logger")
LOGGER_ITSELF = Party("logger", own=True)
OPERATOR = Party("operator")
EMERGENCY = Party("emergency-operator")
OPERATING_BRIDGE = Party("operating-bridge")
# A bridge has rights on the keys of all bodies as the first of these, and on those of the robots
# that it may drive as the second.
BRIDGES = (Party("bridge"), OPERATING_BRIDGE)
OWN_BRIDGES = (Party("bridge", own=True), Party("operating-bridge", own=True))
AUDIENCE = (ANY_HOST, THE_LOGGER, OPERATOR, *BRIDGES)
ALL = (THE_PHYSICS, *AUDIENCE)


class Right(NamedTuple):
    """The parties at both ends of a kind of key.

    A party that hears a key may also query it, if it can be queried.
    """

    # Put, query, or declare a token.
    sends: tuple[Party, ...]
    # Subscribe, reply, or watch tokens.
    hears: tuple[Party, ...]


# Kinds of keys -> the rights on them.
_RIGHTS: dict[tuple[str, ...], Right] = {
    ("velocity",): Right(
        (OWN_HOST, *OWN_BRIDGES, THE_PHYSICS), (THE_PHYSICS, THE_LOGGER, *OWN_BRIDGES)
    ),
    ("advice",): Right((OWN_HOST, *OWN_BRIDGES), (THE_PHYSICS,)),
    ("velocities", "left", "join"): Right((OWN_HOST,), (THE_PHYSICS,)),
    ("pose", "odometry", "scan"): Right((THE_PHYSICS,), (OWN_HOST, THE_LOGGER, *BRIDGES)),
    # Hosts may not hear it: an agent must not know more than its sensors measure.
    ("truth",): Right((THE_PHYSICS,), (THE_LOGGER, *BRIDGES)),
    ("clock", "refusals", "lost", "end"): Right((THE_PHYSICS,), AUDIENCE),
    ("seen",): Right((THE_PHYSICS,), (OWN_HOST,)),
    ("mail",): Right((ANY_HOST,), (OWN_HOST,)),
    ("letters", "picture", "bundle"): Right((THE_PHYSICS,), (THE_LOGGER,)),
    ("recall",): Right((ANY_HOST,), (THE_PHYSICS,)),
    ("state",): Right((OWN_HOST,), (ANY_HOST, THE_LOGGER)),
    ("events",): Right((THE_PHYSICS,), (THE_LOGGER, OPERATOR, *BRIDGES)),
    ("figures",): Right((THE_PHYSICS,), (THE_LOGGER, OPERATOR)),
    # The counts of refused messages. A host or a logger can do no harm with them.
    ("refused",): Right((OWN_HOST, LOGGER_ITSELF), (THE_PHYSICS,)),
    # Physics asks, too, whether another run is active at its router.
    ("scenario",): Right((THE_PHYSICS, *AUDIENCE, EMERGENCY), (THE_PHYSICS,)),
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
RIGHTS = {kind: right for kinds, right in _RIGHTS.items() for kind in kinds}

# -- the Zenoh messages that a router must let through for these rights


class _Passage(NamedTuple):
    """One kind of Zenoh message in one direction, as seen by the router."""

    # "ingress" or "egress".
    flow: str
    # Zenoh's word for the kind of message.
    message: str


# What a session needs for each thing that it does on a key.
# Without this one a publisher sends nothing.
_LEARNS_SUBSCRIBERS = _Passage("egress", "declare_subscriber")
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
    """Return Zenoh's setting `access_control` for the router of these roles.

    A session has the rights of a role if its certificate and its session id are the role's.
    """
    rules = []
    subjects = []
    policies = []
    for role in roles:
        own_rules = []
        ids = []
        for passage, exprs in _allowed(role, keys).items():
            if exprs:
                rule = _rule(role.name, passage, [*dict.fromkeys(exprs)])
                own_rules.append(rule)
                ids.append(rule["id"])
        if own_rules:
            subject = {"id": role.name, "cert_common_names": [role.name], "zids": [role.session]}
            rules += own_rules
            subjects.append(subject)
            policies.append({"rules": ids, "subjects": [role.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(role: str, passage: _Passage, exprs: list[str]) -> dict[str, Any]:
    """Return the rule that lets a role's messages of one kind pass on these keys."""
    flow, message = passage
    return {
        "id": f"{role} {flow} {message}",
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": exprs,
    }


def _allowed(role: Role, keys: Keys) -> dict[_Passage, list[str]]:
    """Return the passages that a role needs, each with the keys on which it needs it."""
    allowed: dict[_Passage, list[str]] = defaultdict(list)
    for kind, party, passage in _needs(role.duty):
        if passage == _LEARNS_SUBSCRIBERS:
            # A subscriber may subscribe to the keys of all agents at once.
            allowed[passage].append(keys.of(kind))
        else:
            allowed[passage] += _exprs(kind, party, role, keys)
    return allowed


def _needs(duty: Duty) -> Iterator[tuple[str, Party, _Passage]]:
    """Yield each kind of key on which a duty has a right, its party there, and a passage."""
    for kind, right in RIGHTS.items():
        for parties, passages in zip(right, _ends(kind), strict=True):
            for party, passage in product(parties, passages):
                if party.duty == duty:
                    yield kind, party, passage


def _ends(kind: str) -> tuple[tuple[_Passage, ...], tuple[_Passage, ...]]:
    """Return the passages at both ends of a kind of key: of those that send, and that hear."""
    key = TABLE[kind]
    if key.delivery == LIVELINESS:
        return _LIVES, _WATCHES
    if key.delivery == QUERY:
        return _ASKS, _ANSWERS
    if key.replies:
        # It is published, and can be queried, too.
        return _PUTS + _ANSWERS, _SUBSCRIBES + _ASKS
    return _PUTS, _SUBSCRIBES


def _exprs(kind: str, party: Party, role: Role, keys: Keys) -> list[str]:
    """Return the keys of a kind on which a role has a right as a party."""
    if not party.own:
        return [keys.of(kind)]
    # The session in a token of the logger may be any: `orchard` puts the run's id in its place.
    names_a_session = role.duty == "host" or kind != "alive"
    if names_a_session:
        session = role.session
    else:
        session = "*"
    names = list(role.names)
    if "{bin}" in TABLE[kind].template:
        names = [name for name in names if kind_of(name) == "bin"]
    return [keys.of(kind, name, session) for name in names]
