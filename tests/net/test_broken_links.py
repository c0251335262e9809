"""Links that break at a certain message, without a network: no luck is needed to meet the
moment.

`Run` (tests/support/recorded_messages.py) is physics and a host in this process. `Net` carries what
they send. A session is alive while its liveliness tokens are there, and it says `left` when it
leaves. Physics sends `end` until all sessions have left.
"""

import math
import signal

import pytest
from calling_agents import cast
from local_runs import SMALL, TICKS
from recorded_messages import HOST, KEYS, RUN, Net, Query, Run, StandIn

from orchard.contract.messages import pack
from orchard.net.bus import Alive, Sample, Signal
from orchard.net.host import HostEnded
from orchard.server.barriers import AGAIN_SECONDS
from orchard.server.loop import END_SECONDS, LEAVE_SECONDS, RunLoop
from orchard.server.options import RunOptions
from orchard.sim.engine import Engine
from orchard.wire.messages import Departure, Joined, Report


class LosesTheEnd(Net):
    """A network that loses the first message that the run is over, and then the host's links."""

    def put(self, sender, key, payload) -> None:
        was_sent_before = any(key == sent_key for sent_key, _ in self.sent)
        if key != KEYS.of("end") or was_sent_before:
            super().put(sender, key, payload)
            return
        self.sent.append((key, payload))
        for name in Engine.begin(SMALL).layout.agents:
            self.alive(KEYS.of("alive", name, HOST), False)


def test_a_host_cut_off_at_the_end_is_told_it_again(undisturbed):
    run = Run(SMALL, RUN, TICKS, LosesTheEnd(), cast)
    assert run.to_the_end().hash == undisturbed
    assert run.code == 0


class Leaving(StandIn):
    """The bus of physics, at which items arrive at certain times of a clock of its own.

    It is its own inbox: `take` lets virtual time pass until the next item.
    """

    def __init__(self) -> None:
        super().__init__(Net(), "physics1")
        self.inbox = self
        self.now = 0.0
        # When physics published that the run is over, s.
        self.end_seconds = []
        # What arrives: (seconds, item), in the order of time.
        self.items = []

    def take(self, seconds):
        if self.items and self.items[0][0] <= self.now + seconds:
            self.now, item = self.items.pop(0)
            return item
        self.now += seconds
        return None

    def publish(self, key, payload, newest_wins=False) -> None:
        if key == KEYS.of("end"):
            self.end_seconds.append(round(self.now, 3))

    def clock(self) -> float:
        return self.now


TOKEN = KEYS.of("alive", "picker_01", "a")
GONE = Alive(TOKEN, False)
BACK = Alive(TOKEN, True)
LEFT = Sample(KEYS.of("left", session="a"), pack(Departure(RUN)))
LEFT_ANOTHER_RUN = Sample(KEYS.of("left", session="a"), pack(Departure("other")))
# Session a wants to join, although the run is over.
ASKS = Query(KEYS.of("join", session="a"), b"")


# What arrives at physics after its run, as (s, item), until when it waits, s, and when it says
# again that the run is over, every END_SECONDS; None: as long as it waits, eight times or more.
LEAVINGS = {
    "says so and goes": ([(0.01, LEFT), (0.02, GONE)], 0.02, []),
    "goes and its word comes later": ([(0.01, GONE), (0.02, LEFT)], 0.02, []),
    "is cut off and comes back": (
        [(0.01, GONE), (0.3, BACK), (0.55, LEFT), (0.56, GONE)],
        0.56,
        [0.2, 0.4],
    ),
    "asks to join": (
        [(0.1, ASKS), (0.2, ASKS), (0.3, ASKS), (0.4, ASKS), (0.45, LEFT), (0.46, GONE)],
        0.46,
        [0.2, 0.4],
    ),
    "keeps its token": ([(0.01, LEFT)], LEAVE_SECONDS, None),
    "is dead": ([(0.01, GONE)], LEAVE_SECONDS, None),
    "leaves another run": ([(0.01, LEFT_ANOTHER_RUN), (0.02, GONE)], LEAVE_SECONDS, None),
}


@pytest.mark.parametrize(("items", "until", "end_seconds"), LEAVINGS.values(), ids=LEAVINGS)
def test_physics_waits_for_sessions_and_tells_the_end_again(items, until, end_seconds):
    bus = waited(items, LEAVE_SECONDS)
    assert bus.now == pytest.approx(until)
    if end_seconds is None:
        assert len(bus.end_seconds) >= 8
    else:
        assert bus.end_seconds == end_seconds


# s for which physics waits before a reset at most.
RESET_SECONDS = 15.0


@pytest.mark.parametrize(
    ("items", "until"),
    [
        ([(0.01, GONE)], LEAVE_SECONDS),
        ([(0.01, LEFT)], RESET_SECONDS),
        ([(0.01, LEFT), (7.0, GONE)], 7.0),
    ],
    ids=["a dead session", "a token that stays", "a token that goes late"],
)
def test_a_reset_is_patient_with_tokens_not_with_dead_sessions(items, until):
    """Before a reset physics waits until the token of a session that has left is gone: the router
    may be slow to tell.

    It waits for a dead session, which never says that it leaves, no longer than at an end. It looks
    every END_SECONDS.
    """
    bus = waited(items, RESET_SECONDS)
    assert bus.now == pytest.approx(until, abs=1.1 * END_SECONDS)


def waited(items, seconds: float) -> Leaving:
    """Let physics wait at the end of a run until all sessions have left. Return its bus.

    `seconds`: how long it waits at most.
    """
    bus = Leaving()
    physics = RunLoop(bus, KEYS, Engine.begin(SMALL), RunOptions(run=RUN))
    roster = physics.run.drivers.roster
    roster.token("picker_01", "a", True)
    roster.join("picker_01", "a")
    bus.items = items
    physics._await_leaving(physics.run.end("duration"), seconds)
    return bus


