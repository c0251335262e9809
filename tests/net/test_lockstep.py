"""Lockstep over a network: the trajectory is that of local mode, whatever the network does.

The network and its processes are simulated, unless a test is marked `processes`. `undisturbed` is
the hash of local mode (tests/conftest.py). A client is a session that a test drives itself.
"""

import itertools
import math
import queue
import signal

import msgpack
import pytest
from command_line import python
from fleet import wait_for
from local_runs import AGENTS, SMALL, TICKS, TOY
from patience import PATIENCE

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.net import bus, zenoh_bus
from orchard.net.bus import Inbox
from orchard.net.refusals import Refusals
from orchard.net.requests import ask

# Two hosts whose agents and handlers of messages are slow.
SLOW = pytest.param(2, "calling_agents:slow", marks=pytest.mark.processes)


@pytest.mark.parametrize(("hosts", "agents"), [(1, TOY), (2, TOY), (AGENTS, TOY), SLOW])
def test_agents_that_call_each_other_do_as_in_local_mode(fleet, undisturbed, hosts, agents):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    fleet.share(hosts, agents)
    assert fleet.end() == undisturbed


@pytest.mark.processes
def test_a_subscriber_to_everything_changes_nothing(fleet, undisturbed):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    client = fleet.client()
    received = queue.Queue()
    client.session.declare_subscriber("**", lambda sample: received.put(str(sample.key_expr)))
    fleet.share(2, TOY)
    assert fleet.end() == undisturbed

    missing = set()
    for name in lay_out(SMALL).names:
        for kind in ("pose", "scan", "velocity"):
            missing.add(client.keys.of(kind, name))

    def was_last_missing(key: str) -> bool:
        missing.discard(key)
        return not missing

    # It ends with an error if one of the keys is never heard.
    wait_for(received, was_last_missing)


def x_of(pose: dict) -> float:
    """Return where a body is along the rows, m, by its message."""
    return pose["pose"]["position"]["x"]


def test_a_robot_stands_until_a_client_drives_it(fleet):
    """Half a second after the client's last velocity the robot stands again."""
    fleet.physics(SMALL, "--absent", "picker_01", "--speed", "4")
    client = fleet.client()
    poses = client.hear("orchard/picker_01/pose")
    fleet.host("--without", "picker_01")
    pose = wait_for(poses, lambda pose: pose["tick"] >= 10)
    assert x_of(pose) == -35.5, "the robot is where it started"

    while x_of(pose) < -34.5:
        client.drive("picker_01", pose["tick"], 0.5)
        pose = wait_for(poses, lambda pose: True)
    last_driven_tick = pose["tick"]

    def stands_later(pose: dict) -> bool:
        return pose["tick"] > last_driven_tick + 10 and pose["twist"]["linear"]["x"] == 0.0

    # It drove 1 m, to -34.5 m. At 0.5 m/s half a second more is 0.25 m; poses that were under way
    # when the client stopped make it somewhat more.
    standing = wait_for(poses, stands_later)
    assert x_of(standing) < -33.0
    assert client.quit()["state"] == "quitting"
    fleet.end()


# Each reason for which a velocity is refused, and the key on which the test sends it.
REFUSED_KEYS = {
    "not the owner": "orchard/picker_01/velocity",
    "not owned": "orchard/picker_02/velocity",
    "out of bounds": "orchard/picker_02/velocity",
    "future tick": "orchard/picker_02/velocity",
    "malformed": "orchard/picker_02/velocity",
    "no such robot": "orchard/picker_99/velocity",
    "other run": "orchard/picker_02/velocity",
}


