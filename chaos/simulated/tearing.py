"""Payloads that change on their way over a link, as Zenoh's do where a write is broken off, only
more often.
"""

from collections.abc import Callable
from random import Random
from typing import NamedTuple

from chaos.simulated.census import key_of
from orchard.wire.codec import velocities_of
from orchard.wire.keys import TABLE
from orchard.wire.messages import Velocities, read


class Tears(NamedTuple):
    """How often payloads change on a link. `torn`: the share whose end is bytes of another message.

    `changed`: the share in which one byte is another. Zenoh tore 3 of 380,037 payloads, on links
    that broke.

    `with_valid`: also into what is a message still, with other content. No receiver notices that,
    so no hash is promised.
    """

    torn: float = 0.0
    changed: float = 0.0
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
        self._before = b"\0"  # the payload before

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
            end = len(payload) - at
            arrived = payload[:at] + (before * (end // len(before) + 1))[-end:]
        else:
            arrived = (
                payload[:at]
                + bytes([payload[at] ^ self._random.randint(1, 255)])
                + payload[at + 1 :]
            )
        is_drawn = self._tears.with_valid or not is_message(key, arrived, is_reply)
        if arrived == payload or not is_drawn:
            return payload
        self._count()
        return arrived


def is_message(key: str, payload: bytes, is_reply: bool = False) -> bool:
    """Whether a payload is a valid message on its key, or a valid reply to a query of that key."""
    if not (what := key_of(key)):
        return False
    kind = TABLE[what].message
    kinds = TABLE[what].replies if is_reply else (kind,)
    return any(_is_of_kind(payload, one) for one in kinds if one is not None)


def _is_of_kind(payload: bytes, kind: type) -> bool:
    try:
        if kind is Velocities:
            return not velocities_of(payload)[1]
        read(payload, kind)
    except ValueError:
        return False
    return True
