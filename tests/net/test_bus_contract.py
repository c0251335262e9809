"""What the code of the processes expects of a bus, over Zenoh and over the simulated network; and
of an inbox: nothing is lost there.
"""

import itertools
import threading
from contextlib import ExitStack
from math import inf
from random import Random

import pytest
from patience import PATIENCE

from chaos.relay import Break, Change, Relay
from chaos.simulated.link import Delays
from chaos.simulated.network import Network
from chaos.simulated.scheduler import Scheduler, VirtualInbox
from chaos.simulated.tearing import Tearer, Tears, is_message
from orchard.contract.messages import pack
from orchard.net.bus import TIMED_OUT, Alive, Final, Inbox, Query, Replied, Sample, Signal
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.net.zenoh_bus import client, router
from orchard.wire.messages import Departure, Lost, Recall, Recalled

LONG = 5.0  # s in which all arrives, also on a busy machine
SHORT = 0.5  # s in which nothing arrives
BANDWIDTHS = (inf, 1e6)  # bytes a second
LARGE = 500_000  # bytes of a payload


class OverZenoh:
    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self.router = stack.enter_context(router())
        port = int(self.router.endpoint.rpartition(":")[2])
        self._relay = stack.enter_context(Relay(port))

    def client(self):
        return self._stack.enter_context(client(self._relay.endpoint))

    def start_router(self):
        self._stack.enter_context(router(self.router.endpoint))

    def close(self, bus) -> None:
        bus._session.close()

    def cut(self) -> None:
        self._relay.cut()

    def damage(self, sent: bytes, arrived: bytes) -> None:
        """Let some bytes arrive as others, wherever they stand in a payload."""
        self._relay.damage(Change(sent, arrived))

    def heal(self) -> None:
        self._relay.heal()

    def break_within(self, bus, key: str, payload: bytes, where: bytes) -> None:
        """Publish a payload, and let all links break when it has passed up to `where`."""
        self._relay.damage(Break(where))
        bus.publish(key, payload)


class Changed:
    """Changes what passes a simulated link, as the relay does."""

    def __init__(self, sent: bytes, arrived: bytes) -> None:
        self._sent = sent
        self._arrived = arrived

    def carry(self, key: str, payload: bytes, is_reply: bool) -> bytes:
        return payload.replace(self._sent, self._arrived)


class Simulated:
    def __init__(self, stack: ExitStack, network: Network, task) -> None:
        self._stack = stack
        self._network = network
        self._task = task
        self._names = itertools.count()
        self.router = self.start_router()

    def start_router(self):
        return self._opened(self._network.router_session)

    def client(self):
        return self._opened(self._network.client_session)

    def _opened(self, session):
        inbox = VirtualInbox(self._network.scheduler)
        inbox.read_by(self._task)
        return self._stack.enter_context(
            session(f"bus_{next(self._names)}", self._task, inbox, None)
        )

    def close(self, bus) -> None:
        self._network.end(bus)

    def cut(self) -> None:
        for bus in list(self._network.sessions):
            self._network.cut(bus.name, 0.0)

    def damage(self, sent: bytes, arrived: bytes) -> None:
        self._tear_by(Changed(sent, arrived))

    def heal(self) -> None:
        self._tear_by(None)

    def _tear_by(self, tearer) -> None:
        for link in self._network.router.links.values():
            link.tearer = tearer

    def break_within(self, bus, key: str, payload: bytes, where: bytes) -> None:
        bus.publish(key, payload)
        self.cut()


def over_zenoh(script) -> None:
    with ExitStack() as stack:
        script(OverZenoh(stack))


def simulated(script) -> None:
    for seed in range(5):
        _simulated(script, seed)


def _simulated(script, seed: int) -> None:
    scheduler = Scheduler()
    network = Network(
        scheduler,
        f"contract {seed}",
        Delays(share=Random(seed).random(), bytes_per_second=BANDWIDTHS[seed % len(BANDWIDTHS)]),
        pauses=0.1,
    )

    def body() -> None:
        with ExitStack() as stack:
            script(Simulated(stack, network, task))

    task = scheduler.spawn("script", body)
    scheduler.run(lambda: task.is_over, 1000.0)
    if task.error is not None:
        raise task.error
    assert task.is_over


