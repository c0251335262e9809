"""The emergency stop overrides motion, in the engine and over the bus, whatever drives the robot
and whatever process ends.

`stop` takes names or kinds of robots; without any it stops all. A robot and its bin are stopped
together, and stand until they are reset. `fleet` runs processes over a simulated network.
"""

import signal
from pathlib import Path
from typing import Any

import msgpack
import pytest
from fleet import Client, assert_goes_on, assert_stands, wait_for
from local_runs import HARVEST_TICKS, SMALL, harvest_hash, played
from raycaster import world_of
from stage import Driven, Stage, Standing, empty_orchard

from orchard.contract.agent import AHEAD
from orchard.contract.events import Frame
from orchard.contract.messages import Couple, pack, unpack
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.kinds import kind_of
from orchard.field.scenario import NEAREST, Scenario
from orchard.launch.request import agent_names
from orchard.local import Local
from orchard.sim.engine import Engine
from orchard.sim.frames import FrameBuilder
from orchard.sim.obstacles import with_names
from orchard.sim.snapshot import Snapshot

ROBOTS = ("picker", "carrier", "bin", "tractor")
MOVERS = (*ROBOTS, "worker", "visitor", "dog", "cat")
FORWARD = Twist(x=0.5)


@pytest.fixture
def driven() -> Stage:
    """Return a stage on which picker_01 has driven at 0.5 m/s for 3 s, and drives on."""
    stage = Stage(empty_orchard(), picker_01=Driven(FORWARD))
    stage.run(3.0)
    return stage


@pytest.mark.parametrize(
    ("stopped", "reset"),
    [("picker_01", "picker_01"), ("picker_01", "bin_01"), ("bin_01", "picker_01")],
)
def test_a_robot_and_its_bin_stand_until_they_are_reset(driven, stopped, reset):
    assert sorted(driven.local.engine.stop([stopped])) == ["bin_01", "picker_01"]
    picker = driven.pose("picker_01")
    bin_ = driven.pose("bin_01")
    driven.run(5.0)
    assert driven.local.actions["picker_01"].twist == FORWARD, "its agent drives"
    assert driven.pose("picker_01") == picker
    assert driven.pose("bin_01") == bin_
    driven.local.engine.reset([reset])
    driven.run(4.0)
    assert driven.pose("picker_01")[0] == pytest.approx(picker[0] + 2.0)
    assert driven.pose("bin_01")[0] == pytest.approx(bin_[0] + 2.0)


def test_a_reset_robot_goes_on_and_never_back():
    stage = Stage(empty_orchard())
    stage.run(5.0)
    # After stops of 0.5 s to 4.4 s.
    for ticks in range(5, 45, 3):
        stage.local.engine.stop()
        stage.run(ticks / 10)
        stage.local.engine.reset()
        xs = [stage.pose("picker_01")[0]]
        for _ in range(15):
            stage.tick()
            xs.append(stage.pose("picker_01")[0])
        assert xs == sorted(xs), ticks
        assert xs[-1] > xs[0], ticks


def test_all_robots_stand_and_people_and_animals_walk_on():
    stage = Stage(Scenario(rows=3))
    stage.run(5.0)
    stage.local.engine.stop()
    where = {name: stage.pose(name) for name in stage.world.index}
    stage.run(20.0)
    moved = {kind_of(name) for name in where if stage.pose(name) != where[name]}
    assert not moved & set(ROBOTS)
    assert moved == set(MOVERS) - set(ROBOTS)
    stage.local.engine.reset()
    stage.run(20.0)
    assert stage.pose("picker_01") != where["picker_01"]
    assert stage.pose("tractor_01") != where["tractor_01"]


@pytest.mark.parametrize("word", ["picker_99", "worker", "worker_01", "traffic", ""])
def test_a_word_that_means_no_robot_stops_no_robot(driven, word):
    with pytest.raises(ValueError, match="no such agent or kind; there are bin, carrier, picker"):
        driven.local.engine.stop(["picker_01", word])
    assert not driven.world.stopped.any()


def test_a_robot_that_is_stopped_is_not_stopped_again(driven):
    """A reset of other robots does not concern it."""
    engine = driven.local.engine
    engine.stop(["picker"])
    assert engine.stop(["picker_01"]) == []
    assert sorted(engine.reset(["picker_02"])) == ["bin_02", "picker_02"]
    assert driven.world.stopped[driven.world.index["picker_01"]]


