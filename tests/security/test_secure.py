"""Which role may do what, by effect: real certificates, real sessions, a real physics process, and
sessions that try what is not theirs.

A role is what a session may do in a secured run: its certificate and the router's access rules say
so. amy has the agent of picker_01 (`MINE`), and ben those of picker_02 (`HERS`) and bin_01. What
the access rules deny is dropped without a word, so the tests look at what happens.
"""

import json
import shutil
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
import zenoh
from fleet import Fleet as Processes
from local_runs import SMALL
from patience import PATIENCE
from secured_run import HERS, KEYS, MINE, Farm, Somebody

from orchard.contract.messages import pack
from orchard.launch.request import agent_names
from orchard.net.bus import Alive, Final, Query, Sample
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import client, router
from orchard.security.certificates import Authority
from orchard.security.identity import Identity, Keyring
from orchard.security.roles import AUTHORITY, RIGHTS, SERVANTS, Role, access_control
from orchard.wire import messages as wire
from orchard.wire.keys import TABLE
from orchard.wire.messages import read

# Options of physics that leave all agents to clients.
NO_AGENTS = [word for name in agent_names(SMALL) for word in ("--absent", name)]


@pytest.fixture
def farm(folder, tmp_path):
    """Give a secured physics process, and sessions that join it."""
    with ExitStack() as stack:
        processes = Processes(tmp_path, stack)
        processes.physics(SMALL, "--secure", str(folder / "physics"), "--speed", "4", *NO_AGENTS)
        farm = Farm(folder, processes.endpoint, processes.run, stack)
        farm.physics = processes.world
        yield farm


@pytest.fixture
def meeting(folder):
    """Give a secured router without physics, and sessions that join it."""
    with (
        ExitStack() as stack,
        router("tls/127.0.0.1:0", identity=Keyring.load(folder).of("physics")) as bus,
    ):
        farm = Farm(folder, bus.endpoint, "", stack)
        farm.bus = bus
        yield farm


def test_an_agent_moves_its_own_robot_and_no_other(farm):
    """amy tries to drive ben's robot in all ways, then drives her own. The other one stands still,
    until ben drives it.
    """
    amy = farm.come("amy")
    ben = farm.come("ben")
    witness = farm.come("logger")
    for name in (MINE, HERS):
        witness.bus.subscribe(KEYS.of("pose", name))
    start = witness.pose(HERS)

    def amy_drives(tick: int) -> None:
        amy.drive(HERS, tick)
        for session in (amy.bus.id, ben.bus.id):
            for owner in ("", amy.bus.id, ben.bus.id):
                amy.drive_as(session, owner, HERS, tick)
        amy.drive(MINE, tick)

    moved = witness.sees_it_move(MINE, amy_drives)
    still = witness.pose(HERS)
    assert still.tick >= moved.tick
    assert still.pose == start.pose
    witness.sees_it_move(HERS, lambda tick: ben.drive(HERS, tick))


def test_an_agent_does_not_move_what_another_holds(farm):
    """Physics waits for ben's answer. An answer of amy in ben's name does not count."""
    amy = farm.come("amy")
    ben = farm.come("ben")
    ben.bus.subscribe(KEYS.of("pose", HERS))
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    start = ben.pose(HERS)
    assert ben.join(HERS) == ""
    tick = ben.pose(HERS).tick
    for ahead in range(3):
        amy.drive_as(amy.bus.id, ben.bus.id, HERS, tick + ahead)
        amy.drive_as(ben.bus.id, ben.bus.id, HERS, tick + ahead)
    # A reply shows that physics has read what amy sent before.
    assert amy.asks("scenario")
    for ahead in range(3):
        velocities = wire.Velocities(farm.run, tick + ahead, ben.bus.id, {HERS: wire.Report()})
        ben.bus.publish(KEYS.of("velocities", session=ben.bus.id), pack(velocities))
        after = ben.pose(HERS)
    assert after.tick > tick
    assert after.pose == start.pose


def test_an_agent_is_alive_under_its_own_name_only(farm):
    amy = farm.come("amy")
    ben = farm.come("ben")
    amy.bus.declare_alive(KEYS.of("alive", HERS, amy.bus.id))
    amy.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    amy.bus.declare_alive(KEYS.of("alive", MINE, amy.bus.id))
    missing = "its liveliness token is missing"
    # This reply shows that physics has heard of all that amy declared before.
    assert amy.join(MINE) == ""
    assert amy.join(HERS) == missing
    assert ben.join(HERS) == missing
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    assert ben.join(HERS) == ""


