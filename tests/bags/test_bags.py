"""Bags of ROS 2: that of a recording has its bits and says what it lacks; a replay drives as the
bag says.
"""

import json
import math
import os
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from command_line import orchard, scenario_file
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SMALL, local_hash, played
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

from orchard.bags import drives
from orchard.bags.drives import RecordingError, ranges_of, read_drives
from orchard.bags.export import Bag, chosen, export
from orchard.bags.export_command import check_bag, export_bag, lacks
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
from orchard.commands.main import app
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, LASER_RANGE
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.local import Local
from orchard.sim.frames import FrameBuilder
from orchard.view.recorder import SCAN_BEAMS, Recorder, hits

TICKS = 40
NANOSECONDS = 10**8  # of a tick
ROBOTS = ["carrier_01", "picker_01", "picker_02"]


def record(file, ticks=range(1, TICKS + 1), gap=None):
    """Record some ticks of a run. Return pose, twist and wanted velocities of each tick.

    `gap`: the arguments of `Recorder.gap`, for a gap before them.
    """
    local = Local(SMALL)
    recorder = Recorder(lay_out(SMALL), "one", file)
    frames = FrameBuilder(local.engine)
    was = {}
    if gap is not None:
        recorder.gap(*gap)
    while local.engine.tick < max(ticks):
        events = local.tick()
        world = local.engine.world
        wanted = local.engine.lookahead.wanted
        if world.tick in ticks:
            recorder.tick(frames.frame(events))
            was[world.tick] = world.pose.copy(), world.twist.copy(), wanted.copy()
    assert recorder.close()
    return was


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("recorded") / "run.rrd"
    return file, record(file)


def read(file):
    """Return the messages of a bag by topic, each with its tick."""
    by_topic = {}
    with AnyReader([file]) as reader:
        for connection, stamp, data in reader.messages():
            tick, rest = divmod(stamp, NANOSECONDS)
            assert rest == 0
            message = reader.deserialize(data, connection.msgtype)
            by_topic.setdefault(connection.topic, []).append((tick, message))
    return by_topic


@pytest.fixture(scope="module")
def exported(recorded, tmp_path_factory):
    file = tmp_path_factory.mktemp("exported") / "run.mcap"
    assert export_bag(recorded[0], file, [], True) == 0
    return read(file)


def test_the_velocities_in_a_bag_have_the_bits_of_the_run(recorded, exported):
    index = lay_out(SMALL).index
    for name in ROBOTS:
        odometry = dict(exported[f"/{name}/odom"])
        commands = dict(exported[f"/{name}/cmd_vel"])
        assert [*odometry] == [*range(TICKS + 1)]
        assert [*commands] == [*range(TICKS)]
        for tick, (poses, twists, wanted) in recorded[1].items():
            twist = odometry[tick].twist.twist
            commanded = commands[tick - 1].twist
            assert (twist.linear.x, twist.linear.y, twist.angular.z) == tuple(twists[index[name]])
            velocity = (commanded.linear.x, commanded.linear.y, commanded.angular.z)
            assert velocity == tuple(wanted[index[name]])
            pose = odometry[tick].pose.pose
            assert (pose.position.x, pose.position.y) == pytest.approx(
                poses[index[name], :2], abs=1e-5
            )
            assert 2 * math.atan2(pose.orientation.z, pose.orientation.w) == pytest.approx(
                poses[index[name], 2], abs=1e-6
            )


def test_a_bag_has_the_clock_the_frames_and_what_never_changes(exported):
    assert [tick for tick, _ in exported["/clock"]] == [*range(TICKS + 1)]
    for tick, message in exported["/tf"]:
        frames = [transform.child_frame_id for transform in message.transforms]
        assert frames == [f"{name}/base_link" for name in ROBOTS]
        for transform in message.transforms:
            stamp = transform.header.stamp
            assert stamp.sec * 10 + stamp.nanosec // NANOSECONDS == tick
    ((_, fixed),) = exported["/tf_static"]
    assert [transform.child_frame_id for transform in fixed.transforms] == [
        f"{name}/{frame}" for name in ROBOTS for frame in ("odom", "laser")
    ]
    ((_, map_),) = exported["/map"]
    assert len(map_.data) == map_.info.width * map_.info.height
    assert {f"/{name}/robot_description" for name in ROBOTS} <= exported.keys()


