"""Payloads that change on their way over a link, as Zenoh's do where a write is broken off, only more often."""

from collections.abc import Callable
from random import Random
from typing import NamedTuple


class Tears(NamedTuple):
    """How often payloads change on a link. `torn`: the share whose end is bytes of another message.

    `changed`: the share in which one byte is another. Zenoh tore 3 of 380,037 payloads, on links that broke.
    """

    torn: float = 0.0
    changed: float = 0.0


class Tearer:
    """Draws which payloads of one link change."""

    def __init__(self, tears: Tears, random: Random, count: Callable[[], None]) -> None:
        """`count`: called for each payload that has changed."""
        self._tears, self._random, self._count = tears, random, count
        self._before = b"\0"  # the payload before

    def carry(self, payload: bytes) -> bytes:
        """Return a payload as it arrives."""
        before, self._before = self._before, payload or self._before
        chance = self._random.random()
        if not payload or chance >= self._tears.torn + self._tears.changed:
            return payload
        at = self._random.randrange(len(payload))
        if chance < self._tears.torn:
            end = len(payload) - at
            arrived = payload[:at] + (before * (end // len(before) + 1))[-end:]
        else:
            arrived = (
                payload[:at]
                + bytes([payload[at] ^ self._random.randint(1, 255)])
                + payload[at + 1 :]
            )
        if arrived != payload:
            self._count()
        return arrived
