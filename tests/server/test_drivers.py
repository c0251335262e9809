"""Physics' side of the sessions that drive: what it keeps of those that come and go, and velocities of which each part counts by itself."""

from collections import Counter

import msgpack
import pytest
from local_runs import SMALL, local_hash
from recorded_messages import KEYS, Run

from orchard.contract.agent import STATES, Action, Hold
from orchard.net import host as hosts
from orchard.wire.messages import Velocities, read


def coming(drivers, session, names):
    for name in names:
        drivers.token(name, session, True)
    assert drivers.join(names, session) == {}


def going(drivers, session, names):
    for name in names:
        drivers.token(name, session, False)


def test_nothing_is_kept_of_a_session_whose_last_agent_is_with_another():
    run = Run(SMALL, "run1", 10)
    drivers, retired = run.physics.run.drivers, run.physics.bus.retired
    one, other = drivers.roster.names[:2]
    coming(drivers, "first", [one, other])
    going(drivers, "first", [one, other])
    coming(drivers, "second", [one])
    assert retired == [], "the first holds one still"
    coming(drivers, "third", [other])
    assert retired == [KEYS.of("seen", session="first")]


def test_nothing_is_kept_of_a_session_that_is_not_waited_for():
    run = Run(SMALL, "run1", 10)
    drivers, retired = run.physics.run.drivers, run.physics.bus.retired
    names = drivers.roster.names[:2]
    coming(drivers, "first", names)
    drivers.release({names[0]})
    assert retired == []
    drivers.release({names[1]})
    assert retired == [KEYS.of("seen", session="first")]


def test_a_session_that_is_silent_for_too_long_loses_also_its_agents_that_hold():
    run = Run(SMALL, "run1", 10)
    drivers = run.physics.run.drivers
    silent, other = ["worker_01", "traffic"], ["picker_01"]
    coming(drivers, "first", silent), coming(drivers, "second", other)
    engine = run.physics.run.engine
    engine.observe(), engine.due(())
    engine.advance({name: Action(hold=Hold(500)) for name in (*silent, *other)}, {})
    engine.wake(["worker_01", *other])
    drivers.begin(engine.observe(), 0.0)
    assert drivers.answers.missing == {"worker_01", "picker_01"}
    drivers.answers.missing.discard("picker_01")  # it has answered
    drivers.give_up()
    assert sorted(drivers.roster.owners) == ["picker_01"]
    assert sorted(drivers.lost) == ["traffic", "worker_01"]


# -- velocities


TICKS, FEW = 30, 8
BROKEN = STATES.index("broken")


def with_a_fault(payload: bytes, fault: dict) -> bytes:
    """The velocities of a host of which the part of picker_01 has a fault."""
    message = msgpack.unpackb(payload)
    message["velocities"].get("picker_01", {}).update(fault)
    return msgpack.packb(message)


FAULTS = [{"steps_done": True}, {"twist": 5}, {"twist": [101.0]}, {"unknown": 1}, {"deeds": [{"type": "dig"}]}, {"doing": b"bytes"}]
FAULTS += [{"doing": "x" * 201}, {"twist": [0.0, 1.0]}, {"requests": [["traffic", {"type": "where"}]] * 501}]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: str(fault)[:60])
def test_a_part_that_is_refused_stops_this_robot_and_delays_no_other(fault, monkeypatch, caplog):
    run = Run(SMALL, "run1", FEW)
    run.physics.run.drivers.answers._patience = 4.0
    send = run.host.bus.publish

    def publish(key, payload, newest_wins=False):
        send(key, with_a_fault(payload, fault) if key.endswith("/velocities") else payload, newest_wins)

    monkeypatch.setattr(run.host.bus, "publish", publish)
    end = run.to_the_end()
    assert (end.tick, end.why) == (FEW, "duration")
    assert not any(key.endswith("/lost") for key, _ in run.net.sent), "physics never waited for it in vain"
    world, account = run.engine.world, run.engine.states.counts.ticks
    assert run.physics.run.refusal_totals.counts.total() >= FEW
    assert "picker_01: " in caplog.text
    assert world.distance[world.index["picker_01"]] == 0.0
    assert world.distance[world.index["picker_02"]] > 0.1
    assert account["picker_01"][BROKEN] == FEW
    assert account["picker_02"][BROKEN] == 0


def test_velocities_that_are_too_large_for_one_message_go_in_several(monkeypatch):
    monkeypatch.setattr(hosts, "MAX_PAYLOAD", 1000)
    run = Run(SMALL, "run1", TICKS)
    assert run.to_the_end().hash == local_hash(SMALL, TICKS)
    answers = Counter(read(payload, Velocities).tick for key, payload in run.net.sent if key.endswith("/velocities"))
    assert answers[0] > 2
    assert run.physics.run.refusal_totals.counts.total() == 0
