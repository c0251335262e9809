"""Who may drive, by effect: real certificates, real sessions, a real physics process, and those who try what is not theirs."""

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from alone import SMALL, local_hash
from command_line import line_with, orchard, summary_of
from fleet import ROOT, SECONDS, Process
from fleet import Fleet as Processes
from machines import machines, needs_machines, within
from typer.testing import CliRunner

import run
from orchard.access import RIGHTS, SERVANTS, Role, access_control
from orchard.bus import Alive, Bus, Final, Question, Replied, Sample, client, router
from orchard.certificates import Authority
from orchard.config import Scenario, to_yaml
from orchard.endpoints import BusError
from orchard.identity import AUTHORITY, Identity, Keyring
from orchard.keys import TABLE, Keys
from orchard.messages import pack
from orchard.security import host_roles, make
from orchard.wire.course import Command, Join, Joined, RefusedThere, Stop
from orchard.wire.driving import Drive, Report, Velocities, Velocity
from orchard.wire.geometry_msgs import Angular, Linear
from orchard.wire.sensing import Clock, Odometry
from orchard.wire.vocabulary import read
from orchard.wire.watching import Figures
from processes.fleet import free_port
from processes.passes import shares
from processes.together import agent_names

KEYS = Keys()
MINE, HERS = "picker_01", "picker_02"
WISHES = [f"amy={MINE}", f"ben={HERS},bin_01", "shed=carrier"]
NOBODY = [word for name in agent_names(SMALL) for word in ("--absent", name)]


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    """What `run.py secure` makes, for the small scenario: a role for each of two pickers, one for the carriers, two for the rest."""
    path = tmp_path_factory.mktemp("secure") / "roles"
    make(path, host_roles(agent_names(SMALL), WISHES, lambda rest: shares(rest, 2)), ["192.168.1.10"], 30)
    return path


@pytest.fixture(scope="session")
def stranger(tmp_path_factory) -> Path:
    """The same, but by another authority."""
    path = tmp_path_factory.mktemp("stranger") / "roles"
    make(path, host_roles(agent_names(SMALL), WISHES, lambda rest: shares(rest, 2)), [], 30)
    return path


# -- who tries


class Somebody:
    """A session with one role's certificate, and what it does with it."""

    def __init__(self, bus: Bus, run: str) -> None:
        self.bus, self.run = bus, run

    def drive(self, name: str, tick: int) -> None:
        self.bus.publish(KEYS.of("velocity", name), pack(Velocity(self.run, tick, Linear(1.0), Angular(0.0))))

    def drive_as(self, session: str, holder: str, name: str, tick: int) -> None:
        """By a message for all that a session holds."""
        velocities = Velocities(self.run, tick, holder, {name: Drive(Linear(1.0), Angular(0.0))})
        self.bus.publish(KEYS.of("velocities", session=session), pack(velocities))

    def join(self, name: str) -> str:
        """Why it may not hold an agent; '' if it may."""
        [reply] = self.asks("join", Join(self.run, self.bus.id, [name]), self.bus.id)
        return read(reply.payload, Joined).refused.get(name, "")

    def asks(self, what: str, message=None, session: str = "*") -> list[Replied]:
        """All replies to a query."""
        self.bus.ask(KEYS.of(what, session=session), pack(message) if message else b"", what, SECONDS)
        replies = []
        while not isinstance(item := self.wait(Replied | Final), Final):
            replies.append(item)
        return replies

    def wait(self, type_: type, wanted=lambda item: True):
        """The first thing of a type that arrives, for which something is so."""
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline:
            item = self.bus.inbox.take(max(0.0, deadline - time.monotonic()))
            if isinstance(item, type_) and wanted(item):
                return item
        raise AssertionError(f"no {type_.__name__} came")

    def pose(self, name: str) -> Odometry:
        """The next one of a robot."""
        return read(self.wait(Sample, lambda sample: sample.key == KEYS.of("pose", name)).payload, Odometry)

    def sees_it_move(self, name: str, driving) -> Odometry:
        """The first pose of a robot that is not the next one, while somebody drives."""
        deadline, first = time.monotonic() + SECONDS, self.pose(name)
        while (pose := self.pose(name)).pose == first.pose:
            assert time.monotonic() < deadline, f"{name} does not move"
            driving(pose.tick)
        return pose


