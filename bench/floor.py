"""The floor under lockstep: the same number and size of messages between the same number of processes, over bare Zenoh, and nothing else.

    python -m bench.floor ENDPOINT NUMBER AHEAD BACK SIZE   (started by `ticks_per_second`)

The hub is the router, as physics is. At each tick it sends every client what physics sends it, and waits until all have sent all that
agents send. Nothing is packed, unpacked, checked or computed.
"""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue

import zenoh
from zenoh.handlers import Callback

from orchard.launch.supervisor import QUICK_TICKS, take_turns

WARM_UP = 50  # ticks


@dataclass(frozen=True)
class Way:
    """What travels one way between the hub and each client."""

    messages: int
    size: int  # bytes of each

    def apart(self, messages: int) -> "Way":
        """The same bytes in so many messages."""
        return Way(messages, round(self.messages * self.size / messages))


@dataclass(frozen=True)
class Traffic:
    """What travels at every tick, but for queries."""

    clients: int
    ahead: Way  # to each client
    back: Way  # from each

    def apart(self, bodies: int) -> "Traffic":
        """The same with a message for each body's pose, scan and velocity."""
        each = max(1, round(bodies / self.clients))
        return Traffic(self.clients, self.ahead.apart(2 * each), self.back.apart(each))


def ticks_per_second(traffic: Traffic, seconds: float) -> float:
    """Start the clients, and tick with them."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    with zenoh.open(_config("router", "listen", endpoint)) as session:
        arrived: SimpleQueue[None] = SimpleQueue()
        counter = _Counter(traffic.clients * traffic.back.messages, lambda: arrived.put(None))
        ready: SimpleQueue[None] = SimpleQueue()
        kept = [
            session.declare_subscriber("floor/back/*/*", _calling(counter.count)),
            session.liveliness().declare_subscriber("floor/ready/*", _calling(lambda sample: ready.put(None)), history=True),
        ]
        clients = [_start(endpoint, i, traffic) for i in range(traffic.clients)]
        try:
            for _ in clients:
                ready.get(timeout=60)
            return _tick(session, traffic, arrived, seconds)
        finally:
            session.put("floor/end", b"")
            for client in clients:
                client.wait(timeout=20)
            del kept


class _Counter:
    """Rings once for so many messages."""

    def __init__(self, enough: int, ring: Callable[[], None]) -> None:
        self.enough, self.ring, self.seen = enough, ring, 0

    def count(self, sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        self.seen += 1
        if self.seen == self.enough:
            self.seen = 0
            self.ring()


def _tick(session: zenoh.Session, traffic: Traffic, arrived: "SimpleQueue[None]", seconds: float) -> float:
    publishers = [_publisher(session, f"floor/ahead/{i}/{k}") for i in range(traffic.clients) for k in range(traffic.ahead.messages)]
    payload = bytes(traffic.ahead.size)

    def tick() -> None:
        for publisher in publishers:
            publisher.put(payload)
        arrived.get(timeout=20)

    for _ in range(WARM_UP):
        tick()
    begun, ticks = time.perf_counter(), 0
    while time.perf_counter() - begun < seconds:
        tick()
        ticks += 1
    return ticks / (time.perf_counter() - begun)


def _client(endpoint: str, number: int, ahead: int, back: int, size: int) -> None:
    """Answer so many messages with so many others."""
    awake: SimpleQueue[bool] = SimpleQueue()
    with zenoh.open(_config("client", "connect", endpoint)) as session:
        publishers, payload = [_publisher(session, f"floor/back/{number}/{k}") for k in range(back)], bytes(size)
        kept = [
            session.declare_subscriber(f"floor/ahead/{number}/*", _calling(_Counter(ahead, lambda: awake.put(True)).count)),
            session.declare_subscriber("floor/end", _calling(lambda sample: awake.put(False))),
        ]
        kept.append(session.liveliness().declare_token(f"floor/ready/{number}"))
        while awake.get():
            for publisher in publishers:
                publisher.put(payload)


def _calling(function: Callable[[zenoh.Sample], object]) -> Callback:
    """In zenoh's own thread, as the bus does it."""
    return Callback(function, indirect=False)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def _start(endpoint: str, number: int, traffic: Traffic) -> subprocess.Popen:
    figures = (number, traffic.ahead.messages, traffic.back.messages, traffic.back.size)
    client = subprocess.Popen([sys.executable, "-m", "bench.floor", endpoint, *map(str, figures)], env=QUICK_TICKS | os.environ)
    take_turns(client.pid)
    return client


def _config(mode: str, side: str, endpoint: str) -> zenoh.Config:
    config = zenoh.Config()
    settings = {"mode": mode, f"{side}/endpoints": [endpoint], "scouting/multicast/enabled": False, "scouting/gossip/enabled": False}
    for key, value in (settings | {"transport/shared_memory/enabled": False}).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    _client(sys.argv[1], *map(int, sys.argv[2:]))
