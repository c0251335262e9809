"""Lockstep with a real router and real processes: the trajectory is that of local mode, whatever
the network does.
"""

import math
import queue
import signal

import msgpack
import pytest
from command_line import python
from fleet import until
from local_runs import AGENTS, SMALL, TICKS, TOY
from patience import PATIENCE

from chaos.simulated.router import Router
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.net import bus
from orchard.net.bus import Inbox
from orchard.net.host import TAKEN_TRIES
from orchard.net.refusals import Refusals
from orchard.net.requests import REFUSED_TRIES, ask
from orchard.net.zenoh_bus import client, router
from orchard.server.drivers import MALFORMED_IN_TURN

SLOW = pytest.param(
    2, "calling_agents:slow", marks=pytest.mark.processes
)  # slow agents and slow handlers


@pytest.mark.parametrize(("hosts", "agents"), [(1, TOY), (2, TOY), (AGENTS, TOY), SLOW])
def test_agents_that_call_each_other_do_as_in_local_mode(fleet, undisturbed, hosts, agents):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    fleet.share(hosts, agents)
    assert fleet.end() == undisturbed


@pytest.mark.processes
def test_someone_who_hears_everything_changes_nothing(fleet, undisturbed):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    client = fleet.client()
    heard = queue.Queue()
    client.session.declare_subscriber("**", lambda sample: heard.put(str(sample.key_expr)))
    fleet.share(2, TOY)
    assert fleet.end() == undisturbed
    missing = {
        client.keys.of(what, name)
        for name in lay_out(SMALL).names
        for what in ("pose", "scan", "velocity")
    }
    until(heard, lambda key: missing.discard(key) or not missing)


def test_a_robot_stands_until_someone_drives_it(fleet):
    fleet.physics(SMALL, "--absent", "picker_01", "--speed", "4")
    someone = fleet.client()
    poses = someone.hear("orchard/picker_01/pose")
    fleet.host("--without", "picker_01")
    pose = until(poses, lambda pose: pose["tick"] >= 10)
    assert pose["pose"]["position"]["x"] == -35.5, "it stands"
    while pose["pose"]["position"]["x"] < -34.5:
        someone.drive("picker_01", pose["tick"], 0.5)
        pose = until(poses, lambda pose: True)
    standing = until(
        poses,
        lambda later: later["tick"] > pose["tick"] + 10 and later["twist"]["linear"]["x"] == 0.0,
    )
    assert standing["pose"]["position"]["x"] < -33.0, (
        "half a second after the last velocity it stands"
    )
    assert someone.quit()["state"] == "quitting"
    fleet.end()


def test_only_the_owner_drives_a_robot(fleet):
    fleet.physics(SMALL, "--absent", "picker_02", "--speed", "20")
    someone = fleet.client()
    figures, clock, told = (
        someone.hear(f"orchard/{key}") for key in ("figures", "clock", "refusals")
    )
    fleet.host("--without", "picker_02", agents=TOY)
    tick = until(clock, lambda message: True)["tick"]
    someone.drive("picker_01", tick, 1.0)
    someone.drive("picker_02", tick, 1.0, owner="me")
    someone.drive("picker_02", tick, 1.0, owner="me")
    someone.put(
        "orchard/picker_02/velocity", tick=tick, linear={"x": 0.0, "y": 1.0}, angular={"z": 0.0}
    )
    someone.put(
        "orchard/picker_02/velocity", tick=tick + 10**6, linear={"x": 0.0}, angular={"z": 0.0}
    )
    someone.put(
        "orchard/picker_02/velocity", tick=tick, linear={"x": float("nan")}, angular={"z": 0.0}
    )
    someone.put("orchard/picker_99/velocity", tick=tick, linear={"x": 0.0}, angular={"z": 0.0})
    someone.put(
        "orchard/picker_02/velocity",
        run="another",
        tick=tick,
        linear={"x": 0.0},
        angular={"z": 0.0},
    )
    wanted = {
        "not the owner",
        "not owned",
        "out of bounds",
        "future tick",
        "malformed",
        "no such robot",
        "other run",
    }
    refused = until(
        figures, lambda message: sum(message["messages_refused"].values()) > len(wanted)
    )["messages_refused"]
    assert refused == dict.fromkeys(wanted, 1) | {"not owned": 2}
    said = [told.get(timeout=PATIENCE) for _ in wanted]
    assert {refusal["reason"]: refusal["key"] for refusal in said} == dict.fromkeys(
        wanted, "orchard/picker_02/velocity"
    ) | {
        "not the owner": "orchard/picker_01/velocity",
        "no such robot": "orchard/picker_99/velocity",
    }
    assert {refusal["reason"]: refusal["session"] for refusal in said} == dict.fromkeys(
        wanted, ""
    ) | {"not owned": "me"}
    assert told.empty(), "each key and reason once a second"
    fleet.stop()


