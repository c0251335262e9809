"""Messages that the network changes on their way: which process notices, and asks or sends again.

The network is simulated (chaos/simulated/). A test replaces a method of its router, and so changes
what passes. TOY agents run the small orchard for TICKS ticks; `undisturbed` is the hash without any
change.
"""

import math

import msgpack
import pytest
from local_runs import SMALL, TICKS, TOY

from chaos.simulated.router import Router
from orchard.launch.supervisor import free_port
from orchard.net.host import TAKEN_TRIES
from orchard.net.requests import REFUSED_TRIES
from orchard.server.drivers import MALFORMED_IN_TURN


def changing_joins(monkeypatch, change, times: float = 1) -> list[bytes]:
    """Let `change` make other bytes of the first joins, `times` of them, on their way.

    Return a list to which all joins are added, as they were sent.
    """
    ask = Router.ask
    joins = []

    def ask_with_change(router, link, number, key, payload):
        if key.endswith("/join"):
            joins.append(payload)
            if len(joins) <= times:
                payload = change(payload)
        ask(router, link, number, key, payload)

    monkeypatch.setattr(Router, "ask", ask_with_change)
    return joins


# What the network changes in a join: these bytes into those.
CHANGES = {
    "a name": (b"picker_01", b"pickar_01"),
    "the field of the names": (b"names", b"nemes"),
    "the field of the owner": (b"owner", b"ovner"),
    "the field of the run": (b"run", b"rum"),
}


@pytest.mark.parametrize("change", [*CHANGES, "the owner", "the run", "its first byte"])
def test_a_host_joins_although_a_byte_of_its_join_was_changed(
    change, fleet, undisturbed, monkeypatch
):
    """Physics refuses the changed join, and the host sends it a second time."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))

    def with_another_last_digit(word: bytes) -> bytes:
        digit = b"1" if word.endswith(b"0") else b"0"
        return word[:-1] + digit

    def changed(payload: bytes) -> bytes:
        join = msgpack.unpackb(payload)
        if change in CHANGES:
            before, after = CHANGES[change]
        elif change == "its first byte":
            before = payload[:1]
            # A byte that begins no message of msgpack.
            after = b"\xc1"
        else:
            before = join[change.removeprefix("the ")].encode()
            after = with_another_last_digit(before)
        assert before in payload
        return payload.replace(before, after, 1)

    joins = changing_joins(monkeypatch, changed)
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
    assert len(joins) == 2


def changing_scenarios(monkeypatch, change, numbers: range) -> list[str]:
    """Let `change` alter the answers with these numbers to questions for the scenario.

    The first answer has number 0. `change` alters the message in place. Return a list to which the
    key of each question is added.
    """
    reply = Router.reply
    asked = []

    def reply_with_change(router, number, key, payload, error):
        if key.endswith("/scenario"):
            if len(asked) in numbers:
                message = msgpack.unpackb(payload)
                change(message)
                payload = msgpack.packb(message)
            asked.append(key)
        reply(router, number, key, payload, error)

    monkeypatch.setattr(Router, "reply", reply_with_change)
    return asked


def with_a_false_value(message: dict) -> None:
    message["scenario"]["pickers"] = -1


def with_a_false_key(message: dict) -> None:
    message["scenario"]["pockers"] = message["scenario"].pop("pickers")


def with_an_unknown_agent(message: dict) -> None:
    message["agents"] = ["pickar_01", *message["agents"]]


@pytest.mark.parametrize("change", [with_a_false_value, with_a_false_key, with_an_unknown_agent])
@pytest.mark.parametrize("number", [0, 1], ids=["at its start", "as it joins"])
def test_a_host_asks_again_for_a_scenario_that_was_changed(
    change, number, fleet, undisturbed, monkeypatch
):
    """A host asks for the scenario when it starts and when it joins: here three times in all."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    asked = changing_scenarios(monkeypatch, change, range(number, number + 1))
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
    assert len(asked) == 3


def test_a_host_with_only_invalid_scenarios_ends_with_the_reason(fleet, monkeypatch):
    fleet.physics(SMALL, "--duration", "1")
    asked = changing_scenarios(monkeypatch, with_a_false_value, range(100))
    code, _, err = fleet.host(agents=TOY).end()
    assert code == 2
    assert len(asked) == REFUSED_TRIES
    assert "the scenario that physics sent" in err
    assert "pickers" in err