def test_a_session_that_holds_no_agent_is_not_one_that_leaves():
    roster = RunLoop(Leaving(), KEYS, Engine.begin(SMALL), RunOptions(run=RUN)).run.drivers.roster
    roster.leave("a")
    roster.join("picker_01", "b")
    roster.leave("a")
    assert not roster.all_have_left()
    assert not roster._leaving


def test_a_host_says_that_it_leaves_when_the_run_is_over():
    run = Run(SMALL, RUN, 5, Net(), cast)
    run.to_the_end()
    assert [key for key, _ in run.net.sent].count(KEYS.of("left", session=HOST)) == 1


def test_a_host_says_that_it_leaves_when_a_user_stops_it():
    run = Run(SMALL, RUN, 5, Net(), cast)
    run.host.bus.inbox.put(Signal(signal.SIGTERM))
    with pytest.raises(HostEnded):
        run.host.run()
    assert [key for key, _ in run.net.sent] == [KEYS.of("left", session=HOST)]


@pytest.mark.parametrize("joins_again", [False, True])
def test_a_host_that_joins_again_sends_no_answer_of_before(monkeypatch, joins_again):
    """A tick that comes again gets the same answer, but not after a join.

    Physics may then have come to the tick in another way, for example from a snapshot.
    """
    run = Run(SMALL, RUN, 5, Net(), cast)
    run.to_the_end()
    host = run.host
    sent = run.net.sent
    ticks = [payload for key, payload in sent if key == KEYS.of("seen", session=HOST)]
    # As if the host had answered long ago: a repetition that comes too soon gets no answer.
    host._answer.at = -math.inf
    if joins_again:
        layout = run.physics._engine.layout
        monkeypatch.setattr("orchard.net.host.fetch_layout", lambda *_: (None, layout))
        monkeypatch.setattr(host, "_joined", lambda: Joined(RUN, host._answer.tick, {}, {}))
        host.join()
    if joins_again:
        answers = []
    else:
        answers = [KEYS.of("velocities", session=HOST)]
    before = len(sent)
    host.handle(Sample(KEYS.of("seen", session=HOST), ticks[-1]))
    assert [key for key, _ in sent[before:]] == answers


def test_a_session_that_joins_again_has_not_left():
    roster = RunLoop(Leaving(), KEYS, Engine.begin(SMALL), RunOptions(run=RUN)).run.drivers.roster
    roster.join("picker_01", "a")
    roster.leave("a")
    assert roster.all_have_left()
    roster.join("picker_01", "a")
    assert not roster.all_have_left()


def test_a_session_that_may_not_own_all_its_agents_owns_none():
    """Physics refuses the whole join: else it would wait for agents that the session does not run.

    `join` returns the names that are refused, with the reasons.
    """
    drivers = RunLoop(Leaving(), KEYS, Engine.begin(SMALL), RunOptions(run=RUN)).run.drivers
    names = ["picker_01", "picker_02"]
    for name in names:
        drivers.token(name, "a", True)
    assert drivers.join(["picker_02"], "a") == {}
    drivers.token("picker_01", "b", True)
    drivers.token("picker_02", "b", True)
    assert drivers.join(names, "b").keys() == {"picker_02"}
    assert drivers.roster.owners == {"picker_02": "a"}
    assert drivers.join(["picker_01", "nobody"], "b").keys() == {"nobody"}
    assert drivers.roster.owners == {"picker_02": "a"}
    assert drivers.join(["picker_01"], "b") == {}
    assert drivers.roster.owners == {"picker_01": "b", "picker_02": "a"}


class Silent(Leaving):
    """A bus at which nothing arrives, on a clock of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: list[tuple[float, str]] = []

    def __len__(self) -> int:
        return 0

    def take(self, seconds, enough=1):
        self.now += seconds

    def publish(self, key, payload, newest_wins=False) -> None:
        if key.endswith("/seen"):
            self.shown.append((round(self.now, 3), key))


def test_each_silent_session_gets_its_tick_again():
    """If only one session got it, a dead host would keep the tick from a host that has missed it.

    Patience is over after 3.5 repetitions, and then no session owns an agent.
    """
    bus = Silent()
    options = RunOptions(run=RUN, patience=3.5 * AGAIN_SECONDS)
    loop = RunLoop(bus, KEYS, Engine.begin(SMALL), options)
    drivers = loop.run.drivers
    owners = {"picker_01": "a", "picker_02": "b", "bin_01": "c"}
    for name, owner in owners.items():
        drivers.token(name, owner, True)
        assert drivers.join([name], owner) == {}
    drivers.begin(loop.run.engine.observe(), 0.0)
    loop._await_answers()
    times = [AGAIN_SECONDS * number for number in range(4)]
    for owner in owners.values():
        key = KEYS.of("seen", session=owner)
        assert [at for at, shown in bus.shown if shown == key] == times
    assert drivers.roster.owners == {}


def test_a_session_that_answers_for_some_agents_keeps_these():
    """The session lives, so physics takes only those agents for which it has not answered."""
    loop = RunLoop(Silent(), KEYS, Engine.begin(SMALL), RunOptions(run=RUN, patience=1.0))
    drivers = loop.run.drivers
    names = ["bin_01", "picker_01", "picker_02"]
    for name in names:
        drivers.token(name, "a", True)
    assert drivers.join(names, "a") == {}
    drivers.begin(loop.run.engine.observe(), 0.0)
    drivers.answers.take("picker_01", "a", 0, Report())
    loop._await_answers()
    assert drivers.roster.owners == {"picker_01": "a"}
