"""Real messages of a run in this process, on all keys and in both directions; and what noise, age
and malice make of them.

Three parts: stand-ins for Zenoh, over which physics and one host harvest in this process (`Net`,
`StandIn`, `Run`, `recorded`); small helpers for tests of the rules of lockstep and realtime; and
mutants of messages, at random (`mutants`), for tests that no message can harm a receiver.
"""

import math
import random
import re
import struct
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import msgpack
from patience import PATIENCE

from docs.message_examples import EXAMPLES
from orchard.behaviour.catalogue import make_agents
from orchard.contract.messages import MAX_PAYLOAD, StateRequest, pack
from orchard.net.bus import Alive, Final, Inbox, Replied, Sample
from orchard.net.bus import Query as AnyQuery
from orchard.net.host import Host, HostEnded
from orchard.server.loop import RunLoop
from orchard.server.options import RunOptions
from orchard.server.roster import Roster
from orchard.sim.engine import Engine
from orchard.wire.keys import TABLE, Keys
from orchard.wire.messages import Answered, Letter, Recall, Received, Stop, read

KEYS = Keys()
HOST = "host1"
RUN = "run1"


class Query(AnyQuery):
    """A query that keeps its replies and errors, and passes each on to the session that asked.

    `dropped`: whether it is answered to the end. `ticket`: by which the session knows its question.
    """

    def __init__(
        self,
        key: str,
        payload: bytes,
        replied: Callable[[Replied], None] = lambda reply: None,
        ticket: object = None,
    ) -> None:
        self.key = key
        self.payload = payload
        self.replies = []
        self.errors = []
        self.dropped = False
        self._replied = replied
        self._ticket = ticket

    def reply(self, payload: bytes) -> None:
        self.replies.append(payload)
        self._replied(Replied(self._ticket, payload, ""))

    def refuse(self, reason: str) -> None:
        self.errors.append(reason)
        self._replied(Replied(self._ticket, b"", reason))
        self.drop()

    def drop(self) -> None:
        if not self.dropped:
            self._replied(Final(self._ticket))
        self.dropped = True


class Net:
    """Carries what stand-ins for buses send each other, and writes all of it down."""

    def __init__(self) -> None:
        self.buses: list[StandIn] = []
        self.sent: list[tuple[str, bytes]] = []  # key, payload
        self.queries: list[Query] = []
        self.on_put: Callable[[str, bytes], None] = lambda key, payload: None

    def put(self, sender: "StandIn", key: str, payload: bytes) -> None:
        self.sent.append((key, payload))
        for bus in self.buses:
            if bus is not sender and bus.hears(bus.keys, key):
                bus.inbox.put(Sample(key, payload))
        self.on_put(key, payload)

    def alive(self, key: str, up: bool) -> None:
        for bus in self.buses:
            if bus.hears(bus.tokens, key):
                bus.inbox.put(Alive(key, up))