def test_a_bare_client_is_waited_for_in_lockstep(fleet):
    fleet.physics(SMALL, "--duration", "3")
    fleet.host("--without", "worker_01", agents=TOY)
    someone = fleet.client()
    poses = someone.hear("orchard/worker_01/pose")
    clock = someone.hear("orchard/clock")
    token = someone.declare("orchard/alive/worker_01/me")
    assert someone.join("worker_01")["memories"] == {"worker_01": None}
    places = []
    for tick in range(30):
        until(clock, lambda message, tick=tick: message["tick"] == tick)
        pose = until(poses, lambda message, tick=tick: message["tick"] == tick)["pose"]["position"]
        places.append((pose["x"], pose["y"]))
        someone.drive("worker_01", tick, 0.5, owner="me")
    token.undeclare()
    fleet.end()
    assert math.dist(places[0], places[-1]) == pytest.approx(0.5 * 2.9)


def test_a_name_that_is_taken_is_refused_by_name(fleet):
    fleet.physics(SMALL, "--speed", "10")
    clock = fleet.client().hear("orchard/clock")
    first = fleet.host(agents=TOY)
    until(clock, lambda message: True)
    second = fleet.host("--only", "picker_01", agents=TOY)
    code, _, err = second.end()
    assert code == 2
    assert "picker_01: it is taken" in err
    fleet.hosts = [first]
    fleet.stop()


def changing_joins(monkeypatch, change, times: float = 1) -> list[bytes]:
    """Let the network change so many joins.

    Return a list that gets all of them, as they were sent.
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
    fleet.physics(SMALL, "--duration", str(TICKS / 10))

    def changed(payload: bytes) -> bytes:
        join = msgpack.unpackb(payload)
        words = {"the owner": join["owner"].encode(), "the run": join["run"].encode()}
        before, after = CHANGES.get(change, (payload[:1], b"\xc1"))
        if change in words:
            before = words[change]
            after = before[:-1] + (b"0" if before[-1:] != b"0" else b"1")
        assert before in payload
        return payload.replace(before, after, 1)

    joins = changing_joins(monkeypatch, changed)
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
    assert len(joins) == 2


def changing_scenarios(monkeypatch, change, which: range) -> list[str]:
    """Let the network change the answers to these questions for the scenario, by their numbers.

    Return a list that gets the key of each question.
    """
    reply = Router.reply
    asked = []

    def reply_with_change(router, number, key, payload, error):
        if key.endswith("/scenario"):
            if len(asked) in which:
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
@pytest.mark.parametrize("which", [0, 1], ids=["at its start", "as it joins"])
def test_a_host_asks_again_for_a_scenario_that_was_changed(
    change, which, fleet, undisturbed, monkeypatch
):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    asked = changing_scenarios(monkeypatch, change, range(which, which + 1))
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
    assert len(asked) == 3


def test_a_host_with_only_invalid_scenarios_ends_with_the_reason(fleet, monkeypatch):
    fleet.physics(SMALL, "--duration", "1")
    asked = changing_scenarios(monkeypatch, with_a_false_value, range(100))
    code, _, err = fleet.host(agents=TOY).end()
    assert (code, len(asked)) == (2, REFUSED_TRIES)
    assert "the scenario that physics sent" in err
    assert "pickers" in err


def changing_actions(monkeypatch, times: float) -> None:
    """Let the network change the action of a picker in so many messages: it is no action any more,
    and all others are.
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
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    changing_actions(monkeypatch, times)
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed


