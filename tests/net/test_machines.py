"""Several machines and real links: the hash is that of local mode.

Also the commands of docs/how-to.md for two machines. A machine is a network namespace of this one
(tests/support/machines.py): the first has a cable to each of the others, its guests. Simulated
machines: tests/chaos.
"""

import queue
import shlex
import signal
import subprocess

import pytest
from code_blocks import block, commands
from command_line import line_with, orchard, starting, summary_of
from fleet import ROOT, wait_for
from local_runs import ALONE, SMALL, TICKS, TOY, local_hash, played
from machines import harm, harms, machines, needs_machines, run_both, slowed, unplugged, within
from patience import PATIENCE

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.net.zenoh_bus import router

pytestmark = pytest.mark.processes

PORT = 7447
# The addresses of the router on the first machine, as each of three guests finds it.
MIDDLE = [f"tcp/192.168.{n}.10:{PORT}" for n in (1, 2, 3)]
# Slow enough that a fault meets the run where it shall.
PACE = (
    "--speed",
    "5",
    "--duration",
    str(TICKS / 10),
)
# s, for which links are down.
DOWN = 5.0


@needs_machines
def test_three_machines_with_a_router_have_the_local_hash(fleet):
    with machines("a", "b") as (middle, one, other):
        routing = fleet.router(f"tcp/0.0.0.0:{PORT}", before=within(middle))
        first, second, _ = MIDDLE
        fleet.physics(SMALL, "--connect", first, "--duration", str(TICKS / 10), before=within(one))
        fleet.host("--only", "bin", "--only", "traffic", endpoint=first, before=within(one))
        fleet.host(
            "--without", "bin", "--without", "traffic", endpoint=second, before=within(other)
        )
        assert fleet.end() == local_hash(SMALL, TICKS)
        routing.signal(signal.SIGTERM)
        assert routing.end()[0] == 0


@needs_machines
def test_links_that_are_down_for_five_seconds_change_nothing(fleet, undisturbed):
    """First the link of a third of the agents is down, then that of physics.

    Each time the sessions are given up and opened again.
    """
    with machines("a", "b", "c") as (middle, *guests):
        fleet.router(f"tcp/0.0.0.0:{PORT}", before=within(middle))
        fleet.physics(SMALL, *PACE, "--connect", MIDDLE[0], before=within(guests[0]))
        for n, guest in enumerate(guests):
            fleet.host("--share", f"{n}/3", agents=TOY, endpoint=MIDDLE[n], before=within(guest))
        clock = fleet.hear("orchard/clock", f"tcp/127.0.0.1:{PORT}", before=within(middle))
        for tick, guest in ((20, 2), (60, 1)):
            wait_for(clock, lambda message, tick=tick: message["tick"] >= tick)
            # At --speed 5 it would be 50 ticks a second. Not even 10 a second come.
            with unplugged(middle, guest), pytest.raises(queue.Empty):
                wait_for(
                    clock, lambda message, tick=tick: message["tick"] >= tick + 10 * DOWN, DOWN
                )
        assert fleet.end() == undisturbed


@needs_machines
def test_a_slow_link_changes_nothing(fleet, undisturbed):
    with machines("a") as (host, guest):
        slowed(host, 1, "rate", "8mbit", "burst", "16kb", "latency", "200ms")
        fleet.physics(SMALL, *PACE, "--listen", f"tcp/0.0.0.0:{PORT}", before=within(host))
        fleet.host(
            "--share", "0/2", agents=TOY, endpoint=f"tcp/127.0.0.1:{PORT}", before=within(host)
        )
        fleet.host("--share", "1/2", agents=TOY, endpoint=MIDDLE[0], before=within(guest))
        assert fleet.end() == undisturbed


# A whole harvest of three rows, with three exchanges.
BRIEF = Scenario(rows=3, row_length=20.0, carriers=2, **ALONE)
# Ticks of BRIEF in local mode, until the last bin is unloaded and the harvest is over. The test
# asserts that it is.
UNLOADED = 2864
# Ticks, until both pickers have another bin.
FIRST_EXCHANGE = 600


