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

from orchard.contract.messages import MAX_PAYLOAD
from orchard.net.bus import Bus, Sample
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import client
from orchard.wire.keys import TABLE, Keys

# s for which it listens to real messages, before it sends its own.
LISTEN_SECONDS = 0.3
# Invalid messages that it publishes.
MESSAGES = 150
# Kinds of keys that it queries.
ASKED = ("scenario", "join", "recall", "stop", "mail", "state")
# Kinds of keys on which it publishes nothing: those of liveliness tokens, which have no payload.
SILENT = ("alive", "physics")
# The share of messages that are made from real ones; the others are random bytes.
MUTATED_SHARE = 0.6
# The share of random payloads that are a byte larger than the largest that is allowed.
TOO_LARGE_SHARE = 0.01
# Agents that it names, of which some do not exist.
NAMES = ("picker_01", "carrier_02", "bin_03", "worker_01", "traffic", "unknown", "physics")


def fuzz(endpoint: str, run: str, seed: int) -> None:
    """Connect, listen, then publish and query invalid messages.

    Publish nothing if the router at `endpoint` cannot be reached.
    """
    random = Random(seed)
    _send_raw_bytes(endpoint, random)
    with suppress(BusError), client(endpoint, seconds=2.0) as bus:
        samples = _received(bus)
        for _ in range(MESSAGES):
            key, payload = invalid_message(random, samples, run)
            bus.publish(key, payload, newest_wins=True)
        for what in ASKED:
            # Up to 60 bytes; nobody reads the replies, for which Zenoh waits at most 5 s.
            key = Keys().of(what, random.choice(NAMES), "unknown")
            bus.ask(key, random.randbytes(1 + random.randrange(60)), None, 5.0)


def mutated(random: Random, payload: bytes, run: str) -> bytes:
    """Return a message with the id of another run.

    In it up to three bytes may be changed, and its end may be cut off or repeated.
    """
    # A run's id is hexadecimal, so none has these letters. It is as long: the rest stays in place.
    other_run = "".join(random.choices("ghijklmn", k=len(run)))
    message = bytearray(payload.replace(run.encode(), other_run.encode()))
    for _ in range(random.randrange(4)):
        message[random.randrange(len(message))] = random.randrange(256)
    cut = random.randrange(len(message))
    return bytes(random.choice((message, message[:cut], message + message[cut:])))


def invalid_message(random: Random, samples: list[Sample], run: str) -> tuple[str, bytes]:
    """Return a key and the payload to publish on it."""
    # The keys of sessions are orchard/hosts/SESSION/...
    known = {sample.key.split("/")[2] for sample in samples if "/hosts/" in sample.key}
    sessions = sorted(known) or ["unknown"]
    keys = []
    for what in TABLE:
        if what not in SILENT:
            keys += [Keys().of(what, name, random.choice(sessions)) for name in NAMES]
    real = [sample for sample in samples if run.encode() in sample.payload]
    if real and random.random() < MUTATED_SHARE:
        sample = random.choice(real)
        key = random.choice((sample.key, random.choice(keys)))
        return key, mutated(random, sample.payload, run)
    if random.random() < TOO_LARGE_SHARE:
        size = MAX_PAYLOAD + 1
    else:
        size = random.randrange(200)
    return random.choice(keys), random.randbytes(size)


def _received(bus: Bus) -> list[Sample]:
    """Return what is published in LISTEN_SECONDS."""
    bus.subscribe(f"{Keys().prefix}/**")
    deadline = time.monotonic() + LISTEN_SECONDS
    samples = []
    remaining = LISTEN_SECONDS
    while remaining > 0.0:
        item = bus.inbox.take(remaining)
        if isinstance(item, Sample):
            samples.append(item)
        remaining = deadline - time.monotonic()
    return samples


def _send_raw_bytes(endpoint: str, random: Random) -> None:
    """Send random bytes, which are not even Zenoh's protocol, to the port itself."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with suppress(OSError), socket.create_connection((host, int(port)), 1.0) as connection:
        connection.sendall(random.randbytes(random.randrange(1, 2000)))