class Farm:
    """A secured run, of which nobody holds an agent, and those who come to it."""

    def __init__(self, folder: Path, endpoint: str, run: str, stack: ExitStack) -> None:
        self.keyring, self.endpoint, self.run, self._stack = Keyring.load(folder), endpoint, run, stack

    def come(self, role: str) -> Somebody:
        return Somebody(self._stack.enter_context(client(self.endpoint, identity=self.keyring.of(role))), self.run)


@pytest.fixture
def farm(folder, tmp_path):
    with ExitStack() as stack:
        processes = Processes(tmp_path, stack)
        processes.physics(SMALL, "--secure", str(folder / "physics"), "--speed", "4", *NOBODY)
        farm = Farm(folder, processes.endpoint, processes.run, stack)
        farm.physics = processes.world
        yield farm


@pytest.fixture
def meeting(folder):
    """A router with physics' rules, and nobody at it yet."""
    with ExitStack() as stack, router("tls/127.0.0.1:0", identity=Keyring.load(folder).of("physics")) as bus:
        farm = Farm(folder, bus.endpoint, "", stack)
        farm.bus = bus
        yield farm


# -- a whole run


def test_a_secured_run_is_local_mode(folder, tmp_path):
    summary, recording = tmp_path / "summary.json", tmp_path / "run.rrd"
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(to_yaml(SMALL))
    done = orchard(scenario, "--secure", folder, "--duration", 30, "--record", recording, "--summary", summary)
    assert done.returncode == 0, done.stdout + done.stderr
    assert summary_of(summary)["hash"] == local_hash(SMALL, 300)
    assert summary_of(summary)["messages_refused"] == {}
    assert recording.stat().st_size > 100_000  # the logger has heard what happened


@pytest.mark.parametrize("its", ["router", pytest.param("physics", marks=pytest.mark.soak)])
def test_a_machine_needs_no_more_than_its_roles_directory(its, folder, tmp_path):
    """Each process with a copy of its own role's files, and nothing beside them; physics is the router, or there is one of its own."""
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    copies = {path.name: str(shutil.copytree(path, tmp_path / f"machine of {path.name}" / path.name)) for path in folder.iterdir()}
    with ExitStack() as stack:

        def start(role: str, module: str, *arguments: str) -> Process:
            process = Process(f"processes.{module}", *arguments, "--secure", copies[role])
            stack.callback(process.kill)
            return process

        where = ["--listen", "tls/127.0.0.1:0"]
        if its == "router":
            where = ["--connect", start("router", "router", *where).line().split()[-1]]
        physics = start("physics", "physics", f"{tmp_path}/scenario.yaml", *where, "--duration", "20")
        endpoint = physics.line().split()[2].rstrip(",")
        hosts = [start(role, "agents", "--connect", endpoint) for role in ("amy", "ben", "shed", "agents_1", "agents_2")]
        code, out, err = physics.end()
        assert code == 0, out + err
        assert out.split()[-1] == local_hash(SMALL, 200)
        assert [host.end(10.0)[0] for host in hosts] == [0] * 5


@pytest.mark.parametrize("killed", ["host", *(pytest.param(one, marks=pytest.mark.soak) for one in ("physics", "router"))])
def test_who_is_killed_comes_back_as_the_same_role(killed, folder, tmp_path):
    """Under the same session, which the others may still have in mind."""
    with ExitStack() as stack:
        fleet = Processes(tmp_path, stack)
        pace = ["--secure", str(folder / "physics"), "--speed", "15", "--duration", "20", "--snapshots", str(tmp_path / "snapshots")]
        place = ["--listen", f"tls/127.0.0.1:{free_port()}"]
        routing = ["processes.router", *place, "--secure", str(folder / "router")]
        if killed == "router":
            middle = fleet.start(*routing)
            assert middle.line().startswith("listening on")
            place = ["--connect", place[1]]
        fleet.physics(SMALL, *place, *pace)
        for role in ("amy", "ben", "shed", "agents_1", "agents_2"):
            fleet.host("--secure", str(folder / role))
        with client(fleet.endpoint, identity=Keyring.load(folder).of("logger")) as bus:
            bus.subscribe(KEYS.of("clock"))
            Somebody(bus, fleet.run).wait(Sample, lambda sample: read(sample.payload, Clock).tick >= 30)
        match killed:
            case "host":
                fleet.hosts.pop(0).kill()
                fleet.host("--secure", str(folder / "amy"))
            case "physics":
                fleet.world.kill()
                fleet.physics(SMALL, *place, *pace, "--resume", "--run", fleet.run)
            case "router":
                middle.kill()
                assert fleet.start(*routing).line().startswith("listening on")
        assert fleet.end() == local_hash(SMALL, 200)


