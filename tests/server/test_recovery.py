"""What comes back after a kill or a freeze, and what is told of it.

`fleet` runs the processes over a simulated network (tests/conftest.py). SIGSTOP freezes a process,
and SIGCONT lets it go on. `complaints` is what a process has logged. All else that may happen:
`tests/chaos/test_schedules.py`.
"""

import os
import re
import signal

import pytest
from fleet import wait_for
from local_runs import SMALL, TICKS, TOY, local_hash
from recorded_messages import Net, StandIn
from stage import empty_orchard

from orchard.local import Local
from orchard.net.refusals import Refused
from orchard.server.loop import RunLoop
from orchard.server.options import RunOptions
from orchard.server.snapshots import last
from orchard.sim.engine import Engine
from orchard.sim.snapshot import as_file, newest
from orchard.wire.keys import Keys

# Slow enough that a fault meets the run where it shall.
PACE = (
    "--speed",
    "15",
    "--duration",
    str(TICKS / 10),
)


def wait_for_tick(fleet, tick):
    wait_for(fleet.client().hear("orchard/clock"), lambda message: message["tick"] >= tick)


def end(process):
    """Wait for the end of a process that was killed."""
    process.signal(signal.SIGKILL)
    process.end()


@pytest.mark.parametrize(
    "dispatch",
    [
        "predictive",
        *(pytest.param(name, marks=pytest.mark.soak) for name in ("farthest-first", "nearest")),
    ],
)
def test_hosts_killed_while_bins_call_change_nothing(fleet, dispatch):
    scenario = empty_orchard(dispatch=dispatch)
    fleet.physics(scenario, "--speed", "30", "--duration", "90")
    fleet.share(2)
    # Bins report; carriers are under way; bins are left.
    for tick in (20, 300, 700):
        wait_for_tick(fleet, tick)
        end(fleet.hosts.pop(0))
        fleet.host("--share", f"{0 if tick != 300 else 1}/2")
    assert fleet.end() == local_hash(scenario, 900)


def test_a_host_that_sleeps_too_long_joins_when_it_wakes(fleet, tmp_path):
    """It sleeps for longer than physics' patience of 3 s and the lease of its link, 2 s.

    After these 2 s its link counts as gone. So hosts whose agents have mail for the sleeping one
    learn that it does not answer, and are themselves in time.
    """
    fleet.physics(
        SMALL, "--speed", "5", "--patience", "3", "--snapshots", str(tmp_path / "snapshots")
    )
    someone = fleet.client()
    lost, velocities, clock = (
        someone.hear(f"orchard/{key}") for key in ("lost", "picker_01/velocity", "clock")
    )
    fleet.host("--without", "picker_01", agents=TOY)
    hung = fleet.host("--only", "picker_01", agents=TOY)
    wait_for(velocities, lambda velocity: velocity["tick"] >= 20)
    hung.signal(signal.SIGSTOP)
    named = wait_for(lost, lambda message: True)
    assert named["names"] == ["picker_01"]
    wait_for(clock, lambda message: message["tick"] >= named["tick"] + 20)
    hung.signal(signal.SIGCONT)
    wait_for(velocities, lambda velocity: velocity["tick"] > named["tick"])
    fleet.stop()
    assert "no answer" in fleet.world.complaints
    assert "joining again" in hung.complaints
    assert newest(tmp_path / "snapshots", []).lost == {"picker_01": named["tick"]}, (
        "and the person that resumes the run is told"
    )


def test_a_session_given_up_is_refused_until_it_joins(fleet):
    """Session `me` owns worker_01 and does not answer for 1 s, so physics gives it up. When it has
    joined again, its answer to tick 0 is too old.
    """
    fleet.physics(SMALL, "--speed", "5", "--patience", "1")
    someone = fleet.client()
    lost, figures, clock = (someone.hear(f"orchard/{key}") for key in ("lost", "figures", "clock"))
    fleet.host("--without", "worker_01")
    token = someone.declare("orchard/alive/worker_01/me")
    assert not someone.join("worker_01")["refused"]
    wait_for(lost, lambda message: message["owner"] == "me")
    someone.drive("worker_01", 0, 0.5, owner="me")
    wait_for(figures, lambda message: message["messages_refused"] == {"not owned": 1})
    wait_for(clock, lambda message: message["tick"] >= 20)
    assert not someone.join("worker_01")["refused"]
    someone.drive("worker_01", 0, 0.5, owner="me")
    wait_for(
        figures, lambda message: message["messages_refused"] == {"not owned": 1, "past tick": 1}
    )
    token.undeclare()
    fleet.stop()