def test_a_stop_during_coupling_ends_well():
    """The picker is stopped when a carrier has left it an empty bin. Then the bin is stopped in
    place of the picker.
    """
    stage = Stage(empty_orchard(dispatch=NEAREST))
    stage.run_until(lambda: bool(stage.happened("uncoupled", "carrier_01")), 300)
    offered = stage.happened("uncoupled", "carrier_01")[0].whom
    stage.local.engine.stop(["picker_01"])
    stage.run(10.0)
    assert stage.local.memories["picker_01"].offered == offered
    assert stage.local.actions["picker_01"].deeds == [Couple(offered)], "its agent asks for it"
    assert stage.bin_of("picker_01") == ""
    stage.local.engine.stop([offered])
    stage.local.engine.reset(["picker_01"])
    stage.run(3.0)
    assert stage.bin_of("picker_01") == "", "the bin is stopped now"
    assert stage.happened("deed refused", "picker_01")[-1].detail == "couple: the bin is stopped"
    stage.local.engine.reset([offered])
    stage.run_until(lambda: stage.bin_of("picker_01") == offered, 5)
    stage.run_to_the_end()
    assert stage.world.delivered == 3


def test_a_long_stop_is_no_jam_and_a_jam_comes_back(soon_jammed):
    """While robots are stopped no time counts. After the reset it counts from zero.

    The carriers never move, so the harvest jams after 120 s without progress (`soon_jammed`).
    """
    stage = Stage(empty_orchard(), **{name: Standing() for name in ("carrier_01", "carrier_02")})
    stage.run(100)
    stage.local.engine.stop()
    stage.run(140)
    assert stage.account.jam == []
    stage.local.engine.reset()
    stage.run(110)
    assert stage.account.jam == []
    stage.run_until(lambda: stage.account.jam != [], 20)


def test_what_people_are_told_and_the_figures(driven):
    camera = FrameBuilder(driven.local.engine)
    driven.local.engine.stop(["picker_01"])
    driven.run(2.0)
    assert {event.who for event in driven.happened("stopped")} == {"picker_01", "bin_01"}
    assert driven.account.message("", {}).doing["picker_01"] == "stopped"
    assert camera.frame([]).doing["picker_01"] == "stopped"
    assert driven.account.figures()["stopped_seconds"] == {"bin_01": 2.0, "picker_01": 2.0}
    driven.local.engine.reset()
    driven.run(1.0)
    assert {event.who for event in driven.happened("reset")} == {"picker_01", "bin_01"}
    assert camera.frame([]).doing["picker_01"] != "stopped"
    assert driven.account.figures()["stopped_seconds"] == {"bin_01": 2.0, "picker_01": 2.0}
    assert driven.account.figures()["state_seconds"]["picker"]["stopped"] == 2.0


def test_a_robot_without_an_action_stands_after_a_reset():
    engine = Engine.begin(empty_orchard())
    camera = FrameBuilder(engine)

    def step() -> Frame:
        engine.observe()
        engine.due(())
        return camera.frame(engine.advance({}, {}))

    step()
    engine.stop(["picker_01"])
    assert step().doing["picker_01"] == "stopped"
    engine.reset()
    assert step().doing["picker_01"] == "standing"


def test_of_bodies_in_the_way_the_nearest_is_named_first():
    world = world_of(
        ("picker", Pose(0.0, 0.0, EAST)),
        ("worker", Pose(2.1, 0.3, EAST)),
        ("worker", Pose(1.7, -0.3, EAST)),
    )
    assert with_names(world, "picker_01", AHEAD) == "worker_03, worker_02 ahead"


def test_a_run_that_goes_on_from_a_snapshot_is_still_stopped():
    local = Local(Scenario(rows=3))
    local.engine.stop(["picker_01"])
    resumed = Local.resume(unpack(pack(local.snapshot()), Snapshot))
    where = resumed.engine.world.pose[0].copy()
    played(resumed, 50)
    i = resumed.engine.world.index["picker_01"]
    assert resumed.engine.world.distance[i] == 0.0
    assert resumed.engine.world.distance[resumed.engine.world.index["picker_02"]] > 1.0
    assert (resumed.engine.world.pose[0] == where).all()


def test_a_stop_reset_before_the_next_step_changes_nothing():
    local = Local(Scenario(rows=3))
    for tick in range(HARVEST_TICKS):
        if tick % 100 == 7:
            local.engine.stop()
            local.engine.reset()
        local.tick()
    assert local.engine.hash == harvest_hash()


def ask(someone: Client, stop: bool, *names: str, **changes) -> Any:
    """Ask physics to stop robots, or to reset them. Return its answer."""
    (reply,) = someone.ask(
        "orchard/stop",
        msgpack.packb({"run": someone.run, "stop": stop, "names": list(names)} | changes),
    )
    return reply


def test_a_foreign_clients_velocity_moves_no_stopped_robot(fleet):
    fleet.physics(SMALL, "--absent", "picker_01", "--speed", "10")
    someone = fleet.client()
    poses = someone.hear("orchard/picker_01/pose")
    fleet.host("--without", "picker_01")
    pose = wait_for(poses, lambda pose: True)
    while pose["twist"]["linear"]["x"] == 0.0:
        someone.drive("picker_01", pose["tick"], 0.5)
        pose = wait_for(poses, lambda pose: True)
    answer = ask(someone, True, "picker_01")
    assert sorted(answer["changed"]) == sorted(answer["stopped"]) == ["bin_01", "picker_01"]
    stands = wait_for(poses, lambda pose: pose["tick"] == answer["tick"] + 1)
    for _ in range(30):
        someone.drive("picker_01", stands["tick"], 0.5)
        pose = wait_for(poses, lambda pose: True)
        assert pose["pose"] == stands["pose"]
    assert ask(someone, False)["stopped"] == []
    while pose["pose"] == stands["pose"]:
        someone.drive("picker_01", pose["tick"], 0.5)
        pose = wait_for(poses, lambda pose: True)
    fleet.stop()


