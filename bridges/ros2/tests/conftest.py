"""An orchard, a bridge, and a user of ROS 2: three processes, on loopback only. The user is the
process of the test. `make ecosystem` runs these tests.
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

# Before rclpy is imported: it takes them once. Processes with other ids hear nothing of each other.
os.environ |= {
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

FOLDER = Path(__file__).parents[1]
PAGE = (FOLDER.parents[1] / "docs" / "ros2.md").read_text()
# For the first start of an orchard on a machine, which compiles.
BEGIN_SECONDS = 150.0
END_SECONDS = 20.0


def block(name):
    """Return the block of code of the page that has this name."""
    (text,) = re.findall(rf"^```\w+ {name}\n(.*?)^```$", PAGE, re.M | re.S)
    return text


def free_port():
    """Return a port of the loopback that was free a moment ago."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@contextmanager
def started(words, log, **options):
    """In this context, a process runs that writes its output into a log; it is ended by its id."""
    with (
        open(log, "wb") as output,
        subprocess.Popen(words, stdout=output, stderr=subprocess.STDOUT, **options) as process,
    ):
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(END_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()


def wait_until_it_says(words, log, process, seconds=BEGIN_SECONDS):
    """Wait until a process has written some words to its log."""
    end = time.monotonic() + seconds
    while words not in log.read_text():
        assert process.poll() is None, f"it has ended: {log.read_text()}"
        assert time.monotonic() < end, f"not within {seconds} s: {log.read_text()}"
        time.sleep(0.02)


class User:
    """A node of ROS 2. Every wait has a limit.

    `bridge`: the process of the bridge, and `log` its log.
    """

    def __init__(self, node, bridge, log):
        self.bridge = bridge
        self.log = log
        self.node = node
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)

    def hear(self, topic, kind, qos):
        """Subscribe to a topic. Return the list to which each of its messages is added."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def until(self, condition, seconds=20.0, needs_bridge=True):
        """Handle what arrives until a condition is true. Return what it gives then.

        `needs_bridge`: whether the bridge must not end meanwhile.
        """
        end = time.monotonic() + seconds
        while True:
            outcome = condition()
            if outcome:
                return outcome
            assert time.monotonic() < end, f"not within {seconds} s"
            if needs_bridge and self.bridge.poll() is not None:
                pytest.fail(f"the bridge has ended: {self.log.read_text()}")
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, service, kind, seconds=20.0):
        """Call a service that takes no argument. Return its response."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, seconds)
        future = client.call_async(kind.Request())
        self.until(future.done, seconds)
        return future.result()


class Scene:
    """An orchard, with a bridge to it, and a user."""

    def __init__(self, folder, endpoint, orchard, bridge, user):
        """`orchard`, `bridge`: their processes. Their logs are in the folder."""
        self.folder = folder
        self.endpoint = endpoint
        self.orchard = orchard
        self.bridge = bridge
        self.user = user


def bridging(endpoint, words, log):
    """Return the context of a bridge. `words`: of its command line."""
    command = [sys.executable, "-m", "orchard_ros2", "--ros-args", "-p", f"endpoint:={endpoint}"]
    return started([*command, *words], log, cwd=FOLDER)


@contextmanager
def scene(folder, orchard_words, bridge_words):
    """In this context, an orchard and a bridge run, each with these words of its command line."""
    scheme = "tls" if "--secure" in orchard_words else "tcp"
    endpoint = f"{scheme}/127.0.0.1:{free_port()}"
    words = [*shlex.split(os.environ["ORCHARD"]), *orchard_words]
    words += ["--listen", endpoint, "--record", "none"]
    environment = os.environ | {"ORCHARD_RUNS": str(folder / "runs")}
    log = folder / "bridge.log"
    with (
        started(words, folder / "orchard.log", cwd=folder, env=environment) as orchard,
        bridging(endpoint, bridge_words, log) as bridge,
    ):
        rclpy.init()
        try:
            user = User(rclpy.create_node("user"), bridge, log)
            yield Scene(folder, endpoint, orchard, bridge, user)
        finally:
            rclpy.shutdown()


@pytest.fixture(scope="session", autouse=True)
def has_orchard():
    """Refuse to begin without the command of an orchard."""
    if "ORCHARD" not in os.environ:
        pytest.exit(
            "ORCHARD: the command of the Orchard; ORCHARD_PYTHON: its Python. `make ecosystem` sets"
            " both",
            2,
        )