def on_both(script):
    @pytest.mark.parametrize("play", [over_zenoh, simulated], ids=["zenoh", "simulated"])
    def test(play):
        play(script)

    return test


def heard(bus, count: int, type_: type = Sample) -> list:
    items = []
    while len(items) < count:
        item = bus.inbox.take(LONG)
        assert item is not None, f"only {items}"
        if isinstance(item, type_):
            items.append(item)
    return items


def is_silent(bus) -> bool:
    return bus.inbox.take(SHORT) is None


def when(bus, is_so) -> None:
    deadline = bus.clock() + LONG
    while not is_so():
        assert bus.clock() < deadline
        bus.sleep(0.01)


@on_both
def test_samples_of_one_session_arrive_in_order(net):
    """Samples of one session arrive in order and no session hears itself."""
    one = net.client()
    other = net.client()
    for bus in (one, other):
        bus.subscribe("a/*")
    when(one, lambda: one.is_heard("a/b"))
    for number in range(200):
        one.publish(f"a/{number % 3}", str(number).encode())
    assert [int(sample.payload) for sample in heard(other, 200)] == list(range(200))
    assert is_silent(one)


@on_both
def test_a_large_payload_arrives_before_a_later_small_one(net):
    """A large payload arrives whole and before a small one that follows it."""
    one = net.client()
    other = net.client()
    net.router.subscribe("a")
    other.subscribe("a")
    when(one, lambda: one.is_heard("a"))
    payloads = [bytes([number]) * LARGE for number in range(3)] + [b"small"]
    for payload in payloads:
        one.publish("a", payload)
    for bus in (other, net.router):
        assert [sample.payload for sample in heard(bus, len(payloads))] == payloads


@on_both
def test_a_large_reply_arrives_whole(net):
    asker, _, query = asked(net)
    query.reply(b"!" * LARGE)
    query.drop()
    assert heard(asker, 2, Replied | Final) == [Replied(1, b"!" * LARGE, ""), Final(1)]


@on_both
def test_a_router_has_a_session_of_its_own(net):
    bus = net.client()
    bus.subscribe("to/client")
    net.router.subscribe("to/router")
    when(bus, lambda: bus.is_heard("to/router"))
    when(bus, lambda: net.router.is_heard("to/client"))
    bus.publish("to/router", b"1")
    net.router.publish("to/client", b"2")
    assert heard(net.router, 1) == [Sample("to/router", b"1")]
    assert heard(bus, 1) == [Sample("to/client", b"2")]


@on_both
def test_a_router_is_alone_at_its_endpoint(net):
    """So the sessions of the first one are never left with a router that no other can reach."""
    bus = net.client()
    net.router.subscribe("a")
    with pytest.raises(BusError):
        net.start_router()
    when(bus, lambda: bus.is_heard("a"))
    bus.publish("a", b"1")
    assert heard(net.router, 1) == [Sample("a", b"1")]


@on_both
def test_two_subscriptions_that_meet_a_key_give_the_sample_twice(net):
    one = net.client()
    other = net.client()
    other.subscribe("a/*")
    other.subscribe("a/b", quietly=True)
    when(one, lambda: one.is_heard("a/b"))
    other.sleep(SHORT)
    one.publish("a/b", b"1")
    assert heard(other, 2) == [Sample("a/b", b"1")] * 2


@on_both
def test_a_publisher_knows_whether_another_session_subscribes(net):
    one = net.client()
    other = net.client()
    one.subscribe("a/b")
    assert not one.is_heard("a/b")
    other.subscribe("a/**")
    when(one, lambda: one.is_heard("a/b"))
    assert not one.is_heard("b")
    net.close(other)
    when(one, lambda: not one.is_heard("a/b"))


@on_both
def test_a_watcher_learns_of_earlier_tokens_and_changes(net):
    """A session that watches learns of tokens from before and of each change."""
    one = net.client()
    other = net.client()
    one.declare_alive("alive/x/1")
    one.sleep(SHORT)
    other.watch("alive/*/*")
    assert heard(other, 1, Alive) == [Alive("alive/x/1", True)]
    one.declare_alive("alive/y/1")
    one.withdraw("alive/x/1")
    assert heard(other, 2, Alive) == [Alive("alive/y/1", True), Alive("alive/x/1", False)]
    net.close(one)
    assert heard(other, 1, Alive) == [Alive("alive/y/1", False)]


