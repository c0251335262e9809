"""Damaged messages that no receiver of a run may accept, made of recorded ones."""

import itertools
import random
from collections.abc import Iterator

from recorded_messages import mutants, rewritten

from orchard.net.refusals import Refused, read_message
from orchard.wire.keys import TABLE
from orchard.wire.messages import VelocityParts

RUN = "run1"
# Queries without a payload.
EMPTY = ("state", "simulation_state", "scenario", "layout")


def would_be_accepted(what: str, payload: bytes) -> bool:
    """Whether a receiver of this run could take a payload for a message of a kind.

    `what`: the kind, a key of `orchard.wire.keys.TABLE`.
    """
    if what in EMPTY and not payload:
        return True
    # The good parts of a sender count, even if its other parts are malformed.
    if what == "velocities" and not refusal_of(payload, VelocityParts, RUN):
        return True
    types = [type_ for type_ in (TABLE[what].message, *TABLE[what].replies) if type_ is not None]
    return any(not refusal_of(payload, type_, RUN) for type_ in types)


def refusal_of(payload: bytes, type_: type, run: str) -> str:
    """Return why a payload is refused as a message of a type in a run; "" if it is accepted."""
    try:
        read_message(payload, type_, run)
    except Refused as refusal:
        return refusal.reason
    return ""


def bad_messages(messages, what: str, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield (key, payload) of `count` bad messages of a kind.

    They are mutants of each recorded message in turn: once as it is, of another run, and once
    rewritten as one of RUN.
    """
    chance = random.Random(f"{what} {seed}")
    endless = [
        (key, mutants(original, chance))
        for key, payload in messages[what]
        for original in (payload, rewritten(payload, run=RUN))
    ]
    candidates = ((key, next(payloads)) for key, payloads in itertools.cycle(endless))
    # Some mutants are still good messages, such as one in which only an id has changed.
    refused = (
        (key, payload) for key, payload in candidates if not would_be_accepted(what, payload)
    )
    return itertools.islice(refused, count)
