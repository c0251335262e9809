"""Kill it, freeze it, cut it off: lockstep waits, goes on, and has the hash of a run that nothing happened to."""

import os
import signal
from pathlib import Path

import msgpack
import pytest
from fleet import until
from local_runs import SMALL, TICKS, TOY, local_hash
from recorded_messages import Net, StandIn
from stage import empty_orchard

from orchard.contract.messages import pack
from orchard.launch.supervisor import free_port
from orchard.local import Local
from orchard.net.bus import Alive, Query
from orchard.net.refusals import Refused
from orchard.server.loop import RunLoop
from orchard.server.options import RunOptions
from orchard.server.snapshots import last
from orchard.sim.engine import Engine
from orchard.sim.snapshot import as_file, newest
from orchard.wire.keys import Keys
from orchard.wire.messages import Join

PACE = ("--speed", "15", "--duration", str(TICKS / 10))  # slow enough that a fault meets the run where it shall


def wait_for_tick(fleet, tick):
    until(fleet.client().hear("orchard/clock"), lambda message: message["tick"] >= tick)


def end(process):
    """Kill it, without help by a person."""
    process.signal(signal.SIGKILL)
    process.end()


# -- agents


IN_SOAK = [pytest.param(2, 2, marks=pytest.mark.soak), pytest.param(1, 17, marks=pytest.mark.soak)]


@pytest.mark.parametrize(("killed", "tick"), [(1, 1), (2, 60), *IN_SOAK])
def test_hosts_that_are_killed_at_any_tick_and_started_again_change_nothing(fleet, undisturbed, killed, tick):
    fleet.physics(SMALL, *PACE)
    fleet.share(2, TOY)
    wait_for_tick(fleet, tick)
    for host in fleet.hosts[:killed]:
        end(host)
    fleet.hosts = fleet.hosts[killed:]
    for number in range(killed):
        fleet.host("--share", f"{number}/2", agents=TOY)
    assert fleet.end() == undisturbed


@pytest.mark.parametrize(
    "dispatch", ["predictive", *(pytest.param(name, marks=pytest.mark.soak) for name in ("farthest-first", "nearest"))]
)
def test_hosts_that_are_killed_while_bins_call_and_carriers_leave_early_change_nothing(fleet, dispatch):
    scenario = empty_orchard(dispatch=dispatch)
    fleet.physics(scenario, "--speed", "30", "--duration", "90")
    fleet.share(2)
    for tick in (20, 300, 700):  # bins report; carriers are under way; bins are left
        wait_for_tick(fleet, tick)
        end(fleet.hosts.pop(0))
        fleet.host("--share", f"{0 if tick != 300 else 1}/2")
    assert fleet.end() == local_hash(scenario, 900)


def test_a_host_that_is_killed_again_and_again_changes_nothing(fleet, undisturbed):
    fleet.physics(SMALL, *PACE)
    fleet.share(2, TOY)
    for tick in (10, 25, 26, 50, 80):
        wait_for_tick(fleet, tick)
        end(fleet.hosts.pop(0))
        fleet.hosts.insert(0, fleet.host("--share", "0/2", agents=TOY))
        fleet.hosts.pop()
    assert fleet.end() == undisturbed


def test_a_host_that_sleeps_for_a_while_changes_nothing(fleet, undisturbed):
    fleet.physics(SMALL, *PACE, "--patience", "30")
    fleet.share(2, TOY)
    clock = fleet.client().hear("orchard/clock")
    until(clock, lambda message: message["tick"] >= 20)
    fleet.hosts[0].signal(signal.SIGSTOP)
    seen_again = fleet.client().hear("orchard/hosts/*/seen")
    first = seen_again.get(timeout=20)
    until(seen_again, lambda message: message["tick"] == first["tick"])  # physics asks again, for it is not answered
    fleet.hosts[0].signal(signal.SIGCONT)
    assert fleet.end() == undisturbed


