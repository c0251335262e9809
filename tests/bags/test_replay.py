"""Runs that are driven by the velocities of a bag (`orchard replay`), and bags that cannot do so.

A velocity of a bag counts from the tick of its stamp on, in place of what the robot's agent wants.
`Commands` are the velocities of a bag: robot -> tick -> Twist.
"""

import json
import math
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from bag_recordings import TICKS, record
from command_line import orchard, scenario_file
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SMALL, local_hash, played

from orchard.bags.drives import read_drives
from orchard.bags.export import Bag, export
from orchard.bags.plain import messages, topics
from orchard.bags.replay import (
    KEPT_TICKS,
    SCENARIO,
    Commands,
    check_robots,
    read_commands,
    replayed,
)
from orchard.bags.velocities import BagVelocities
from orchard.behaviour.catalogue import make_agents
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.local import Local

LAYOUT = lay_out(SMALL)


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    """Return the bag of a run, with the velocities of all bodies. Each of them has an agent."""
    folder = tmp_path_factory.mktemp("bag")
    record(folder / "run.rrd")
    drives = read_drives(folder / "run.rrd")
    export(drives, drives.names, folder / "run.mcap", track=unseen)
    return folder / "run.mcap"


def unseen(ticks: Iterable[Any], count: int) -> Iterable[Any]:
    """Return the ticks of an export as they are: nobody watches its progress."""
    return ticks


def driven(commands: Commands, ticks: int = TICKS) -> Local:
    """Return a run that has followed the velocities of a bag for some ticks."""
    return played(Local(SMALL, replayed(make_agents(LAYOUT), commands)), ticks)


def written(path: Path, *rows: tuple[topics.Topic, str, int, messages.Message]) -> Path:
    """Write a bag of messages: topic, robot, tick and message of each."""
    with Bag(path) as bag:
        for topic, robot, tick, message in rows:
            bag.write(topic, robot, tick, message)
    return path


def test_a_bag_gives_the_hash_of_its_run_again(bag):
    commands = read_commands(bag)
    assert commands.scenario == SMALL
    assert commands.velocities.keys() == set(LAYOUT.names)
    assert driven(commands).engine.hash == local_hash(SMALL, TICKS)


def test_the_velocities_of_a_bag_count_not_the_agents(bag):
    """The agent would drive at 1 m/s."""
    # 0.25 m/s for 10 ticks of 0.1 s.
    in_the_bag = {tick: Twist(0.25) for tick in range(10, 20)}
    until_then = driven(Commands(None, {}), 10)
    with_the_bag = driven(Commands(None, {"picker_01": in_the_bag}), 20)
    picker = LAYOUT.index["picker_01"]
    before = until_then.engine.world.pose[picker, 0]
    after = with_the_bag.engine.world.pose[picker, 0]
    assert after - before == pytest.approx(10 * 0.025, abs=1e-9)


@pytest.mark.parametrize(
    ("tick", "is_driven"),
    [(9, False), (10, True), (10 + KEPT_TICKS - 1, True), (10 + KEPT_TICKS, False)],
)
def test_a_velocity_counts_for_half_a_second(tick, is_driven):
    """`KEPT_TICKS` ticks; then the agent drives again."""
    local = driven(Commands(None, {"picker_01": {10: Twist(0.25)}}), tick + 1)
    assert (local.engine.world.twist[LAYOUT.index["picker_01"], 0] == 0.25) == is_driven


def test_bags_of_other_software_are_read_too(tmp_path):
    """A Twist has no stamp, so the time of its message counts.

    A stamp between two ticks counts from the later one on.
    """
    path = written(
        tmp_path / "one.mcap",
        (topics.CMD_VEL_UNSTAMPED, "picker_01", 7, messages.twist(0.5, 0.0, 0.1)),
    )
    expected = Commands(None, {"picker_01": {7: Twist(0.5, 0.0, 0.1)}}, {"picker_01": [7]})
    assert read_commands(path) == expected
    late = messages.velocity("picker_01", 7, 0.5, 0.1)
    late.fields["header"].fields["stamp"].fields["nanosec"] += 1
    path = written(tmp_path / "two.mcap", (topics.CMD_VEL, "picker_01", 9, late))
    assert read_commands(path).velocities == {"picker_01": {8: Twist(0.5, 0.0, 0.1)}}


def test_a_stamp_of_zero_is_no_stamp(tmp_path):
    unset = messages.velocity("picker_01", 0, 0.5, 0.1)
    path = written(tmp_path / "one.mcap", (topics.CMD_VEL, "picker_01", 9, unset))
    assert read_commands(path).velocities == {"picker_01": {9: Twist(0.5, 0.0, 0.1)}}