@needs_machines
def test_a_secured_run_over_two_machines_is_local_mode(folder, tmp_path):
    """The guest has its own role's files only, and knows the other machine by its address."""
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    own = str(shutil.copytree(folder / "shed", tmp_path / "shed"))
    with machines("s") as (host, guest), ExitStack() as stack:
        here, there = "tls/127.0.0.1:7447", "tls/192.168.1.10:7447"
        listen = ["--listen", "tls/0.0.0.0:7447", "--secure", str(folder / "physics")]
        physics = Process("processes.physics", f"{tmp_path}/scenario.yaml", *listen, "--duration", "20", before=within(host))
        stack.callback(physics.kill)
        assert physics.line().startswith("listening on")
        for role in ("amy", "ben", "agents_1", "agents_2"):
            stack.callback(Process("processes.agents", "--connect", here, "--secure", str(folder / role), before=within(host)).kill)
        stack.callback(Process("processes.agents", "--connect", there, "--secure", own, before=within(guest)).kill)
        code, out, err = physics.end()
        assert code == 0, out + err
        assert out.split()[-1] == local_hash(SMALL, 200)


@needs_machines
def test_the_commands_of_the_document_run_the_carriers_on_another_machine(tmp_path):
    block = re.search(r"```sh secured, two machines\n(.*?)```", (ROOT / "docs" / "security.md").read_text(), re.S).group(1)
    commands = [shlex.split(line) for line in block.splitlines() if not line.startswith("#")]
    assert all(words[:2] == [".venv/bin/python", "run.py"] for words in commands)
    make_roles, first, second = ([sys.executable, str(ROOT / "run.py"), *words[2:]] for words in commands)
    first += ["--rows", "3", "--duration", "30", "--record", "none", "--summary", str(tmp_path / "summary.json")]
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    subprocess.run([*make_roles, "--rows", "3"], cwd=here, check=True, timeout=SECONDS)
    shutil.copytree(here / "roles" / "shed", there / "shed")
    with machines("d") as (host, guest):
        one = subprocess.Popen([*within(host), *first], cwd=here, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            said = line_with("carrier: left to others", one)
            other = subprocess.run([*within(guest), *second], cwd=there, capture_output=True, text=True, timeout=3 * SECONDS)
            rest, _ = one.communicate(timeout=SECONDS)
        finally:
            one.kill()
    assert (one.returncode, other.returncode) == (0, 0), said + rest + other.stdout + other.stderr
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 300)


# -- an agent, and what is another's


def test_an_agent_moves_its_own_robot_and_no_other(farm):
    amy, ben, witness = farm.come("amy"), farm.come("ben"), farm.come("logger")
    for name in (MINE, HERS):
        witness.bus.subscribe(KEYS.of("pose", name))
    start = witness.pose(HERS)

    def amy_drives(tick: int) -> None:
        amy.drive(HERS, tick)
        for session in (amy.bus.id, ben.bus.id):
            for holder in ("", amy.bus.id, ben.bus.id):
                amy.drive_as(session, holder, HERS, tick)
        amy.drive(MINE, tick)

    moved = witness.sees_it_move(MINE, amy_drives)
    still = witness.pose(HERS)
    assert still.tick >= moved.tick
    assert still.pose == start.pose
    witness.sees_it_move(HERS, lambda tick: ben.drive(HERS, tick))


def test_an_agent_does_not_move_what_another_holds(farm):
    """Physics waits for ben's answer; that of amy, in ben's name, is none."""
    amy, ben = farm.come("amy"), farm.come("ben")
    ben.bus.subscribe(KEYS.of("pose", HERS))
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    start = ben.pose(HERS)
    assert ben.join(HERS) == ""
    tick = ben.pose(HERS).tick
    for ahead in range(3):
        amy.drive_as(amy.bus.id, ben.bus.id, HERS, tick + ahead)
        amy.drive_as(ben.bus.id, ben.bus.id, HERS, tick + ahead)
    assert amy.asks("scenario")  # physics has read what came before
    for ahead in range(3):
        velocities = Velocities(farm.run, tick + ahead, ben.bus.id, {HERS: Drive(Linear(0.0), Angular(0.0))})
        ben.bus.publish(KEYS.of("velocities", session=ben.bus.id), pack(velocities))
        after = ben.pose(HERS)
    assert after.tick > tick
    assert after.pose == start.pose