def test_a_host_that_sleeps_for_longer_than_patience_and_lease_joins_again_when_it_wakes(fleet, tmp_path):
    """3 s: the agents that had letters for it learn within 2 s that it does not answer, and are in time."""
    fleet.physics(SMALL, "--speed", "5", "--patience", "3", "--snapshots", str(tmp_path / "snapshots"))
    someone = fleet.client()
    lost, velocities, clock = (someone.hear(f"orchard/{key}") for key in ("lost", "picker_01/velocity", "clock"))
    fleet.host("--without", "picker_01", agents=TOY)
    hung = fleet.host("--only", "picker_01", agents=TOY)
    until(velocities, lambda velocity: velocity["tick"] >= 20)
    hung.signal(signal.SIGSTOP)
    named = until(lost, lambda message: True)
    assert named["names"] == ["picker_01"]
    until(clock, lambda message: message["tick"] >= named["tick"] + 20)
    hung.signal(signal.SIGCONT)
    until(velocities, lambda velocity: velocity["tick"] > named["tick"])
    fleet.world.signal(signal.SIGTERM)
    fleet.end()
    assert "no answer" in fleet.world.complaints
    assert newest(tmp_path / "snapshots", []).lost == {"picker_01": named["tick"]}, "and the person that resumes the run is told"


def test_what_one_says_late_who_was_given_up_is_refused_until_it_joins_again(fleet):
    fleet.physics(SMALL, "--speed", "5", "--patience", "1")
    someone = fleet.client()
    lost, figures, clock = (someone.hear(f"orchard/{key}") for key in ("lost", "figures", "clock"))
    fleet.host("--without", "worker_01")
    token = someone.declare("orchard/alive/worker_01/me")
    join = msgpack.packb({"run": fleet.run, "owner": "me", "names": ["worker_01"]})
    assert not someone.ask("orchard/hosts/me/join", join)[0]["refused"]
    until(lost, lambda message: message["owner"] == "me")
    someone.drive("worker_01", 0, 0.5, owner="me")
    until(figures, lambda message: message["messages_refused"] == {"not owned": 1})
    until(clock, lambda message: message["tick"] >= 20)
    assert not someone.ask("orchard/hosts/me/join", join)[0]["refused"]
    someone.drive("worker_01", 0, 0.5, owner="me")
    until(figures, lambda message: message["messages_refused"] == {"not owned": 1, "past tick": 1})
    token.undeclare()
    fleet.world.signal(signal.SIGTERM)
    fleet.end()


# -- physics


@pytest.mark.parametrize("tick", [3, pytest.param(40, marks=pytest.mark.soak)])
def test_physics_that_is_killed_goes_on_from_its_last_snapshot_to_the_same_hash(fleet, undisturbed, tmp_path, tick):
    keeping = ("--snapshots", str(tmp_path / "snapshots"), "--snapshot-every", "0.2")
    fleet.physics(SMALL, *PACE, *keeping)
    fleet.share(2, TOY)
    wait_for_tick(fleet, tick)
    end(fleet.world)
    fleet.physics(SMALL, *PACE, *keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)
    assert fleet.end() == undisturbed


def test_physics_and_a_host_that_are_killed_together_change_nothing(fleet, undisturbed, tmp_path):
    keeping = ("--snapshots", str(tmp_path / "snapshots"), "--snapshot-every", "0.2")
    fleet.physics(SMALL, *PACE, *keeping)
    fleet.share(2, TOY)
    wait_for_tick(fleet, 30)
    end(fleet.hosts.pop())
    end(fleet.world)
    fleet.physics(SMALL, *PACE, *keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)
    fleet.host("--share", "1/2", agents=TOY)
    assert fleet.end() == undisturbed


def test_a_torn_snapshot_is_named_and_the_one_before_it_is_used(fleet, undisturbed, tmp_path):
    folder = tmp_path / "snapshots"
    keeping = ("--snapshots", str(folder), "--snapshot-every", "0.1", "--speed", "5")
    fleet.physics(SMALL, *PACE, *keeping)
    fleet.share(2, TOY)
    until(fleet.client().hear("orchard/clock"), lambda _: len(list(folder.glob("tick-*.snapshot"))) >= 2)
    end(fleet.world)
    torn = max(folder.glob("tick-*.snapshot"))
    torn.write_bytes(torn.read_bytes()[:1000])
    fleet.physics(SMALL, *PACE, *keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)
    assert torn.name in fleet.world.error()
    assert fleet.end() == undisturbed


def killed_with_snapshots(fleet, tmp_path) -> tuple[Path, tuple[str, ...]]:
    """Kill physics at tick 30. Return the folder of its snapshots, and its arguments for them."""
    folder = tmp_path / "snapshots"
    keeping = ("--snapshots", str(folder), "--snapshot-every", "0.2")
    fleet.physics(SMALL, *PACE, *keeping)
    fleet.share(2, TOY)
    wait_for_tick(fleet, 30)
    end(fleet.world)
    return folder, keeping


