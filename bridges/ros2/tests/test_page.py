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
    orchard, bridge = (line.split() for line in block("ros2 run").splitlines())
    del orchard[orchard.index("--listen") :]  # the scene chooses a free port
    assert orchard.pop(0) == "orchard" and bridge[:2] == ["orchard-ros2", "--ros-args"]
    others = [
        word
        for pair in zip(bridge[2::2], bridge[3::2], strict=True)
        if "endpoint" not in pair[1]
        for word in pair
    ]
    with (
        scene(tmp_path, [*orchard, "--rows", "3"], others) as run,
        started([sys.executable, "-c", block("ros2 node")], tmp_path / "node.log"),
    ):
        odom = run.user.hear("picker_01/odom", Odometry, 10)
        run.user.until(lambda: odom, BEGIN_SECONDS)
        run.user.until(lambda: odom[-1].twist.twist.linear.x == 0.5)
    assert "m ahead" in (tmp_path / "node.log").read_text()


def test_the_package_installs_command_launch_file_and_picture(tmp_path):
    """The package is installed with its command its launch file and its picture.

    As in the block `install`, but without the environment.
    """
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
    assert (share / "launch" / "orchard.launch.py").exists() and (
        share / "rviz" / "orchard.rviz"
    ).exists()


def test_the_launch_file_gives_parameters_that_the_bridge_takes(tmp_path):
    """The launch file gives the bridge parameters that it takes.

    `launch` has no wheel, so the file is read and not run: the bridge is started with its
    defaults, as the file writes them.
    """
    text = (FOLDER / "launch" / "orchard.launch.py").read_text()
    values = {
        node.targets[0].id: node.value
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign)
    }
    given = {name: value for name, (value, _) in ast.literal_eval(values["ARGUMENTS"]).items()}
    rows = dict(re.findall(r"^\| `(\w+)` \| `?(.+?)`? \|", PAGE, re.M))
    empty = {"robots": "all robots"}  # what an empty value stands for, where that is not none
    expected = {
        name: value if value not in ("''", "['']") else empty.get(name, "none")
        for name, value in given.items()
    }
    assert expected == {name: rows[name] for name in given}
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = [
        word
        for name, value in (given | {"endpoint": endpoint}).items()
        for word in ("-p", f"{name}:={value}")
    ]
    log = tmp_path / "bridge.log"
    with bridging(endpoint, words, log) as bridge:
        wait_until_it_says(f"nothing answers at {endpoint}", log, bridge)


def told(topic):
    """How the page's table names a topic and its quality of service."""
    reliability = {
        topics.SENSOR_DATA: "sensor data: best effort, 5",
        topics.LATCHED: "transient local, 1",
    }
    return (
        topic.of("NAME"),
        topic.type.replace("/msg/", "/"),
        reliability.get(topic.qos, f"reliable, {topic.qos.depth}"),
    )


@pytest.mark.parametrize(
    "topic",
    [topic for topic in vars(topics).values() if isinstance(topic, Topic)],
    ids=lambda topic: topic.name,
)
def test_each_topic_is_on_the_page(topic):
    name, kind, qos = told(topic)
    (row,) = [line for line in PAGE.splitlines() if line.startswith("| `") and f"`{name}`" in line]
    assert kind.split("/")[-1] in row and qos in row


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
    shown = {
        value["Value"]: value
        for display in config["Displays"]
        for value in display.values()
        if isinstance(value, dict)
    }
    known = {
        "/" + topic.of("picker_01").lstrip("/"): topic
        for topic in vars(topics).values()
        if isinstance(topic, Topic)
    }
    assert set(shown) <= set(known) and config["Global Options"]["Fixed Frame"] == topics.MAP
    for name, value in shown.items():
        assert value["Reliability Policy"] == (
            "Reliable" if known[name].qos.reliable else "Best Effort"
        )
        assert value["Durability Policy"] == (
            "Transient Local" if known[name].qos.latched else "Volatile"
        )
