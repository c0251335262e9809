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
# m, x of the stretch of a row in which ROS drives; the rest, where places are exact, is the
# agent's.
ROW = (-34.0, -9.0)
HARVEST_SECONDS = 300.0


def test_a_harvest_finishes_with_a_picker_that_ros_drives(tmp_path):
    scenario, summary = tmp_path / "small.yaml", tmp_path / "summary.json"
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
    speeds = [
        odom.twist.twist.linear.x
        for odom in odometry
        if is_in_row(odom) and odom.twist.twist.linear.x
    ]
    assert sum(abs(speed) == SHARE for speed in speeds) > 0.8 * len(speeds), "ROS did not drive it"


def is_in_row(odom):
    return ROW[0] < odom.pose.pose.position.x < ROW[1]
