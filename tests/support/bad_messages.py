"""Bad messages: damaged ones, of another run and of this one, and none that make sense."""

import itertools
import random

from recorded_messages import mutants, rewritten

from orchard.net.refusals import Refused, read_message
from orchard.wire.keys import TABLE
from orchard.wire.messages import VelocityParts

RUN = "run1"
EMPTY = ("state", "simulation_state", "scenario", "layout")  # queries without a payload


def make_sense(what: str, payload: bytes) -> bool:
    """Whether it is a message of this run: those are not thrown."""
    if what == "velocities" and not refusal_of(payload, VelocityParts, RUN):
        return True  # each part counts by itself
    types = [type_ for type_ in (TABLE[what].message, *TABLE[what].replies) if type_ is not None]
    return any(not refusal_of(payload, type_, RUN) for type_ in types) or (
        what in EMPTY and not payload
    )


def refusal_of(payload: bytes, type_: type, run: str) -> str:
    try:
        read_message(payload, type_, run)
    except Refused as refusal:
        return refusal.reason
    return ""


def bad(messages, what: str, count: int, seed: int):
    """(key, payload): of another run and damaged, or of this run and damaged so that they are no
    messages.
    """
    chance = random.Random(f"{what} {seed}")
    sources = [
        (key, p) for key, payload in messages[what] for p in (payload, rewritten(payload, run=RUN))
    ]
    kinds = [(key, mutants(payload, chance)) for key, payload in sources]
    thrown = ((key, next(of)) for key, of in itertools.cycle(kinds))
    return itertools.islice(
        ((key, payload) for key, payload in thrown if not make_sense(what, payload)), count
    )
