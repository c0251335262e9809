"""What an unknown client could fill is bounded: log lines, counts of refusals, liveliness tokens."""

import socket
from contextlib import ExitStack

import msgpack
from local_runs import SMALL
from recorded_messages import Run

from orchard.net.bus import Alive, Sample
from orchard.net.refusals import Refusals, Refused
from orchard.net.zenoh_bus import client, router


def test_what_is_told_is_short_and_does_nothing_to_a_terminal(caplog):
    refusals = Refusals()
    for number in range(3000):
        refusals.note(f"orchard/{number}\x1b[2J{'x' * 60_000}/velocity", Refused("malformed", "\x1b[2J\n" + "y" * 100_000))
    assert refusals.counts == {"malformed": 3000}
    assert len(refusals._logged) == 1000
    assert all(len(key) <= 200 and key.isprintable() for key, _ in refusals._logged)
    assert all(len(record.getMessage()) < 500 and record.getMessage().isprintable() for record in caplog.records)


def test_reasons_and_sessions_that_are_made_up_are_bounded():
    physics = Run(SMALL, "run1", 1).physics
    for number in range(3000):
        count = {"malformed": 1} if number % 2 else {f"reason {number}": 1}
        physics.bus.inbox.put(Sample(f"orchard/hosts/made{number}/refused", msgpack.packb({"run": "run1", "counts": count})))
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}{'x' * 100}", True))
    while physics.arrivals.take(0.0):
        pass
    assert len(physics.run.refusal_totals.there) == 1000
    assert physics.run.refusal_totals.counts == {"malformed": 1500 + 3000, "too many": 500}
    assert not physics.run.drivers.roster.tokens


def test_tokens_are_bounded():
    physics = Run(SMALL, "run1", 1).physics
    for number in range(11_000):
        physics.bus.inbox.put(Alive(f"orchard/alive/picker_01/s{number}", True))
    while physics.arrivals.take(0.0):
        pass
    assert physics.run.refusal_totals.counts == {"too many": 1000}


def test_connections_that_say_nothing_keep_no_client_out():
    with ExitStack() as stack:
        alone = stack.enter_context(router())
        host, _, port = alone.endpoint.removeprefix("tcp/").rpartition(":")
        for _ in range(300):
            stack.enter_context(socket.create_connection((host, int(port))))
        with client(alone.endpoint):
            pass
