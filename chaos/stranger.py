"""Somebody who says nonsense on every key of a run: random bytes, and what was really said, changed. None of it may have an effect.

What was really said and is whole would be a lawful message, and whoever may speak on the bus may send one (who may is the business of
docs/security.md). So the run's id in it is made another's before it is changed further.
"""

import socket
import time
from contextlib import suppress
from random import Random

from orchard.net.bus import Bus, Sample, client
from orchard.net.endpoints import BusError
from orchard.wire.keys import TABLE, Keys

LISTENS = 0.3  # s, for what is really said
SAYS = 150  # things
ASKED = ("scenario", "join", "recall", "command", "stop", "mail", "state")
SILENT = ("alive",)  # no payload has any meaning there
NAMES = ("picker_01", "carrier_02", "bin_03", "worker_01", "traffic", "nobody", "physics")


def babble(endpoint: str, run: str, seed: int) -> None:
    """Come, listen, say nonsense, ask nonsense, and go; where nobody can be reached, say nothing."""
    chance = Random(seed)
    _noise(endpoint, chance)
    with suppress(BusError), client(endpoint, seconds=2.0) as bus:
        heard = _heard(bus)
        for _ in range(SAYS):
            key, payload = _nonsense(chance, heard, run)
            bus.publish(key, payload, newest_wins=True)
        for what in ASKED:
            bus.ask(Keys().of(what, chance.choice(NAMES), "nobody"), chance.randbytes(1 + chance.randrange(60)), None, 5.0)


def nonsense_of(chance: Random, payload: bytes, run: str) -> bytes:
    """A message of another run, with some bytes changed, cut off, or said twice."""
    other = bytearray(payload.replace(run.encode(), "".join(chance.choices("ghijklmn", k=len(run))).encode()))
    for _ in range(chance.randrange(4)):
        other[chance.randrange(len(other))] = chance.randrange(256)
    cut = chance.randrange(len(other))
    return bytes(chance.choice((other, other[:cut], other + other[cut:])))


def _nonsense(chance: Random, heard: list[Sample], run: str) -> tuple[str, bytes]:
    """A key, and what is put there."""
    sessions = sorted({sample.key.split("/")[2] for sample in heard if "/hosts/" in sample.key}) or ["nobody"]
    keys = [Keys().of(what, name, chance.choice(sessions)) for what in TABLE if what not in SILENT for name in NAMES]
    real = [sample for sample in heard if run.encode() in sample.payload]
    if real and chance.random() < 0.6:
        sample = chance.choice(real)
        return chance.choice((sample.key, chance.choice(keys))), nonsense_of(chance, sample.payload, run)
    size = (1 << 20) + 1 if chance.random() < 0.01 else chance.randrange(200)
    return chance.choice(keys), chance.randbytes(size)


def _heard(bus: Bus) -> list[Sample]:
    bus.subscribe(f"{Keys().prefix}/**")
    deadline, heard = time.monotonic() + LISTENS, []
    while (left := deadline - time.monotonic()) > 0.0:
        if isinstance(item := bus.inbox.take(left), Sample):
            heard.append(item)
    return heard


def _noise(endpoint: str, chance: Random) -> None:
    """Random bytes at the very port, which are not even Zenoh's."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with suppress(OSError), socket.create_connection((host, int(port)), 1.0) as link:
        link.sendall(chance.randbytes(chance.randrange(1, 2000)))
