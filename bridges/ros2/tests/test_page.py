"""docs/ros2.md tells the truth: its commands and its node run, its table of topics is the bridge's,
and mistakes are told in words.
"""

import ast
import os
import re
import shutil
import subprocess
import sys

import pytest
import yaml
from conftest import (
    BEGIN_SECONDS,
    FOLDER,
    PAGE,
    block,
    bridging,
    free_port,
    scene,
    started,
    wait_until_it_says,
)
from nav_msgs.msg import Odometry
from orchard_ros2.plain import topics
from orchard_ros2.plain.topics import Topic


def test_the_commands_and_the_node_drive_the_robot(tmp_path):
    orchard_command, bridge_command = block("ros2 run").splitlines()
    # The scene chooses a free port: the page's endpoint goes from both commands. It is the last
    # option of the first and one of the parameters, `-p NAME:=VALUE`, of the second.
    orchard_words = orchard_command.split("--listen")[0].split()
    bridge_words = bridge_command.split()
    assert orchard_words.pop(0) == "orchard"
    assert bridge_words[:2] == ["orchard-ros2", "--ros-args"]
    parameters = []
    for option, value in zip(bridge_words[2::2], bridge_words[3::2], strict=True):
        if "endpoint" not in value:
            parameters += [option, value]
    with (
        scene(tmp_path, [*orchard_words, "--rows", "3"], parameters) as run,
        started([sys.executable, "-c", block("ros2 node")], tmp_path / "node.log"),
    ):
        odom = run.user.hear("picker_01/odom", Odometry, 10)
        run.user.until(lambda: odom, BEGIN_SECONDS)
        run.user.until(lambda: odom[-1].twist.twist.linear.x == 0.5)
    assert "m ahead" in (tmp_path / "node.log").read_text()


def test_the_package_installs_command_launch_file_and_picture(tmp_path):
    """The command of the page's block `ros2 install` installs them, here into a folder."""
    (command,) = [line for line in block("ros2 install").splitlines() if "pip install" in line]
    shutil.copytree(FOLDER, tmp_path / "bridges" / "ros2")
    words = [
        os.environ["ORCHARD_PYTHON"],
        "-m",
        "pip",
        *command.split()[1:],
        "--no-deps",
        "--target",
        "there",
        "--quiet",
    ]
    subprocess.run(words, cwd=tmp_path, check=True, timeout=120)
    share = tmp_path / "there" / "share" / "orchard_ros2"
    assert (tmp_path / "there" / "bin" / "orchard-ros2").exists()
    assert (share / "launch" / "orchard.launch.py").exists()
    assert (share / "rviz" / "orchard.rviz").exists()


def test_the_launch_file_gives_parameters_that_the_bridge_takes(tmp_path):
    """The launch file's defaults are the page's, and the bridge begins with them.

    `launch` has no wheel, so the file is read and not run.
    """
    text = (FOLDER / "launch" / "orchard.launch.py").read_text()
    constants = {
        node.targets[0].id: node.value
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign)
    }
    arguments = ast.literal_eval(constants["ARGUMENTS"])
    defaults = {name: default for name, (default, _) in arguments.items()}
    # The page's table of parameters: | `name` | `default` |
    on_the_page = dict(re.findall(r"^\| `(\w+)` \| `?(.+?)`? \|", PAGE, re.M))
    for name, default in defaults.items():
        meaning = default
        if default in ("''", "['']"):  # empty
            meaning = "all robots" if name == "robots" else "none"
        assert on_the_page[name] == meaning
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = []
    for name, value in (defaults | {"endpoint": endpoint}).items():
        words += ["-p", f"{name}:={value}"]
    log = tmp_path / "bridge.log"
    with bridging(endpoint, words, log) as bridge:
        wait_until_it_says(f"nothing answers at {endpoint}", log, bridge)


def row_words(topic):
    """How the page's table names a topic, its type and its quality of service."""
    qualities = {
        topics.SENSOR_DATA: "sensor data: best effort, 5",
        topics.LATCHED: "transient local, 1",
    }
    return (
        topic.of("NAME"),
        topic.type.replace("/msg/", "/"),
        qualities.get(topic.qos, f"reliable, {topic.qos.depth}"),
    )


@pytest.mark.parametrize(
    "topic",
    [topic for topic in vars(topics).values() if isinstance(topic, Topic)],
    ids=lambda topic: topic.name,
)
def test_each_topic_is_on_the_page(topic):
    name, kind, quality = row_words(topic)
    (row,) = [line for line in PAGE.splitlines() if line.startswith("| `") and f"`{name}`" in line]
    assert kind.split("/")[-1] in row
    assert quality in row


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ("endpoint:=nonsense", "must be as tcp/127.0.0.1:7447"),
        ("driven:=picker_01", "a list of robots is as [picker_01, carrier]"),
    ],
)
def test_a_wrong_parameter_is_told_in_words(parameter, words):
    done = subprocess.run(
        [sys.executable, "-m", "orchard_ros2", "--ros-args", "-p", parameter],
        cwd=FOLDER,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr


def test_a_robot_that_the_run_does_not_have_is_told_in_words(tmp_path):
    with scene(
        tmp_path,
        ["--rows", "3", "--mode", "realtime", "--duration", "100"],
        ["-p", "robots:=[picker_77]"],
    ) as run:
        assert run.bridge.wait(BEGIN_SECONDS) == 2
    text = (tmp_path / "bridge.log").read_text()
    assert "picker_77: no such body or kind; there are bin_01" in text and "Traceback" not in text


def test_the_bridge_waits_for_a_run_and_ends_when_it_is_told_to(tmp_path):
    words = [
        sys.executable,
        "-m",
        "orchard_ros2",
        "--ros-args",
        "-p",
        f"endpoint:=tcp/127.0.0.1:{free_port()}",
    ]
    log = tmp_path / "bridge.log"
    with started(words, log, cwd=FOLDER, env=os.environ) as bridge:
        wait_until_it_says("waiting for a run: nothing answers at", log, bridge)
        bridge.terminate()
        assert bridge.wait(20) == 0
    assert "Traceback" not in log.read_text()


def test_rviz_shows_topics_that_are_there():
    """RViz itself is not here: its file is YAML, and names topics and frames of the bridge."""
    config = yaml.safe_load((FOLDER / "rviz" / "orchard.rviz").read_text())["Visualization Manager"]
    # A display names the topics that it shows in the fields that are tables.
    shown = {}
    for display in config["Displays"]:
        for value in display.values():
            if isinstance(value, dict):
                shown[value["Value"]] = value
    known = {
        "/" + topic.of("picker_01").lstrip("/"): topic
        for topic in vars(topics).values()
        if isinstance(topic, Topic)
    }
    assert set(shown) <= set(known)
    assert config["Global Options"]["Fixed Frame"] == topics.MAP
    for name, value in shown.items():
        quality = known[name].qos
        reliability = "Reliable" if quality.reliable else "Best Effort"
        durability = "Transient Local" if quality.latched else "Volatile"
        assert value["Reliability Policy"] == reliability
        assert value["Durability Policy"] == durability
