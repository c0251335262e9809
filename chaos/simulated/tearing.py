"""Payloads that change on their way over a link, as Zenoh's do if a write is broken off.

Here it happens more often.
"""

from collections.abc import Callable
from random import Random
from typing import NamedTuple

from chaos.simulated.census import key_of
from orchard.wire.codec import velocities_of
from orchard.wire.keys import TABLE
from orchard.wire.messages import Velocities, read


class Tears(NamedTuple):
    """How often payloads change on a link. It is True if they change at all.

    Zenoh tore 3 of 380,037 payloads, on links that broke.
    """

    # The share of payloads that get the end of another message in place of their own.
    torn: float = 0.0
    # The share of payloads in which one byte changes.
    changed: float = 0.0
    # Whether a payload may also change into a valid message with other content. No receiver notices
    # that, so no hash is promised then.
    with_valid: bool = False

    def __bool__(self) -> bool:
        return self.torn + self.changed > 0.0


NO_TEARS = Tears()


class Tearer:
    """Draws which payloads of one link change."""

    def __init__(self, tears: Tears, random: Random, count: Callable[[], None]) -> None:
        """`count`: called for each payload that has changed."""
        self._tears = tears
        self._random = random
        self._count = count
        # The payload that has passed before this one.
        self._before = b"\0"

    def carry(self, key: str, payload: bytes, is_reply: bool) -> bytes:
        """Return a payload as it arrives.

        `key`: of its message, or of the query that it replies to.
        """
        before = self._before
        self._before = payload or self._before
        chance = self._random.random()
        if not payload or chance >= self._tears.torn + self._tears.changed:
            return payload
        at = self._random.randrange(len(payload))
        if chance < self._tears.torn:
            # The end of the payload before, repeated if that is too short.
            length = len(payload) - at
            repeated = before * (length // len(before) + 1)
            arrived = payload[:at] + repeated[-length:]
        else:
            byte = payload[at] ^ self._random.randint(1, 255)
            arrived = payload[:at] + bytes([byte]) + payload[at + 1 :]
        is_drawn = self._tears.with_valid or not is_message(key, arrived, is_reply)
        if arrived == payload or not is_drawn:
            return payload
        self._count()
        return arrived


def is_message(key: str, payload: bytes, is_reply: bool = False) -> bool:
    """Whether a payload is a valid message on its key, or a valid reply to a query of that key."""
    what = key_of(key)
    if not what:
        return False
    kinds: tuple[type | None, ...] = (TABLE[what].message,)
    if is_reply:
        kinds = TABLE[what].replies
    return any(_is_of_kind(payload, kind) for kind in kinds if kind is not None)


def _is_of_kind(payload: bytes, kind: type) -> bool:
    """Whether a payload is a message of a kind, and all of it counts."""
    try:
        if kind is Velocities:
            # Malformed actions alone make no ValueError: the others count.
            _, faults = velocities_of(payload)
            return not faults
        read(payload, kind)
    except ValueError:
        return False
    return True