def test_a_host_that_took_a_false_tick_joins_again(fleet, undisturbed, monkeypatch):
    """It would refuse all that physics sends as past, until physics gives it up."""
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
    assert fleet.scheduler.now < 10.0


def test_a_robot_stands_whose_actions_are_always_malformed(fleet, monkeypatch):
    """So a client that always sends such actions keeps no session waiting."""
    fleet.physics(SMALL, "--duration", "2")
    changing_actions(monkeypatch, math.inf)
    fleet.host(agents=TOY)
    code, _, _ = fleet.world.end()
    assert code == 1, "a broken agent is not a good run"
    assert fleet.scheduler.now < 10.0


def test_a_host_whose_joins_are_all_refused_ends_with_the_reason(fleet, monkeypatch):
    fleet.physics(SMALL, "--duration", "1")
    joins = changing_joins(
        monkeypatch, lambda join: join.replace(b"picker_01", b"pickar_01"), math.inf
    )
    code, _, err = fleet.host("--only", "picker_01", agents=TOY).end()
    assert (code, len(joins)) == (2, REFUSED_TRIES)
    assert "pickar_01: there is no such agent" in err


def test_a_host_that_waits_asks_again_after_a_changed_join(fleet, monkeypatch):
    """It asks long for a name that is taken. One changed join among these is no reason to end."""
    fleet.physics(SMALL, "--duration", "100")
    fleet.host("--only", "picker_01", agents=TOY)
    joins = []

    def changed(payload: bytes) -> bytes:
        joins.append(payload)
        return payload.replace(b"names", b"nemes") if len(joins) == 10 else payload

    changing_joins(monkeypatch, changed, math.inf)
    code, _, err = fleet.host("--only", "picker_01", agents=TOY).end()
    assert (code, len(joins)) == (2, TAKEN_TRIES + 2)
    assert "picker_01: it is taken" in err


def test_a_host_with_a_wrong_name_ends_with_words(fleet):
    fleet.physics(SMALL, "--duration", "1")
    code, _, err = fleet.host("--only", "pickar_01", agents=TOY).end()
    assert code == 2
    assert "pickar_01: no such agent or kind" in err


def test_the_robot_of_a_broken_agent_stands_and_the_others_go_on(fleet):
    fleet.physics(SMALL, "--duration", "2")
    host = fleet.host(agents="calling_agents:broken")
    code, _, _ = fleet.world.end()
    assert code == 1, "a broken agent is not a good run"
    code, _, err = host.end()
    assert code == 0
    assert err.count("picker_01 raised an error at tick 0") == 1
    assert "calling_agents.py" in err


def memory_in(velocities):
    memory = velocities["velocities"].get("picker_01", {}).get("memory")
    return memory and msgpack.unpackb(memory)


def test_a_new_host_takes_over_the_robot_of_a_killed_one(fleet):
    fleet.physics(SMALL, "--patience", "0.5", "--speed", "10")
    someone = fleet.client()
    lost, poses, velocities = (
        someone.hear(f"orchard/{key}") for key in ("lost", "picker_01/pose", "hosts/*/velocities")
    )
    fleet.host("--without", "picker_01", agents=TOY)
    killed = fleet.host("--only", "picker_01", agents=TOY)
    before = until(velocities, lambda message: message["tick"] >= 5 and memory_in(message))
    killed.signal(signal.SIGKILL)
    tick = until(lost, lambda message: message["names"] == ["picker_01"])["tick"]
    until(poses, lambda pose: pose["tick"] > tick + 2 and pose["twist"]["linear"]["x"] == 0.0)
    fleet.hosts.remove(killed)
    fleet.host("--only", "picker_01", agents=TOY)
    after = until(velocities, lambda message: message["tick"] > tick and memory_in(message))
    assert memory_in(after)["heard"] >= memory_in(before)["heard"]
    fleet.stop()


def test_hosts_leave_when_physics_is_gone(fleet):
    fleet.physics(SMALL, "--speed", "10")
    clock = fleet.client().hear("orchard/clock")
    host = fleet.host("--patience", "1", agents=TOY)
    until(clock, lambda message: message["tick"] == 3)
    fleet.world.signal(signal.SIGKILL)
    code, _, err = host.end()
    assert code == 1
    assert "physics is gone" in err


