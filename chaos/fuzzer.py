"""A fuzzer: a client that sends random bytes, and mutated messages of the run, on every key.

None of them may have an effect.

A complete message of the run would be valid, and every client that may write on the bus may send
one (docs/security.md says which may). Therefore the fuzzer replaces the run's id in a message
before it mutates the message further.
"""

import socket
import time
from contextlib import suppress
from random import Random

from orchard.net.bus import Bus, Sample
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import client
from orchard.wire.keys import TABLE, Keys

LISTENS = 0.3  # s, for real messages
SAYS = 150  # messages
ASKED = ("scenario", "join", "recall", "stop", "mail", "state")
SILENT = ("alive", "physics")  # payloads have no meaning on these keys
NAMES = ("picker_01", "carrier_02", "bin_03", "worker_01", "traffic", "unknown", "physics")


def fuzz(endpoint: str, run: str, seed: int) -> None:
    """Connect, listen, then publish and query invalid messages.

    Publish nothing if the router at `endpoint` cannot be reached.
    """
    random = Random(seed)
    _send_raw_bytes(endpoint, random)
    with suppress(BusError), client(endpoint, seconds=2.0) as bus:
        samples = _received(bus)
        for _ in range(SAYS):
            key, payload = invalid_message(random, samples, run)
            bus.publish(key, payload, newest_wins=True)
        for what in ASKED:
            bus.ask(
                Keys().of(what, random.choice(NAMES), "unknown"),
                random.randbytes(1 + random.randrange(60)),
                None,
                5.0,
            )


def mutated(random: Random, payload: bytes, run: str) -> bytes:
    """Return a message with the id of another run, in which some bytes may be changed, cut off or
    repeated.
    """
    message = bytearray(
        payload.replace(run.encode(), "".join(random.choices("ghijklmn", k=len(run))).encode())
    )
    for _ in range(random.randrange(4)):
        message[random.randrange(len(message))] = random.randrange(256)
    cut = random.randrange(len(message))
    return bytes(random.choice((message, message[:cut], message + message[cut:])))


def invalid_message(random: Random, samples: list[Sample], run: str) -> tuple[str, bytes]:
    """Return a key and the payload to publish on it."""
    sessions = sorted(
        {sample.key.split("/")[2] for sample in samples if "/hosts/" in sample.key}
    ) or ["unknown"]
    keys = [
        Keys().of(what, name, random.choice(sessions))
        for what in TABLE
        if what not in SILENT
        for name in NAMES
    ]
    real = [sample for sample in samples if run.encode() in sample.payload]
    if real and random.random() < 0.6:
        sample = random.choice(real)
        return random.choice((sample.key, random.choice(keys))), mutated(
            random, sample.payload, run
        )
    size = (1 << 20) + 1 if random.random() < 0.01 else random.randrange(200)
    return random.choice(keys), random.randbytes(size)


def _received(bus: Bus) -> list[Sample]:
    bus.subscribe(f"{Keys().prefix}/**")
    deadline = time.monotonic() + LISTENS
    samples = []
    while (left := deadline - time.monotonic()) > 0.0:
        if isinstance(item := bus.inbox.take(left), Sample):
            samples.append(item)
    return samples


def _send_raw_bytes(endpoint: str, random: Random) -> None:
    """Send random bytes, which are not even Zenoh's protocol, to the port itself."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with suppress(OSError), socket.create_connection((host, int(port)), 1.0) as connection:
        connection.sendall(random.randbytes(random.randrange(1, 2000)))