class StandIn:
    """A session on a `Net`, with the methods of `bus.Bus` that the program calls.

    `keys`: patterns of keys to which it subscribes. `tokens`: patterns of liveliness tokens that it
    watches. `answers`: keys on which it answers queries.
    """

    def __init__(self, net: Net, session: str) -> None:
        self.inbox = Inbox()
        self.id = session
        self.endpoint = "nowhere"
        self.executor = ThreadPoolExecutor(max_workers=1)
        self.keys = []
        self.tokens = []
        self.answers = []
        self.retired = []
        self._net = net
        net.buses.append(self)

    def clock(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    @staticmethod
    def hears(patterns: list[str], key: str) -> bool:
        return any(re.fullmatch(pattern.replace("*", "[^/]*"), key) for pattern in patterns)

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        self._net.put(self, key, payload)

    def retire(self, key: str) -> None:
        self.retired.append(key)

    def is_heard(self, keys: str) -> bool:
        return True

    def ask(self, key: str, payload: bytes, ticket: object, seconds: float = 0.0) -> None:
        # The first session that answers there gets the query. Without one it is over at once.
        bus = next((bus for bus in self._net.buses if bus.hears(bus.answers, key)), None)
        query = Query(key, payload, self.inbox.put, ticket)
        self._net.queries.append(query)
        query.drop() if bus is None else bus.inbox.put(query)

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        self.keys.append(keys)

    def answer(self, key: str) -> None:
        self.answers.append(key)

    def watch(self, tokens: str) -> None:
        self.tokens.append(tokens)

    def declare_alive(self, token: str) -> None:
        self._net.alive(token, True)

    def withdraw(self, token: str) -> None:
        self._net.alive(token, False)


class Run:
    """Physics and one host with all agents, each in its thread."""

    def __init__(
        self,
        scenario,
        run: str,
        ticks: int,
        net: Net | None = None,
        cast: Callable[..., dict] = make_agents,
    ) -> None:
        """`cast`: returns the agents of a layout."""
        self.net = net or Net()
        self.engine = Engine.begin(scenario)
        self.physics = RunLoop(
            StandIn(self.net, "physics1"),
            KEYS,
            self.engine,
            RunOptions(duration=ticks / 10, run=run),
        )
        self.host = Host(
            StandIn(self.net, HOST),
            KEYS,
            run=run,
            mode="lockstep",
            layout=self.engine.layout,
            agents=cast(self.engine.layout),
        )

    def to_the_end(self):
        """Harvest until both have ended. Return the end that physics publishes."""
        ends = []
        run = threading.Thread(
            target=lambda: ends.append(self.physics.play(self.engine.rehearse)), daemon=True
        )
        self.physics.arrivals.listen()
        self.host.listen()
        run.start()
        try:
            self.host.run()
        except HostEnded as ended:
            self.code = ended.code
            for name in self.host.runners:
                self.net.alive(KEYS.of("alive", name, HOST), False)
        run.join(PATIENCE)
        return ends[0]


# -- what stands in for the network and the clock in the tests of lockstep's and realtime's rules


class ReadQuery(Query):
    """A query whose replies are read."""

    def __init__(self, payload):
        super().__init__("", payload)

    def reply(self, payload):
        self.replies.append(read(payload, Received | Answered))


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def letter(sender="bin_01", tick=4, number=0):
    """Return a packed letter, which asks for a state. `number`: which of its sender's at a tick."""
    return pack(Letter(RUN, tick, sender, number, StateRequest()))


def roster(*held):
    """Return the roster of a bin and a picker. `held`: (agent, session that owns it), ..."""
    members = Roster(["bin_01", "picker_01"])
    for name, owner in held:
        members.token(name, owner, True)
        members.join(name, owner)
    return members


def heard_at(box, tick, name="picker_01"):
    """Return the requests that a mailbox delivers to an agent at a tick."""
    mail = box.deliver(tick).get(name)
    return [] if mail is None else mail.requests


def recorded(scenario, run: str, ticks: int) -> dict[str, list[tuple[str, bytes]]]:
    """Return some real messages of each kind of key, replies among them: (key, payload)."""
    recorded_run = Run(scenario, run, ticks)

    # Near the end a client asks what no host asks.
    def ask_too(key: str, payload: bytes) -> None:
        if key == KEYS.of("clock") and msgpack.unpackb(payload)["tick"] == ticks - 2:
            bus = recorded_run.host.bus
            bus.ask(KEYS.of("stop"), pack(Stop(run, True, ["picker_01"])), "a ticket")
            bus.ask(KEYS.of("stop"), pack(Stop(run, False, [])), "a ticket")
            bus.ask(KEYS.of("recall"), pack(Recall(run, ticks - 2)), "a ticket")
            bus.ask(KEYS.of("scenario"), b"", "a ticket")

    recorded_run.net.on_put = ask_too
    recorded_run.to_the_end()
    sent = list(recorded_run.net.sent)
    for query in recorded_run.net.queries:
        for payload in (query.payload, *query.replies):
            if payload:
                sent.append((query.key, payload))

    by_kind: dict[str, list[tuple[str, bytes]]] = {kind: [] for kind in TABLE}
    for key, payload in sent:
        by_kind[key.rsplit("/", 1)[1]].append((key, payload))

    # An example of each message, also of those that did not occur.
    for kind, row in TABLE.items():
        for type_ in (row.message, *row.replies):
            if type_ is not None:
                example = rewritten(pack(EXAMPLES[type_]), run=run)
                by_kind[kind].append((KEYS.of(kind, "picker_01", "stranger"), example))

    # Of many messages every so many is returned, so that 40 to 80 are left: mutants of these are
    # enough, and take less time.
    return {kind: messages[:: max(1, len(messages) // 40)] for kind, messages in by_kind.items()}


def rewritten(payload: bytes, **fields) -> bytes:
    """Return a message in which some fields have other values."""
    return msgpack.packb(msgpack.unpackb(payload, strict_map_key=False) | fields)


def nested(levels: int) -> bytes:
    """Return msgpack of lists in lists, so deep: 0x91 begins a list of one, and 0xc0 is nil."""
    return b"\x91" * levels + b"\xc0"


# What fields of messages become: wrong values of each type.
HUGE = "x" * 300_000
NUMBERS = [-1, 2**63, 2**64 - 1, -(2**63), 1.5, math.nan, math.inf, -math.inf, 1e308]
TEXTS = ["", "nobody_99", "picker_01\n", "\x1b[2J\x00", "../../*", "**", b"", b"\xff" * 57]
TREES = [[], {}, [[]], {"a": {}}, [None] * 300, {1: 2}, {b"x": 1}, [math.nan] * 7, {"x" * 300: 0}]
JUNK = [None, True, *NUMBERS, *TEXTS, *TREES, msgpack.Timestamp(1, 1), msgpack.ExtType(5, b"ab")]
# Pieces of arrays such as scans (float32): no distances, and pieces of the wrong length.
BAD_ARRAYS = [struct.pack("<f", number) for number in (math.nan, -math.inf, -1.0)] + [
    b"\0",
    struct.pack("<d", math.nan),
]


def of_bytes(payload: bytes, chance: random.Random) -> bytes:
    """Return a payload with bits flipped, cut off, put in or doubled; or other bytes."""
    at = chance.randrange(len(payload))
    some = chance.randbytes(chance.randrange(1, 9))
    # Only the case that is drawn is computed. The last two are maps and lists that are nested too
    # deep: 0x81 begins a map of one.
    return chance.choice(
        [
            lambda: (
                payload[:at] + bytes([payload[at] ^ 1 << chance.randrange(8)]) + payload[at + 1 :]
            ),
            lambda: payload[:at],
            lambda: payload[:at] + some + payload[at:],
            lambda: payload[:at] + some + payload[at + len(some) :],
            lambda: payload + payload[:at],
            lambda: some * chance.randrange(20),
            lambda: payload[:at] + nested(chance.choice([5, 2000])) + payload[at + 1 :],
            lambda: b"\x81" * chance.choice([10, 5000]) + payload,
        ]
    )()


def of_fields(value, chance: random.Random):
    """Return a map or list in which one thing, at any depth, is wrong.

    It is of another type or size, unknown, doubled or missing. The shares of the draws are such
    that all of these occur often, and most mutants are wrong deep inside.
    """
    if isinstance(value, dict) and value and chance.random() < 0.9:
        key = chance.choice(list(value))
        if chance.random() < 0.15:
            return {name: part for name, part in value.items() if name != key}
        if chance.random() < 0.15:
            return value | {
                chance.choice(
                    ["unknown", "run ", 7, b"run", HUGE[: chance.choice([300, 70_000])]]
                ): chance.choice(JUNK)
            }
        return value | {key: of_fields(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.8:
        at = chance.randrange(len(value))
        return (
            value[:at]
            + [of_fields(value[at], chance)] * chance.choice([0, 1, 1, 2, 50])
            + value[at + 1 :]
        )
    if isinstance(value, bytes) and value and chance.random() < 0.8:
        # At the beginning of a number: those of arrays have 4 or 8 bytes.
        at = 8 * chance.randrange(1 + len(value) // 8)
        bad = chance.choice(BAD_ARRAYS)
        return value[:at] + bad + value[at + len(bad) * chance.randrange(2) :]
    return chance.choice(JUNK) if chance.random() < 0.99 else HUGE


def mutants(payload: bytes, chance: random.Random) -> Iterator[bytes]:
    """Yield, without end, what may become of one message."""
    tree = msgpack.unpackb(payload, strict_map_key=False)
    while True:
        for _ in range(3):
            yield msgpack.packb(of_fields(tree, chance))
            yield of_bytes(payload, chance)
        # It is seldom drawn, for there is one of a message.
        yield doubled(tree)


def doubled(tree: dict) -> bytes:
    """Return a map in which the last field stands twice."""
    *_, (key, value) = tree.items()
    packer = msgpack.Packer()
    parts = [part for item in [*tree.items(), (key, value)] for part in item]
    return packer.pack_map_header(len(tree) + 1) + b"".join(map(packer.pack, parts))


def oversized() -> list[bytes]:
    """Return payloads that are larger than a receiver accepts: of zeros, of a text, of lists."""
    packed = [
        msgpack.packb(tree)
        for tree in ({"run": "x" * (MAX_PAYLOAD - 20)}, [[]] * (MAX_PAYLOAD // 2))
    ]
    return [bytes(MAX_PAYLOAD + 1), *packed, bytes(1 << 22)]
