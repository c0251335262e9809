"""The directory of roles, and whole secured runs: by one command and by many, on several machines,
with kills; and what users get wrong.
"""

import shutil
import signal
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from called import called
from code_blocks import block, commands
from command_line import orchard, scenario_file, summary_of
from fleet import Process
from local_runs import SMALL, local_hash
from machines import machines, needs_machines, run_both, within
from patience import PATIENCE
from secured_run import KEYS, Somebody

from orchard.commands.main import main
from orchard.field.scenario import Scenario, to_yaml
from orchard.launch.supervisor import free_port
from orchard.net.bus import Sample
from orchard.net.zenoh_bus import client
from orchard.security.certificates import Authority
from orchard.security.identity import Keyring
from orchard.security.roles import AUTHORITY
from orchard.wire.messages import Clock, read

# The longest name of an agent.
LONGEST = "w" * 64


def test_keys_are_for_the_owners_eyes_only(folder):
    """Only the user who has made the roles may read them."""
    assert folder.stat().st_mode & 0o777 == 0o700
    for role in folder.iterdir():
        assert role.stat().st_mode & 0o777 == 0o700
        assert (role / "key.pem").stat().st_mode & 0o777 == 0o600


def secured(*arguments: object):
    """Run `orchard secure` in this process. Return what it printed, and its exit code."""
    return called("secure", *arguments)


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


def test_roles_made_anew_leave_what_somebody_has_put_beside_them(tmp_path):
    assert secured(tmp_path, "--rows", 3, "--hosts", 1).exit_code == 0
    for folder in ("agents_1", "authority"):
        diary = tmp_path / folder / "diary.txt"
        diary.write_text("dear diary")
        done = secured(tmp_path, "--rows", 3, "--anew")
        assert done.exit_code == 2
        assert f"{diary}: `orchard secure` did not make it" in done.stderr
        assert diary.read_text() == "dear diary"
        diary.unlink()


@pytest.mark.parametrize(
    "role", ['{"role": "web server"}', '{"name": "web", "duty": 1}', "no JSON"]
)
def test_a_folder_with_a_role_of_another_program_stays(role, tmp_path):
    assert secured(tmp_path, "--rows", 3, "--hosts", 1).exit_code == 0
    (tmp_path / "web").mkdir()
    (tmp_path / "web" / "role.json").write_text(role)
    done = secured(tmp_path, "--rows", 3, "--anew")
    assert done.exit_code == 2
    assert "it has other files, such as web" in done.stderr
    assert (tmp_path / "web" / "role.json").read_text() == role


def test_each_agent_gets_a_role_however_long_its_name_is(tmp_path):
    (tmp_path / "own.yaml").write_text(f"agents_without_body: {{{LONGEST}: my_package.Weather}}")
    done = secured(tmp_path / "roles", tmp_path / "own.yaml", "--hosts", "each")
    assert done.exit_code == 0, done.stderr
    assert Keyring.load(tmp_path / "roles").of(LONGEST).role.names == (LONGEST,)


# Arguments of `orchard secure`, and words of the refusal.
NO_ROLES = [
    (["--role", f"{LONGEST}x=carrier"], f"{LONGEST}x: not a name for a role; use up to 64 letters"),
    (
        ["--role", "authority=carrier"],
        "authority: not a name for a role; the directory of this name",
    ),
    (["--role", "shed"], "shed: expected NAME=KIND|AGENT"),
    (["--role", "Shed!=carrier"], "Shed!: not a name for a role"),
    (["--role", "physics=carrier"], "physics is the name of two roles"),
    (["--role", "shed=carier"], "carier: no such agent or kind"),
    (["--role", "shed=carrier", "--role", "barn=carrier_01"], "carrier_01 is in two roles"),
    (["--bridge", "ros2=carier"], "carier: no such agent or kind"),
    (["--bridge", "ROS 2"], "ROS 2: not a name for a role"),
    (["--address", "http://shed"], "http://shed: neither an address nor the name of a machine"),
]


@pytest.mark.parametrize(("arguments", "named"), NO_ROLES)
def test_what_cannot_be_made_is_named_and_nothing_is_written(arguments, named, tmp_path):
    done = secured(tmp_path / "roles", "--rows", 3, *arguments)
    assert done.exit_code == 2
    assert named in done.stderr
    assert not (tmp_path / "roles").exists()


def test_another_directorys_things_are_left_alone(tmp_path):
    (tmp_path / "diary.txt").write_text("dear diary")
    done = secured(tmp_path, "--rows", 3)
    assert done.exit_code == 2
    assert "it has other files" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


