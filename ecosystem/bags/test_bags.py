"""A bag of a run, read by the readers of others: Foxglove's for ROS 2 messages in MCAP files, and
rosbags. Both must find the same.
"""

import math
import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

# The command `orchard`; `.ci/ecosystem` names that of the clone.
ORCHARD = shlex.split(os.environ.get("ORCHARD", "orchard"))
SECONDS = 300  # that a command may take
# The run of docs/ros2.md: its robots, and its ticks, of 0.1 s.
ROBOTS = ("carrier_01", "picker_01", "picker_02", "tractor_01")
TICKS = 600
TICK_NANOSECONDS = 10**8
SCAN_TICKS = 5  # from a recorded scan to the next one
PAGE = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text()
# The blocks of code of the page, by their names.
BLOCKS = dict(re.findall(r"^```(?:python|sh) (\S+)\n(.*?)^```$", PAGE, re.M | re.S))


def orchard(block: str, folder: Path) -> list[str]:
    """Do the commands of a block of the page, and return what each has printed."""
    printed = []
    for line in BLOCKS[block].splitlines():
        _, *words = shlex.split(line)
        done = subprocess.run(
            [*ORCHARD, *words], cwd=folder, capture_output=True, text=True, timeout=SECONDS
        )
        assert done.returncode == 0, done.stdout + done.stderr
        printed.append(done.stdout)
    return printed


def hash_in(printed: str) -> str:
    """Return the hash of a run."""
    return re.findall(r"^hash ([0-9a-f]{64})$", printed, re.M)[0]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bag that the page makes of a run, in a folder in which the run's hash is kept too."""
    folder = tmp_path_factory.mktemp("bag")
    recorded, _ = orchard("bag", folder)
    (folder / "hash").write_text(hash_in(recorded))
    return folder / "run.mcap"


def read_by_foxglove(bag: Path) -> dict[str, list]:
    """Return the messages of each topic, in order: (time in ns, message)."""
    by_topic: dict[str, list] = {}
    with bag.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            by_topic.setdefault(channel.topic, []).append((message.log_time, decoded))
    return by_topic


def read_by_rosbags(bag: Path) -> dict[str, list]:
    """Return the messages of each topic, in order: (time in ns, message)."""
    by_topic: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            by_topic.setdefault(connection.topic, []).append((stamp, message))
    return by_topic


def values_in(message: object) -> tuple:
    """Return all that is in an odometry. The messages of two readers are of different types."""
    pose = message.pose.pose
    twist = message.twist.twist
    return (
        pose.position.x,
        pose.position.y,
        pose.orientation.z,
        pose.orientation.w,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
        message.header.frame_id,
        message.child_frame_id,
    )


def place_of(message: object) -> tuple[float, float]:
    """Return x and y of an odometry, m."""
    position = message.pose.pose.position
    return position.x, position.y


def test_the_program_of_the_page_reads_the_bag(bag: Path) -> None:
    program = [sys.executable, "-W", "error", "-c", BLOCKS["bag-reader"]]
    done = subprocess.run(program, cwd=bag.parent, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    # It prints the time of the last message, in s, and what is in it.
    assert done.stdout.startswith(f"{TICKS / 10} ")


def test_a_bag_drives_its_robots_to_the_same_hash_in_lockstep(bag: Path) -> None:
    (printed,) = orchard("bag-replay", bag.parent)
    assert hash_in(printed) == (bag.parent / "hash").read_text()


def test_both_readers_find_the_same(bag: Path) -> None:
    """They find as many messages on the same topics, and the same odometry."""
    foxglove = read_by_foxglove(bag)
    rosbags = read_by_rosbags(bag)
    assert foxglove.keys() == rosbags.keys()
    for topic, messages in foxglove.items():
        assert len(messages) == len(rosbags[topic]), topic
    for name in ROBOTS:
        topic = f"/{name}/odom"
        for (time, message), (other_time, other) in zip(
            foxglove[topic], rosbags[topic], strict=True
        ):
            assert (time, values_in(message)) == (other_time, values_in(other))


def test_a_robot_is_where_its_velocities_lead_it(bag: Path) -> None:
    """From the message alone, as a stranger reads it: the pose moves by the velocity in the
    message, in its own frame.
    """
    by_topic = read_by_foxglove(bag)
    times = [time for time, _ in by_topic["/clock"]]
    assert times == [tick * TICK_NANOSECONDS for tick in range(TICKS + 1)]
    for name in ROBOTS:
        odometry = [message for _, message in by_topic[f"/{name}/odom"]]
        assert len(odometry) == TICKS + 1
        for before, after in pairwise(odometry):
            step = math.dist(place_of(before), place_of(after))
            # A step takes 0.1 s. Recorded poses are float32.
            speed = abs(after.twist.twist.linear.x)
            assert step == pytest.approx(speed * 0.1, abs=1e-3)
        assert len(by_topic[f"/{name}/cmd_vel"]) == TICKS
        assert len(by_topic[f"/{name}/scan"]) == TICKS // SCAN_TICKS
    velocities = [message.twist for _, message in by_topic["/picker_01/cmd_vel"]]
    assert any(velocity.linear.x > 0.0 for velocity in velocities), "the picker drives"


def test_a_bag_is_compressed(bag: Path) -> None:
    with bag.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {"zstd"}
