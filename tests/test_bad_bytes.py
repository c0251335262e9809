"""A hundred thousand bad messages on all keys, and bad scenarios and snapshots: refused, counted, without effect; memory stays as it is.

In an unsecured run a stranger can do what keyspace.md allows to anybody: stop robots and the run, drive what nobody holds, hold what
nobody holds; and, who gives itself out for physics or for a holder, whatever these can. Such messages are none of these tests', which
throw what was meant for another run, what is no message, and what cannot be.
"""

import hashlib
import itertools
import logging
import math
import random
from collections import Counter
from contextlib import ExitStack, suppress
from types import SimpleNamespace

import msgpack
import numpy as np
import psutil
import pytest
import zenoh
from corpus import HOST, KEYS, Net, Query, Run, StandIn, mutants, oversized, recorded, rewritten
from fleet import Fleet, until
from test_lockstep import SMALL, local_hash
from test_snapshot import assert_usable_or_refused, local_at

from orchard.bus import Alive, Final, Replied, Sample
from orchard.config import LARGEST_FILE, ScenarioError, load
from orchard.host import Asking, newcomer, told
from orchard.hosting import Asked
from orchard.keys import TABLE
from orchard.layout import lay_out
from orchard.local import Local
from orchard.lockstep import Refusals, Refused, understood
from orchard.messages import State, pack
from orchard.snapshot import HEAD, LARGEST, VERSION, SnapshotError, read
from orchard.wire.course import Done, Joined, Stopped
from orchard.wire.driving import Velocity
from orchard.wire.geometry_msgs import Angular, Linear
from orchard.wire.letters import Answered, Recalled, Received
from processes.account import Account
from processes.logger import Logger
from processes.pages import Pages
from processes.together import _hear as follow

RUN, TICKS = "run1", 60
MOST_MEMORY = 64 << 20  # bytes, that 100,000 messages may leave behind

TO_PHYSICS = ("velocity", "velocities", "refused", "scenario", "join", "recall", "stop", "command")
TO_HOST = ("seen", "lost", "end", "mail", "state")
TO_LOGGER = ("picture", "events", "letters", "lost", "end")
TO_RUN_PY = ("figures", "end")
ASKED = ("scenario", "join", "recall", "stop", "command", "mail", "state")


@pytest.fixture(scope="module")
def other():
    """Real messages of another run."""
    return recorded(SMALL, "other", 40)


def make_sense(what: str, payload: bytes) -> bool:
    """Whether it is a message of this run: those are not thrown."""
    types = [type_ for type_ in (TABLE[what].message, *TABLE[what].replies) if type_ is not None]
    return any(not refusal_of(payload, type_, RUN) for type_ in types) or (what in ("state", "scenario") and not payload)


def refusal_of(payload: bytes, type_: type, run: str) -> str:
    try:
        understood(payload, type_, run)
    except Refused as refusal:
        return refusal.reason
    return ""


def bad(messages, what: str, count: int, seed: int):
    """(key, payload): of another run and damaged, or of this run and damaged so that they are no messages."""
    chance = random.Random(f"{what} {seed}")
    sources = [(key, p) for key, payload in messages[what] for p in (payload, rewritten(payload, run=RUN))]
    kinds = [(key, mutants(payload, chance)) for key, payload in sources]
    thrown = ((key, next(of)) for key, of in itertools.cycle(kinds))
    return itertools.islice(((key, payload) for key, payload in thrown if not make_sense(what, payload)), count)


def impossible(what: str, tick: int, host: str = HOST):
    """(payload, how many refusals): well-formed messages of this run that cannot be."""
    drive = {"linear": {"x": 0.7}, "angular": {"z": 0.1}}
    one, many = {"run": RUN, **drive}, {"run": RUN, "velocities": {name: drive for name in ("picker_01", "bin_02", "worker_01")}}
    return {
        "velocity": [
            (one | {"tick": tick + 5000, "holder": host}, 1),
            (one | {"tick": tick, "holder": "stranger"}, 1),
            (one | {"tick": tick}, 1),
        ],
        "velocities": [(many | {"tick": tick + 5000, "holder": host}, 1), (many | {"tick": tick, "holder": "stranger"}, 3)],
        "join": [({"run": RUN, "holder": "stranger", "names": ["picker_01"]}, 1)],
        "recall": [({"run": RUN, "tick": tick + 5000}, 1)],
        "stop": [({"run": RUN, "stop": True, "names": ["nobody"]}, 1), ({"run": RUN, "stop": True, "names": ["picker_01", "cat"]}, 1)],
        "mail": [
            ({"run": RUN, "tick": tick + 5000, "sender": "picker_01", "number": 0, "body": {"type": "where"}}, 1),
            ({"run": RUN, "tick": tick, "sender": "nobody_01", "number": 0, "body": {"type": "where"}}, 1),
        ],
        "seen": [({"run": RUN, "tick": tick + 5000, "names": [], "states": b"", "ranges": b"", "hitches": {}, "fills": {}, "full": []}, 1)],
    }.get(what, [])


