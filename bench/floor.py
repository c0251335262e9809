"""The floor benchmark: the cost of lockstep's messages alone.

It sends the messages of a run again over bare Zenoh.

    python -m bench.floor ENDPOINT NUMBER TRACE   (`ticks_per_second` starts these client processes)

There are as many processes as in the real run: clients stand for the hosts of agents, and the hub
for physics, which is the router too. `program.py` records which messages a run sends, a trace. At
each tick the hub sends an observation to each client that was asked at that tick, and waits until
these clients have sent their velocities. Clients send the requests of the run to each other as
gets, with two replies each ("received" at once, and the answer a tick later), and wait for them as
the hosts of the run do. Nothing is packed, unpacked, checked or computed.
"""

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import zenoh
from zenoh.handlers import Callback

from orchard.launch.supervisor import QUICK_TICKS, free_port, take_turns

# s that a message may take; if one takes longer, a message is lost.
TAKEN_SECONDS = 20.0
START_SECONDS = 60.0  # that a client may take to start
# Bytes at the beginning of a request that tell its tick.
STAMP = 4
# As orchard.net.bus asks.
GET: dict[str, Any] = {
    "target": zenoh.QueryTarget.ALL,
    "consolidation": zenoh.ConsolidationMode.NONE,
    "congestion_control": zenoh.CongestionControl.BLOCK,
}


class Sizes(msgspec.Struct, frozen=True):
    """The mean sizes of the messages of a run, bytes."""

    seen: int  # from the hub to a client
    velocities: int  # from a client to the hub
    request: int
    answer: int  # of both replies


class Tick(msgspec.Struct, frozen=True):
    """The messages of one tick."""

    asked: list[int]  # the clients that get an observation
    requests: list[tuple[int, int]]  # from which client to which


class Trace(msgspec.Struct, frozen=True):
    """The messages of a run."""

    clients: int
    sizes: Sizes
    ticks: list[Tick]

    @property
    def asked(self) -> float:
        """The mean number of clients that are asked at a tick."""
        return sum(len(tick.asked) for tick in self.ticks) / len(self.ticks)

    @property
    def requests(self) -> float:
        """The mean number of requests of a tick."""
        return sum(len(tick.requests) for tick in self.ticks) / len(self.ticks)

    def without_open_requests(self) -> "Trace":
        """Return the trace without the requests that are answered after its last tick.

        An answer comes two ticks after its request: so the last two ticks have none.
        """
        last = [Tick(tick.asked, []) for tick in self.ticks[-2:]]
        return Trace(self.clients, self.sizes, self.ticks[:-2] + last)


