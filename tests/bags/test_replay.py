"""A bag drives its robots again: to the same hash, and differently if its velocities are others."""

import json
import math
from contextlib import suppress
from pathlib import Path

import pytest
from command_line import orchard
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SMALL, local_hash, played
from orchard_ros2 import messages, topics
from test_export import TICKS, record

from orchard.agents.catalogue import make_agents
from orchard.bags.export import Bag, export
from orchard.bags.replay import KEPT_TICKS, SCENARIO, Commands, check_robots, read_commands, replayed
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
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
    return played(Local(SMALL, replayed(make_agents(LAYOUT), commands)), ticks)


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


MOVES = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, 1.0, 0.0))
NAN = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, math.nan, 0.0))


def scenario(text: str) -> tuple[topics.Topic, str, int, messages.Message]:
    return SCENARIO, "", 0, messages.text(text)


UNUSABLE = [
    (b"notes", "one.mcap: it cannot be read as a bag"),
    (None, "one.mcap: no such file or folder; expected a bag of ROS 2: an .mcap file, or the folder"),
    (
        [(topics.CLOCK, "", 1, messages.clock(1))],
        r"no velocity; expected the topic /NAME/cmd_vel .*; its topics are /clock \(ros",
    ),
    ([NAN], r"/picker_01/cmd_vel, tick 3: a velocity of \(nan, 0.0, 0.0\); expected numbers from -100 to 100"),
    ([scenario("rows: 3"), MOVES], r"the scenario in .*one.mcap: it cannot be read as JSON: JSON is malformed"),
    (
        [scenario("[" * 100_000 + "]" * 100_000), MOVES],
        r"the scenario in .*one.mcap: it cannot be read as JSON: maximum recursion",
    ),
    ([scenario('{"rows": ' + "[" * 900 + "]" * 900 + "}"), MOVES], r"the scenario in .*one.mcap: rows = .*: must be a whole number"),
]


@pytest.mark.parametrize(("content", "words"), UNUSABLE)
def test_bags_that_cannot_be_used_are_refused_in_words(tmp_path, content, words):
    path = tmp_path / "one.mcap"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content:
        written(path, *content)
    with pytest.raises((ValueError, ScenarioError), match=words):
        read_commands(path)


@given(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=4), st.floats(0.5, 1))
def test_a_damaged_bag_is_read_or_refused_in_words(tmp_path_factory, changes, kept):
    path = written(tmp_path_factory.mktemp("bag") / "one.mcap", scenario('{"rows": 4}'), MOVES)
    damaged = bytearray(path.read_bytes())
    for place, byte in changes:
        damaged[int(place * len(damaged))] = byte
    path.write_bytes(damaged[: int(kept * len(damaged))])
    with suppress(ValueError, ScenarioError):
        read_commands(path)


def test_a_bag_that_drives_bodies_of_another_orchard_is_refused(tmp_path):
    with pytest.raises(ValueError, match="it drives rocket, not in this orchard, whose robots are carrier_01, picker_01, "):
        check_robots(tmp_path, Commands(None, {"rocket": {}}), LAYOUT.index)


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [("agents", {"picker": "nowhere.Mine"}, "picker"), *((key, "nowhere.Mine", key) for key in ("dispatch", "rows_to_pickers", "route"))],
)
def test_code_that_the_scenario_in_a_bag_names_is_imported_only_if_the_user_asks(tmp_path, key, value, named):
    path = written(tmp_path / "one.mcap", scenario(json.dumps({"rows": 3, key: value})), MOVES)
    replay = ("replay", path, "--mode", "local", "--record", "none", "--duration", "1")
    refused, asked = orchard(*replay, code=2), orchard(*replay, "--own-code", code=1 if key == "agents" else 2)
    assert refused.stdout == ""
    wanted = f"{path}: its scenario names code, which can do whatever you can: {named}: nowhere.Mine; --own-code imports it"
    assert refused.stderr == f"{wanted}, a SCENARIO.yaml replaces it\n"
    assert "cannot be used: ModuleNotFoundError: No module named 'nowhere'" in asked.stderr
    if key == "dispatch":  # what the user names is the user's
        orchard(*replay, "--dispatch", "nearest")


def test_a_bag_of_another_orchard_is_refused_before_the_run(tmp_path):
    path = written(tmp_path / "run.mcap", (topics.CMD_VEL, "picker_09", 3, messages.velocity("picker_09", 3, 1.0, 0.0)))
    done = orchard("replay", path, "--mode", "local", "--rows", 3, "--record", "none", code=2)
    assert done.stdout == ""
    assert done.stderr.startswith(f"{path}: it drives picker_09, not in this orchard, whose robots are carrier_01, ")
    assert done.stderr.endswith("; expected the orchard of the bag: its scenario, or --pickers and --carriers as there\n")