@needs_machines
@pytest.mark.parametrize(
    "ticks",
    [
        FIRST_EXCHANGE,
        *(pytest.param(UNLOADED, marks=pytest.mark.soak, id=f"harvest {n}") for n in range(10)),
    ],
)
def test_lost_doubled_and_reordered_packets_change_nothing(fleet, ticks):
    """Half of the agents are on each of two machines. In each run other packets suffer.

    v1 and v2 are the ends of the cables at the first machine, and eth0 that at each guest.
    """
    local = played(Local(BRIEF), ticks)
    with machines("a", "b") as (host, *guests):
        for guest in guests:
            harm(guest, "eth0")
        harm(host, "v1", "v2")
        duration = ("--duration", str(ticks / 10))
        fleet.physics(BRIEF, *duration, "--listen", f"tcp/0.0.0.0:{PORT}", before=within(host))
        for n, guest in enumerate(guests):
            fleet.host("--share", f"{n}/2", endpoint=MIDDLE[n], before=within(guest))
        assert fleet.end() == local.engine.hash
        for end in ("v1", "v2"):
            assert harms(host, end)["lost"] > 0
    assert local.ended == ("harvested" if ticks == UNLOADED else "")


@needs_machines
def test_two_commands_run_the_carriers_on_another_machine(tmp_path):
    first, second = commands(block("docs/how-to.md", "two machines"))
    first += [
        "--rows",
        "3",
        "--duration",
        "60",
        "--record",
        "none",
        "--summary",
        str(tmp_path / "summary.json"),
    ]
    with machines("a") as (host, guest):
        run_both(host, first, guest, second)
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 600)


def test_missing_agents_are_told_and_one_guest_runs_them(tmp_path):
    """A run that leaves agents to others prints the command that runs them. The test types it."""
    path = tmp_path / "summary.json"
    left = ["--without", "carrier", "--without", "picker_01"]
    with starting(
        "--rows", 3, *left, "--duration", 5, "--record", "none", "--summary", path
    ) as run:
        typed = shlex.split(line_with("left to other processes: ", run).partition("processes: ")[2])
        line = line_with("waiting for", run)
        assert "carrier_01, carrier_02" in line
        guest = subprocess.run(typed, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
        assert guest.returncode == 0, guest.stdout + guest.stderr
        assert "hosting carrier_01, carrier_02, picker_01" in guest.stdout
        out, _ = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, out
    assert summary_of(path)["hash"] == local_hash(Scenario(rows=3), 50)


# What a user types, and words of the refusal. No program listens on port 9.
MISTAKES = [
    (
        ["--connect", "tcp/127.0.0.1:9", "--only", "carrier"],
        "tcp/127.0.0.1:9: no router answers there",
    ),
    (
        ["--connect", "tcp/127.0.0.1:9", "--record", "none"],
        "tcp/127.0.0.1:9: no router answers there",
    ),
    (["--connect", "tcp/127.0.0.1:9", "--only", "carrier", "--rows", "3"], "leave out --rows"),
    (["--listen", "nonsense"], "nonsense: not an endpoint"),
    (["--listen", "tcp/127.0.0.1:99999"], "tcp/127.0.0.1:99999: 99999 is not a port"),
    (["--listen", "tcp/127.0.0.1:seven"], "tcp/127.0.0.1:seven: seven is not a port"),
    (["--without", "carier"], "carier: no such agent or kind"),
    (["--only", "carrier"], "--connect"),
    (["--mode", "local", "--without", "carrier"], "local mode is one process"),
    (["--listen", "tcp/127.0.0.1:7", "--connect", "tcp/127.0.0.1:9"], "--listen or --connect"),
]


@pytest.mark.parametrize(("arguments", "named"), MISTAKES)
def test_what_cannot_be_is_named(arguments, named):
    assert named in orchard(*arguments, code=2).stderr


def test_a_port_in_use_is_named():
    with router() as taken:
        done = orchard("--rows", 3, "--record", "none", "--listen", taken.endpoint, code=2)
    assert f"{taken.endpoint}: cannot listen there; the port is in use" in done.stderr