def test_only_the_owner_drives_a_robot(fleet):
    """A session "me" drives robots that it does not own, and sends velocities that are wrong.

    Figures count each refusal. `refusals` has each key and reason once a second, so the second
    velocity of the same kind is counted there and not published. A session is only known of a
    velocity that names its owner and an agent that no session owns.
    """
    fleet.physics(SMALL, "--absent", "picker_02", "--speed", "20")
    client = fleet.client()
    figures = client.hear("orchard/figures")
    clock = client.hear("orchard/clock")
    refusals = client.hear("orchard/refusals")
    fleet.host("--without", "picker_02", agents=TOY)
    tick = wait_for(clock, lambda message: True)["tick"]

    own_key = "orchard/picker_02/velocity"
    stand = {"linear": {"x": 0.0}, "angular": {"z": 0.0}}
    # Not the owner, then twice not owned.
    client.drive("picker_01", tick, 1.0)
    client.drive("picker_02", tick, 1.0, owner="me")
    client.drive("picker_02", tick, 1.0, owner="me")
    # Out of bounds: no robot moves sideways. Then a future tick, and a malformed number.
    client.put(own_key, tick=tick, linear={"x": 0.0, "y": 1.0}, angular={"z": 0.0})
    client.put(own_key, tick=tick + 10**6, **stand)
    client.put(own_key, tick=tick, linear={"x": float("nan")}, angular={"z": 0.0})
    # No such robot, and another run.
    client.put("orchard/picker_99/velocity", tick=tick, **stand)
    client.put(own_key, run="another", tick=tick, **stand)

    def counts_all(message: dict) -> bool:
        return sum(message["messages_refused"].values()) > len(REFUSED_KEYS)

    counts = wait_for(figures, counts_all)["messages_refused"]
    assert counts == dict.fromkeys(REFUSED_KEYS, 1) | {"not owned": 2}

    messages = [refusals.get(timeout=PATIENCE) for _ in REFUSED_KEYS]
    assert {message["reason"]: message["key"] for message in messages} == REFUSED_KEYS
    sessions = {message["reason"]: message["session"] for message in messages}
    assert sessions == dict.fromkeys(REFUSED_KEYS, "") | {"not owned": "me"}
    assert refusals.empty()
    fleet.stop()


def test_a_bare_client_is_waited_for_in_lockstep(fleet):
    fleet.physics(SMALL, "--duration", "3")
    fleet.host("--without", "worker_01", agents=TOY)
    client = fleet.client()
    poses = client.hear("orchard/worker_01/pose")
    clock = client.hear("orchard/clock")
    token = client.declare("orchard/alive/worker_01/me")
    assert client.join("worker_01")["memories"] == {"worker_01": None}
    places = []
    for tick in range(30):
        wait_for(clock, lambda message, tick=tick: message["tick"] == tick)
        pose = wait_for(poses, lambda message, tick=tick: message["tick"] == tick)["pose"][
            "position"
        ]
        places.append((pose["x"], pose["y"]))
        client.drive("worker_01", tick, 0.5, owner="me")
    token.undeclare()
    fleet.end()
    # 0.5 m/s, for 2.9 s between the poses of the first and the last tick.
    assert math.dist(places[0], places[-1]) == pytest.approx(0.5 * 2.9)


def test_a_name_that_is_taken_is_refused_by_name(fleet):
    fleet.physics(SMALL, "--speed", "10")
    clock = fleet.client().hear("orchard/clock")
    first = fleet.host(agents=TOY)
    wait_for(clock, lambda message: True)
    second = fleet.host("--only", "picker_01", agents=TOY)
    code, _, err = second.end()
    assert code == 2
    assert "picker_01: it is taken" in err
    fleet.hosts = [first]
    fleet.stop()


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
    """Return the memory of picker_01 that a message of its host brings, None without one."""
    memory = velocities["velocities"].get("picker_01", {}).get("memory")
    return memory and msgpack.unpackb(memory)


