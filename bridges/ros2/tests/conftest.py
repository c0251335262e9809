"""An orchard, a bridge, and a user of ROS 2: three processes, on loopback only.

The user is this one.
"""

import os
import re
import shlex
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

os.environ |= {
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

FOLDER = Path(__file__).parents[1]
PAGE = (FOLDER.parents[1] / "docs" / "ros2.md").read_text()
BEGIN_SECONDS = 150.0  # the first start of an orchard on a machine compiles


def block(name):
    """A block of the page that has a name."""
    (text,) = re.findall(rf"^```\w+ {name}\n(.*?)^```$", PAGE, re.M | re.S)
    return text


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@contextmanager
def started(words, log, **options):
    """A process that is ended by its id at the end."""
    with (
        open(log, "wb") as output,
        subprocess.Popen(words, stdout=output, stderr=subprocess.STDOUT, **options) as process,
    ):
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def wait_until_it_says(words, log, process, seconds=BEGIN_SECONDS):
    """Wait until a process has written some words to its log."""
    end = time.monotonic() + seconds
    while words not in (text := log.read_text()):
        assert process.poll() is None and time.monotonic() < end, text
        time.sleep(0.02)


class User:
    """A node of ROS 2 with what it has heard. Every wait has a limit."""

    def __init__(self, node, bridge, log):
        self.bridge, self.log = bridge, log
        self.node, self.executor, self.heard = node, SingleThreadedExecutor(), {}
        self.executor.add_node(node)

    def hear(self, topic, kind, qos):
        """Keep each message of a topic."""
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, qos)
        return self.heard[topic]

    def until(self, condition, seconds=20.0, needs_bridge=True):
        """Spin until a condition is true."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, f"not within {seconds} s"
            assert self.bridge.poll() is None or not needs_bridge, (
                f"the bridge has ended: {self.log.read_text()}"
            )
            self.executor.spin_once(timeout_sec=0.02)
        return found

    def call(self, service, kind, seconds=20.0):
        """Call a service that takes no argument."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, seconds)
        future = client.call_async(kind.Request())
        self.until(future.done, seconds)
        return future.result()


class Scene:
    """An orchard, with a bridge to it, and a user."""

    def __init__(self, folder, endpoint, orchard, bridge, user):
        self.folder, self.endpoint, self.orchard, self.bridge, self.user = (
            folder,
            endpoint,
            orchard,
            bridge,
            user,
        )


def bridging(endpoint, words, log):
    """A process that is a bridge."""
    return started(
        [sys.executable, "-m", "orchard_ros2", "--ros-args", "-p", f"endpoint:={endpoint}", *words],
        log,
        cwd=FOLDER,
    )


@contextmanager
def scene(folder, orchard_words, bridge_words):
    endpoint = f"{'tls' if '--secure' in orchard_words else 'tcp'}/127.0.0.1:{free_port()}"
    words = [
        *shlex.split(os.environ["ORCHARD"]),
        *orchard_words,
        "--listen",
        endpoint,
        "--record",
        "none",
    ]
    with (
        started(
            words,
            folder / "orchard.log",
            cwd=folder,
            env=os.environ | {"ORCHARD_RUNS": str(folder / "runs")},
        ) as orchard,
        bridging(endpoint, bridge_words, folder / "bridge.log") as bridge,
    ):
        rclpy.init()
        try:
            yield Scene(
                folder,
                endpoint,
                orchard,
                bridge,
                User(rclpy.create_node("user"), bridge, folder / "bridge.log"),
            )
        finally:
            rclpy.shutdown()


@pytest.fixture(scope="session", autouse=True)
def has_orchard():
    if "ORCHARD" not in os.environ:
        pytest.exit(
            "ORCHARD: the command of the Orchard; ORCHARD_PYTHON: its Python. `make ecosystem` sets"
            " both",
            2,
        )
