"""What unknown clients may do: of their replies to a query those that make sense count, and all
that they could fill is bounded.

A stranger is a session that is no process of the run. `other` has the messages of another run, of
which `bad_messages` makes damaged ones. A question takes the first reply that makes sense.
"""

import math
import socket
from contextlib import ExitStack

import msgpack
import pytest
from bad_messages import RUN, bad_messages, refusal_of
from local_runs import SMALL
from recorded_messages import KEYS, Net, Query, Run, StandIn, oversized, rewritten

from orchard.contract.messages import StateRequest, pack
from orchard.net.bus import Alive, Replied, Sample
from orchard.net.mailbox import SentRequest
from orchard.net.refusals import Refusals, Refused, read_message
from orchard.net.requests import ErrorReply, ask, fetch_run
from orchard.net.zenoh_bus import client, router
from orchard.wire.messages import Answered, Joined, Recalled, Received, SimulationState, Stopped


def test_replies_to_requests_are_refused_unless_they_are_answers(other):
    """bin_01 asked at tick 7. So `received` is of tick 7, and the answer of 8, after it."""
    host = Run(SMALL, RUN, 1).host
    asked = SentRequest("bin_01", 7, 0, "picker_01", StateRequest())
    thrown = 0
    for _, payload in bad_messages(other, "mail", 4000, 3):
        host.handle(Replied(asked, payload, ""))
        thrown += 1
    stale = [Received(RUN, 6), Received(RUN, 8), Answered(RUN, 8, None)]
    offers = [
        {"type": "offer", "x": value, "y": 0.0, "distance": 1.0}
        for value in (math.nan, math.inf, 1e9)
    ]
    for payload in [
        *map(pack, stale),
        *(
            msgpack.packb({"type": "answered", "run": RUN, "tick": 8, "body": body})
            for body in offers
        ),
    ]:
        host.handle(Replied(asked, payload, ""))
        thrown += 1
    assert host.refusals.counts.total() == thrown
    assert not (asked.received or asked.answered or asked.answer)


class Crowd(StandIn):
    """A bus on which a stranger refuses each question, and others reply to it."""

    def __init__(self, replies) -> None:
        super().__init__(Net(), "crowd")
        self._replies = replies

    def ask(self, key, payload, ticket, seconds=0.0) -> None:
        query = Query(key, payload, self.inbox.put, ticket)
        query._replied(Replied(ticket, b"", "go away\x1b[2J"))
        for reply in self._replies:
            query.reply(reply)


@pytest.mark.parametrize(
    ("what", "type_"),
    [
        ("join", Joined),
        ("recall", Recalled),
        ("stop", Stopped),
        ("step_simulation", SimulationState),
    ],
)
def test_a_question_takes_the_reply_that_makes_sense(other, what, type_):
    """It comes last, after 500 bad ones, which are refused and counted."""
    example = next(p for _, p in reversed(other[what]) if not refusal_of(p, type_, "other"))
    valid = rewritten(example, run=RUN)
    refusals = Refusals()
    bads = [payload for _, payload in bad_messages(other, what, 500, 4)]
    crowd = Crowd([*bads, valid])
    reply = ask(
        crowd,
        KEYS.of(what),
        b"",
        lambda payload: read_message(payload, type_, RUN),
        refusals=refusals,
    )
    assert reply.run == RUN
    assert refusals.counts.total() == len(bads)


def test_a_newcomer_hears_physics_among_others(other):
    valid = next(p for _, p in other["scenario"])
    assert (
        fetch_run(Crowd([b"\xc1", b"", msgpack.packb({"run": RUN}), *oversized(), valid]), KEYS).run
        == "other"
    )


class Refusing(Crowd):
    """A network on which physics is away, and another client refuses the first questions.

    `questions`: how many it refuses.
    """

    def __init__(self, questions: int, reply: bytes) -> None:
        super().__init__([reply])
        self._left = questions

    def ask(self, key, payload, ticket, seconds=0.0) -> None:
        self._left -= 1
        if self._left < 0:
            super().ask(key, payload, ticket, seconds)
        else:
            Query(key, payload, self.inbox.put, ticket).refuse("no")

    def sleep(self, seconds: float) -> None:
        pass


def test_a_newcomer_asks_again_if_another_client_refuses(other):
    valid = next(p for _, p in other["scenario"])
    assert fetch_run(Refusing(20, valid), KEYS).run == "other"
    with pytest.raises(ErrorReply, match="no"):
        fetch_run(Refusing(100, valid), KEYS, tries=20)


def test_what_is_told_is_short_and_does_nothing_to_a_terminal(caplog):
    """Keys and reasons are shortened, and characters that control a terminal are left out.

    Of 3,000 different keys each is counted, and 1,000 are remembered.
    """
    refusals = Refusals()
    for number in range(3000):
        refusals.note(
            f"orchard/{number}\x1b[2J{'x' * 60_000}/velocity",
            Refused("malformed", "\x1b[2J\n" + "y" * 100_000),
        )
    assert refusals.counts == {"malformed": 3000}
    assert len(refusals._logged) == 1000
    assert all(len(key) <= 200 and key.isprintable() for key, _ in refusals._logged)
    assert all(
        len(record.getMessage()) < 500 and record.getMessage().isprintable()
        for record in caplog.records
    )


def test_reasons_and_sessions_that_are_made_up_are_bounded():
    """3,000 made-up sessions tell their refusals, half of them for made-up reasons, and 3,000
    tokens come with keys that are too long.

    Malformed are the 1,500 messages with made-up reasons and the 3,000 tokens. Of the others the
    first 1,000 sessions are kept, and 500 are too many.
    """
    physics = Run(SMALL, "run1", 1).physics
    for number in range(3000):
        count = {"malformed": 1} if number % 2 else {f"reason {number}": 1}
        physics.bus.inbox.put(
            Sample(
                f"orchard/hosts/made{number}/refused",
                msgpack.packb({"run": "run1", "counts": count}),
            )
        )
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}{'x' * 100}", True))
    while physics.arrivals.take(0.0):
        pass
    assert len(physics.run.refusal_totals.there) == 1000
    assert physics.run.refusal_totals.counts == {"malformed": 1500 + 3000, "too many": 500}
    assert not physics.run.drivers.roster.tokens


def test_tokens_are_bounded():
    """10,000 liveliness tokens are kept (`MOST_TOKENS`), and the others are refused."""
    physics = Run(SMALL, "run1", 1).physics
    for number in range(11_000):
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}", True))
    while physics.arrivals.take(0.0):
        pass
    assert physics.run.refusal_totals.counts == {"too many": 1000}


def test_connections_that_say_nothing_keep_no_client_out():
    """By Zenoh's default a router handles 100 connections that have not said what they are."""
    with ExitStack() as stack:
        alone = stack.enter_context(router())
        host, _, port = alone.endpoint.removeprefix("tcp/").rpartition(":")
        for _ in range(300):
            stack.enter_context(socket.create_connection((host, int(port))))
        with client(alone.endpoint):
            pass