class Thrower:
    """Throws at a run while it goes on, at each tick some, and knows how many of them must be refused."""

    def __init__(self, run: Run, messages, count: int) -> None:
        self.run, self.expected, self.memory = run, Counter(), []
        self.asked, self.errors, self.replies = 0, 0, 0
        self.by_key = Counter()
        self._messages, self._each = messages, count // ((TICKS - 8) * len(TO_PHYSICS + TO_HOST))
        run.net.on_put = self.at_clock

    def at_clock(self, key: str, payload: bytes) -> None:
        if key != KEYS.of("clock") or not 2 <= (tick := msgpack.unpackb(payload)["tick"]) < TICKS - 6:
            return
        self.run.net.sent.clear()
        self.run.net.queries.clear()
        self.memory.append(psutil.Process().memory_info().rss)
        for whats, bus in ((TO_PHYSICS, self.run.physics.bus), (TO_HOST, self.run.host.bus)):
            for what in whats:
                for key_, bad_ in bad(self._messages, what, self._each, tick):
                    self.throw(bus, what, key_, bad_, 1)
                for message, refusals in impossible(what, tick):
                    self.throw(bus, what, KEYS.of(what, "picker_01", "stranger"), msgpack.packb(message), refusals)
        for number in range(10):
            self.throw_tokens(tick * 10 + number)

    def throw(self, bus: StandIn, what: str, key: str, payload: bytes, refusals: int) -> None:
        self.expected[bus.id] += refusals
        self.by_key[what] += 1
        if what in ASKED:
            self.asked += 1
            bus.inbox.put(Query(KEYS.of(what, key.split("/")[1], HOST), payload, self.hear))
        else:
            bus.inbox.put_quietly(Sample(key if key.count("/") <= 3 else KEYS.of(what), payload))

    def hear(self, item: Replied | Final) -> None:
        self.errors += isinstance(item, Replied) and bool(item.error)
        self.replies += isinstance(item, Replied) and not item.error

    def throw_tokens(self, number: int) -> None:
        """Names that are not there; tokens and keys that stand for many."""
        bus = self.run.physics.bus
        for key in (f"orchard/alive/nobody_{number}/x", "orchard/**", "orchard/alive/*/x", "orchard/alive/picker_01/*", "**"):
            bus.inbox.put(Alive(key, number % 2 == 0))
        bus.inbox.put(Sample("orchard/**", b"\x80"))
        bus.inbox.put(Sample(f"orchard/nobody_{number}/velocity", pack(Velocity(RUN, 1, Linear(1.0), Angular(0.0)))))
        self.run.host.bus.inbox.put(Sample("orchard/**", b"\x80"))
        self.run.host.bus.inbox.put(Alive("orchard/alive/**", False))
        self.expected[bus.id] += 7
        self.expected[self.run.host.bus.id] += 1
        self.by_key["tokens and wildcards"] += 9


