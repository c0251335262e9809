"""A bag drives its robots again: to the same hash, and differently if its velocities are others."""

import math
from pathlib import Path

import pytest
from command_line import orchard
from local_runs import SMALL, local_hash
from orchard_ros2 import messages, topics
from test_export import TICKS, record

from orchard.agents.catalogue import make_agents
from orchard.bags.bag import Bag
from orchard.bags.export import export
from orchard.bags.replay import KEPT_TICKS, Commands, check_robots, read_commands, replayed
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.local import Local
from orchard.view.drives import read_drives

LAYOUT = lay_out(SMALL)


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    record(folder / "run.rrd")
    drives = read_drives(folder / "run.rrd")
    export(drives, [name for name in drives.names if name in LAYOUT.agents], folder / "run.mcap", lambda ticks, _: ticks)
    return folder / "run.mcap"


def driven(commands: Commands, ticks: int = TICKS) -> Local:
    local = Local(SMALL, replayed(make_agents(LAYOUT), commands))
    for _ in range(ticks):
        local.tick()
    return local


def written(path: Path, *told: tuple[topics.Topic, str, int, messages.Message]) -> Path:
    with Bag(path) as bag:
        for topic, robot, tick, message in told:
            bag.write(topic, robot, tick, message)
    return path


def test_a_bag_gives_the_hash_of_its_run_again(bag):
    commands = read_commands(bag)
    assert commands.scenario == SMALL
    assert commands.velocities.keys() == set(LAYOUT.names)
    assert driven(commands).engine.hash == local_hash(SMALL, TICKS)


def test_the_velocities_of_a_bag_count_and_not_those_of_the_agent(bag):
    known = {tick: Twist(0.25) for tick in range(10, 20)}
    local = driven(Commands(None, {"picker_01": known}), 20)
    others = driven(Commands(None, {}), 10)
    before, after = (one.engine.world.pose[LAYOUT.index["picker_01"], 0] for one in (others, local))
    assert after - before == pytest.approx(10 * 0.025, abs=1e-9)


@pytest.mark.parametrize(("tick", "is_driven"), [(9, False), (10, True), (10 + KEPT_TICKS - 1, True), (10 + KEPT_TICKS, False)])
def test_a_velocity_counts_for_half_a_second(tick, is_driven):
    local = driven(Commands(None, {"picker_01": {10: Twist(0.25)}}), tick + 1)
    assert (local.engine.world.twist[LAYOUT.index["picker_01"], 0] == 0.25) == is_driven


def test_bags_of_other_software_are_read_too(tmp_path):
    """A Twist has no stamp: the message's time counts. What is between two ticks counts from the later one on."""
    path = written(tmp_path / "one.mcap", (topics.CMD_VEL_UNSTAMPED, "picker_01", 7, messages.twist(0.5, 0.0, 0.1)))
    assert read_commands(path) == Commands(None, {"picker_01": {7: Twist(0.5, 0.0, 0.1)}})
    late = messages.velocity("picker_01", 7, 0.5, 0.1)
    late.fields["header"].fields["stamp"].fields["nanosec"] += 1
    path = written(tmp_path / "two.mcap", (topics.CMD_VEL, "picker_01", 9, late))
    assert read_commands(path).velocities == {"picker_01": {8: Twist(0.5, 0.0, 0.1)}}


def test_bags_that_cannot_be_used_are_told(tmp_path):
    (tmp_path / "notes.mcap").write_text("notes")
    with pytest.raises(ValueError, match=r"notes.mcap: it cannot be read as a bag"):
        read_commands(tmp_path / "notes.mcap")
    with pytest.raises(ValueError, match=r"none.mcap: no such file or folder; expected a bag of ROS 2: an .mcap file, or the folder"):
        read_commands(tmp_path / "none.mcap")
    path = written(tmp_path / "clock.mcap", (topics.CLOCK, "", 1, messages.clock(1)))
    with pytest.raises(ValueError, match=r"it has no velocity; expected the topic /NAME/cmd_vel .*; its topics are /clock \(rosgraph_"):
        read_commands(path)
    path = written(tmp_path / "nan.mcap", (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, math.nan, 0.0)))
    with pytest.raises(ValueError, match=r"/picker_01/cmd_vel, tick 3: a velocity of \(nan, 0.0, 0.0\); expected numbers from -100 to 100"):
        read_commands(path)
    with pytest.raises(ValueError, match="it drives rocket, not in this orchard, whose robots are carrier_01, picker_01, "):
        check_robots(path, Commands(None, {"rocket": {}}), LAYOUT.index)


def test_a_bag_of_another_orchard_is_refused_before_the_run(tmp_path):
    path = written(tmp_path / "run.mcap", (topics.CMD_VEL, "picker_09", 3, messages.velocity("picker_09", 3, 1.0, 0.0)))
    done = orchard("replay", path, "--mode", "local", "--rows", 3, "--record", "none")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{path}: it drives picker_09, not in this orchard, whose robots are carrier_01, ")
    assert done.stderr.endswith("; expected the orchard of the bag: its scenario, or --pickers and --carriers as there\n")