def ticks_per_second(trace: Trace) -> float:
    """Start the clients and send the messages of the trace once. Return the rate."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        TemporaryDirectory() as folder,
        zenoh.open(_config("router", "listen", endpoint)) as session,
    ):
        path = Path(folder) / "trace.json"
        path.write_bytes(msgspec.json.encode(trace.without_open_requests()))
        velocities = _Counter()
        ready = SimpleQueue[None]()
        # Zenoh ends a subscription that nothing refers to.
        declared = [
            session.declare_subscriber("floor/velocities/*", _callback(velocities.count)),
            session.liveliness().declare_subscriber(
                "floor/ready/*", _callback(lambda sample: ready.put(None)), history=True
            ),
        ]
        clients = [_start(endpoint, i, path) for i in range(trace.clients)]
        try:
            for _ in clients:
                ready.get(timeout=START_SECONDS)
            return _ticked(session, trace, velocities)
        finally:
            for client in clients:
                client.wait(timeout=TAKEN_SECONDS)
            del declared


class _Counter:
    """Wakes the hub once for several messages: to wake it costs more than a message.

    `left`: how many are still to come. The hub sets it, Zenoh's thread counts it down.
    """

    def __init__(self) -> None:
        self._enough: SimpleQueue[None] = SimpleQueue()
        self.left = 0

    def count(self, sample: zenoh.Sample) -> None:
        """Count a message, which is copied as in a run."""
        sample.payload.to_bytes()
        self.left -= 1
        if self.left == 0:
            self._enough.put(None)

    def wait(self) -> None:
        """Wait until none is left."""
        self._enough.get(timeout=TAKEN_SECONDS)


def _ticked(session: zenoh.Session, trace: Trace, velocities: _Counter) -> float:
    """Send the observations of all ticks as the hub. Return the ticks a second."""
    publishers = [_publisher(session, f"floor/seen/{i}") for i in range(trace.clients)]
    payload = bytes(trace.sizes.seen)
    begun = time.perf_counter()
    for tick in trace.ticks:
        velocities.left = len(tick.asked)
        for client in tick.asked:
            publishers[client].put(payload)
        if tick.asked:
            velocities.wait()
    return len(trace.ticks) / (time.perf_counter() - begun)


class _Client:
    """One client: what has arrived, and what it sends at each of its ticks."""

    def __init__(self, session: zenoh.Session, number: int, trace: Trace) -> None:
        self._session = session
        self._number = number
        self._trace = trace
        # What Zenoh's threads put there: an observation, as bytes; a number, the tick of a get that
        # has ended; or a query, a request of another client.
        self._arrived: SimpleQueue[Any] = SimpleQueue()
        # How many observations wait; tick -> how many of its gets have ended; tick -> the requests
        # of it that wait for their answers.
        self._seen = 0
        self._ends = defaultdict[int, int](int)
        self._held = defaultdict[int, list[zenoh.Query]](list)
        self._answer = bytes(trace.sizes.answer)
        self._velocities = _publisher(session, f"floor/velocities/{number}")
        put = self._arrived.put
        self._declared = [
            session.declare_subscriber(
                f"floor/seen/{number}", _callback(lambda sample: put(sample.payload.to_bytes()))
            ),
            session.declare_queryable(f"floor/mail/{number}", _callback(put)),
            session.liveliness().declare_token(f"floor/ready/{number}"),
        ]

    def run(self) -> None:
        """Answer each tick at which this client is asked.

        A tick is complete when its observation, all requests of the tick before, and all answers to
        the client's own requests of two ticks ago are here.
        """
        payload = bytes(self._trace.sizes.velocities)
        # Tick -> the clients to which a request went, and how many requests come.
        sent: dict[int, list[int]] = {-2: [], -1: []}
        expected = {-1: 0}
        for number, tick in enumerate(self._trace.ticks):
            sent[number] = [to for sender, to in tick.requests if sender == self._number]
            expected[number] = sum(to == self._number for _, to in tick.requests)
            if self._number not in tick.asked:
                continue
            while not (
                self._seen
                and len(self._held[number - 1]) == expected[number - 1]
                and self._ends[number - 2] == len(sent[number - 2])
            ):
                self._take()
            self._seen -= 1
            self._velocities.put(payload)
            for to in sent[number]:
                self._ask(number, to)
            for query in self._held.pop(number - 1):
                query.reply(query.key_expr, self._answer)
                query.drop()  # type: ignore[no-untyped-call]

    def _ask(self, tick: int, to: int) -> None:
        """Send a request of a tick to another client."""
        handler: Callback[zenoh.Reply] = Callback(
            lambda reply: reply.ok.payload.to_bytes() if reply.ok else b"",
            lambda: self._arrived.put(tick),
            indirect=False,
        )
        payload = tick.to_bytes(STAMP) + bytes(self._trace.sizes.request - STAMP)
        self._session.get(
            f"floor/mail/{to}", handler, payload=payload, timeout=TAKEN_SECONDS, **GET
        )

    def _take(self) -> None:
        """Take what has arrived; reply to a request that it is received."""
        match self._arrived.get(timeout=TAKEN_SECONDS):
            case bytes():
                self._seen += 1
            case int(tick):
                self._ends[tick] += 1
            case query:
                self._held[int.from_bytes(query.payload.to_bytes()[:STAMP])].append(query)
                query.reply(query.key_expr, self._answer)


def _callback(function: Callable[[Any], object]) -> "Callback[Any]":
    """Return a handler that runs in Zenoh's own thread, as those of the bus do."""
    return Callback(function, indirect=False)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def _start(endpoint: str, number: int, trace: Path) -> "subprocess.Popen[bytes]":
    """Start a client, with the settings and the priority that a run gives its processes."""
    command = [sys.executable, "-m", "bench.floor", endpoint, str(number), str(trace)]
    client = subprocess.Popen(command, env=QUICK_TICKS | os.environ)
    take_turns(client.pid)
    return client


def _config(mode: str, side: str, endpoint: str) -> zenoh.Config:
    """Return the settings of a session. `side`: 'listen' or 'connect'."""
    config = zenoh.Config()
    settings = {
        "mode": mode,
        f"{side}/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def main(endpoint: str, number: str, path: str) -> None:
    """Be one client."""
    trace = msgspec.json.decode(Path(path).read_bytes(), type=Trace)
    with zenoh.open(_config("client", "connect", endpoint)) as session:
        _Client(session, int(number), trace).run()


if __name__ == "__main__":
    main(*sys.argv[1:])