@on_both
def test_tokens_of_two_sessions_with_one_key_are_one_token(net):
    watcher = net.client()
    one = net.client()
    other = net.client()
    watcher.watch("alive/*/*")
    for bus in (one, other):
        bus.declare_alive("alive/x/1")
        bus.sleep(SHORT)
    assert heard(watcher, 1, Alive) == [Alive("alive/x/1", True)]
    net.close(one)
    assert is_silent(watcher)
    other.withdraw("alive/x/1")
    assert heard(watcher, 1, Alive) == [Alive("alive/x/1", False)]


@on_both
def test_all_queryables_reply_and_then_it_is_final(net):
    """All queryables reply as often as they like and then it is final."""
    asker = net.client()
    one = net.client()
    other = net.client()
    one.answer("a/one")
    other.answer("a/*")
    asker.sleep(SHORT)
    asker.ask("a/one", b"?", "ticket")
    for bus, payloads in ((one, [b"1", b"2"]), (other, [b"3"])):
        (query,) = heard(bus, 1, Query)
        assert (query.key, query.payload) == ("a/one", b"?")
        for payload in payloads:
            query.reply(payload)
        query.drop()
    items = heard(asker, 4, Replied | Final)
    assert sorted(item.payload for item in items[:3]) == [b"1", b"2", b"3"]
    assert items[3] == Final("ticket")


def asked(net, key="a", seconds=LONG):
    """A session that asks another one, the other one, and the query that it has heard."""
    asker = net.client()
    other = net.client()
    other.answer("a")
    asker.sleep(SHORT)
    asker.ask(key, b"", 1, seconds)
    return asker, other, *heard(other, 1, Query)


@on_both
def test_a_refusal_is_an_error_and_the_end(net):
    asker, _, query = asked(net)
    query.refuse("no")
    assert heard(asker, 2, Replied | Final) == [Replied(1, b"", "no"), Final(1)]


@on_both
def test_a_query_with_wildcards_has_the_key_that_was_asked(net):
    _, _, query = asked(net, "*")
    assert query.key == "*"


@on_both
def test_a_query_that_meets_no_queryable_is_final_at_once(net):
    asker = net.client()
    asker.ask("a", b"", 1, 100.0)
    assert heard(asker, 1, Replied | Final) == [Final(1)]


@on_both
def test_a_session_answers_its_own_query(net):
    bus = net.client()
    bus.answer("a")
    bus.ask("a", b"?", 1)
    (query,) = heard(bus, 1, Query)
    query.reply(b"!")
    query.drop()
    assert heard(bus, 2, Replied | Final) == [Replied(1, b"!", ""), Final(1)]


@on_both
def test_a_query_that_nobody_drops_ends_with_its_time(net):
    begun = net.router.clock()
    asker, _, query = asked(net, seconds=1.0)
    query.reply(b"!")
    assert heard(asker, 3, Replied | Final) == [
        Replied(1, b"!", ""),
        Replied(1, b"", TIMED_OUT),
        Final(1),
    ]
    assert asker.clock() - begun >= SHORT + 0.9
    query.reply(b"late")
    assert is_silent(asker)


@on_both
def test_a_query_is_final_when_the_answerer_goes(net):
    """A query is final when the session that should answer goes."""
    asker, other, _ = asked(net, seconds=100.0)
    net.close(other)
    assert heard(asker, 1, Replied | Final) == [Final(1)]


@on_both
def test_after_a_cut_tokens_and_declarations_come_back(net):
    """After a cut all tokens are gone and come back and all that was declared counts again."""
    bus = net.client()
    net.router.declare_alive("alive/physics/1")
    net.router.watch("alive/x/*")
    bus.watch("alive/physics/*")
    bus.subscribe("a")
    bus.answer("b")
    bus.declare_alive("alive/x/1")
    assert heard(bus, 1, Alive) == [Alive("alive/physics/1", True)]
    assert heard(net.router, 1, Alive) == [Alive("alive/x/1", True)]
    net.cut()
    assert heard(bus, 2, Alive) == [Alive("alive/physics/1", False), Alive("alive/physics/1", True)]
    assert heard(net.router, 2, Alive) == [Alive("alive/x/1", False), Alive("alive/x/1", True)]
    when(bus, lambda: net.router.is_heard("a"))
    net.router.publish("a", b"1")
    assert heard(bus, 1) == [Sample("a", b"1")]
    net.router.ask("b", b"", 1)
    heard(bus, 1, Query)[0].refuse("no")
    assert heard(net.router, 2, Replied | Final) == [Replied(1, b"", "no"), Final(1)]