def test_an_agent_is_alive_under_its_own_name_only(farm):
    amy, ben = farm.come("amy"), farm.come("ben")
    amy.bus.declare_alive(KEYS.of("alive", HERS, amy.bus.id))
    amy.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    amy.bus.declare_alive(KEYS.of("alive", MINE, amy.bus.id))
    missing = "its liveliness token is missing"
    assert amy.join(MINE) == ""  # physics has heard of what came before
    assert amy.join(HERS) == missing
    assert ben.join(HERS) == missing
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    assert ben.join(HERS) == ""


def test_nobody_joins_in_anothers_name(farm):
    """Ben's token stands, and physics knows what its agent remembers: it tells ben alone."""
    amy, ben = farm.come("amy"), farm.come("ben")
    ben.bus.subscribe(KEYS.of("pose", HERS))
    ben.bus.declare_alive(KEYS.of("alive", HERS, ben.bus.id))
    assert ben.join(HERS) == ""
    tick = ben.pose(HERS).tick
    drive = Drive(Linear(0.0), Angular(0.0), report=Report(memory=b"where it hid the key"))
    ben.bus.publish(KEYS.of("velocities", session=ben.bus.id), pack(Velocities(farm.run, tick, ben.bus.id, {HERS: drive})))
    ben.wait(Sample, lambda sample: sample.key == KEYS.of("pose", HERS) and read(sample.payload, Odometry).tick > tick)
    wish = Join(farm.run, ben.bus.id, [HERS])
    for session in (ben.bus.id, "*", "**", f"{ben.bus.id[:3]}$*"):
        assert amy.asks("join", wish, session) == [], "it goes nowhere"
    assert amy.asks("join", Join(farm.run, amy.bus.id, [HERS]), ben.bus.id) == []
    [refusal] = amy.asks("join", wish, amy.bus.id)
    assert refusal.error.startswith("not the holder")
    [reply] = ben.asks("join", wish, ben.bus.id)
    assert read(reply.payload, Joined).memories == {HERS: b"where it hid the key"}


def test_an_agent_hears_its_own_mail_and_no_other(meeting):
    amy, ben, asker = meeting.come("amy"), meeting.come("ben"), meeting.come("shed")
    amy.bus.answer(KEYS.of("mail", HERS))
    for name, somebody in ((MINE, amy), (HERS, ben)):  # what amy declared first has come before what she declares second
        somebody.bus.answer(KEYS.of("mail", name))
        assert who_answers(asker, name, [amy, ben]) == [somebody]


def who_answers(asker: Somebody, name: str, others: list[Somebody]) -> list[Somebody]:
    """All of them whom a request to a robot's agent reaches. It is asked again until there is one."""
    deadline, heard = time.monotonic() + SECONDS, []
    while not heard:
        assert time.monotonic() < deadline, f"nobody answers for {name}"
        asker.bus.ask(KEYS.of("mail", name), b"", name, SECONDS)
        while not isinstance(asker.bus.inbox.take(0.01), Final):
            for other in others:
                if isinstance(question := other.bus.inbox.take(0.0), Question):
                    heard.append(other)
                    question.reply(b"yes")
                    question.drop()
    return heard


def test_an_agent_sees_its_own_robot_and_no_other(farm):
    amy, ben = farm.come("amy"), farm.come("ben")
    for what in ("pose", "scan", "velocity"):
        amy.bus.subscribe(KEYS.of(what, HERS))
    amy.bus.subscribe(KEYS.of("picture"))
    amy.bus.subscribe(KEYS.of("pose", MINE))
    ben.bus.subscribe(KEYS.of("pose", HERS))
    tick, newest = ben.pose(HERS).tick, -1
    while newest <= tick:
        heard = amy.wait(Sample)
        assert heard.key == KEYS.of("pose", MINE)
        newest = read(heard.payload, Odometry).tick


