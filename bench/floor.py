"""The floor benchmark: the cost of lockstep's messages alone. It sends messages of the same number and size over bare Zenoh.

    python -m bench.floor ENDPOINT NUMBER TO_CLIENT FROM_CLIENT SIZE   (`ticks_per_second` starts these client processes)

There are as many processes as in the real run. The hub is the router, as physics is. At each tick it sends to each client the messages
that physics would send, and waits until all clients have sent the messages that agents would send. Nothing is packed, unpacked, checked
or computed.
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
class Flow:
    """The messages of one tick in one direction between the hub and each client."""

    messages: int
    size: int  # bytes of each


@dataclass(frozen=True)
class Traffic:
    """The messages of one tick, without queries."""

    clients: int
    to_client: Flow  # to each client
    from_client: Flow  # from each client


def ticks_per_second(traffic: Traffic, seconds: float) -> float:
    """Start the clients and tick with them for `seconds`. Return the rate."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    with zenoh.open(_config("router", "listen", endpoint)) as session:
        arrived: SimpleQueue[None] = SimpleQueue()
        counter = _Counter(traffic.clients * traffic.from_client.messages, lambda: arrived.put(None))
        ready: SimpleQueue[None] = SimpleQueue()
        declared = [
            session.declare_subscriber("floor/back/*/*", _callback(counter.count)),
            session.liveliness().declare_subscriber("floor/ready/*", _callback(lambda sample: ready.put(None)), history=True),
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
            del declared


class _Counter:
    """Calls `signal` after every `enough` messages."""

    def __init__(self, enough: int, signal: Callable[[], None]) -> None:
        self.enough, self.signal, self.seen = enough, signal, 0

    def count(self, sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        self.seen += 1
        if self.seen == self.enough:
            self.seen = 0
            self.signal()


def _tick(session: zenoh.Session, traffic: Traffic, arrived: "SimpleQueue[None]", seconds: float) -> float:
    publishers = [_publisher(session, f"floor/ahead/{i}/{k}") for i in range(traffic.clients) for k in range(traffic.to_client.messages)]
    payload = bytes(traffic.to_client.size)

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


def _client(endpoint: str, number: int, to_client: int, from_client: int, size: int) -> None:
    """Answer each `to_client` messages with `from_client` messages of `size` bytes."""
    events: SimpleQueue[bool] = SimpleQueue()  # True: a tick to answer; False: the end
    with zenoh.open(_config("client", "connect", endpoint)) as session:
        publishers, payload = [_publisher(session, f"floor/back/{number}/{k}") for k in range(from_client)], bytes(size)
        declared = [
            session.declare_subscriber(f"floor/ahead/{number}/*", _callback(_Counter(to_client, lambda: events.put(True)).count)),
            session.declare_subscriber("floor/end", _callback(lambda sample: events.put(False))),
        ]
        declared.append(session.liveliness().declare_token(f"floor/ready/{number}"))
        while events.get():
            for publisher in publishers:
                publisher.put(payload)


def _callback(function: Callable[[zenoh.Sample], object]) -> Callback:
    """A handler that runs in zenoh's own thread, as those of the bus do."""
    return Callback(function, indirect=False)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def _start(endpoint: str, number: int, traffic: Traffic) -> subprocess.Popen:
    arguments = (number, traffic.to_client.messages, traffic.from_client.messages, traffic.from_client.size)
    client = subprocess.Popen([sys.executable, "-m", "bench.floor", endpoint, *map(str, arguments)], env=QUICK_TICKS | os.environ)
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
