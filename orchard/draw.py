"""Random numbers that depend on (seed, name, tick) alone, so that an agent started afresh draws the same ones."""

import hashlib


def draw(seed: int, name: str, tick: int, count: int = 1) -> list[float]:
    """`count` (at most 8) numbers, each uniform in [0, 1), for one agent at one tick."""
    digest = hashlib.blake2b(f"{seed}/{name}/{tick}".encode(), digest_size=64).digest()
    return [(int.from_bytes(digest[8 * i : 8 * i + 8], "little") >> 11) / 2.0**53 for i in range(count)]
