"""Tens of thousands of bad messages on all keys: refused, counted, without effect; memory stays as
it is.

The messages are those of another run, damaged ones, and well-formed ones that cannot be, such as a
tick far ahead. In an unsecured run any client may also stop robots and the run, and own agents that
no session owns: such messages are good ones, and no part of these tests.
"""

import logging
import math
from collections import Counter
from itertools import product
from random import Random
from types import SimpleNamespace

import msgpack
import numpy as np
import psutil
import pytest
from bad_messages import RUN, bad_messages, refusal_of
from local_runs import AGENTS, SMALL, local_hash
from recorded_messages import HOST, KEYS, Net, Query, Run, StandIn, oversized

from orchard.contract.messages import pack
from orchard.field.layout import lay_out
from orchard.launch.follower import _hear as follow
from orchard.net.bus import Alive, Final, Replied, Sample
from orchard.net.refusals import Refused
from orchard.record.logger import FrameQueue, Logger
from orchard.wire.keys import TABLE
from orchard.wire.messages import Angular, Linear, Velocity, read

pytestmark = pytest.mark.processes

TICKS = 60
# Bytes that all these messages may leave behind: 64 MiB.
MOST_MEMORY = 64 << 20
# The last parts of keys: of messages to physics, of messages to a host, and of queries.
CONTROL = ("simulation_state", "set_simulation_state", "step_simulation", "reset_simulation")
TO_PHYSICS = (
    "velocity",
    "velocities",
    "refused",
    "scenario",
    "join",
    "recall",
    "stop",
    *CONTROL,
    "layout",
    "advice",
)
TO_HOST = ("seen", "lost", "end", "mail", "state")
ASKED = ("scenario", "join", "recall", "stop", "mail", "state", "layout", *CONTROL)


def impossible(what: str, tick: int, host: str = HOST):
    """Return well-formed messages of this run that cannot be, each with its number of refusals.

    `what`: the last part of the key. A message with velocities of three bodies may be refused for
    each of them. Ticks are 5,000 ahead of the present one, `tick`.
    """
    drive = {"linear": {"x": 0.7}, "angular": {"z": 0.1}}
    one = {"run": RUN, **drive}
    many = {
        "run": RUN,
        "velocities": {name: drive for name in ("picker_01", "bin_02", "worker_01")},
    }
    return {
        "velocity": [
            (one | {"tick": tick + 5000, "owner": host}, 1),
            (one | {"tick": tick, "owner": "stranger"}, 1),
            (one | {"tick": tick}, 1),
        ],
        "velocities": [
            (many | {"tick": tick + 5000, "owner": host}, 1),
            (many | {"tick": tick, "owner": "stranger"}, 3),
        ],
        "join": [({"run": RUN, "owner": "stranger", "names": ["picker_01"]}, 1)],
        "recall": [({"run": RUN, "tick": tick + 5000}, 1)],
        "stop": [
            ({"run": RUN, "stop": True, "names": ["nobody"]}, 1),
            ({"run": RUN, "stop": True, "names": ["picker_01", "cat"]}, 1),
        ],
        "mail": [
            (
                {
                    "run": RUN,
                    "tick": tick + 5000,
                    "sender": "picker_01",
                    "number": 0,
                    "body": {"type": "where"},
                },
                1,
            ),
            (
                {
                    "run": RUN,
                    "tick": tick,
                    "sender": "nobody_01",
                    "number": 0,
                    "body": {"type": "where"},
                },
                1,
            ),
        ],
        "seen": [
            (
                {
                    "run": RUN,
                    "tick": tick + 5000,
                    "names": [],
                    "states": b"",
                    "ranges": b"",
                    "hitches": {},
                    "fills": {},
                    "full": [],
                },
                1,
            )
        ],
    }.get(what, [])