def changing_actions(monkeypatch, times: float) -> None:
    """Let the network spoil the action of picker_01 in the first messages, `times` of them.

    The other actions of these messages stay as they are.
    """
    publish = Router.publish
    changed = []

    def publish_with_change(router, link, key, payload, may_drop):
        message = msgpack.unpackb(payload) if key.endswith("/velocities") else {}
        if "picker_01" in message.get("velocities", {}) and len(changed) < times:
            changed.append(message["tick"])
            message["velocities"]["picker_01"] = {"doing": 7}
            payload = msgpack.packb(message)
        publish(router, link, key, payload, may_drop)

    monkeypatch.setattr(Router, "publish", publish_with_change)


@pytest.mark.parametrize("times", [1, MALFORMED_IN_TURN - 1])
def test_an_action_that_was_changed_is_sent_again(fleet, undisturbed, monkeypatch, times):
    """Physics asks for it again, until MALFORMED_IN_TURN in turn were malformed."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    changing_actions(monkeypatch, times)
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed


# Simulated s of the network within which a run of a few seconds is over. A host that waits until
# physics gives it up needs longer.
SOON = 10.0


def test_a_host_that_took_a_false_tick_joins_again(fleet, undisturbed, monkeypatch):
    """The network changes one tick to 5000, so the host takes all that follow for past ones.

    No agent is asked at the false tick. If the host did not join again, it would refuse the later
    ones until physics gave it up.
    """
    publish = Router.publish
    changed = []

    def publish_with_change(router, link, key, payload, may_drop):
        message = msgpack.unpackb(payload) if key.endswith("/seen") else {}
        if message.get("tick", 0) >= 10 and not changed:
            changed.append(message["tick"])
            payload = msgpack.packb(message | {"tick": 5000, "asked": []})
        publish(router, link, key, payload, may_drop)

    monkeypatch.setattr(Router, "publish", publish_with_change)
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
    assert fleet.scheduler.now < SOON


def test_a_robot_stands_whose_actions_are_always_malformed(fleet, monkeypatch):
    """A client that always sends malformed actions keeps no other session waiting.

    The run lasts 2 s; its exit code is 1, because an agent broke.
    """
    fleet.physics(SMALL, "--duration", "2")
    changing_actions(monkeypatch, math.inf)
    fleet.host(agents=TOY)
    code, _, _ = fleet.world.end()
    assert code == 1, "a broken agent is not a good run"
    assert fleet.scheduler.now < SOON


def test_a_host_whose_joins_are_all_refused_ends_with_the_reason(fleet, monkeypatch):
    fleet.physics(SMALL, "--duration", "1")
    joins = changing_joins(
        monkeypatch, lambda join: join.replace(b"picker_01", b"pickar_01"), math.inf
    )
    code, _, err = fleet.host("--only", "picker_01", agents=TOY).end()
    assert code == 2
    assert len(joins) == REFUSED_TRIES
    assert "pickar_01: there is no such agent" in err


def test_a_host_that_waits_asks_again_after_a_changed_join(fleet, monkeypatch):
    """A second host asks TAKEN_TRIES times for a name that is taken, and the last answer ends it.

    The tenth join is changed on its way, and does not count. It and the join of the first host make
    two more.
    """
    fleet.physics(SMALL, "--duration", "100")
    fleet.host("--only", "picker_01", agents=TOY)
    joins = []

    def changed(payload: bytes) -> bytes:
        joins.append(payload)
        return payload.replace(b"names", b"nemes") if len(joins) == 10 else payload

    changing_joins(monkeypatch, changed, math.inf)
    code, _, err = fleet.host("--only", "picker_01", agents=TOY).end()
    assert code == 2
    assert len(joins) == TAKEN_TRIES + 2
    assert "picker_01: it is taken" in err


def test_a_run_ends_beside_another_one_whose_answer_was_changed(fleet, monkeypatch):
    """The second run cannot read what the first one answers, and asks again.

    So it learns that the first run is there, and ends.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fleet.router(endpoint)
    fleet.physics(SMALL, "--duration", "1", "--connect", endpoint)
    reply = Router.reply
    asked = []

    def reply_with_change(router, number, key, payload, error):
        if key.endswith("/scenario"):
            asked.append(key)
            if len(asked) == 1:
                # A byte that begins no message of msgpack.
                payload = b"\xc1"
        reply(router, number, key, payload, error)

    monkeypatch.setattr(Router, "reply", reply_with_change)
    code, _, err = fleet.start("orchard.processes.physics", "--connect", endpoint).end()
    assert code == 2
    assert f"run {fleet.run} is active there" in err
    assert len(asked) == 2
