"""Nonsense on every key of a run of real processes: it is refused, counted, and logged once; and
the run is the same to the last bit.
"""

import random

import pytest
from fleet import wait_for
from local_runs import SMALL, TICKS, TOY

from orchard.wire.keys import TABLE

pytestmark = pytest.mark.processes

NAMES = ("picker_01", "bin_02", "traffic", "nobody")


@pytest.fixture
def running(fleet, tmp_path):
    """Start a run with two hosts and a logger, which waits before its first tick.

    Return a client, a function that waits for the summary at the end, and the logger.
    """
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    logger = fleet.start(
        "orchard.processes.logger",
        "--connect",
        fleet.endpoint,
        "--record",
        str(tmp_path / "run.rrd"),
    )
    assert logger.line().startswith("recording")
    someone = fleet.client()
    ends = someone.hear("orchard/end")
    clock = someone.hear("orchard/clock")
    fleet.share(2, TOY)
    wait_for(clock, lambda message: True)

    def summary():
        # Among the ends are nonsense bytes, too.
        end = wait_for(ends, lambda end: isinstance(end, dict) and end.get("run") == fleet.run)
        return end["summary"]

    return someone, summary, logger


def every_key(someone):
    """Return all keys of a run, for some names and sessions."""
    sessions = {
        str(reply.ok.key_expr).rsplit("/", 1)[1]
        for reply in someone.session.liveliness().get("orchard/alive/**")
        if reply.ok
    }
    return sorted(
        {
            someone.keys.of(what, name, session)
            for what in TABLE
            for name in NAMES
            for session in sessions
        }
    )


def wait_for_the_end(fleet, logger):
    """Wait for the end of a run. Return what its processes have printed."""
    code, out, err = fleet.world.end()
    assert code == 0, err
    assert logger.end()[0] == 0
    return out, err + logger.complaints


def test_random_bytes_on_every_key_change_nothing(fleet, running, undisturbed):
    """On each key there are up to 60 random bytes, as a message and as a query. Two messages are
    worse: a byte that begins no msgpack, and a megabyte, more than a receiver takes.
    """
    someone, summary, logger = running
    chance = random.Random(1)
    for key in every_key(someone):
        for size in (0, 1, 60):
            someone.session.put(key, chance.randbytes(chance.randrange(size + 1)))
        someone.session.get(key, lambda reply: None, payload=chance.randbytes(20), timeout=5.0)
        someone.session.delete(key)
    someone.session.get("orchard/**", lambda reply: None, payload=b"\xc1", timeout=5.0)
    someone.session.put("orchard/picker_01/velocity", bytes((1 << 20) + 1))
    out, err = wait_for_the_end(fleet, logger)
    assert undisturbed in out
    assert err.count("refused on orchard/picker_01/velocity") == 1, "logged once"
    assert err.count("refused on orchard/bundle") == 1, "by the logger"
    # There are more than 30 keys that some process receives.
    refused = summary()["messages_refused"]
    assert refused["malformed"] > 30, refused


def test_a_client_that_pretends_to_be_physics_is_not_missed(fleet, running, undisturbed):
    """A client declares a token like that of physics, and withdraws it: no process takes physics
    for lost.
    """
    someone, _, logger = running
    someone.declare("orchard/alive/physics/another/one").undeclare()
    assert undisturbed in wait_for_the_end(fleet, logger)[0]
