"""The bus over Zenoh and over the simulated network of chaos/simulated, for scripts over both.

A script is a function of a test. It gets a network, opens sessions on it, and lets them publish,
ask and lose their links. It must see the same on both networks: so the simulated network, by which
random faults are tested, behaves as Zenoh does.
"""

import itertools
from contextlib import ExitStack
from math import inf
from random import Random

import pytest

from chaos.relay import Break, Change, Relay
from chaos.simulated.link import Delays
from chaos.simulated.network import Network
from chaos.simulated.scheduler import Scheduler, VirtualInbox
from orchard.net.bus import Query, Sample
from orchard.net.zenoh_bus import client, router

# s within which everything arrives, also on a busy machine.
LONG = 5.0
# s that a test waits to see that nothing arrives.
SHORT = 0.5
# Bytes a second.
BANDWIDTHS = (inf, 1e6)
# Bytes of a payload that Zenoh sends in several parts.
LARGE = 500_000
# Seeds from which the delays of the simulated networks are drawn.
SEEDS = range(5)
# Simulated s within which a script must be over.
SCRIPT_SECONDS = 1000.0


class OverZenoh:
    """Sessions of Zenoh, whose clients reach the router through a relay that can break."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self.router = stack.enter_context(router())
        port = int(self.router.endpoint.rpartition(":")[2])
        self._relay = stack.enter_context(Relay(port))

    def client(self):
        return self._stack.enter_context(client(self._relay.endpoint))

    def start_router(self):
        """Start a router at the same address, after the first one was closed."""
        self._stack.enter_context(router(self.router.endpoint))

    def close(self, bus) -> None:
        """End a session without a word, as when its process is killed."""
        bus._session.close()

    def cut(self) -> None:
        """Break all links. Zenoh connects again by itself, through the relay."""
        self._relay.cut()

    def damage(self, sent: bytes, arrived: bytes) -> None:
        """Let some bytes arrive as others, wherever they stand in a payload."""
        self._relay.damage(Change(sent, arrived))

    def heal(self) -> None:
        """Let all bytes arrive as they are sent again."""
        self._relay.heal()

    def break_within(self, bus, key: str, payload: bytes, where: bytes) -> None:
        """Publish a payload, and let all links break when it has passed up to `where`."""
        self._relay.damage(Break(where))
        bus.publish(key, payload)


class ReplacedBytes:
    """Replaces some bytes of what passes a simulated link, as the relay does for Zenoh."""

    def __init__(self, sent: bytes, arrived: bytes) -> None:
        self._sent = sent
        self._arrived = arrived

    def carry(self, key: str, payload: bytes, is_reply: bool) -> bytes:
        return payload.replace(self._sent, self._arrived)


class Simulated:
    """Sessions of the simulated network, in the task of one script."""

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
        self._tear_by(ReplacedBytes(sent, arrived))

    def heal(self) -> None:
        self._tear_by(None)

    def _tear_by(self, tearer) -> None:
        """Let a tearer change what passes the links; None: nothing does."""
        for link in self._network.router.links.values():
            link.tearer = tearer

    def break_within(self, bus, key: str, payload: bytes, where: bytes) -> None:
        """Publish a payload, and let all links break: it is still on its way, for links delay."""
        bus.publish(key, payload)
        self.cut()


def over_zenoh(script) -> None:
    """Run a script of a test over Zenoh."""
    with ExitStack() as stack:
        script(OverZenoh(stack))


def simulated(script) -> None:
    """Run a script of a test over simulated networks with several delays."""
    for seed in SEEDS:
        _run_simulated(script, seed)


def _run_simulated(script, seed: int) -> None:
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
    scheduler.run(lambda: task.is_over, SCRIPT_SECONDS)
    if task.error is not None:
        raise task.error
    assert task.is_over


def on_both(script):
    """Make two tests of a script: one over Zenoh, one over the simulated network."""

    @pytest.mark.parametrize("run", [over_zenoh, simulated], ids=["zenoh", "simulated"])
    def test(run):
        run(script)

    test.__doc__ = script.__doc__
    return test


def received(bus, count: int, type_: type = Sample) -> list:
    """Return the next `count` items of a type that arrive; items of other types are passed over."""
    items = []
    while len(items) < count:
        item = bus.inbox.take(LONG)
        assert item is not None, f"only {items}"
        if isinstance(item, type_):
            items.append(item)
    return items


def is_silent(bus) -> bool:
    """Whether nothing arrives for a short while."""
    return bus.inbox.take(SHORT) is None


def wait_until(bus, condition) -> None:
    """Wait by the clock of a session until a condition holds."""
    deadline = bus.clock() + LONG
    while not condition():
        assert bus.clock() < deadline
        bus.sleep(0.01)


def ask_one(net, key="a", seconds=LONG):
    """Let one session ask another. Return the asker, the answerer and the query, not yet answered.

    `key`: on which it asks; the answerer answers on "a". `seconds`: for how long the asker waits.
    The query's ticket is 1.
    """
    asker = net.client()
    answerer = net.client()
    answerer.answer("a")
    # Until the router knows that the answerer answers, it would find none.
    asker.sleep(SHORT)
    asker.ask(key, b"", 1, seconds)
    (query,) = received(answerer, 1, Query)
    return asker, answerer, query