@on_both
def test_a_cut_ends_a_query_that_is_under_way(net):
    asker = net.client()
    net.router.answer("a")
    asker.sleep(SHORT)
    asker.ask("a", b"", 1, 100.0)
    (query,) = heard(net.router, 1, Query)
    net.cut()
    assert heard(asker, 1, Replied | Final) == [Final(1)]
    query.reply(b"late")
    query.drop()
    assert is_silent(asker)


RUN = "run1"
# What tears a payload in schedules: its end is bytes of another message, or one byte is another.
KINDS_OF_TEARS = (Tears(torn=1.0), Tears(changed=1.0))


def damaged(key: str, payload: bytes, tears: Tears, is_reply: bool = False) -> bytes:
    """Return a payload as a link of a schedule tears it, so that no receiver can take it."""
    tearer = Tearer(tears, Random(1), lambda: None)
    other = pack(Lost("another run", 7, ["bin_01"], "a"))
    for _ in range(100):
        tearer.carry(key, other, is_reply)
        arrived = tearer.carry(key, payload, is_reply)
        if arrived != payload:
            assert not is_message(key, arrived, is_reply)
            return arrived
    raise AssertionError(f"{payload!r} is not torn")


def refusal_of(payload: bytes, type_: type) -> str:
    """Return why a receiver refuses a payload; '' if it takes it."""
    try:
        read_message(payload, type_, RUN)
    except Refused as refusal:
        return refusal.reason
    return ""


@on_both
def test_a_torn_payload_arrives_torn_and_what_follows_whole(net):
    """A torn or changed payload arrives as it is: its reader refuses it, the link stays, and the
    next one is whole.
    """
    key = "orchard/hosts/a/left"
    whole = pack(Departure(RUN))
    one = net.client()
    other = net.client()
    one.declare_alive("alive/x/1")
    other.watch("alive/x/*")
    heard(other, 1, Alive)
    other.subscribe("orchard/hosts/*/left")
    when(one, lambda: one.is_heard(key))
    for tears in KINDS_OF_TEARS:
        torn = damaged(key, whole, tears)
        net.damage(whole, torn)
        one.publish(key, whole)
        assert [sample.payload for sample in heard(other, 1)] == [torn]
        assert refusal_of(torn, Departure) == "malformed"
        net.heal()
        one.publish(key, whole)
        assert [refusal_of(sample.payload, Departure) for sample in heard(other, 1)] == [""]
    assert is_silent(other)


@on_both
def test_a_torn_payload_of_a_stranger_is_told_by_its_bytes(net):
    """A stranger that publishes on the key of another is heard beside it, also with torn bytes."""
    key = "orchard/hosts/a/left"
    whole = pack(Departure(RUN))
    torn = damaged(key, whole, KINDS_OF_TEARS[0])
    owner = net.client()
    stranger = net.client()
    other = net.client()
    other.subscribe(key)
    for bus in (owner, stranger):
        when(bus, lambda bus=bus: bus.is_heard(key))
    stranger.publish(key, torn)
    assert [sample.payload for sample in heard(other, 1)] == [torn]
    owner.publish(key, whole)
    assert [sample.payload for sample in heard(other, 1)] == [whole]
    assert [refusal_of(payload, Departure) for payload in (torn, whole)] == ["malformed", ""]


@on_both
def test_a_torn_question_and_a_torn_reply_end_as_others_do(net):
    """A torn question is heard, a torn reply too, and each question ends with its last reply."""
    key = "orchard/recall"
    question = pack(Recall(RUN, 7))
    reply = pack(Recalled(RUN, 7, []))
    asker = net.client()
    other = net.client()
    other.answer(key)
    asker.sleep(SHORT)
    for tears in KINDS_OF_TEARS:
        torn = damaged(key, question, tears)
        net.damage(question, torn)
        asker.ask(key, question, "torn question")
        (query,) = heard(other, 1, Query)
        assert (query.key, query.payload) == (key, torn)
        assert refusal_of(query.payload, Recall) == "malformed"
        query.refuse("malformed")
        ends = [Replied("torn question", b"", "malformed"), Final("torn question")]
        assert heard(asker, 2, Replied | Final) == ends
        torn = damaged(key, reply, tears, is_reply=True)
        net.damage(reply, torn)
        asker.ask(key, question, "torn reply")
        (query,) = heard(other, 1, Query)
        assert query.payload == question
        query.reply(reply)
        query.drop()
        ends = [Replied("torn reply", torn, ""), Final("torn reply")]
        assert heard(asker, 2, Replied | Final) == ends
        assert refusal_of(torn, Recalled) == "malformed"
        net.heal()
    assert is_silent(asker)
    assert is_silent(other)