def test_no_session_joins_in_anothers_name(farm):
    """Physics tells the memory of ben's agent to ben alone, while ben's token is there."""
    amy = farm.come("amy")
    ben = farm.come("ben")
    ben.bus.subscribe(KEYS.of("pose", HERS))
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    assert ben.join(HERS) == ""
    tick = ben.pose(HERS).tick
    drive = wire.Report(memory=b"where it hid the key")
    ben.bus.publish(
        KEYS.of("velocities", session=ben.bus.id),
        pack(wire.Velocities(farm.run, tick, ben.bus.id, {HERS: drive})),
    )
    ben.wait(
        Sample,
        lambda sample: (
            sample.key == KEYS.of("pose", HERS) and read(sample.payload, wire.Odometry).tick > tick
        ),
    )
    wish = wire.Join(farm.run, ben.bus.id, [HERS])
    for session in (ben.bus.id, "*", "**", f"{ben.bus.id[:3]}$*"):
        assert amy.asks("join", wish, session) == [], "it goes nowhere"
    assert amy.asks("join", wire.Join(farm.run, amy.bus.id, [HERS]), ben.bus.id) == []
    [refusal] = amy.asks("join", wish, amy.bus.id)
    assert refusal.error.startswith("not the owner")
    [reply] = ben.asks("join", wish, ben.bus.id)
    assert read(reply.payload, wire.Joined).memories == {HERS: b"where it hid the key"}


def test_an_agent_hears_its_own_mail_and_no_other(meeting):
    amy = meeting.come("amy")
    ben = meeting.come("ben")
    asker = meeting.come("shed")
    amy.bus.answer(KEYS.of("mail", HERS))
    # The router takes what amy declares in order. So it has refused the mail of ben's robot before
    # it takes that of her own.
    amy.bus.answer(KEYS.of("mail", MINE))
    assert sessions_that_answer(asker, MINE, [amy, ben]) == [amy]
    ben.bus.answer(KEYS.of("mail", HERS))
    assert sessions_that_answer(asker, HERS, [amy, ben]) == [ben]


def sessions_that_answer(asker: Somebody, name: str, others: list[Somebody]) -> list[Somebody]:
    """Return which of these sessions a request to a robot's agent reaches.

    The request is made again until it reaches one.
    """
    deadline = time.monotonic() + PATIENCE
    heard = []
    while not heard:
        assert time.monotonic() < deadline, f"no session answers for {name}"
        asker.bus.ask(KEYS.of("mail", name), b"", name, PATIENCE)
        while not isinstance(asker.bus.inbox.take(0.01), Final):
            for other in others:
                if isinstance(question := other.bus.inbox.take(0.0), Query):
                    heard.append(other)
                    question.reply(b"yes")
                    question.drop()
    return heard


def test_an_agent_sees_its_own_robot_and_no_other(farm):
    """While ben sees ticks pass, amy hears only the poses of her own robot."""
    amy = farm.come("amy")
    ben = farm.come("ben")
    for what in ("pose", "scan", "velocity"):
        amy.bus.subscribe(KEYS.of(what, HERS))
    amy.bus.subscribe(KEYS.of("picture"))
    amy.bus.subscribe(KEYS.of("pose", MINE))
    ben.bus.subscribe(KEYS.of("pose", HERS))
    tick = ben.pose(HERS).tick
    newest = -1
    while newest <= tick:
        heard = amy.wait(Sample)
        assert heard.key == KEYS.of("pose", MINE)
        newest = read(heard.payload, wire.Odometry).tick


def test_another_session_with_a_roles_certificate_may_nothing(meeting):
    """The rules name the session, too. What amy's sister puts with amy's certificate never arrives,
    and what amy puts afterwards does.
    """
    meeting.bus.subscribe(KEYS.of("velocity"))
    amy = meeting.keyring.of("amy")
    with client(
        meeting.endpoint, identity=replace(amy, role=replace(amy.role, name="amys_sister"))
    ) as sister:
        sister.publish(KEYS.of("velocity", MINE), b"sister")
    meeting.come("amy").bus.publish(KEYS.of("velocity", MINE), b"amy")
    assert Somebody(meeting.bus, "").wait(Sample).payload == b"amy"


