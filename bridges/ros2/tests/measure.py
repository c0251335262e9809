"""What the bridge costs, and how soon a robot does what ROS says: the default orchard in real time,
all its bodies, 10 Hz.

    ORCHARD=.venv/bin/orchard .venv-ros2/bin/python bridges/ros2/tests/measure.py
"""

import random
import statistics
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import psutil
from conftest import BEGIN_SECONDS, scene
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from orchard_ros2.plain import topics
from orchard_ros2.publishers import profile, type_of
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

CHANGES = 60  # of the velocity, each of which is timed
SECONDS = 20.0  # for which the bridge's share of a core is measured


def rest(user, seconds):
    """Handle what arrives for some time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        user.executor.spin_once(timeout_sec=0.01)


def latencies(user, odom, orders):
    """Return the seconds from a changed cmd_vel until odom shows it, at random moments of a tick,
    sorted.

    `odom`: the list of messages. `orders`: the publisher of cmd_vel.
    """
    chance = random.Random(1)
    seconds = []
    for i in range(CHANGES):
        message = TwistStamped()
        # Forward and backward in turns, m/s.
        wanted = 0.1 if i % 2 else -0.1
        message.twist.linear.x = wanted
        rest(user, chance.uniform(0.1, 0.3))
        begin = time.monotonic()
        orders.publish(message)
        user.until(lambda wanted=wanted: odom[-1].twist.twist.linear.x == wanted)
        seconds.append(time.monotonic() - begin)
    return sorted(seconds)


def share_of_core(user, bridge, names):
    """Return the bridge's share of a core, while all topics of all bodies are heard; and the
    messages a second that were heard.
    """
    heard = [user.hear(f"{name}/odom", Odometry, 10) for name in names]
    heard += [user.hear(f"{name}/scan", LaserScan, qos_profile_sensor_data) for name in names]
    with suppress(ImportError):
        heard.append(user.hear("/tf", type_of(topics.TF.type), profile(topics.TF.qos)))
    user.until(lambda: all(heard))
    process = psutil.Process(bridge.pid)
    messages_before = sum(map(len, heard))
    used_before = sum(process.cpu_times()[:2])
    rest(user, SECONDS)
    used = sum(process.cpu_times()[:2]) - used_before
    messages = sum(map(len, heard)) - messages_before
    return used / SECONDS, messages / SECONDS


def main():
    """Measure both, and print them."""
    everyone = "[bin,carrier,cat,dog,picker,tractor,visitor,weed,worker]"
    parameters = ["-p", f"robots:={everyone}", "-p", "driven:=[picker_01]"]
    words = ["--mode", "realtime", "--without", "picker_01"]
    with tempfile.TemporaryDirectory() as folder, scene(Path(folder), words, parameters) as run:
        user = run.user
        odom = user.hear("picker_01/odom", Odometry, 10)
        orders = user.node.create_publisher(TwistStamped, "picker_01/cmd_vel", 1)
        user.until(lambda: odom, BEGIN_SECONDS)
        user.until(orders.get_subscription_count)
        latency = latencies(user, odom, orders)
        topics_there = [name for name, _ in user.node.get_topic_names_and_types()]
        names = sorted({name.split("/")[1] for name in topics_there if name.endswith("/odom")})
        share, rate = share_of_core(user, run.bridge, names)
    median = statistics.median(latency)
    most = latency[-1]
    print(
        f"changed cmd_vel until odom shows it: median {1e3 * median:.0f} ms, most {1e3 * most:.0f}"
        f" ms, of {CHANGES}"
    )
    print(
        f"bridge: {100 * share:.1f} % of a core, {len(names)} bodies, {rate:.0f} messages of odom,"
        " scan and, with tf2_msgs, tf a second"
    )
    print(f"load of this machine: {psutil.getloadavg()[0]:.1f} on {psutil.cpu_count()} cores")


if __name__ == "__main__":
    main()