def test_another_session_with_a_roles_certificate_may_nothing(meeting):
    """The rules name the session as well: nobody is alive under another's id."""
    meeting.bus.subscribe(KEYS.of("velocity"))
    amy = meeting.keyring.of("amy")
    with client(meeting.endpoint, identity=replace(amy, role=replace(amy.role, name="amys_sister"))) as sister:
        sister.publish(KEYS.of("velocity", MINE), b"sister")
    meeting.come("amy").bus.publish(KEYS.of("velocity", MINE), b"amy")
    assert Somebody(meeting.bus, "").wait(Sample).payload == b"amy"


# -- the logger, and the operator


def test_the_logger_moves_nothing_and_stops_nothing(farm):
    """What it may put is how much it refused: that is counted, and is what comes last here."""
    logger, operator = farm.come("logger"), farm.come("operator")
    logger.bus.subscribe(KEYS.of("pose", MINE))
    operator.bus.subscribe(KEYS.of("figures"))
    start = logger.pose(MINE)
    logger.drive(MINE, start.tick)
    logger.bus.declare_alive(KEYS.of("alive", MINE, logger.bus.id))
    assert logger.asks("command", Command(farm.run, "stop")) == []
    assert logger.asks("join", Join(farm.run, logger.bus.id, [MINE]), logger.bus.id) == []
    logger.bus.publish(KEYS.of("refused", session=logger.bus.id), pack(RefusedThere(farm.run, {"malformed": 7})))
    counted = operator.wait(Sample, lambda sample: read(sample.payload, Figures).messages_refused.get("malformed") == 7)
    tick = read(counted.payload, Figures).tick
    while (pose := logger.pose(MINE)).tick < tick:
        pass
    assert pose.pose == start.pose


def test_the_operator_stops_the_run_and_an_agent_cannot(farm):
    amy, operator = farm.come("amy"), farm.come("operator")
    stop = Command(farm.run, "stop")
    assert amy.asks("command", stop) == []
    assert len(operator.asks("command", stop)) == 1
    code, out, err = farm.physics.end()
    assert code == 0, err
    assert "stopped" in out


def test_the_warden_stops_a_robot_and_an_agent_cannot(farm):
    amy, warden, witness = farm.come("amy"), farm.come("warden"), farm.come("logger")
    stop = Stop(farm.run, True, [MINE])
    assert amy.asks("stop", stop) == []
    assert len(warden.asks("stop", stop)) == 1
    witness.bus.subscribe(KEYS.of("pose", MINE))
    assert warden.asks("command", Command(farm.run, "stop")) == []
    assert witness.pose(MINE)


# -- strangers


def test_who_has_no_certificate_is_not_let_in(meeting):
    config = zenoh.Config()
    tls = {"transport/link/tls/root_ca_certificate": str(meeting.keyring.folder / "amy" / AUTHORITY)}
    settings = {"mode": "client", "connect/endpoints": [meeting.endpoint], "connect/timeout_ms": 2000, "connect/exit_on_failure": True}
    for key, value in (settings | tls | {"scouting/multicast/enabled": False}).items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_who_speaks_no_tls_is_not_let_in(meeting):
    with pytest.raises(BusError, match="nobody listens there"), client(meeting.endpoint.replace("tls/", "tcp/"), seconds=1.0):
        pass


def test_another_authoritys_certificate_is_worth_nothing(meeting, stranger):
    amy = Keyring.load(stranger).of("amy")
    with pytest.raises(BusError, match="does not vouch for"), client(meeting.endpoint, seconds=1.0, identity=amy):
        pass


def test_a_router_believes_no_other_authority_either(meeting, stranger, tmp_path):
    """A stranger who knows whom to trust is still a stranger."""
    own = shutil.copytree(stranger / "amy", tmp_path / "amy")
    shutil.copy(meeting.keyring.folder / "amy" / AUTHORITY, own / AUTHORITY)
    identity = Identity(meeting.keyring.of("amy").role, own)
    with pytest.raises(BusError, match="wants none of"), client(meeting.endpoint, seconds=1.0, identity=identity):
        pass


def test_an_agent_cannot_pose_as_physics(folder, tmp_path):
    """Its certificate is for calling, not for being called."""
    own = shutil.copytree(folder / "amy", tmp_path / "amy")
    shutil.copy(folder / "physics" / "access.json", own)
    ben = Keyring.load(folder).of("ben")
    with router("tls/127.0.0.1:0", identity=Identity.load(own)) as false:
        calling = client(false.endpoint, seconds=1.0, identity=ben)
        with pytest.raises(BusError, match="does not vouch for"):
            calling.__enter__()