def test_the_logger_moves_nothing_and_stops_nothing(farm):
    """It tries what only others may. Last it puts how much it refused, which a logger may: when
    that is counted, physics has got all of the logger that it will get.
    """
    logger = farm.come("logger")
    operator = farm.come("operator")
    logger.bus.subscribe(KEYS.of("pose", MINE))
    operator.bus.subscribe(KEYS.of("figures"))
    start = logger.pose(MINE)
    logger.drive(MINE, start.tick)
    logger.bus.declare_alive(KEYS.of("alive", MINE, logger.bus.id))
    assert logger.asks("set_simulation_state", wire.SetSimulationState(farm.run, "quitting")) == []
    assert logger.asks("join", wire.Join(farm.run, logger.bus.id, [MINE]), logger.bus.id) == []
    logger.bus.publish(
        KEYS.of("refused", session=logger.bus.id),
        pack(wire.RefusedThere(farm.run, {"malformed": 7})),
    )
    counted = operator.wait(
        Sample,
        lambda sample: read(sample.payload, wire.Figures).messages_refused.get("malformed") == 7,
    )
    tick = read(counted.payload, wire.Figures).tick
    while (pose := logger.pose(MINE)).tick < tick:
        pass
    assert pose.pose == start.pose


def test_the_operator_ends_a_run_and_an_agent_cannot(farm):
    amy = farm.come("amy")
    operator = farm.come("operator")
    end = wire.SetSimulationState(farm.run, "quitting")
    assert amy.asks("set_simulation_state", end) == []
    assert len(operator.asks("set_simulation_state", end)) == 1
    code, out, err = farm.physics.end()
    assert code == 0, err
    assert "stopped" in out


def test_an_emergency_operator_stops_a_robot_and_resets_no_run(farm):
    """The role may stop robots, and an agent may not. To reset the run is not its right either."""
    amy = farm.come("amy")
    operator = farm.come("emergency-operator")
    witness = farm.come("logger")
    stop = wire.Stop(farm.run, True, [MINE])
    assert amy.asks("stop", stop) == []
    assert len(operator.asks("stop", stop)) == 1
    witness.bus.subscribe(KEYS.of("pose", MINE))
    assert operator.asks("reset_simulation", wire.ResetSimulation(farm.run)) == []
    assert witness.pose(MINE)


def test_a_session_without_a_certificate_is_not_let_in(meeting):
    """It knows the authority, and speaks TLS."""
    config = zenoh.Config()
    tls = {
        "transport/link/tls/root_ca_certificate": str(meeting.keyring.folder / "amy" / AUTHORITY)
    }
    settings = {
        "mode": "client",
        "connect/endpoints": [meeting.endpoint],
        "connect/timeout_ms": 2000,
        "connect/exit_on_failure": True,
    }
    for key, value in (settings | tls | {"scouting/multicast/enabled": False}).items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def assert_not_let_in(words, endpoint, identity=None):
    """Assert that a client with this identity gets no session."""
    with pytest.raises(BusError, match=words), client(endpoint, seconds=1.0, identity=identity):
        pass


def test_a_session_without_tls_is_not_let_in(meeting):
    assert_not_let_in("no router answers there", meeting.endpoint.replace("tls/", "tcp/"))


def test_another_authoritys_certificate_is_worth_nothing(meeting, stranger):
    assert_not_let_in("does not verify", meeting.endpoint, Keyring.load(stranger).of("amy"))


def test_a_router_believes_no_other_authority_either(meeting, stranger, tmp_path):
    """The client trusts the right authority, but its certificate is of another one."""
    own = shutil.copytree(stranger / "amy", tmp_path / "amy")
    shutil.copy(meeting.keyring.folder / "amy" / AUTHORITY, own / AUTHORITY)
    assert_not_let_in(
        "does not accept the certificate in",
        meeting.endpoint,
        Identity(meeting.keyring.of("amy").role, own),
    )


def test_an_agent_cannot_pose_as_physics(folder, tmp_path):
    """The certificate of an agent is for clients, not for servers."""
    own = shutil.copytree(folder / "amy", tmp_path / "amy")
    shutil.copy(folder / "physics" / "access.json", own)
    with router("tls/127.0.0.1:0", identity=Identity.load(own)) as false:
        assert_not_let_in("does not verify", false.endpoint, Keyring.load(folder).of("ben"))