class Thrower:
    """Throws some bad messages at a run at each tick, and knows how many must be refused.

    `messages`: of another run, by the last part of the key. `count`: how many to throw in all.
    """

    def __init__(self, run: Run, messages, count: int) -> None:
        self.run = run
        # Session id -> how many messages it must refuse.
        self.expected = Counter()
        # Bytes that this process uses, at each tick.
        self.memory = []
        self.asked = 0
        # A list, for both threads append to it.
        self.replies: list[Replied] = []
        self.by_key = Counter()
        self._messages = messages
        # It throws at all ticks but the first two and the last six: the run must still have time
        # to refuse them.
        self._each = count // ((TICKS - 8) * len(TO_PHYSICS + TO_HOST))
        run.net.on_put = self.at_clock

    def at_clock(self, key: str, payload: bytes) -> None:
        """Throw the messages of a tick when physics publishes its clock."""
        if key != KEYS.of("clock"):
            return
        tick = msgpack.unpackb(payload)["tick"]
        if not 2 <= tick < TICKS - 6:
            return
        # What the run sends is not needed, and would count as memory that was left behind.
        self.run.net.sent.clear()
        self.run.net.queries.clear()
        self.memory.append(psutil.Process().memory_info().rss)
        for whats, bus in ((TO_PHYSICS, self.run.physics.bus), (TO_HOST, self.run.host.bus)):
            for what in whats:
                for key_, bad_ in bad_messages(self._messages, what, self._each, tick):
                    self.throw(bus, what, key_, bad_, 1)
                for message, refusals in impossible(what, tick):
                    self.throw(
                        bus,
                        what,
                        KEYS.of(what, "picker_01", "stranger"),
                        msgpack.packb(message),
                        refusals,
                    )
        for number in range(10):
            self.throw_tokens(tick * 10 + number)

    def throw(self, bus: StandIn, what: str, key: str, payload: bytes, refusals: int) -> None:
        """Put a bad message into the inbox of physics or of the host, as a query or a sample."""
        self.expected[bus.id] += refusals
        self.by_key[what] += 1
        if what in ASKED:
            self.asked += 1
            bus.inbox.put(Query(KEYS.of(what, key.split("/")[1], HOST), payload, self.hear))
        else:
            bus.inbox.put_quietly(Sample(key if key.count("/") <= 3 else KEYS.of(what), payload))

    def hear(self, item: Replied | Final) -> None:
        if isinstance(item, Replied):
            self.replies.append(item)

    def throw_tokens(self, number: int) -> None:
        """Declare tokens of names that do not exist, and tokens and keys that stand for many."""
        bus = self.run.physics.bus
        for key in (
            f"orchard/alive/nobody_{number}/x",
            "orchard/**",
            "orchard/alive/*/x",
            "orchard/alive/picker_01/*",
            "**",
        ):
            bus.inbox.put(Alive(key, number % 2 == 0))
        bus.inbox.put(Sample("orchard/**", b"\x80"))
        bus.inbox.put(
            Sample(
                f"orchard/nobody_{number}/velocity",
                pack(Velocity(RUN, 1, Linear(1.0), Angular(0.0))),
            )
        )
        self.run.host.bus.inbox.put(Sample("orchard/**", b"\x80"))
        self.run.host.bus.inbox.put(Alive("orchard/alive/**", False))
        # Physics refuses the five tokens and both samples. The host refuses the sample; a token
        # that concerns no physics is nothing to it.
        self.expected[bus.id] += 7
        self.expected[self.run.host.bus.id] += 1
        self.by_key["tokens and wildcards"] += 9


