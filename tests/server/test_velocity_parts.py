"""The velocities of a host: each agent's part counts by itself, and they go in several messages if one would be too large."""

from collections import Counter

import msgpack
import pytest
from local_runs import SMALL, local_hash
from recorded_messages import Run

from orchard.contract.agent import STATES
from orchard.net import host as hosts
from orchard.wire.messages import Velocities, read

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