def test_a_certificate_holds_for_its_addresses_only(folder):
    keyring = Keyring.load(folder)
    with router("tls/127.0.0.2:0", identity=keyring.of("physics")) as elsewhere:
        assert_not_let_in(
            r"does not verify .*: IP address mismatch", elsewhere.endpoint, keyring.of("amy")
        )


# s for which a certificate is valid. On a busy machine the first is over before it is used.
LIVES = (3.0, 30.0, 300.0)


def test_a_connection_ends_with_its_certificate(folder, tmp_path):
    """The router closes it when the certificate is over: the token comes, and then it goes."""
    shutil.copytree(folder, tmp_path / "roles")
    authority = Authority.begin(1)
    keyring = Keyring.load(tmp_path / "roles")
    authority.vouch(keyring.of("physics").role, keyring.roles["physics"], ["127.0.0.1"])
    with router("tls/127.0.0.1:0", identity=keyring.of("physics")) as bus:
        bus.watch(KEYS.of("alive"))
        physics = Somebody(bus, "")
        with ExitStack() as stack:
            amy = _connected_while_valid(stack, authority, keyring, bus.endpoint)
            amy.declare_alive(KEYS.of("alive", MINE, amy.id))
            assert physics.wait(Alive).up
            assert not physics.wait(Alive).up


def _connected_while_valid(stack, authority, keyring, endpoint):
    """Return a session of amy with a certificate that ends soon."""
    for life in LIVES:
        end = datetime.now(UTC) + timedelta(seconds=life)
        authority.vouch(keyring.of("amy").role, keyring.roles["amy"], until=end)
        with suppress(BusError):
            return stack.enter_context(client(endpoint, identity=keyring.of("amy")))
    raise AssertionError(f"no session in {LIVES[-1]} s")


def test_a_role_is_at_work_once(meeting):
    meeting.come("amy")
    assert_not_let_in("use this role already", meeting.endpoint, meeting.keyring.of("amy"))


def test_every_key_has_rights():
    """RIGHTS says of each key which roles may use it."""
    assert set(RIGHTS) == set(TABLE)


def test_no_role_writes_what_is_anothers():
    """The access rules of Zenoh are computed for some roles, and read by their ids.

    "ingress put" are the keys on which the router takes messages of a role.
    """
    roles = [*SERVANTS, Role("amy", "host", (MINE,)), Role("ben", "host", (HERS,))]
    roles += [
        Role("eve", "bridge"),
        Role("ros2", "bridge", (MINE,)),
        Role("operating", "operating-bridge", (MINE,)),
    ]
    rules = {rule["id"]: rule["key_exprs"] for rule in access_control(roles, KEYS)["rules"]}
    amy = Role("amy", "host").session
    written = {f"orchard/{MINE}/velocity", f"orchard/{MINE}/advice"}
    written |= {f"orchard/hosts/{amy}/{what}" for what in ("velocities", "refused", "left")}
    assert set(rules["amy ingress put"]) == written
    asked = {
        f"orchard/hosts/{amy}/join",
        "orchard/*/mail",
        "orchard/*/state",
        "orchard/recall",
        "orchard/scenario",
    }
    asked |= {"orchard/layout", "orchard/simulation_state"}
    assert set(rules["amy ingress query"]) == set(rules["amy egress reply"]) == asked
    assert rules["amy ingress liveliness_token"] == [f"orchard/alive/{MINE}/{amy}"]
    assert rules["logger ingress put"] == [
        f"orchard/hosts/{Role('logger', 'logger').session}/refused"
    ]
    assert "operator ingress put" not in rules
    control = {
        "orchard/set_simulation_state",
        "orchard/step_simulation",
        "orchard/reset_simulation",
    }
    may = {
        role.name
        for role in roles
        if control.intersection(rules.get(f"{role.name} ingress query", ()))
    }
    assert may == {"operator", "emergency-operator", "operating"}
    assert not any("reset" in key for key in rules["emergency-operator ingress query"]), (
        "it stops and pauses"
    )
    assert "eve ingress put" not in rules
    assert "eve ingress liveliness_token" not in rules
    assert (
        rules["ros2 ingress put"]
        == rules["operating ingress put"]
        == [f"orchard/{MINE}/velocity", f"orchard/{MINE}/advice"]
    )
    assert set(rules["ros2 ingress query"]) == {
        "orchard/scenario",
        "orchard/layout",
        "orchard/simulation_state",
    }
    assert not [name for name in rules if "delete" in name]