def test_a_rain_of_bad_messages_changes_no_bit(other, caplog):
    caplog.set_level(logging.WARNING)
    run = Run(SMALL, RUN, TICKS)
    thrower = Thrower(run, other, 40_000)
    end = run.to_the_end()
    assert end.hash == local_hash(SMALL, TICKS), "no effect"
    assert run.physics.run.refusal_totals.counts.total() == thrower.expected["physics1"]
    assert run.host.refusals.counts.total() == thrower.expected[HOST]
    assert len(thrower.replies) == thrower.asked and all(
        reply.error for reply in thrower.replies
    ), "nonsense gets an error reply"
    assert sum(thrower.by_key.values()) > 40_000
    # In the first fifth of the ticks memory grows in any case, for what all messages need.
    assert max(thrower.memory) - thrower.memory[len(thrower.memory) // 5] < MOST_MEMORY
    drivers = run.physics.run.drivers
    assert len(run.physics.run.refusal_totals.there) <= 1000
    assert not drivers.unowned._sent
    assert len(drivers.recovery_log.memories) <= AGENTS
    assert not any(
        "Traceback" in record.getMessage() or record.exc_info or len(record.getMessage()) > 700
        for record in caplog.records
    )
    refused = run.physics.run.refusal_totals.counts, run.host.refusals.counts
    print(dict(thrower.by_key), *map(dict, refused), [m >> 20 for m in thrower.memory[::10]])


@pytest.fixture
def logger():
    return Logger(StandIn(Net(), "logger1"), KEYS, RUN, lay_out(SMALL), FrameQueue())


def test_the_logger_refuses_them_and_writes_nothing(other, logger):
    thrown = 0
    for what in ("bundle", "lost", "end"):
        for key, payload in [
            *bad_messages(other, what, 3000, 0),
            *((KEYS.of(what), p) for p in oversized()),
        ]:
            logger._handle(Sample(key, payload))
            thrown += 1
    for key in ("orchard/**", "orchard/nobody"):
        logger._handle(Sample(key, b""))
    assert logger.refusals.counts.total() == thrown + 2
    assert not logger._notes
    assert not len(logger.queue)


def bundled(picture: dict) -> Sample:
    """Return a bundle with one picture."""
    return Sample(
        KEYS.of("bundle"),
        msgpack.packb(
            {"run": RUN, "tick": TICKS, "events": [], "letters": [], "pictures": [picture]}
        ),
    )


# Bytes of a pose: x, y and yaw as float 64.
POSE = 24


def test_pictures_that_are_not_of_this_orchard_are_refused(other, logger):
    """Each change makes an array too short, too long, of no numbers, or of what cannot be."""
    picture = next(
        p
        for _, p in reversed(other["picture"])
        if msgpack.unpackb(p)["scans"] and len(msgpack.unpackb(p)["poses"]) > POSE
    )
    good = msgpack.unpackb(picture) | {"run": RUN}
    changes = [
        {"poses": good["poses"][:-POSE]},
        {"poses": b"abc"},
        {"poses": np.full(len(good["poses"]) // 8, math.nan).tobytes()},
        {"scans": good["scans"][1:]},
        {"scans": [b"\0" * 4] * len(good["scans"])},
        {"coupled": [0]},
        {"coupled": [2**40]},
        {"fill": [math.nan]},
        {"row_ends": [[1.0, 0.0, 0.0, 0.0]]},
        {"alive": [True]},
        {"tick": 2**50},
        {"doing": {"Not A Name": "x"}},
    ]
    for change in changes:
        logger._handle(bundled(good | change))
    assert logger.refusals.counts == {"malformed": len(changes)}
    assert not len(logger.queue)
    bodies = len(good["poses"]) // POSE
    # A picture that is whole has all arrays: of each body, or four numbers of each of three rows.
    whole = {
        "alive": [True] * bodies,
        "row_ends": [[0.0] * 4] * 3,
        "fill": [0.0] * bodies,
        "coupled": [-1] * bodies,
        "whole": True,
    }
    logger._handle(bundled(good | whole))
    assert len(logger.queue) == 1, "the good one is taken"


def test_run_py_refuses_them_and_shows_nothing(other):
    shown = []
    progress = SimpleNamespace(show=lambda *what: shown.append(what))
    half = {
        "run": RUN,
        "tick": 1,
        "figures": {"sim_seconds": "x"},
        "doing": {},
        "waits_for": {},
        "messages_refused": {},
    }
    thrown = [
        *bad_messages(other, "figures", 3000, 1),
        *bad_messages(other, "end", 3000, 1),
        ("orchard/figures", msgpack.packb(half)),
    ]
    for key, payload in thrown:
        with pytest.raises(Refused):
            follow(Sample(key, payload), RUN, progress)
    assert not shown


def test_keys_that_only_others_hear_are_read_by_the_same_rules(other):
    for what in ("pose", "scan", "clock", "state"):
        for _, payload in bad_messages(other, what, 1500, 2):
            assert refusal_of(payload, TABLE[what].message, RUN)


def test_a_query_with_wildcards_moves_nothing(fleet):
    fleet.physics(SMALL, "--duration", "6")
    someone = fleet.client()
    messages = ({"state": "quitting"}, {"state": "paused"}, {"stop": True, "names": []})
    for key, message in product(
        ("orchard/*", "orchard/**", "**", "orchard/set_$*", "orchard/st$*"), messages
    ):
        replies = someone.ask(key, msgpack.packb({"run": fleet.run} | message))
        assert replies and set(replies) == {"no such key"}, key
    fleet.share(1)
    assert fleet.end() == local_hash(SMALL, 60)


def test_a_payload_that_ends_with_others_is_refused(other):
    """Zenoh delivers such payloads when it closes a full link: the end is bytes of other messages.

    If only the last value of a message is torn, nothing may show it. So ends are torn that are at
    least as long as the last value. What agents are shown and what they answer end with a value
    that shows each tear, so there a single byte must be noticed.
    """
    chance = Random(1)
    # Bytes that are torn at least, of the messages in which it is not nine: a float has nine. The
    # last value of a scan are the 60 ranges of a bin, of 4 bytes each.
    least = {"seen": 1, "velocities": 1, "velocity": 1, "scan": 241}
    payloads = [payload for sent in other.values() for _, payload in sent]
    for what in sorted(other.keys() - {"scenario", "layout"}):
        for _ in range(300 if other[what] else 0):
            payload = chance.choice(other[what])[1]
            after = b"\xfe\xbf\xe6" + b"".join(chance.choices(payloads, k=3))
            torn = chance.randrange(least.get(what, 9), len(payload))
            with pytest.raises(ValueError):  # noqa: PT011 - each fault has words of its own
                read(payload[:-torn] + (after * 100)[:torn], TABLE[what].message)