def test_physics_names_who_is_missing_and_all_stop_when_asked(fleet):
    fleet.physics(SMALL)
    host = fleet.host("--without", "picker_02", agents=TOY)
    assert any(
        fleet.world.error() == "physics: waiting for 1 agents: picker_02\n" for _ in range(10)
    )
    host.signal(signal.SIGTERM)
    fleet.stop()


def test_bins_and_physics_answer_questions(fleet):
    fleet.physics(SMALL, "--speed", "10")
    someone = fleet.client()
    states = someone.hear("orchard/bin_01/state")
    fleet.host(agents=TOY)
    published = until(states, lambda state: True)
    assert (published["full"], published["fill"], published["coupled_to"]) == (
        False,
        0.0,
        "picker_01",
    )
    assert someone.ask("orchard/bin_01/state")[0]["coupled_to"] == "picker_01"
    assert (
        "other run"
        in someone.ask(
            "orchard/set_simulation_state", msgpack.packb({"run": "another", "state": "quitting"})
        )[0]
    )
    answer = someone.ask("orchard/scenario")[0]
    assert answer["run"] == fleet.run
    assert Scenario.model_validate(answer["scenario"]) == SMALL
    assert someone.quit()["state"] == "quitting"
    fleet.end()


def test_a_get_that_nobody_answers_ends_without_a_reply():
    inbox = Inbox()
    with router(inbox=inbox) as alone:
        for key in ("orchard/nobody/mail", "this//is no key"):
            alone.ask(key, b"", "ticket")
            assert inbox.take(5.0) == bus.Final("ticket")


def test_who_asks_does_something_while_nobody_answers():
    """A session that asks does something meanwhile although nothing answers.

    A host looks whether physics is gone.
    """
    looks = iter(("it is there", "it is there"))

    def look() -> None:
        if next(looks, None) is None:
            raise TimeoutError("physics is gone")

    with router() as silent, client(silent.endpoint) as asker:
        silent.answer("orchard/recall")
        with pytest.raises(TimeoutError, match="physics is gone"):
            ask(asker, "orchard/recall", b"", bytes, refusals=Refusals(), meanwhile=look)


def test_agents_load_neither_the_compiler_nor_the_viewer():
    code = (
        "import sys, orchard.behaviour.catalogue, orchard.processes.agents, "
        "orchard.processes.physics; print({'numba', 'rerun'} & set(sys.modules))"
    )
    assert python("-c", code).stdout == "set()\n"


def test_a_second_run_with_the_same_prefix_must_go(fleet, undisturbed, tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fleet.router(endpoint)
    fleet.physics(SMALL, "--duration", str(TICKS / 10), "--connect", endpoint)
    assert f"waiting for {AGENTS} agents" in fleet.world.error()
    code, _, said = fleet.start("orchard.processes.physics", "--connect", endpoint).end()
    assert code == 2
    assert (
        f"run {fleet.run} is active there, with prefix orchard; choose another router or prefix"
        in said
    )
    fleet.share(2, TOY)
    assert fleet.end() == undisturbed


@pytest.mark.parametrize("leaves", [False, True], ids=["stays", "goes"])
def test_a_token_of_a_run_that_is_not_there_ends_no_run(leaves, fleet, undisturbed):
    """It may be of a process that was killed a moment ago, or of any client."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    token = fleet.client().declare("orchard/alive/physics/another/1")
    if leaves:
        token.undeclare()
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed


def test_a_run_ends_beside_another_one_whose_answer_was_changed(fleet, monkeypatch):
    """It asks again while the token of the other one is there."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fleet.router(endpoint)
    fleet.physics(SMALL, "--duration", "1", "--connect", endpoint)
    reply = Router.reply
    asked = []

    def reply_with_change(router, number, key, payload, error):
        if key.endswith("/scenario"):
            asked.append(key)
            if len(asked) == 1:
                payload = b"\xc1"
        reply(router, number, key, payload, error)

    monkeypatch.setattr(Router, "reply", reply_with_change)
    code, _, said = fleet.start("orchard.processes.physics", "--connect", endpoint).end()
    assert code == 2
    assert f"run {fleet.run} is active there" in said
    assert len(asked) == 2