def test_the_scans_in_a_bag_are_those_of_the_recording(exported):
    scans = exported["/picker_01/scan"]
    assert [tick for tick, _ in scans] == [*range(5, TICKS + 1, 5)]
    laser = KINDS["picker"].laser
    for _, scan in scans:
        assert len(scan.ranges) == laser.beams // SCAN_BEAMS
        assert scan.angle_increment == pytest.approx(laser.increment * SCAN_BEAMS)
        assert scan.angle_min == pytest.approx(laser.first)
        assert np.isfinite(scan.ranges).any()
        assert np.isinf(scan.ranges).any()


@given(
    st.lists(
        st.one_of(st.just(math.inf), st.floats(2.0, LASER_RANGE - 0.1)), min_size=180, max_size=180
    )
)
def test_ranges_come_back_from_the_points_of_a_recording(ranges):
    """Points are rounded to a grid. From 2 m on the beams lie further apart than its cells."""
    laser = KINDS["picker"].laser
    sweep = np.array(ranges, dtype=np.float32)
    points, _ = hits(sweep[None], laser, SCAN_BEAMS)
    found = ranges_of(points[:, :2].astype(float), laser, SCAN_BEAMS)
    assert (np.isinf(found) == np.isinf(sweep[::SCAN_BEAMS])).all()
    seen = np.isfinite(found)
    assert np.abs(found[seen] - sweep[::SCAN_BEAMS][seen]).max(initial=0.0) < 1 / 32


def test_the_robots_of_a_bag_are_chosen_by_name_or_kind(recorded):
    drives = read_drives(recorded[0])
    assert chosen(drives, []) == ROBOTS
    assert chosen(drives, ["bin", "worker_01"]) == ["bin_01", "bin_02", "bin_03", "worker_01"]
    with pytest.raises(ValueError, match="rocket"):
        chosen(drives, ["rocket"])


@pytest.mark.parametrize("rule", ["rows_to_pickers", "route"])
def test_code_named_in_a_recording_is_not_imported(recorded, tmp_path, monkeypatch, rule):
    monkeypatch.setattr(
        drives, "_scenario_in", lambda *_: SMALL.model_copy(update={rule: "nowhere.Mine"})
    )
    export(read_drives(recorded[0]), ROBOTS, tmp_path / "run.mcap", lambda ticks, _: ticks)
    assert rule in read(tmp_path / "run.mcap")["/orchard/scenario"][0][1].data


def test_a_gap_is_told_and_is_a_gap_in_the_bag(tmp_path):
    record(tmp_path / "run.rrd", range(1, 11))
    record(tmp_path / "run.part2.rrd", range(21, 31), (10, 21, "the logger was away"))
    drives = read_drives(tmp_path / "run.rrd")
    assert lacks(drives) == ["nothing recorded from 1.0 s to 2.1 s; the bag lacks that, too"]
    export(drives, ROBOTS, tmp_path / "run.mcap", lambda ticks, _: ticks)
    assert [tick for tick, _ in read(tmp_path / "run.mcap")["/picker_01/odom"]] == [
        *range(11),
        *range(21, 31),
    ]