# Arguments of a run, and words of the refusal. The roles in the folder are those of SMALL.
NO_RUNS = [
    (["--secure", "nowhere"], "nowhere: no roles there"),
    (
        ["--secure", "{folder}", "--listen", "tcp/127.0.0.1:0"],
        "not secure; with --secure use an endpoint such as tls/",
    ),
    (["--listen", "tls/127.0.0.1:0"], "tls needs certificates; --secure DIR"),
    (["--secure", "{folder}", "--pickers", 3], "no role for"),
    (["--secure", "{folder}", "--hosts", 2], "leave out --hosts"),
    (["--secure", "{folder}", "--mode", "local"], "local mode is one process"),
    (["--secure", "{folder}", "--without", "bin_01"], "ben is the role of bin_01, picker_02"),
    (
        ["--secure", "{folder}", "--without", "bin_01"],
        "`orchard secure --role NAME=bin_01` gives the others a role of their own",
    ),
    (["--secure", "{folder}/shed"], "shed: the role physics is not in it; it has shed"),
    (
        ["--secure", "{folder}", "--connect", "tls/127.0.0.1:9", "--only", "carrier"],
        "with --only choose one of them: DIR/<role>",
    ),
]


@pytest.mark.parametrize(("arguments", "named"), NO_RUNS)
def test_what_cannot_be_run_is_named(arguments, named, folder, tmp_path, monkeypatch, capfd):
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    words = [str(word).format(folder=folder) for word in arguments]
    guest = [] if "--only" in words else [tmp_path / "scenario.yaml", "--record", "none"]
    monkeypatch.setattr("sys.argv", ["orchard", "harvest", *map(str, guest), *words])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert named in " ".join(capfd.readouterr().err.split())


@pytest.fixture
def roles(folder, tmp_path) -> Path:
    """Return a copy of the folder of roles, which a test may spoil."""
    return shutil.copytree(folder, tmp_path / "roles")


def of_ben(own: Path, stranger: Path) -> None:
    """Give amy the certificate of ben."""
    for name in ("certificate.pem", "key.pem"):
        shutil.copy(own.parent / "ben" / name, own)


def expired(own: Path, stranger: Path) -> None:
    """Give amy a certificate that is over."""
    Authority.begin(30).vouch(
        Keyring.load(own).of("amy").role, own, until=datetime.now(UTC) - timedelta(minutes=1)
    )


def with_more_names(own: Path, stranger: Path) -> None:
    """Add an agent to amy's role, without a certificate for that."""
    (own / "role.json").write_text(
        (own / "role.json").read_text().replace('"picker_01"', '"picker_01", "picker_02"')
    )


# What makes amy's directory useless, given hers and that of another authority; and what is said.
NO_USE = [
    (lambda own, stranger: (own / "key.pem").unlink(), "key.pem: no such file"),
    (
        lambda own, stranger: shutil.copy(stranger / "amy" / "key.pem", own),
        "not the key of the certificate",
    ),
    (
        lambda own, stranger: shutil.copy(stranger / "amy" / AUTHORITY, own),
        "not issued by authority.pem",
    ),
    (of_ben, "the certificate of ben, not of amy"),
    (expired, "UTC, not now"),
    (
        lambda own, stranger: (own / "certificate.pem").write_text("nonsense"),
        "certificate.pem: not a certificate",
    ),
    (
        lambda own, stranger: (own / "role.json").write_text("{}"),
        "role.json: not as `orchard secure` wrote it",
    ),
    (with_more_names, "role.json has changed .duty host, names picker_01, picker_02."),
]


@pytest.mark.parametrize(("spoil", "named"), NO_USE)
def test_a_directory_of_no_use_is_named(spoil, named, roles, stranger):
    spoil(roles / "amy", stranger)
    with pytest.raises(ValueError, match=named):
        Keyring.load(roles).of("amy")


@pytest.mark.parametrize(
    "rules",
    [
        "{}",
        "",
        "[]",
        '{"enabled": false}',
        '{"enabled": true, "default_permission": "allow", "subjects": []}',
    ],
)
def test_access_rules_that_let_all_through_are_refused(rules, roles):
    (roles / "router" / "access.json").write_text(rules)
    with pytest.raises(ValueError, match=r"access\.json: "):
        Keyring.load(roles).of("router").rules()


def test_a_private_key_that_others_can_read_is_named(roles, caplog):
    key = roles / "amy" / "key.pem"
    Keyring.load(roles).of("amy")
    assert not caplog.records
    key.chmod(0o644)
    Keyring.load(roles).of("amy")
    assert f"{key}: other users can read this private key (mode 644)" in caplog.text


pytestmark = pytest.mark.processes

# Roles of the small scenario.
HOSTS = ("amy", "ben", "shed", "agents_1", "agents_2")


