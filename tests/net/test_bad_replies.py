"""A query that unknown clients answer too takes the reply that makes sense, and refuses all others."""

import math

import msgpack
import pytest
from bad_messages import RUN, bad, refusal_of
from local_runs import SMALL
from recorded_messages import KEYS, Net, Query, Run, StandIn, oversized, rewritten

from orchard.contract.messages import StateRequest, pack
from orchard.net.bus import Replied
from orchard.net.mailbox import SentRequest
from orchard.net.refusals import Refusals, read_message
from orchard.net.requests import ask, fetch_run
from orchard.wire.messages import Answered, Joined, Recalled, Received, SimulationState, Stopped


def test_replies_to_requests_are_refused_unless_they_are_answers(other):
    host, asked, thrown = Run(SMALL, RUN, 1).host, SentRequest("bin_01", 7, 0, "picker_01", StateRequest()), 0
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
    """Of all sessions that reply to a get the last is physics."""

    def __init__(self, replies) -> None:
        super().__init__(Net(), "crowd")
        self._replies = replies

    def ask(self, key, payload, ticket, seconds=0.0) -> None:
        query = Query(key, payload, self.inbox.put, ticket)
        query._replied(Replied(ticket, b"", "go away\x1b[2J"))
        for reply in self._replies:
            query.reply(reply)


@pytest.mark.parametrize(
    ("what", "type_"), [("join", Joined), ("recall", Recalled), ("stop", Stopped), ("step_simulation", SimulationState)]
)
def test_who_asks_takes_the_reply_that_makes_sense(other, what, type_):
    example = next(p for _, p in reversed(other[what]) if not refusal_of(p, type_, "other"))
    good, refusals = rewritten(example, run=RUN), Refusals()
    bads = [payload for _, payload in bad(other, what, 500, 4)]
    crowd = Crowd([*bads, good])
    reply = ask(crowd, KEYS.of(what), b"", lambda payload: read_message(payload, type_, RUN), refusals=refusals)
    assert reply.run == RUN
    assert refusals.counts.total() == len(bads)


def test_a_newcomer_hears_physics_among_others(other):
    good = next(p for _, p in other["scenario"])
    assert fetch_run(Crowd([b"\xc1", b"", msgpack.packb({"run": RUN}), *oversized(), good]), KEYS).run == "other"
