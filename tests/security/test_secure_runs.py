"""Whole secured runs: in one command and in many, over several machines, with kills; and what is said of a run that is not secured."""

import shutil
import signal
import subprocess

import pytest
from code_blocks import block, commands
from command_line import line_with, orchard, scenario_file, summary_of
from fleet import SECONDS, Process
from local_runs import SMALL, local_hash
from machines import machines, needs_machines, within
from secured_run import KEYS, Somebody

from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.net.bus import Sample
from orchard.net.zenoh_bus import client
from orchard.security.identity import Keyring
from orchard.wire.messages import Clock, read

pytestmark = pytest.mark.processes

HOSTS = ("amy", "ben", "shed", "agents_1", "agents_2")  # roles of the small scenario

# -- a whole run


def test_a_secured_run_is_local_mode(folder, tmp_path):
    summary, recording = tmp_path / "summary.json", tmp_path / "run.rrd"
    orchard(scenario_file(tmp_path, SMALL), "--secure", folder, "--duration", 30, "--record", recording, "--summary", summary)
    assert summary_of(summary)["hash"] == local_hash(SMALL, 300)
    assert summary_of(summary)["messages_refused"] == {}
    assert recording.stat().st_size > 100_000  # the logger has heard what happened


@pytest.mark.parametrize("its", ["router", pytest.param("physics", marks=pytest.mark.soak)])
def test_a_machine_needs_no_more_than_its_roles_directory(its, fleet, folder, tmp_path):
    """Each process with a copy of its own role's files, and nothing beside them; physics is the router, or there is one of its own."""
    copies = {path.name: str(shutil.copytree(path, tmp_path / f"machine of {path.name}" / path.name)) for path in folder.iterdir()}
    where = ["--listen", "tls/127.0.0.1:0"]
    if its == "router":
        where = ["--connect", fleet.start("orchard.processes.router", *where, "--secure", copies["router"]).line().split()[-1]]
    fleet.physics(SMALL, *where, "--secure", copies["physics"], "--duration", "20")
    for role in HOSTS:
        fleet.host("--secure", copies[role])
    assert fleet.end() == local_hash(SMALL, 200)


@pytest.mark.parametrize("killed", ["host", *(pytest.param(one, marks=pytest.mark.soak) for one in ("physics", "router"))])
def test_who_is_killed_comes_back_as_the_same_role(killed, fleet, folder, tmp_path):
    """Under the same session, which the others may still have in mind."""
    pace = ["--secure", str(folder / "physics"), "--speed", "15", "--duration", "20", "--snapshots", str(tmp_path / "snapshots")]
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
    """The guest has its own role's files only, and knows the other machine by its address."""
    own = str(shutil.copytree(folder / "shed", tmp_path / "shed"))
    with machines("s") as (host, guest):
        listen = ["--listen", "tls/0.0.0.0:7447", "--secure", str(folder / "physics")]
        fleet.physics(SMALL, *listen, "--duration", "20", before=within(host))
        for role in HOSTS:
            if role != "shed":
                fleet.host("--secure", str(folder / role), endpoint="tls/127.0.0.1:7447", before=within(host))
        fleet.host("--secure", own, endpoint="tls/192.168.1.10:7447", before=within(guest))
        assert fleet.end() == local_hash(SMALL, 200)


@needs_machines
def test_the_commands_of_the_document_run_one_after_the_other_the_last_ones_on_two_machines(tmp_path):
    alone = commands(block("docs/security.md", "secured"))
    make_roles, first, second = commands(block("docs/security.md", "secured, two machines"))
    for command in (*alone, make_roles, first):  # what `second` runs follows from the run
        command += ["--rows", "3"]
    alone[-1] += ["--duration", "5", "--record", "none"]
    first += ["--duration", "30", "--record", "none", "--summary", str(tmp_path / "summary.json")]
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    for command in (*alone, make_roles):
        subprocess.run(command, cwd=here, check=True, timeout=SECONDS)
    shutil.copytree(here / "roles" / "shed", there / "shed")
    with machines("d") as (host, guest):
        one = subprocess.Popen([*within(host), *first], cwd=here, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            said = line_with("carrier: left to other processes", one)
            other = subprocess.run([*within(guest), *second], cwd=there, capture_output=True, text=True, timeout=3 * SECONDS)
            rest, _ = one.communicate(timeout=SECONDS)
        finally:
            one.kill()
    assert (one.returncode, other.returncode) == (0, 0), said + rest + other.stdout + other.stderr
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 300)


# -- without security


def test_a_public_address_without_security_is_warned_of_once(tmp_path):
    done = orchard(scenario_file(tmp_path, SMALL), "--listen", "tcp/0.0.0.0:0", "--duration", 1, "--record", "none")
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