def test_a_torn_recording_gives_the_bag_of_what_is_left(recorded, tmp_path, capfd):
    whole = recorded[0].read_bytes()
    (tmp_path / "run.rrd").write_bytes(whole[: len(whole) * 3 // 4])
    assert export_bag(tmp_path / "run.rrd", tmp_path / "run.mcap", [], False) == 0
    ticks = len(read(tmp_path / "run.mcap")["/picker_01/odom"])
    assert ticks > 30
    assert (
        f"its end is torn off, and it is repaired; it ends at {(ticks - 1) / 10} s; the bag lacks"
        " that, too" in capfd.readouterr().err
    )
    (tmp_path / "run.rrd").write_bytes(whole[: len(whole) // 8])
    with pytest.raises(RecordingError, match=r"run.rrd: it has no|run.rrd: it cannot"):
        read_drives(tmp_path / "run.rrd")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"RRF2 and nothing more", "it cannot be read"),
        (b"no recording", "it cannot be read"),
        (None, "no such recording"),
    ],
)
def test_what_is_no_recording_is_told(tmp_path, content, words):
    if content is not None:
        (tmp_path / "run.rrd").write_bytes(content)
    with pytest.raises(RecordingError, match=f"run.rrd: {words}"):
        read_drives(tmp_path / "run.rrd")


NO_PLACES = [
    ("notes.mcap", r"notes.mcap: this is no bag, and is not replaced; expected another name"),
    ("run.bag", r"run.bag: expected a name that ends in .mcap, as .*run.mcap"),
    ("nowhere/run.mcap", "nowhere is no directory"),
    ("pipe.mcap", "pipe.mcap: this is no bag, and is not replaced"),
]


@pytest.mark.parametrize(("name", "words"), NO_PLACES)
def test_files_that_a_bag_must_not_replace_are_told(tmp_path, name, words):
    (tmp_path / "notes.mcap").write_text("notes")
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises((ValueError, OSError), match=words):
        check_bag(tmp_path / name)


def test_a_bag_that_ends_with_an_error_leaves_no_file(recorded, tmp_path):
    def broken(ticks, _):
        yield next(iter(ticks))
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        export(read_drives(recorded[0]), ROBOTS, tmp_path / "run.mcap", broken)
    assert [*tmp_path.iterdir()] == []


def test_the_command_writes_a_bag_and_says_what_is_in_it(recorded, tmp_path):
    done = orchard("export", recorded[0], "--mcap", tmp_path / "run.mcap", "--robots", "picker_01")
    assert done.stderr == ""
    assert "run.mcap: 167 messages of picker_01, 0.0 MB" in done.stdout
    assert len(read(tmp_path / "run.mcap")["/picker_01/odom"]) == TICKS + 1


def test_a_bag_without_the_packages_of_its_extra_is_told(recorded, tmp_path, monkeypatch, capsys):
    for name in list(sys.modules):
        if name.startswith(("rosbags", "orchard.bags", "orchard.launch.replayed")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(SystemExit) as end:
        app(["export", str(recorded[0]), "--mcap", str(tmp_path / "run.mcap")])
    assert end.value.code == 2
    assert "pip install 'orchard-sim[ros2-export]'" in capsys.readouterr().err


def test_the_quality_of_service_is_in_the_bag(recorded, tmp_path):
    export(read_drives(recorded[0]), ["picker_01"], tmp_path / "run.mcap", lambda ticks, _: ticks)
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        latched = {
            c.topic
            for c in reader.connections
            if c.ext.offered_qos_profiles[0].durability is QosDurability.TRANSIENT_LOCAL
        }
    assert latched == {"/map", "/orchard/scenario", "/tf_static", "/picker_01/robot_description"}


LAYOUT = lay_out(SMALL)


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    record(folder / "run.rrd")
    drives = read_drives(folder / "run.rrd")
    export(
        drives,
        [name for name in drives.names if name in LAYOUT.agents],
        folder / "run.mcap",
        lambda ticks, _: ticks,
    )
    return folder / "run.mcap"


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


TODAY = 17_642_900_000  # the tick of a wall clock: seconds since 1970 times ten


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
    expected = driven(read_commands(path, from_first_stamp=True), 15).engine.hash
    assert done.stdout.endswith(f"hash {expected}\n")


def test_a_run_that_ends_before_the_first_velocity_has_failed():
    velocities = BagVelocities(Path("run.mcap"), {"picker_01": [900, 901], "picker_02": [-1]})
    velocities.check(math.inf)
    assert [*velocities.troubles(901)] == []
    (trouble,) = velocities.troubles(900)
    assert "none of its 3 velocities falls within the run" in trouble
    assert "the run begins at 0 s and ended at 90.0 s" in trouble
    counts = "picker_01 1 of 2, picker_02 0 of 1"
    told = f"Velocities of run.mcap that fell within the run: {counts}."
    assert velocities.sentence(901) == told


MOVES = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, 1.0, 0.0))
NAN = (topics.CMD_VEL, "picker_01", 3, messages.velocity("picker_01", 3, math.nan, 0.0))


def scenario(text: str) -> tuple[topics.Topic, str, int, messages.Message]:
    """Return the message that brings a scenario."""
    return SCENARIO, "", 0, messages.text(text)


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
    asked = orchard(*replay, "--own-code", code=1 if key == "agents" else 2)
    assert refused.stdout == ""
    wanted = (
        f"{path}: its scenario names code, which can do whatever you can: {named}: nowhere.Mine;"
        " --own-code imports it"
    )
    assert refused.stderr == f"{wanted}, a SCENARIO.yaml replaces it\n"
    assert "cannot be used: ModuleNotFoundError: No module named 'nowhere'" in asked.stderr
    if key == "dispatch":
        # A policy that the user names replaces that of the bag.
        orchard(*replay, "--dispatch", "nearest")


def test_a_replay_that_has_ended_cannot_go_on_without_its_bag(tmp_path):
    path = written(tmp_path / "run.mcap", MOVES)
    record = tmp_path / "replayed.rrd"
    done = orchard(
        "replay", path, "--rows", 3, "--mode", "local", "--record", record, "--duration", "1"
    )
    assert "To go on" not in done.stdout
    assert "no usable snapshot" in orchard("--resume", record, "--mode", "local", code=2).stderr


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