def test_physics_whose_scenario_file_is_gone_goes_on_from_the_newest_snapshot_that_is_its_own(fleet, undisturbed, tmp_path):
    folder, keeping = killed_with_snapshots(fleet, tmp_path)
    (tmp_path / "scenario.yaml").unlink()
    os.mkfifo(folder / "tick-000000999.snapshot")
    alien = Local(SMALL).snapshot()
    alien.run = "another"
    (folder / "tick-000000998.snapshot").write_bytes(as_file(alien)[1])
    gone = str(tmp_path / "scenario.yaml")
    fleet.world = fleet.start(
        "orchard.processes.physics", gone, *PACE, *keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint
    )
    assert fleet.end() == undisturbed
    assert "tick-000000999.snapshot: not a snapshot" in fleet.world.complaints
    assert "tick-000000998.snapshot: of another run, another" in fleet.world.complaints


def test_physics_that_has_only_a_torn_snapshot_begins_anew_and_says_so(fleet, undisturbed, tmp_path):
    folder, keeping = killed_with_snapshots(fleet, tmp_path)
    for path in folder.glob("tick-*.snapshot"):
        path.write_bytes(path.read_bytes()[:1000])
    fleet.physics(SMALL, *PACE, *keeping, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)
    assert fleet.end() == undisturbed
    assert "the run begins anew" in fleet.world.complaints


# -- the router


def test_a_router_that_is_killed_and_started_again_changes_nothing(fleet, undisturbed):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = fleet.start("orchard.processes.router", "--listen", endpoint)
    router.line()
    fleet.physics(SMALL, *PACE, "--connect", endpoint)
    fleet.share(2, TOY)
    wait_for_tick(fleet, 30)
    end(router)
    again = fleet.start("orchard.processes.router", "--listen", endpoint)
    assert "listening" in again.line()
    assert fleet.end() == undisturbed


# -- what comes back


class SlowStart:
    """A bus at which one agent after another joins again, each so many seconds after the last, on a clock of its own."""

    id, endpoint, executor = "here", "nowhere", None

    def __init__(self, names, seconds):
        self.inbox, self.now, self._seconds = self, 0.0, seconds
        self._items = iter([item for name in names for item in (Alive(f"orchard/alive/{name}/s-{name}", True), Knock(name, f"s-{name}"))])

    def take(self, seconds, enough=1):
        item = next(self._items, None)
        self.now += seconds if item is None else 0.5 * self._seconds
        return item

    def clock(self):
        return self.now


class Knock(Query):
    """The wish to join."""

    def __init__(self, name, session):
        self.key, self.payload = f"orchard/hosts/{session}/join", pack(Join("here", session, [name]))

    def reply(self, payload):
        pass

    def refuse(self, reason):
        raise AssertionError(reason)

    def drop(self):
        pass


@pytest.mark.parametrize(("seconds", "is_there"), [(10.0, True), (20.0, False)])
def test_who_held_agents_is_waited_for_as_long_as_one_after_another_comes_back(seconds, is_there):
    local = Local(SMALL)
    local.tick()
    before = local.snapshot()
    before.run = "here"
    names = before.held = before.held[:4]
    bus = SlowStart(names, seconds)
    physics = RunLoop(bus, Keys(), Engine.resume(before), RunOptions(patience=15.0), before)
    physics.gather()
    assert (sorted(physics.run.drivers.roster.owners) == names) == is_there
    assert (physics.run.drivers.lost == {}) == is_there


# -- what was refused


def test_what_was_refused_before_physics_was_killed_is_in_its_figures_afterwards(tmp_path):
    options = RunOptions(run="run7", snapshots=str(tmp_path))
    before = RunLoop(StandIn(Net(), "physics1"), Keys(), Engine.begin(SMALL), options).run
    before.refusal_totals.note("a key", Refused("malformed"))
    before.refusal_totals.hear("host1", {"malformed": 2, "not all": 1})
    before.keep()
    before.account.snapshot_writer.finish()
    snapshot = last(tmp_path)
    totals = RunLoop(StandIn(Net(), "physics2"), Keys(), Engine.resume(snapshot), options, snapshot).run.refusal_totals
    assert totals.total() == {"malformed": 3, "not all": 1}
    totals.note("a key", Refused("past tick"))
    totals.hear("host1", {"malformed": 3, "not all": 1})
    assert totals.total() == {"malformed": 4, "not all": 1, "past tick": 1}, "a session that is still there counts once"