def test_the_newest_stamp_counts_where_messages_changed_places(tmp_path):
    """Two velocities count from tick 7 on: one stamped at tick 7, and one stamped 1 ns before,
    which was recorded after it.
    """
    old = messages.velocity("picker_01", 7, 0.5, 0.0)
    old.fields["header"].fields["stamp"].fields["nanosec"] -= 1
    new = messages.velocity("picker_01", 7, 0.25, 0.0)
    path = written(
        tmp_path / "one.mcap",
        (topics.CMD_VEL, "picker_01", 8, new),
        (topics.CMD_VEL, "picker_01", 9, old),
    )
    commands = read_commands(path)
    assert commands.velocities == {"picker_01": {7: Twist(0.25)}}
    assert commands.ticks == {"picker_01": [7, 7]}


# The tick of a wall clock in November 2025: seconds since 1970 times ten.
TODAY = 17_642_900_000


def recorded_today(path: Path, kind: str, robots: tuple[str, ...] = ("picker_01",)) -> Path:
    """Write 20 velocities of each robot, recorded with ROS 2 and stamped by the wall clock."""
    rows = []
    for tick in range(TODAY, TODAY + 20):
        for robot in robots:
            if kind == "Twist":
                rows.append((topics.CMD_VEL_UNSTAMPED, robot, tick, messages.twist(0.25, 0.0, 0.0)))
            else:
                velocity = messages.velocity(robot, tick, 0.25, 0.0)
                rows.append((topics.CMD_VEL, robot, tick, velocity))
    return written(path, *rows)


@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
def test_a_bag_of_the_wall_clock_can_begin_at_its_first_stamp(tmp_path, kind):
    path = recorded_today(tmp_path / "run.mcap", kind)
    commands = read_commands(path, from_first_stamp=True)
    assert commands.ticks == {"picker_01": [*range(20)]}
    assert driven(commands, 20).engine.hash != local_hash(SMALL, 20)


def test_the_first_stamp_of_all_robots_is_the_beginning(tmp_path):
    """It becomes tick 0. A stamp 1 ns after 3 ticks later counts from the fourth tick on."""
    later = messages.velocity("picker_02", TODAY + 4, 0.25, 0.0)
    later.fields["header"].fields["stamp"].fields["nanosec"] += 1
    first = messages.velocity("picker_01", TODAY + 1, 0.25, 0.0)
    path = written(
        tmp_path / "run.mcap",
        (topics.CMD_VEL, "picker_02", TODAY + 4, later),
        (topics.CMD_VEL, "picker_01", TODAY + 1, first),
    )
    ticks = read_commands(path, from_first_stamp=True).ticks
    assert ticks == {"picker_01": [0], "picker_02": [4]}


REPLAY = ("--rows", 3, "--mode", "local", "--record", "none")


@pytest.mark.parametrize(
    ("kind", "duration", "ending"),
    [
        ("Twist", ("--duration", 20), "would end at 20.0 s"),
        ("TwistStamped", (), "would end with the harvest"),
    ],
)
def test_a_bag_without_a_velocity_in_the_run_is_refused(tmp_path, kind, duration, ending):
    path = recorded_today(tmp_path / "run.mcap", kind)
    done = orchard("replay", path, *REPLAY, *duration, code=2)
    assert done.stdout == ""
    assert (
        done.stderr == f"{path}: none of its 20 velocities falls within the run: "
        "the first is at 1764290000.0 s, the last at 1764290001.9 s; "
        f"the run begins at 0 s and {ending}; "
        "--from-first-stamp begins the run at the first velocity of the bag\n"
    )


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_a_replay_says_how_many_velocities_fell_within_it(tmp_path, mode):
    path = recorded_today(tmp_path / "run.mcap", "Twist", ("picker_02", "picker_01"))
    run = ("replay", path, scenario_file(tmp_path, SMALL), "--mode", mode, "--record", "none")
    done = orchard(*run, "--duration", "1.5", "--from-first-stamp")
    counts = "picker_01 15 of 20, picker_02 15 of 20"
    assert f"Velocities of {path} that fell within the run: {counts}.\n" in done.stdout
    # 1.5 s are 15 ticks.
    expected = driven(read_commands(path, from_first_stamp=True), 15).engine.hash
    assert done.stdout.endswith(f"hash {expected}\n")


def test_a_run_that_ends_before_the_first_velocity_has_failed():
    """The first velocity within a run is at tick 900. A run of 901 ticks has it, one of 900 not."""
    velocities = BagVelocities(Path("run.mcap"), {"picker_01": [900, 901], "picker_02": [-1]})
    # Before a run of unknown length this raises nothing.
    velocities.check(math.inf)
    assert [*velocities.troubles(901)] == []
    (trouble,) = velocities.troubles(900)
    assert "none of its 3 velocities falls within the run" in trouble
    assert "the run begins at 0 s and ended at 90.0 s" in trouble
    counts = "picker_01 1 of 2, picker_02 0 of 1"
    assert velocities.sentence(901) == (
        f"Velocities of run.mcap that fell within the run: {counts}."
    )


