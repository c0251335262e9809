"""A bag of a run, read by the readers of others: Foxglove's for ROS 2 messages in MCAP files, and
rosbags. Both must find the same.
"""

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

ORCHARD = shlex.split(os.environ.get("ORCHARD", "orchard"))
SECONDS = 300
ROBOTS = ("carrier_01", "picker_01", "picker_02", "tractor_01")
TICKS = 600  # of the run of docs/ros2.md
PAGE = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text()
BLOCKS = {
    name: text
    for name, text in re.findall(r"^```(?:python|sh) (\S+)\n(.*?)^```$", PAGE, re.M | re.S)
}


def orchard(block: str, folder: Path) -> list[str]:
    """What the commands of a block of the page print."""
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
    return re.findall(r"^hash ([0-9a-f]{64})$", printed, re.M)[0]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    recorded, _ = orchard("bag", folder)
    (folder / "hash").write_text(hash_in(recorded))
    return folder / "run.mcap"


def read_by_foxglove(bag: Path) -> dict[str, list]:
    """Topic -> [(nanoseconds, message)]."""
    found: dict[str, list] = {}
    with bag.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def read_by_rosbags(bag: Path) -> dict[str, list]:
    """Topic -> [(nanoseconds, message)]."""
    found: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            found.setdefault(connection.topic, []).append(
                (stamp, reader.deserialize(data, connection.msgtype))
            )
    return found


def numbers(message: object) -> tuple:
    """All that is in an odometry."""
    pose, twist = message.pose.pose, message.twist.twist
    place = (pose.position.x, pose.position.y, pose.orientation.z, pose.orientation.w)
    return (
        *place,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
        message.header.frame_id,
        message.child_frame_id,
    )


def test_the_program_of_the_page_reads_the_bag(bag: Path) -> None:
    program = [sys.executable, "-W", "error", "-c", BLOCKS["bag-reader"]]
    done = subprocess.run(program, cwd=bag.parent, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{TICKS / 10} ")


def test_a_bag_drives_its_robots_to_the_same_hash_in_lockstep(bag: Path) -> None:
    (printed,) = orchard("bag-replay", bag.parent)
    assert hash_in(printed) == (bag.parent / "hash").read_text()


def test_both_readers_find_the_same(bag: Path) -> None:
    foxglove, rosbags = read_by_foxglove(bag), read_by_rosbags(bag)
    assert {topic: len(found) for topic, found in foxglove.items()} == {
        topic: len(found) for topic, found in rosbags.items()
    }
    for name in ROBOTS:
        one, other = foxglove[f"/{name}/odom"], rosbags[f"/{name}/odom"]
        assert [(time, numbers(message)) for time, message in one] == [
            (time, numbers(message)) for time, message in other
        ]


def test_a_robot_is_where_its_velocities_lead_it(bag: Path) -> None:
    """From the message alone, as a stranger reads it: the pose moves by the velocity in the
    message, in its own frame.
    """
    found = read_by_foxglove(bag)
    assert [time for time, _ in found["/clock"]] == [tick * 10**8 for tick in range(TICKS + 1)]
    for name in ROBOTS:
        poses = [(message.pose.pose, message.twist.twist) for _, message in found[f"/{name}/odom"]]
        assert len(poses) == TICKS + 1
        for (before, _), (after, twist) in pairwise(poses):
            step = (
                (after.position.x - before.position.x) ** 2
                + (after.position.y - before.position.y) ** 2
            ) ** 0.5
            assert step == pytest.approx(abs(twist.linear.x) * 0.1, abs=1e-3)
        assert len(found[f"/{name}/cmd_vel"]) == TICKS
        assert len(found[f"/{name}/scan"]) == TICKS // 5
    assert any(message.twist.linear.x > 0.0 for _, message in found["/picker_01/cmd_vel"])


def test_a_bag_is_compressed(bag: Path) -> None:
    with bag.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {"zstd"}