def killed_with_snapshots(fleet, tmp_path) -> tuple[str, ...]:
    """Kill physics after its first snapshots. Return the options to go on."""
    keeping = (*PACE, "--snapshots", str(tmp_path / "snapshots"), "--snapshot-every", "0.2")
    fleet.physics(SMALL, *keeping)
    fleet.share(2, TOY)
    wait_for_tick(fleet, 30)
    end(fleet.world)
    return (*keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)


def test_agents_waited_for_are_named_long_before_the_wait_ends(fleet):
    """Of a patience of 15 s, 12 are left when physics names the agents. The test looks after 10."""
    fleet.physics(SMALL, *PACE, "--patience", "15")
    fleet.share(2, TOY)
    wait_for_tick(fleet, 30)
    end(fleet.hosts[0])
    fleet.wait(lambda: False, 10.0)
    assert re.search(
        r"no answer to tick \d+ yet from .*: waiting for up to 12 s more", fleet.world.complaints
    )
    assert "no longer waited for" not in fleet.world.complaints


def test_physics_goes_on_without_its_scenario_file(fleet, undisturbed, tmp_path):
    """It goes on from the newest whole snapshot of this run.

    The newest files are passed over and named: one is half a file, one is a pipe, which would never
    end, and one is a snapshot of another run.
    """
    keeping = killed_with_snapshots(fleet, tmp_path)
    folder = tmp_path / "snapshots"
    gone = tmp_path / "scenario.yaml"
    gone.unlink()
    torn = max(folder.glob("tick-*.snapshot"))
    torn.write_bytes(torn.read_bytes()[:1000])
    os.mkfifo(folder / "tick-000000999.snapshot")
    alien = Local(SMALL).snapshot()
    alien.run = "another"
    (folder / "tick-000000998.snapshot").write_bytes(as_file(alien)[1])
    fleet.world = fleet.start("orchard.processes.physics", str(gone), *keeping)
    assert fleet.end() == undisturbed
    for words in (
        torn.name,
        "tick-000000999.snapshot: is no regular file",
        "tick-000000998.snapshot: of another run, another",
    ):
        assert words in fleet.world.complaints


def test_physics_with_a_torn_snapshot_begins_anew_and_says_so(fleet, undisturbed, tmp_path):
    keeping = killed_with_snapshots(fleet, tmp_path)
    for path in (tmp_path / "snapshots").glob("tick-*.snapshot"):
        path.write_bytes(path.read_bytes()[:1000])
    fleet.physics(SMALL, *keeping)
    assert fleet.end() == undisturbed
    assert "the run begins anew" in fleet.world.complaints


@pytest.mark.parametrize(
    ("seconds", "all_come_back"), [(10.0, True), (20.0, False)], ids=["in time", "too late"]
)
def test_owners_of_agents_are_waited_for_while_they_come_back(
    fleet, tmp_path, seconds, all_come_back
):
    """Physics and its hosts are killed, and a new host comes every `seconds`.

    Physics waits for 15 s from each of them on, so longer in all.
    """
    keeping = killed_with_snapshots(fleet, tmp_path)
    for host in fleet.hosts:
        end(host)
    fleet.hosts.clear()
    fleet.physics(SMALL, *keeping, "--patience", "15", "--duration", "4")
    for number in range(4):
        fleet.wait(lambda: False, seconds)
        fleet.host("--share", f"{number}/4")
    fleet.world.end()
    gave_up = "no longer waited for" in fleet.world.complaints
    assert gave_up != all_come_back, fleet.world.complaints


def test_earlier_refusals_survive_a_kill_of_physics(tmp_path):
    """Physics goes on from a snapshot, and counts what was refused before it was killed.

    A host tells its own refusals as totals since its start. So the host that is still there tells
    the old ones again, and they count once.
    """
    options = RunOptions(run="run7", snapshots=str(tmp_path))
    before = RunLoop(StandIn(Net(), "physics1"), Keys(), Engine.begin(SMALL), options).run
    before.refusal_totals.note("a key", Refused("malformed"))
    before.refusal_totals.hear("host1", {"malformed": 2, "not all": 1})
    before.keep()
    before.account.snapshot_writer.finish()
    snapshot = last(tmp_path)
    totals = RunLoop(
        StandIn(Net(), "physics2"), Keys(), Engine.resume(snapshot), options, snapshot
    ).run.refusal_totals
    assert totals.total() == {"malformed": 3, "not all": 1}
    totals.note("a key", Refused("past tick"))
    totals.hear("host1", {"malformed": 3, "not all": 1})
    assert totals.total() == {
        "malformed": 4,
        "not all": 1,
        "past tick": 1,
    }, "a session that is still there counts once"