def test_a_new_host_takes_over_the_robot_of_a_killed_one(fleet):
    """The new host gets the agent's memory from physics: how many letters the agent has heard."""
    fleet.physics(SMALL, "--patience", "0.5", "--speed", "10")
    client = fleet.client()
    lost = client.hear("orchard/lost")
    poses = client.hear("orchard/picker_01/pose")
    velocities = client.hear("orchard/hosts/*/velocities")
    fleet.host("--without", "picker_01", agents=TOY)
    killed = fleet.host("--only", "picker_01", agents=TOY)
    before = wait_for(velocities, lambda message: message["tick"] >= 5 and memory_in(message))
    killed.signal(signal.SIGKILL)
    tick = wait_for(lost, lambda message: message["names"] == ["picker_01"])["tick"]
    wait_for(poses, lambda pose: pose["tick"] > tick + 2 and pose["twist"]["linear"]["x"] == 0.0)
    fleet.hosts.remove(killed)
    fleet.host("--only", "picker_01", agents=TOY)
    after = wait_for(velocities, lambda message: message["tick"] > tick and memory_in(message))
    assert memory_in(after)["heard"] >= memory_in(before)["heard"]
    fleet.stop()


def test_hosts_leave_when_physics_is_gone(fleet):
    fleet.physics(SMALL, "--speed", "10")
    clock = fleet.client().hear("orchard/clock")
    host = fleet.host("--patience", "1", agents=TOY)
    wait_for(clock, lambda message: message["tick"] == 3)
    fleet.world.signal(signal.SIGKILL)
    code, _, err = host.end()
    assert code == 1
    assert "physics is gone" in err


def test_physics_names_missing_agents_and_all_stop_when_asked(fleet):
    """Within its first ten lines, physics says which agent it waits for."""
    fleet.physics(SMALL)
    host = fleet.host("--without", "picker_02", agents=TOY)
    waiting = "physics: waiting for 1 agents: picker_02\n"
    assert any(fleet.world.error() == waiting for _ in range(10))
    host.signal(signal.SIGTERM)
    fleet.stop()


def test_bins_and_physics_answer_questions(fleet):
    fleet.physics(SMALL, "--speed", "10")
    client = fleet.client()
    states = client.hear("orchard/bin_01/state")
    fleet.host(agents=TOY)

    published = wait_for(states, lambda state: True)
    assert not published["full"]
    assert published["fill"] == 0.0
    assert published["coupled_to"] == "picker_01"
    assert client.ask("orchard/bin_01/state")[0]["coupled_to"] == "picker_01"

    quit_another = msgpack.packb({"run": "another", "state": "quitting"})
    assert "other run" in client.ask("orchard/set_simulation_state", quit_another)[0]

    answer = client.ask("orchard/scenario")[0]
    assert answer["run"] == fleet.run
    assert Scenario.model_validate(answer["scenario"]) == SMALL

    assert client.quit()["state"] == "quitting"
    fleet.end()


def test_a_query_that_meets_no_queryable_ends_without_a_reply():
    inbox = Inbox()
    with zenoh_bus.router(inbox=inbox) as alone:
        for key in ("orchard/nobody/mail", "this//is no key"):
            alone.ask(key, b"", "ticket")
            assert inbox.take(5.0) == bus.Final("ticket")


def test_a_host_that_waits_sees_that_physics_is_gone():
    """While it waits, it calls `meanwhile` again and again; the third call raises here."""
    looks = itertools.count(1)

    def look() -> None:
        if next(looks) == 3:
            raise TimeoutError("physics is gone")

    with zenoh_bus.router() as silent, zenoh_bus.client(silent.endpoint) as asker:
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
    code, _, err = fleet.start("orchard.processes.physics", "--connect", endpoint).end()
    assert code == 2
    assert (
        f"run {fleet.run} is active there, with prefix orchard; choose another router or prefix"
        in err
    )
    fleet.share(2, TOY)
    assert fleet.end() == undisturbed


@pytest.mark.parametrize("leaves", [False, True], ids=["stays", "goes"])
def test_a_token_of_a_run_that_is_not_there_ends_no_run(leaves, fleet, undisturbed):
    """The token may be that of a process that was killed a moment ago, or of any client."""
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    token = fleet.client().declare("orchard/alive/physics/another/1")
    if leaves:
        token.undeclare()
    fleet.host(agents=TOY)
    assert fleet.end() == undisturbed