def test_a_secured_run_is_local_mode(folder, tmp_path):
    summary = tmp_path / "summary.json"
    recording = tmp_path / "run.rrd"
    orchard(
        scenario_file(tmp_path, SMALL),
        "--secure",
        folder,
        "--duration",
        30,
        "--record",
        recording,
        "--summary",
        summary,
    )
    assert summary_of(summary)["hash"] == local_hash(SMALL, 300)
    assert summary_of(summary)["messages_refused"] == {}
    # The logger has heard what happened: a recording of the scenery alone is smaller.
    assert recording.stat().st_size > 100_000


@pytest.mark.parametrize(
    "has_router", [True, pytest.param(False, marks=pytest.mark.soak)], ids=["router", "physics"]
)
def test_a_machine_needs_no_more_than_its_roles_directory(has_router, fleet, folder, tmp_path):
    """Each process has only a copy of its own role's files.

    There is a process for the router, or physics is the router.
    """
    copies = {
        path.name: str(shutil.copytree(path, tmp_path / f"machine of {path.name}" / path.name))
        for path in folder.iterdir()
    }
    where = ["--listen", "tls/127.0.0.1:0"]
    if has_router:
        router = fleet.start("orchard.processes.router", *where, "--secure", copies["router"])
        # It prints: listening on ENDPOINT.
        where = ["--connect", router.line().split()[-1]]
    fleet.physics(SMALL, *where, "--secure", copies["physics"], "--duration", "20")
    for role in HOSTS:
        fleet.host("--secure", copies[role])
    assert fleet.end() == local_hash(SMALL, 200)


@pytest.mark.parametrize(
    "killed",
    ["host", *(pytest.param(one, marks=pytest.mark.soak) for one in ("physics", "router"))],
)
def test_a_killed_process_comes_back_as_the_same_role(killed, fleet, folder, tmp_path):
    """It comes back with the same session id, which the others may still know, and the hash is that
    of local mode.
    """
    pace = [
        "--secure",
        str(folder / "physics"),
        "--speed",
        "15",
        "--duration",
        "20",
        "--snapshots",
        str(tmp_path / "snapshots"),
    ]
    place = ["--listen", f"tls/127.0.0.1:{free_port()}"]
    routing = ["orchard.processes.router", *place, "--secure", str(folder / "router")]
    if killed == "router":
        middle = fleet.start(*routing)
        assert middle.line().startswith("listening on")
        place = ["--connect", place[1]]
    fleet.physics(SMALL, *place, *pace)
    for role in HOSTS:
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
def test_a_secured_run_over_two_machines_is_local_mode(fleet, folder, tmp_path):
    """The guest has only its own role's files, and knows the other machine by its address."""
    own = str(shutil.copytree(folder / "shed", tmp_path / "shed"))
    with machines("s") as (host, guest):
        listen = ["--listen", "tls/0.0.0.0:7447", "--secure", str(folder / "physics")]
        fleet.physics(SMALL, *listen, "--duration", "20", before=within(host))
        for role in HOSTS:
            if role != "shed":
                fleet.host(
                    "--secure",
                    str(folder / role),
                    endpoint="tls/127.0.0.1:7447",
                    before=within(host),
                )
        fleet.host("--secure", own, endpoint="tls/192.168.1.10:7447", before=within(guest))
        assert fleet.end() == local_hash(SMALL, 200)


@needs_machines
def test_the_commands_of_the_document_run_in_order(tmp_path):
    """The last commands run on two machines."""
    alone = commands(block("docs/security.md", "secured"))
    make_roles, first, second = commands(block("docs/security.md", "secured, two machines"))
    # What `second` runs follows from the run.
    for command in (*alone, make_roles, first):
        command += ["--rows", "3"]
    alone[-1] += ["--duration", "5", "--record", "none"]
    first += ["--duration", "30", "--record", "none", "--summary", str(tmp_path / "summary.json")]
    here = tmp_path / "here"
    there = tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    for command in (*alone, make_roles):
        subprocess.run(command, cwd=here, check=True, timeout=PATIENCE)
    shutil.copytree(here / "roles" / "shed", there / "shed")
    with machines("d") as (host, guest):
        run_both(host, first, guest, second, here, there)
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 300)


def test_a_public_address_without_security_is_warned_of_once(tmp_path):
    done = orchard(
        scenario_file(tmp_path, SMALL),
        "--listen",
        "tcp/0.0.0.0:0",
        "--duration",
        1,
        "--record",
        "none",
    )
    assert (done.stdout + done.stderr).count("any client that reaches this address") == 1


@pytest.mark.parametrize(("address", "is_open"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_a_router_warns_of_a_public_address_only(address, is_open):
    routing = Process("orchard.processes.router", "--listen", f"tcp/{address}:0")
    try:
        assert routing.line().startswith("listening on")
        routing.signal(signal.SIGTERM)
        _, _, err = routing.end()
    finally:
        routing.kill()
    assert ("any client that reaches this address" in err) == is_open