def test_what_is_refused_is_answered_and_stops_no_robot(fleet):
    fleet.physics(SMALL, "--absent", "picker_01")
    someone = fleet.client()
    assert (
        ask(someone, True, "picker_01", "piker")
        == "no such robot: piker: no such agent or kind; there are bin, carrier, picker"
    )
    assert ask(someone, True, run="another").startswith("other run")
    assert ask(someone, "yes").startswith("malformed")
    assert someone.ask("orchard/stop", b"nonsense")[0].startswith("malformed")
    assert ask(someone, False) == {
        "run": fleet.run,
        "tick": 0,
        "changed": [],
        "stopped": [],
        "kept": False,
    }
    fleet.stop()


def test_the_latch_outlives_the_agent_and_its_host(fleet):
    fleet.physics(SMALL, "--speed", "10")
    someone = fleet.client()
    poses = someone.hear("orchard/picker_01/pose")
    velocities = someone.hear("orchard/picker_01/velocity")
    fleet.host("--without", "picker_01")
    killed = fleet.host("--only", "picker_01")
    old = wait_for(velocities, lambda velocity: velocity["linear"]["x"] > 0.0)["owner"]
    ask(someone, True, "picker_01")
    killed.signal(signal.SIGKILL)
    fleet.hosts.remove(killed)
    fleet.host("--only", "picker_01")
    wait_for(
        velocities, lambda velocity: velocity["owner"] != old and velocity["linear"]["x"] > 0.0
    )
    assert_stands(poses)
    ask(someone, False)
    assert_goes_on(poses)
    fleet.stop()


# Options that leave all robots without an agent.
NO_AGENTS = [word for name in agent_names(SMALL) for word in ("--absent", name)]


def kept_in(folder: Path) -> list[str]:
    """Return options by which a run without agents keeps snapshots in a folder.

    It keeps one every 1,000 s, and one for each stop: a stop is written before it is answered.
    """
    return [
        "--speed",
        "10",
        "--snapshots",
        str(folder / "snapshots"),
        "--snapshot-every",
        "1000",
        *NO_AGENTS,
    ]


def test_a_stop_that_was_taken_outlives_physics_killed_at_once(fleet, tmp_path):
    keep = kept_in(tmp_path)
    fleet.physics(SMALL, *keep)
    someone = fleet.client()
    wait_for(someone.hear("orchard/figures"), lambda figures: figures["tick"] > 0)
    told = ask(someone, True, "picker_01")
    assert told["kept"]
    fleet.world.kill()
    fleet.physics(SMALL, *keep, "--resume")
    someone = fleet.client()
    answer = ask(someone, False, "picker")
    assert answer["tick"] >= told["tick"]
    assert answer["changed"] == told["stopped"]
    fleet.stop()


def test_on_a_slow_disk_a_stop_is_answered_while_written(fleet, tmp_path):
    """The disk takes 20 s for a snapshot. The answer comes before, with `kept` false: if physics is
    killed now, the stop may be lost.
    """
    keep = kept_in(tmp_path)
    fleet.simulated_world.disk_seconds = 20.0
    fleet.physics(SMALL, *keep)
    someone = fleet.client()
    wait_for(someone.hear("orchard/figures"), lambda figures: figures["tick"] > 0)
    begun = fleet.scheduler.now
    told = ask(someone, True, "picker_01")
    assert fleet.scheduler.now - begun < 4.5, "sooner than the snapshot is written"
    assert sorted(told["stopped"]) == ["bin_01", "picker_01"]
    assert not told["kept"]
    answers = [ask(someone, True, "picker_01") for _ in range(20)]
    assert answers[-1]["kept"], "the same stop again, until the disk has it"
    assert all(
        answer["changed"] == [] and answer["stopped"] == told["stopped"] for answer in answers
    )
    fleet.world.kill()
    fleet.physics(SMALL, *keep, "--resume")
    assert ask(fleet.client(), False)["changed"] == told["stopped"]
    fleet.stop()


def test_a_stop_that_cannot_be_kept_is_answered_so(fleet, tmp_path):
    (tmp_path / "snapshots").write_text("a file where the folder should be")
    fleet.physics(SMALL, *kept_in(tmp_path))
    someone = fleet.client()
    wait_for(someone.hear("orchard/figures"), lambda figures: figures["tick"] > 0)
    answer = ask(someone, True, "picker_01")
    assert sorted(answer["stopped"]) == ["bin_01", "picker_01"]
    assert not answer["kept"]
    fleet.stop()