def test_a_certificate_holds_for_its_addresses_only(folder):
    keyring = Keyring.load(folder)
    with router("tls/127.0.0.2:0", identity=keyring.of("physics")) as elsewhere:
        calling = client(elsewhere.endpoint, seconds=1.0, identity=keyring.of("amy"))
        with pytest.raises(BusError, match="does not vouch for: IP address mismatch"):
            calling.__enter__()


def test_a_connection_ends_with_its_certificate(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "roles")
    authority, keyring = Authority.begin(1), Keyring.load(tmp_path / "roles")
    authority.vouch("physics", keyring.roles["physics"], ["127.0.0.1"])
    authority.vouch("amy", keyring.roles["amy"], until=datetime.now(UTC) + timedelta(seconds=3))
    with router("tls/127.0.0.1:0", identity=keyring.of("physics")) as bus, client(bus.endpoint, identity=keyring.of("amy")) as amy:
        bus.watch(KEYS.of("alive"))
        amy.declare_alive(KEYS.of("alive", MINE, amy.id))
        physics = Somebody(bus, "")
        assert physics.wait(Alive).up
        assert not physics.wait(Alive).up


def test_a_role_is_at_work_once(meeting):
    meeting.come("amy")
    with pytest.raises(BusError, match="at work there already"), client(meeting.endpoint, seconds=1.0, identity=meeting.keyring.of("amy")):
        pass


# -- the rules


def test_every_key_has_somebody_who_may():
    assert set(RIGHTS) == set(TABLE)


def test_nobody_writes_what_is_anothers():
    roles = [*SERVANTS, Role("amy", "host", (MINE,)), Role("ben", "host", (HERS,))]
    rules = {rule["id"]: rule["key_exprs"] for rule in access_control(roles, KEYS)["rules"]}
    amy = roles[-2].session
    written = {f"orchard/{MINE}/velocity", f"orchard/hosts/{amy}/velocities", f"orchard/hosts/{amy}/refused"}
    assert set(rules["amy ingress put"]) == written
    asked = {f"orchard/hosts/{amy}/join", "orchard/*/mail", "orchard/*/state", "orchard/recall", "orchard/scenario"}
    assert set(rules["amy ingress query"]) == set(rules["amy egress reply"]) == asked
    assert rules["amy ingress liveliness_token"] == [f"orchard/alive/{MINE}/{amy}"]
    assert rules["logger ingress put"] == [f"orchard/hosts/{Role('logger', 'logger').session}/refused"]
    assert "operator ingress put" not in rules
    assert not [name for name in rules if "delete" in name]


# -- the directory


def test_keys_are_for_the_owners_eyes_only(folder):
    assert folder.stat().st_mode & 0o777 == 0o700
    for role in folder.iterdir():
        assert role.stat().st_mode & 0o777 == 0o700
        assert (role / "key.pem").stat().st_mode & 0o777 == 0o600


def secured(*arguments: object):
    """`run.py secure` in this process: what it printed, and its exit code."""
    return CliRunner().invoke(run.app, ["secure", *map(str, arguments)], catch_exceptions=False)


def test_an_authority_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "roles"
    assert secured(path, "--rows", 3, "--hosts", 2).exit_code == 0
    before = (path / "authority" / "key.pem").read_bytes()
    again = secured(path, "--rows", 3, "--hosts", 1)
    assert again.exit_code == 2
    assert "--anew" in again.stderr
    assert (path / "authority" / "key.pem").read_bytes() == before
    assert secured(path, "--rows", 3, "--hosts", 1, "--anew").exit_code == 0
    assert (path / "authority" / "key.pem").read_bytes() != before
    assert not (path / "agents_2").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--role", "shed"], "shed: wanted is NAME=KIND|AGENT"),
        (["--role", "Shed!=carrier"], "Shed!: not a name for a role"),
        (["--role", "physics=carrier"], "physics is the name of two roles"),
        (["--role", "shed=carier"], "carier: no such agent or kind"),
        (["--role", "shed=carrier", "--role", "barn=carrier_01"], "carrier_01 is in two roles"),
        (["--address", "http://shed"], "http://shed: neither an address nor the name of a machine"),
    ],
)
def test_what_cannot_be_made_is_named_and_nothing_is_written(arguments, named, tmp_path):
    done = secured(tmp_path / "roles", "--rows", 3, *arguments)
    assert done.exit_code == 2
    assert named in done.stderr
    assert not (tmp_path / "roles").exists()