def test_a_run_under_a_rain_of_bad_messages_is_the_same_to_the_last_bit(other, caplog):
    caplog.set_level(logging.WARNING)
    run = Run(SMALL, RUN, TICKS)
    thrower = Thrower(run, other, 75_000)
    end = run.to_the_end()
    assert end.hash == local_hash(SMALL, TICKS), "no effect"
    assert run.physics.harvest.tally.own.counts.total() == thrower.expected["physics1"]
    assert run.host.refusals.counts.total() == thrower.expected[HOST]
    assert (thrower.errors, thrower.replies) == (thrower.asked, 0), "nonsense gets an error reply"
    assert sum(thrower.by_key.values()) > 75_000
    assert max(thrower.memory) - thrower.memory[len(thrower.memory) // 5] < MOST_MEMORY
    drivers = run.physics.harvest.drivers
    assert len(run.physics.harvest.tally.there) <= 1000 and not drivers.loose._puts and len(drivers.ledger.memories) <= 9
    assert not any("Traceback" in record.getMessage() or record.exc_info or len(record.getMessage()) > 700 for record in caplog.records)
    refused = run.physics.harvest.tally.own.counts, run.host.refusals.counts
    print(dict(thrower.by_key), *map(dict, refused), [m >> 20 for m in thrower.memory[::10]])


@pytest.fixture
def logger():
    return Logger(StandIn(Net(), "logger1"), KEYS, RUN, lay_out(SMALL), Pages())


def test_the_logger_refuses_them_and_writes_nothing(other, logger):
    thrown = 0
    for what in TO_LOGGER:
        for key, payload in [*bad(other, what, 3000, 0), *((KEYS.of(what), p) for p in oversized())]:
            logger._handle(Sample(key, payload))
            thrown += 1
    for key in ("orchard/**", "orchard/nobody"):
        logger._handle(Sample(key, b""))
    assert logger.refusals.counts.total() == thrown + 2
    assert not logger._notes and not len(logger.pages)


def test_pictures_that_are_not_of_this_orchard_are_refused(other, logger):
    picture = next(p for _, p in reversed(other["picture"]) if msgpack.unpackb(p)["scans"] and len(msgpack.unpackb(p)["poses"]) > 24)
    good = msgpack.unpackb(picture) | {"run": RUN}
    changes = [
        {"poses": good["poses"][:-24]},
        {"poses": b"abc"},
        {"poses": np.full(len(good["poses"]) // 8, math.nan).tobytes()},
        {"scans": good["scans"][1:]},
        {"scans": [b"\0" * 4] * len(good["scans"])},
        {"coupled": [0]},
        {"coupled": [2**40]},
        {"fill": [math.nan]},
        {"row_picked": [1.0]},
        {"alive": [True]},
        {"tick": 2**50},
        {"doing": {"Not A Name": "x"}},
    ]
    for change in changes:
        logger._handle(Sample("orchard/picture", msgpack.packb(good | change)))
    assert logger.refusals.counts == {"malformed": len(changes)}
    assert not len(logger.pages)
    logger._handle(
        Sample(
            "orchard/picture",
            msgpack.packb(
                good
                | {name: [0] * 9 for name in ("fill", "coupled")}
                | {
                    "alive": [True] * (len(good["poses"]) // 24),
                    "row_picked": [0.0] * 3,
                    "fill": [0.0] * (len(good["poses"]) // 24),
                    "coupled": [-1] * (len(good["poses"]) // 24),
                }
            ),
        )
    )
    assert len(logger.pages) == 1, "the good one is taken"


def test_run_py_refuses_them_and_shows_nothing(other):
    shown = []
    progress = SimpleNamespace(show=lambda *what: shown.append(what))
    half = {"run": RUN, "tick": 1, "figures": {"sim_seconds": "x"}, "doing": {}, "waits_for": {}, "messages_refused": {}}
    thrown = [item for what in TO_RUN_PY for item in bad(other, what, 3000, 1)] + [("orchard/figures", msgpack.packb(half))]
    for key, payload in thrown:
        with pytest.raises(Refused):
            follow(Sample(key, payload), RUN, progress)
    assert not shown


def test_keys_that_only_others_hear_are_read_by_the_same_rules(other):
    for what in ("pose", "scan", "clock", "state"):
        for _, payload in bad(other, what, 1500, 2):
            assert refusal_of(payload, TABLE[what].message, RUN)


# -- replies


def test_replies_to_requests_are_refused_unless_they_are_answers(other):
    host, asked, thrown = Run(SMALL, RUN, 1).host, Asked("bin_01", 7, 0, "picker_01", State()), 0
    for _, payload in bad(other, "mail", 4000, 3):
        host.handle(Replied(asked, payload, ""))
        thrown += 1
    stale = [Received(RUN, 6), Received(RUN, 8), Answered(RUN, 8, None)]
    offers = [{"type": "offer", "x": value, "y": 0.0, "distance": 1.0} for value in (math.nan, math.inf, 1e9)]
    for payload in [*map(pack, stale), *(msgpack.packb({"type": "answered", "run": RUN, "tick": 8, "body": body}) for body in offers)]:
        host.handle(Replied(asked, payload, ""))
        thrown += 1
    assert host.refusals.counts.total() == thrown
    assert not (asked.received or asked.answered or asked.answer)


class Crowd(StandIn):
    """Of all who reply to a get the last is physics."""

    def __init__(self, replies) -> None:
        super().__init__(Net(), "crowd")
        self._replies = replies

    def ask(self, key, payload, ticket, seconds=0.0) -> None:
        query = Query(key, payload, self.inbox.put, ticket)
        query._replied(Replied(ticket, b"", "go away\x1b[2J"))
        for reply in self._replies:
            query.reply(reply)


@pytest.mark.parametrize(
    ("what", "type_"), [("join", Joined), ("recall", Recalled), ("stop", Stopped), ("command", Done)]
)
def test_who_asks_takes_the_reply_that_makes_sense(other, what, type_):
    example = next(p for _, p in reversed(other[what]) if not refusal_of(p, type_, "other"))
    good, refusals = rewritten(example, run=RUN), Refusals()
    bads = [payload for _, payload in bad(other, what, 500, 4)]
    crowd = Crowd([*bads, good])
    reply = told(crowd, Asking(KEYS.of(what), b"", lambda payload: understood(payload, type_, RUN)), lambda item: None, refusals)
    assert reply.run == RUN
    assert refusals.counts.total() == len(bads)


def test_a_newcomer_hears_physics_among_others(other):
    good = next(p for _, p in other["scenario"])
    assert newcomer(Crowd([b"\xc1", b"", msgpack.packb({"run": RUN}), *oversized(), good]), KEYS).run == "other"


# -- what a stranger could fill


def test_what_is_told_is_short_and_does_nothing_to_a_terminal(caplog):
    refusals = Refusals()
    for number in range(3000):
        refusals.note(f"orchard/{number}\x1b[2J{'x' * 60_000}/velocity", Refused("malformed", "\x1b[2J\n" + "y" * 100_000))
    assert refusals.counts == {"malformed": 3000}
    assert len(refusals._told) == 1000
    assert all(len(key) <= 200 and key.isprintable() for key, _ in refusals._told)
    assert all(len(record.getMessage()) < 500 and record.getMessage().isprintable() for record in caplog.records)


def test_reasons_and_sessions_that_are_made_up_are_bounded():
    physics = Run(SMALL, RUN, 1).physics
    for number in range(3000):
        count = {"malformed": 1} if number % 2 else {f"reason {number}": 1}
        physics.bus.inbox.put(Sample(f"orchard/hosts/made{number}/refused", msgpack.packb({"run": RUN, "counts": count})))
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}{'x' * 100}", True))
    while physics.arrivals.take(0.0):
        pass
    assert len(physics.harvest.tally.there) == 1000
    assert physics.harvest.tally.own.counts == {"malformed": 1500 + 3000, "too many": 500}
    assert not physics.harvest.drivers.roster.anybody()


def test_tokens_are_bounded():
    physics = Run(SMALL, RUN, 1).physics
    for number in range(11_000):
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}", True))
    while physics.arrivals.take(0.0):
        pass
    assert physics.harvest.tally.own.counts == {"too many": 1000}


# -- the same over Zenoh


def test_thousands_over_the_network_change_nothing(tmp_path, other):
    with ExitStack() as stack:
        fleet = Fleet(tmp_path, stack)
        fleet.physics(SMALL, "--duration", "6")
        someone = fleet.client()
        ends, thrown = someone.hear("orchard/end"), 0
        for what in ("velocity", "velocities", "refused"):
            for key, payload in bad(other, what, 1000, 7):
                someone.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
                thrown += 1
        tokens = [
            someone.session.liveliness().declare_token(key) for key in ("orchard/**", "orchard/alive/*/x", "orchard/alive/picker_01/*")
        ]
        for what in ("join", "recall", "stop", "command"):
            for key, payload in bad(other, what, 50, 7):
                (error,) = someone.ask(key, payload)
                assert isinstance(error, str) and error.split(":")[0] in ("malformed", "other run")
                thrown += 1
        fleet.share(2)
        for what in ("seen", "lost", "end", "velocities", "picture"):
            for key, payload in bad(other, what, 300, 8):
                someone.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        for token in tokens:
            token.undeclare()
        end = until(ends, lambda message: isinstance(message, dict) and message.get("run") == fleet.run)
        assert fleet.end() == local_hash(SMALL, 60)
        assert sum(end["summary"]["messages_refused"].values()) >= thrown + len(tokens)


# -- scenarios


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{c}: &{c} [{','.join('*' + p for _ in range(9))}]\n" for p, c in itertools.pairwise("abcdefghi")
)
SCENARIOS = {
    "bomb": BOMB.encode(),
    "deep": b"a: " + b"[" * 60_000,
    "deep maps": b"{a: " * 15_000,
    "huge": b"rows: " + b"9" * 60_000,
    "exponent": b"picking_speed: 1e999999999",
    "twice": b"rows: 3\n" * 8000,
    "tab": b"people:\n\tworkers: 1",
    "nul": b"rows: 3\0",
    "no text": b"rows: \xff\xfe",
    "utf 16": "rows: 3".encode("utf-16"),
    "a megabyte": b"#" * (1 << 20),
    "unknown": b"{" + b"a," * 30_000 + b"}",
    "tag": b"rows: !!python/object/apply:os.system [true]",
    "surrogate": b'rows: "\\ud800"',
    "control": b"rows: \x1b[2J",
    "nan": b"row_width: .nan",
    "list": b"- 1",
    "text": b"rows",
    "merge": b"<<: {rows: 3}",
    "keys": b"? [1, 2]\n: 3",
    "two": b"rows: 3\n---\nrows: 4",
    "agents": b"agents: {1: 2}",
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_bad_scenario_is_refused_in_few_words(tmp_path, name):
    path = tmp_path / "bad.yaml"
    path.write_bytes(SCENARIOS[name])
    with pytest.raises(ScenarioError) as refused:
        load(path)
    assert len(str(refused.value)) < 20_000


@pytest.mark.parametrize("form", [b"\xef\xbb\xbf%s", b"%s"])
def test_marks_and_line_ends_of_other_systems_are_no_harm(tmp_path, form):
    path = tmp_path / "good.yaml"
    path.write_bytes(form % b"rows: 4\r\npickers: 2\r\n")
    assert load(path).rows == 4


def test_a_damaged_scenario_is_one_or_refused(tmp_path):
    path, chance = tmp_path / "damaged.yaml", random.Random(5)
    sources = [
        b"rows: 4\npeople: {workers: 3, visitors: 0}\nlaser: {noise: 0.01}\nagents: {picker: my.Picker}\n",
        b"weeds: 3\ntractor: false\n",
    ]
    pieces = [
        b"&a ",
        b"*a",
        b"!!int ",
        b"\t",
        b"\0",
        b"\xff",
        b"{",
        b"[",
        b"]",
        b": ",
        b"- ",
        b"'",
        b'"',
        b"\n",
        b"\r",
        b"|",
        b"%",
        b"---\n",
        b"1e99",
        b"-",
    ]
    for _ in range(1000):
        text = chance.choice(sources)
        for _ in range(chance.randrange(1, 4)):
            at = chance.randrange(len(text))
            text = text[:at] + chance.choice(pieces) * chance.choice([1, 1, 30]) + text[at + chance.randrange(3) :]
        path.write_bytes(text[:LARGEST_FILE])
        with suppress(ScenarioError):
            load(path)


# -- snapshots


@pytest.fixture(scope="module")
def snapshot():
    """A good one, as plain data."""
    local = local_at(12)
    taken = local.snapshot()
    taken.figures |= Account(local.engine).as_data()
    return msgpack.unpackb(pack(taken), strict_map_key=False)


def resumed(path, tree) -> Local:
    """What becomes of a snapshot with a right checksum. Raises SnapshotError."""
    payload = tree if isinstance(tree, bytes) else msgpack.packb(tree)
    path.write_bytes(HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)
    found = read(path)
    local = Local.resume(found)
    Account(local.engine, found.figures)
    return local


def array(tree, name, kind, place, value):
    values = np.frombuffer(tree["world"][name], kind).copy()
    values[place] = value
    return tree | {"world": tree["world"] | {name: values.tobytes()}}


FALSE = {
    "coupled to 999": lambda t: array(t, "coupled", "<i8", 0, 999),
    "coupled to -7": lambda t: array(t, "coupled", "<i8", 0, -7),
    "coupled to itself": lambda t: array(t, "coupled", "<i8", 0, 0),
    "coupled one way": lambda t: array(t, "coupled", "<i8", 0, -1),
    "nowhere": lambda t: array(t, "pose", "<f8", 0, math.nan),
    "far away": lambda t: array(t, "pose", "<f8", 1, 1e9),
    "infinite turn": lambda t: array(t, "pose", "<f8", 2, math.inf),
    "fast": lambda t: array(t, "twist", "<f8", 0, 1e300),
    "overfull": lambda t: array(t, "fill", "<f8", 0, 1e6),
    "less than none": lambda t: array(t, "row_picked", "<f8", 0, -1.0),
    "two truths": lambda t: array(t, "alive", "u1", 0, 7),
    "from nowhere": lambda t: array(t, "row_from", "<i8", 0, 5),
    "unloaded backwards": lambda t: array(t, "bay_ticks", "<i8", 0, -5),
    "short": lambda t: t | {"world": t["world"] | {"pose": b"\0" * 8}},
    "text": lambda t: t | {"world": t["world"] | {"pose": "x"}},
    "no pose": lambda t: t | {"world": {k: v for k, v in t["world"].items() if k != "pose"}},
    "before the beginning": lambda t: t | {"world": t["world"] | {"tick": -1}},
    "never": lambda t: t | {"world": t["world"] | {"tick": 2**63}},
    "half a tick": lambda t: t | {"world": t["world"] | {"tick": 1.5}},
    "no world": lambda t: t | {"world": {}},
    "no memories": lambda t: t | {"memories": dict.fromkeys(t["memories"], b"\xc1\xc1")},
    "nobody remembers": lambda t: t | {"memories": {"nobody": b"\x80"}},
    "nobody held": lambda t: t | {"held": ["nobody"]},
    "other agents' memories": lambda t: t | {"memories": {**t["memories"], "picker_01": b"\x81\xa4plan\xa1x"}},
    "short hash": lambda t: t | {"digest": b"x"},
    "odd run": lambda t: t | {"run": "a/*"},
    "other scenario": lambda t: t | {"scenario": {"rows": 20}},
    "no scenario": lambda t: t | {"scenario": {"rows": -1}},
    "other figures": lambda t: t | {"figures": {"states": {"since": "x", "ticks": {}}}},
    "no states": lambda t: t | {"figures": {"states": {}}},
    "no invariants": lambda t: t | {"figures": {"invariants": 3}},
    "wall of text": lambda t: t | {"figures": t["figures"] | {"wall_seconds": []}},
    "harvest": lambda t: t | {"figures": t["figures"] | {"harvest": 1}},
    "deep": lambda t: b"\x91" * 100_000,
    "nothing": lambda t: b"",
    "large": lambda t: bytes(LARGEST),
}


@pytest.mark.parametrize("lie", FALSE)
def test_a_snapshot_that_lies_is_refused(tmp_path, snapshot, lie):
    with pytest.raises(SnapshotError) as refused:
        resumed(tmp_path / "lie.snapshot", FALSE[lie](snapshot))
    assert len(str(refused.value)) < 3000


def test_letters_to_nobody_go_nowhere(tmp_path, snapshot):
    written = {"nobody": {"requests": [["nowhere", {"type": "where"}]], "answers": [["nobody", 3, 0, {"type": "yes"}]]}}
    lost = snapshot | {"letters": [*snapshot["letters"], [11, written], [2**60, written], [-5, written]]}
    for tree in (snapshot, lost):
        local = resumed(tmp_path / "letters.snapshot", tree)
        local.tick()
        assert local.engine.tick == 13


def test_a_damaged_snapshot_goes_on_or_is_refused(tmp_path, snapshot):
    path, chance = tmp_path / "damaged.snapshot", random.Random(6)
    assert_usable_or_refused(path, b"")
    good = 0
    for payload in itertools.islice(mutants(msgpack.packb(snapshot), chance), 150):
        with suppress(SnapshotError):
            resumed(path, payload)
            good += 1
    assert good < 110
