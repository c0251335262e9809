"""Bags of ROS 2 that `orchard export` writes from recordings: their bits, and what they lack."""

import math
import os
import sys

import numpy as np
import pytest
from bag_recordings import TICKS, record
from command_line import orchard
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SMALL
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

from orchard.bags.drives import RecordingError, ranges_of, read_drives
from orchard.bags.export import chosen, export
from orchard.bags.export_command import check_bag, export_bag, lacks
from orchard.commands.main import app
from orchard.field.kinds import KINDS, LASER_RANGE
from orchard.field.layout import lay_out
from orchard.view.recorder import SCAN_BEAMS, hits

# ns of a tick of 0.1 s.
NANOSECONDS = 10**8
ROBOTS = ["carrier_01", "picker_01", "picker_02"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return the file of a recorded run, and what `record` returns of it."""
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
    """Return the messages of the bag of `recorded`."""
    file = tmp_path_factory.mktemp("exported") / "run.mcap"
    assert export_bag(recorded[0], file, [], True) == 0
    return read(file)


def test_the_velocities_in_a_bag_have_the_bits_of_the_run(recorded, exported):
    """The odometry of a tick is measured at its end; the command that led to it is stamped with the
    tick before.
    """
    index = lay_out(SMALL).index
    for name in ROBOTS:
        body = index[name]
        odometry = dict(exported[f"/{name}/odom"])
        commands = dict(exported[f"/{name}/cmd_vel"])
        assert [*odometry] == [*range(TICKS + 1)]
        assert [*commands] == [*range(TICKS)]
        for tick, (poses, twists, wanted) in recorded[1].items():
            twist = odometry[tick].twist.twist
            assert (twist.linear.x, twist.linear.y, twist.angular.z) == tuple(twists[body])
            command = commands[tick - 1].twist
            assert (command.linear.x, command.linear.y, command.angular.z) == tuple(wanted[body])

            # Poses are recorded as float32.
            pose = odometry[tick].pose.pose
            assert pose.position.x == pytest.approx(poses[body, 0], abs=1e-5)
            assert pose.position.y == pytest.approx(poses[body, 1], abs=1e-5)
            yaw = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
            assert yaw == pytest.approx(poses[body, 2], abs=1e-6)


def test_a_bag_has_the_clock_the_frames_and_what_never_changes(exported):
    assert [tick for tick, _ in exported["/clock"]] == [*range(TICKS + 1)]
    for tick, message in exported["/tf"]:
        frames = [transform.child_frame_id for transform in message.transforms]
        assert frames == [f"{name}/base_link" for name in ROBOTS]
        for transform in message.transforms:
            stamp = transform.header.stamp
            assert stamp.sec * 10 + stamp.nanosec // NANOSECONDS == tick

    # What never changes is in one message of each topic.
    ((_, fixed),) = exported["/tf_static"]
    assert [transform.child_frame_id for transform in fixed.transforms] == [
        f"{name}/{frame}" for name in ROBOTS for frame in ("odom", "laser")
    ]
    ((_, map_),) = exported["/map"]
    assert len(map_.data) == map_.info.width * map_.info.height
    assert {f"/{name}/robot_description" for name in ROBOTS} <= exported.keys()


def test_the_scans_in_a_bag_are_those_of_the_recording(exported):
    """A recording has a scan of every fifth tick, and of that every SCAN_BEAMS-th beam."""
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
    """A recording keeps a scan as points, rounded to a grid of 1/32 m.

    From 2 m on neighbouring beams lie further apart than its cells, so each point has its own beam.
    180 is the number of beams of a picker's laser.
    """
    laser = KINDS["picker"].laser
    sweep = np.array(ranges, dtype=np.float32)
    points, _ = hits(sweep[None], laser, SCAN_BEAMS)
    kept = sweep[::SCAN_BEAMS]
    read_back = ranges_of(points[:, :2].astype(float), laser, SCAN_BEAMS)
    assert (np.isinf(read_back) == np.isinf(kept)).all()
    is_seen = np.isfinite(read_back)
    # m: a cell of the grid.
    assert np.abs(read_back[is_seen] - kept[is_seen]).max(initial=0.0) < 1 / 32


def test_the_robots_of_a_bag_are_chosen_by_name_or_kind(recorded):
    drives = read_drives(recorded[0])
    assert chosen(drives, []) == ROBOTS
    assert chosen(drives, ["bin", "worker_01"]) == ["bin_01", "bin_02", "bin_03", "worker_01"]
    with pytest.raises(ValueError, match="rocket"):
        chosen(drives, ["rocket"])


@pytest.mark.parametrize("rule", ["rows_to_pickers", "route"])
def test_code_named_in_a_recording_is_not_imported(recorded, tmp_path, monkeypatch, rule):
    scenario = SMALL.model_copy(update={rule: "nowhere.Mine"})
    monkeypatch.setattr("orchard.bags.drives._scenario_in", lambda *_: scenario)
    export(read_drives(recorded[0]), ROBOTS, tmp_path / "run.mcap", lambda ticks, _: ticks)
    assert rule in read(tmp_path / "run.mcap")["/orchard/scenario"][0][1].data


def test_a_gap_is_told_and_is_a_gap_in_the_bag(tmp_path):
    """Ticks 11 to 20 are in neither part of the recording."""
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
    """A recorder that is killed leaves a file whose end is missing."""
    whole = recorded[0].read_bytes()
    (tmp_path / "run.rrd").write_bytes(whole[: len(whole) * 3 // 4])
    assert export_bag(tmp_path / "run.rrd", tmp_path / "run.mcap", [], False) == 0
    poses = len(read(tmp_path / "run.mcap")["/picker_01/odom"])
    assert poses > 30, "three quarters of the file have more than 30 of the TICKS + 1 poses"
    end = (poses - 1) / 10
    assert (
        f"its end is torn off, and it is repaired; it ends at {end} s; the bag lacks that, too"
    ) in capfd.readouterr().err

    # An eighth of the file has too little to be read.
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


# A name for a bag, and why it cannot be used.
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
    # It takes the place of the progress bar, through which all ticks of an export pass.
    def broken(ticks, _):
        yield next(iter(ticks))
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        export(read_drives(recorded[0]), ROBOTS, tmp_path / "run.mcap", broken)
    assert [*tmp_path.iterdir()] == []


def test_the_command_writes_a_bag_and_says_what_is_in_it(recorded, tmp_path):
    """The clock, /tf and the odometry have 41 messages each, TICKS and the start; there are 40
    velocities; scenario, map, description and /tf_static are one each. Without --scans there are
    none: 167 in all.
    """
    done = orchard("export", recorded[0], "--mcap", tmp_path / "run.mcap", "--robots", "picker_01")
    assert done.stderr == ""
    assert "run.mcap: 167 messages of picker_01, 0.0 MB" in done.stdout
    assert len(read(tmp_path / "run.mcap")["/picker_01/odom"]) == TICKS + 1


def test_a_bag_without_the_packages_of_its_extra_is_told(recorded, tmp_path, monkeypatch, capsys):
    # Forget what is imported. A module that is None cannot be imported.
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
        latched = set()
        for connection in reader.connections:
            quality = connection.ext.offered_qos_profiles[0]
            if quality.durability is QosDurability.TRANSIENT_LOCAL:
                latched.add(connection.topic)
    assert latched == {"/map", "/orchard/scenario", "/tf_static", "/picker_01/robot_description"}
