"""Nonsense on every key of a real run: refused, counted, logged once; and the run is the same to the last bit."""

import random

import msgpack
import pytest
import zenoh
from fleet import until
from local_runs import SMALL, TICKS, TOY

from orchard.wire.keys import TABLE

pytestmark = pytest.mark.processes

NAMES = ("picker_01", "bin_02", "traffic", "nobody")


@pytest.fixture
def running(fleet, tmp_path):
    """A run with two hosts and a logger, of which no tick has passed yet; a client, and what it hears of the end."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    logger = fleet.start("orchard.processes.logger", "--connect", fleet.endpoint, "--record", str(tmp_path / "run.rrd"))
    assert logger.line().startswith("recording")
    someone = fleet.client()
    ends, clock = someone.hear("orchard/end"), someone.hear("orchard/clock")
    fleet.share(2, TOY)
    until(clock, lambda message: True)
    return someone, lambda: until(ends, lambda end: isinstance(end, dict) and end.get("run") == fleet.run)["summary"], logger


def sessions_of(someone):
    """The ids of all sessions that own something."""
    return {str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in someone.session.liveliness().get("orchard/alive/**") if reply.ok}


def every_key(someone):
    return sorted({someone.keys.of(what, name, session) for what in TABLE for name in NAMES for session in sessions_of(someone)})


def wait_for_the_end(fleet, logger):
    code, out, err = fleet.world.end()
    assert code == 0, err
    assert logger.end()[0] == 0
    return out, err + logger.complaints


def test_random_bytes_on_every_key_change_nothing(fleet, running, undisturbed):
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
    assert err.count("refused on orchard/picture") == 1, "by the logger"
    refused = summary()["messages_refused"]
    assert refused["malformed"] > 30, refused


def test_what_is_of_another_run_or_past_changes_nothing(fleet, running, undisturbed):
    someone, summary, logger = running
    heard = {}
    for what in ("pose", "scan"):
        key = someone.keys.of(what, "worker_01")
        heard[key] = someone.hear(key)
    for key in ("orchard/clock", "orchard/picture"):
        heard[key] = someone.hear(key)
    messages = {key: until(queue, lambda message: True) for key, queue in heard.items()}
    for key, message in messages.items():
        until(heard[key], lambda later, first=message: later["tick"] > first["tick"] + 2)
        someone.put(key, **message)
        someone.put(key, **message | {"run": "another"})
    someone.put("orchard/lost", run="another", tick=1, names=[], owner="x")
    someone.put("orchard/end", run="another", tick=1, finished=True, why="", hash="", summary={})
    out, _ = wait_for_the_end(fleet, logger)
    assert undisturbed in out
    assert summary()["messages_refused"]["other run"] >= 3


def test_who_pretends_to_be_physics_and_leaves_is_not_missed(fleet, running, undisturbed):
    someone, _, logger = running
    someone.declare("orchard/alive/physics/another").undeclare()
    assert undisturbed in wait_for_the_end(fleet, logger)[0]


def test_every_query_with_nonsense_gets_an_error(fleet):
    fleet.physics(SMALL, "--speed", "10")
    someone = fleet.client()
    clock = someone.hear("orchard/clock")
    fleet.host(agents=TOY)
    until(clock, lambda message: message["tick"] > 2)
    for key in ("scenario", "hosts/me/join", "set_simulation_state", "picker_01/mail", "bin_01/state"):
        for nonsense in (b"\x93nonsense", msgpack.packb({"run": fleet.run}), bytes((1 << 20) + 1)):
            (reply,) = someone.ask(f"orchard/{key}", nonsense)
            assert reply.startswith("malformed"), key
    someone.session.put("orchard/set_simulation_state", b"", congestion_control=zenoh.CongestionControl.BLOCK)
    assert someone.quit()["run"] == fleet.run
    fleet.end()


def test_a_velocity_beyond_the_kind_is_cut(fleet):
    fleet.physics(SMALL, "--absent", "picker_01", "--speed", "5")
    someone = fleet.client()
    poses = someone.hear("orchard/picker_01/pose")
    fleet.host("--without", "picker_01")
    tick = until(poses, lambda pose: True)["tick"]
    someone.drive("picker_01", tick, 50.0)
    assert until(poses, lambda pose: pose["twist"]["linear"]["x"] > 0)["twist"]["linear"]["x"] == 1.0
    someone.quit()
    fleet.end()