@on_both
def test_a_large_payload_changes_in_its_middle_only(net):
    """A large payload that changes has its length, and a later small one its place."""
    one = net.client()
    other = net.client()
    other.subscribe("a")
    when(one, lambda: one.is_heard("a"))
    rest = b"." * LARGE
    net.damage(b"MARKED BYTES", b"OTHER  BYTES")
    one.publish("a", b"MARKED BYTES" + rest)
    one.publish("a", b"small")
    payloads = [sample.payload for sample in heard(other, 2)]
    assert payloads == [b"OTHER  BYTES" + rest, b"small"]


@on_both
def test_of_a_payload_that_breaks_off_nothing_arrives(net):
    """Of a payload within which the links break nothing arrives; what follows arrives whole."""
    one = net.client()
    other = net.client()
    one.watch("alive/x/*")
    other.declare_alive("alive/x/1")
    heard(one, 1, Alive)
    other.subscribe("a")
    when(one, lambda: one.is_heard("a"))
    net.break_within(one, "a", b"MARKED BYTES" + b"." * LARGE, b"MARKED BYTES")
    assert heard(one, 2, Alive) == [Alive("alive/x/1", False), Alive("alive/x/1", True)]
    when(one, lambda: one.is_heard("a"))
    one.publish("a", b"next")
    assert [sample.payload for sample in heard(other, 1)] == [b"next"]


@on_both
def test_a_token_that_flaps_is_seen_unless_another_holds_it(net):
    """A client that declares and withdraws a token is seen, but not beside the holder of that
    token: so nobody can let physics seem to go.
    """
    watcher = net.client()
    one = net.client()
    flapping = net.client()
    watcher.watch("alive/*/*")
    for _ in range(3):
        for declare, up in ((flapping.declare_alive, True), (flapping.withdraw, False)):
            declare("alive/x/1")
            assert heard(watcher, 1, Alive) == [Alive("alive/x/1", up)]
    one.declare_alive("alive/x/1")
    assert heard(watcher, 1, Alive) == [Alive("alive/x/1", True)]
    for _ in range(3):
        flapping.declare_alive("alive/x/1")
        flapping.withdraw("alive/x/1")
    assert is_silent(watcher)


def run_by(work, threads=1):
    started = [threading.Thread(target=work, daemon=True) for _ in range(threads)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join(PATIENCE)
    return not any(thread.is_alive() for thread in started)


def test_a_short_wait_ends_although_it_was_rung_before():
    """A wait that is over before it has begun, because others had the processor, is over."""
    inbox = Inbox()

    def take() -> None:
        for number in range(30_000):
            inbox.put(Signal(number))
            assert inbox.take() == Signal(number)
            assert inbox.take(1e-6 * (number % 30)) is None

    assert run_by(take)


def test_whoever_rings_while_others_do_is_heard():
    inbox = Inbox()
    heard = []
    putters = 4

    def take() -> None:
        heard.extend(inbox.take(PATIENCE) for _ in range(putters * 5000))

    reader = threading.Thread(target=take, daemon=True)
    reader.start()
    assert run_by(lambda: [inbox.put(Signal(number)) for number in range(5000)], putters)
    reader.join(PATIENCE)
    assert sorted(heard) == sorted(Signal(number) for number in range(5000) for _ in range(putters))


def test_an_inbox_that_is_emptied_keeps_only_requests_to_end():
    inbox = Inbox()
    for item in (
        Sample("orchard/end", b""),
        Signal(15),
        Alive("orchard/alive/physics/run1/a", True),
    ):
        inbox.put(item)
    inbox.forget()
    assert inbox.take(0.0) == Signal(15)
    assert inbox.take(0.0) is None