# Messages of a bag, as `written` takes them: one that drives picker_01, and one with no number.
MOVES = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, 1.0, 0.0))

NAN = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, math.nan, 0.0))


def scenario(text: str) -> tuple[topics.Topic, str, int, messages.Message]:
    """Return the message that brings a scenario."""
    return SCENARIO, "", 0, messages.text(text)


# The bytes or the messages of a bag, None without a bag; and words of the error.
UNUSABLE = [
    (b"notes", "one.mcap: it cannot be read as a bag"),
    (
        None,
        "one.mcap: no such file or folder; expected a bag of ROS 2: an .mcap file, or the folder",
    ),
    (
        [(topics.CLOCK, "", 1, messages.clock(1))],
        r"no velocity; expected the topic /NAME/cmd_vel .*; its topics are /clock \(ros",
    ),
    (
        [NAN],
        (
            r"/picker_01/cmd_vel, at 0.3 s: a velocity of \(nan, 0.0, 0.0\); expected numbers from"
            r" -100 to 100"
        ),
    ),
    (
        [scenario("rows: 3"), MOVES],
        r"the scenario in .*one.mcap: it cannot be read as JSON: JSON is malformed",
    ),
    (
        [scenario("[" * 100_000 + "]" * 100_000), MOVES],
        r"the scenario in .*one.mcap: it cannot be read as JSON: maximum recursion",
    ),
    (
        [scenario('{"rows": ' + "[" * 900 + "]" * 900 + "}"), MOVES],
        r"the scenario in .*one.mcap: rows = .*: must be a whole number",
    ),
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


@given(
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=4),
    st.floats(0.5, 1),
)
def test_a_damaged_bag_is_read_or_refused_in_words(tmp_path_factory, changes, kept):
    """`changes`: places in the file, as shares of it, and the bytes that are put there. `kept`: the
    share of the file that is not cut off.
    """
    path = written(tmp_path_factory.mktemp("bag") / "one.mcap", scenario('{"rows": 4}'), MOVES)
    damaged = bytearray(path.read_bytes())
    for place, byte in changes:
        damaged[int(place * len(damaged))] = byte
    path.write_bytes(damaged[: int(kept * len(damaged))])
    with suppress(ValueError, ScenarioError):
        read_commands(path)


def test_a_bag_that_drives_bodies_of_another_orchard_is_refused(tmp_path):
    with pytest.raises(
        ValueError,
        match="it drives rocket, not in this orchard: its robots are carrier_01, picker_01, ",
    ):
        check_robots(tmp_path, Commands(None, {"rocket": {}}), LAYOUT.index)


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("agents", {"picker": "nowhere.Mine"}, "picker"),
        *((key, "nowhere.Mine", key) for key in ("dispatch", "rows_to_pickers", "route")),
    ],
)
def test_code_named_in_a_bag_is_imported_only_if_asked(tmp_path, key, value, named):
    path = written(tmp_path / "one.mcap", scenario(json.dumps({"rows": 3, key: value})), MOVES)
    replay = ("replay", path, "--mode", "local", "--record", "none", "--duration", "1")
    refused = orchard(*replay, code=2)
    assert refused.stdout == ""
    assert refused.stderr == (
        f"{path}: its scenario names code, which can do whatever you can: {named}: nowhere.Mine;"
        " --own-code imports it, a SCENARIO.yaml replaces it\n"
    )

    # A class of an agent is imported in the run, any other one before it.
    imported = orchard(*replay, "--own-code", code=1 if key == "agents" else 2)
    assert "cannot be used: ModuleNotFoundError: No module named 'nowhere'" in imported.stderr
    if key == "dispatch":
        # A policy that the user names replaces that of the bag.
        orchard(*replay, "--dispatch", "nearest")


def test_a_replay_that_has_ended_cannot_go_on_without_its_bag(tmp_path):
    path = written(tmp_path / "run.mcap", MOVES)
    recording = tmp_path / "replayed.rrd"
    done = orchard(
        "replay", path, "--rows", 3, "--mode", "local", "--record", recording, "--duration", "1"
    )
    assert "To go on" not in done.stdout
    assert "no usable snapshot" in orchard("--resume", recording, "--mode", "local", code=2).stderr


def test_a_bag_of_another_orchard_is_refused_before_the_run(tmp_path):
    path = written(
        tmp_path / "run.mcap",
        (topics.CMD_VEL, "picker_09", 3, messages.velocity("picker_09", 3, 1.0, 0.0)),
    )
    done = orchard("replay", path, "--mode", "local", "--rows", 3, "--record", "none", code=2)
    assert done.stdout == ""
    assert done.stderr.startswith(
        f"{path}: it drives picker_09, not in this orchard: its robots are carrier_01, "
    )
    assert done.stderr.endswith(
        "; expected the orchard of the bag: its scenario, or --pickers and --carriers as there\n"
    )
