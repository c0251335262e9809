"""A whole small harvest in which ROS drives picker_01, and its agent keeps plan, mail and deeds.

`cmd_vel` is a Twist.
"""

import json

from conftest import BEGIN_SECONDS, scene
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry

SPEED = 8  # times real time
SMALL = """
rows: 3
row_length: 30
carriers: 2
people: {workers: 0, visitors: 0}
animals: {dogs: 0, cats: 0}
tractor: false
"""
SHARE = 0.75  # of the speed that its agent wants
# x of the part of a row in which ROS drives, m. In the rest, where places are exact, the agent
# does.
ROW = (-34.0, -9.0)
HARVEST_SECONDS = 300.0
# In real time some advice comes too late for its tick.
MOSTLY = 0.8


def test_a_harvest_finishes_with_a_picker_that_ros_drives(tmp_path):
    """ROS lets it drive three quarters as fast as its agent wants; all three bins are delivered."""
    scenario = tmp_path / "small.yaml"
    summary = tmp_path / "summary.json"
    scenario.write_text(SMALL)
    words = [str(scenario), "--mode", "realtime", "--speed", str(SPEED), "--summary", str(summary)]
    with scene(
        tmp_path, words, ["-p", "advised:=[picker_01]", "-p", "enable_stamped_cmd_vel:=false"]
    ) as run:
        user = run.user
        odometry = user.hear("picker_01/odom", Odometry, 10)
        orders = user.node.create_publisher(Twist, "picker_01/cmd_vel", 1)

        def advise(wanted):
            """Drive more slowly than the agent wants, in the rows."""
            if odometry and is_in_row(odometry[-1]) and not wanted.twist.angular.z:
                wanted.twist.linear.x *= SHARE
                orders.publish(wanted.twist)

        user.node.create_subscription(TwistStamped, "picker_01/cmd_vel_agent", advise, 1)
        user.until(lambda: odometry, BEGIN_SECONDS)
        user.until(lambda: run.orchard.poll() is not None, HARVEST_SECONDS, needs_bridge=False)
        assert run.orchard.returncode == 0
    assert json.loads(summary.read_text())["bins_delivered"] == 3
    speeds = [abs(odom.twist.twist.linear.x) for odom in odometry if is_in_row(odom)]
    moving = [speed for speed in speeds if speed]
    # Its agent wants 1 m/s there.
    assert moving.count(SHARE) > MOSTLY * len(moving), "ROS did not drive it"


def is_in_row(odom):
    """Whether a robot is in the part of its row in which ROS drives."""
    return ROW[0] < odom.pose.pose.position.x < ROW[1]