def test_another_directorys_things_are_left_alone(tmp_path):
    (tmp_path / "diary.txt").write_text("dear diary")
    done = secured(tmp_path, "--rows", 3)
    assert done.exit_code == 2
    assert "there is something else in it" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


# -- what a user may get wrong


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--secure", "nowhere"], "nowhere: no roles there"),
        (["--secure", "{folder}", "--listen", "tcp/127.0.0.1:0"], "not secure; with --secure an endpoint is like tls/"),
        (["--listen", "tls/127.0.0.1:0"], "tls needs certificates; --secure DIR"),
        (["--secure", "{folder}", "--pickers", 3], "no role for"),
        (["--secure", "{folder}", "--hosts", 2], "leave out --hosts"),
        (["--secure", "{folder}", "--mode", "local"], "local mode is one process"),
        (["--secure", "{folder}", "--without", "bin_01"], "ben is the role of bin_01, picker_02"),
        (["--secure", "{folder}/shed"], "no role for bin_01"),
        (["--secure", "{folder}", "--connect", "tls/127.0.0.1:9", "--only", "carrier"], "with --only name the one to play"),
    ],
)
def test_what_cannot_be_run_is_named(arguments, named, folder, tmp_path):
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    words = [str(word).format(folder=folder) for word in arguments]
    guest = [] if "--only" in words else [tmp_path / "scenario.yaml", "--record", "none"]
    done = CliRunner().invoke(run.app, ["harvest", *map(str, guest), *words], catch_exceptions=False, env={"COLUMNS": "200"})
    assert done.exit_code == 2, done.output
    assert named in " ".join(done.stderr.split())


def spoil(what: str, own: Path, stranger: Path) -> None:
    """Make a role's directory useless in one way."""
    match what:
        case "missing":
            (own / "key.pem").unlink()
        case "another key":
            shutil.copy(stranger / "amy" / "key.pem", own)
        case "another authority":
            shutil.copy(stranger / "amy" / AUTHORITY, own)
        case "another role":
            for name in ("certificate.pem", "key.pem"):
                shutil.copy(own.parent / "ben" / name, own)
        case "expired":
            Authority.begin(30).vouch("amy", own, until=datetime.now(UTC) - timedelta(minutes=1))
        case "nonsense":
            (own / "certificate.pem").write_text("nonsense")
        case "no role":
            (own / "role.json").write_text("{}")


@pytest.mark.parametrize(
    ("what", "named"),
    [
        ("missing", "key.pem: no such file"),
        ("another key", "not the key of the certificate"),
        ("another authority", "not by the authority in authority.pem"),
        ("another role", "the certificate of ben, not of amy"),
        ("expired", "and not now"),
        ("nonsense", "certificate.pem: not a certificate"),
        ("no role", "role.json: not as `run.py secure` wrote it"),
    ],
)
def test_a_directory_of_no_use_is_named(what, named, folder, stranger, tmp_path):
    shutil.copytree(folder, tmp_path / "roles")
    spoil(what, tmp_path / "roles" / "amy", stranger)
    with pytest.raises(ValueError, match=named):
        Keyring.load(tmp_path / "roles").of("amy")


# -- without security


def test_a_public_address_without_security_is_warned_of_once(tmp_path):
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    done = orchard(tmp_path / "scenario.yaml", "--listen", "tcp/0.0.0.0:0", "--duration", 1, "--record", "none")
    assert done.returncode == 0, done.stderr
    assert (done.stdout + done.stderr).count("whoever reaches this address") == 1


@pytest.mark.parametrize(("address", "is_open"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_a_router_warns_of_a_public_address_only(address, is_open):
    routing = Process("processes.router", "--listen", f"tcp/{address}:0")
    try:
        assert routing.line().startswith("listening on")
        routing.signal(signal.SIGTERM)
        _, _, err = routing.end()
    finally:
        routing.kill()
    assert ("whoever reaches this address" in err) == is_open
