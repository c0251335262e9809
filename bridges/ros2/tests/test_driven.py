"""A user of ROS 2 drives picker_01 of a run in real time, and reads its odometry and its scan."""

import math
from xml.etree import ElementTree

import pytest
from conftest import BEGIN_SECONDS, scene
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from orchard_ros2.client import connected
from orchard_ros2.plain import topics
from orchard_ros2.publishers import profile
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, LaserScan
from std_msgs.msg import String
from std_srvs.srv import Trigger

WATCHDOG = 0.5  # s, for which a velocity counts
# s in which a robot can still move: a step on the way there, one that is under way, and one that
# shows that the robot stands.
STEPS_UNDER_WAY = 0.3
BEAMS = 180  # of a picker's laser


def seconds(message):
    """Return the simulated time of a message, s."""
    return message.header.stamp.sec + message.header.stamp.nanosec / 1e9


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a bridge that drives picker_01; all tests of the module share it."""
    folder = tmp_path_factory.mktemp("driven")
    (folder / "orchard.yaml").write_text("{rows: 3, carrying: {battery: {hours: 1}}, chargers: 1}")
    words = [str(folder / "orchard.yaml"), "--mode", "realtime", "--without", "picker_01"]
    with scene(folder, words, ["-p", "driven:=[picker_01]"]) as run:
        user = run.user
        run.odom = user.hear("picker_01/odom", Odometry, 10)
        run.clock = user.hear("clock", Clock, 10)
        run.orders = user.node.create_publisher(TwistStamped, "picker_01/cmd_vel", 10)
        user.until(lambda: run.odom, BEGIN_SECONDS)
        yield run


def order(run, forward, turn=0.0):
    """Publish a velocity again and again, until the robot has it. `forward`: m/s. `turn`: rad/s."""
    message = TwistStamped()
    message.twist.linear.x = forward
    message.twist.angular.z = turn

    def has_it():
        run.orders.publish(message)
        twist = run.odom[-1].twist.twist
        return (twist.linear.x, twist.angular.z) == (forward, turn)

    run.user.until(has_it)


def drive_on(run, is_enough):
    """Order the robot to drive forward at 0.5 m/s until it is enough."""

    def order_and_look():
        order(run, 0.5)
        return is_enough()

    run.user.until(order_and_look)


def test_the_robot_drives_as_it_is_told(run):
    """It drives east for some time, and then back."""
    order(run, 0.5)
    before = run.odom[-1]
    drive_on(run, lambda: len(run.odom) > 40)
    order(run, -0.25)
    after = next(odom for odom in run.odom if odom.twist.twist.linear.x == -0.25)
    assert after.pose.pose.position.x > before.pose.pose.position.x
    assert after.header.frame_id == "picker_01/odom"
    assert after.child_frame_id == "picker_01/base_link"


def test_a_velocity_is_limited_to_what_the_robot_can_do(run):
    """That is 1 m/s. A velocity that is no number is ignored: then the robot soon stands."""
    message = TwistStamped()

    def drives(ordered, expected):
        message.twist.linear.x = ordered
        run.orders.publish(message)
        return run.odom[-1].twist.twist.linear.x == expected

    run.user.until(lambda: drives(ordered=-1e9, expected=-1.0))
    run.user.until(lambda: drives(ordered=math.nan, expected=0.0))
    assert "cmd_vel is not finite" in (run.folder / "bridge.log").read_text()


def test_nonsense_on_the_keys_is_told_and_passed_over(run):
    """Another client publishes malformed messages; the bridge goes on."""
    log = run.folder / "bridge.log"
    with connected(run.endpoint, "orchard") as client:
        empty = {"run": client.ask("layout")["run"]}
        client.put("picker_01/pose", empty)
        client.put("picker_01/scan", empty | {"ranges": 3})
        client.put("clock", empty)
        client.put("events", empty | {"events": [7]})
        run.user.until(lambda: "a malformed message is passed over" in log.read_text())
    before = len(run.odom)
    run.user.until(lambda: len(run.odom) > before + 5)


def test_a_robot_whose_commander_falls_silent_stands(run):
    order(run, 0.25)
    last = seconds(run.odom[-1])

    def first_standing():
        for odom in run.odom:
            if seconds(odom) > last and odom.twist.twist.linear.x == 0.0:
                return odom
        return None

    standing = seconds(run.user.until(first_standing))
    assert standing - last <= WATCHDOG + STEPS_UNDER_WAY
    # A second later it still stands.
    run.user.until(lambda: seconds(run.odom[-1]) > standing + 1.0)
    assert run.odom[-1].twist.twist.linear.x == 0.0


def test_the_scan_sees_the_rows_beside_the_robot(run):
    scans = run.user.hear("picker_01/scan", LaserScan, qos_profile_sensor_data)
    scan = run.user.until(lambda: scans and scans[-1])
    assert len(scan.ranges) == BEAMS
    near = [distance for distance in scan.ranges if math.isfinite(distance)]
    assert near
    for distance in near:
        assert scan.range_min <= distance <= scan.range_max
    assert scan.header.frame_id == "picker_01/laser"


def test_a_carrier_tells_the_charge_of_its_battery(run):
    heard = run.user.hear("carrier_01/battery_state", BatteryState, 10)
    first = run.user.until(lambda: heard and heard[0])
    assert first.present
    # It lasts an hour, and the test has just begun.
    assert 0.5 < first.percentage <= 1.0
    assert math.isnan(first.voltage), "it is not measured"
    run.user.until(lambda: heard[-1].percentage < first.percentage)


def test_time_is_the_clocks(run):
    """The time of a node with `use_sim_time` is one that was published on /clock."""
    node = Node("sleeper", parameter_overrides=[Parameter("use_sim_time", value=True)])
    run.user.executor.add_node(node)
    now = run.user.until(lambda: node.get_clock().now().nanoseconds)

    def is_published():
        return any(stamp.clock.sec * 10**9 + stamp.clock.nanosec == now for stamp in run.clock)

    run.user.until(is_published)
    run.user.executor.remove_node(node)
    node.destroy_node()


def test_frames_hang_below_map_where_odometry_has_them(run):
    """tf2_msgs has no wheel: the test is skipped where it is not installed."""
    kind = pytest.importorskip("tf2_msgs.msg").TFMessage
    fixed = run.user.hear("/tf_static", kind, profile(topics.LATCHED))
    moved = run.user.hear("/tf", kind, profile(topics.TF.qos))
    still_links = by_child(run.user.until(lambda: fixed and fixed[0].transforms))
    assert still_links["picker_01/odom"].header.frame_id == "map"
    laser = still_links["picker_01/laser"]
    assert laser.header.frame_id == "picker_01/base_link"
    # A picker is 2.5 m long, and its laser is at the middle of its front.
    assert laser.transform.translation.x == 1.25
    moved_links = by_child(run.user.until(lambda: moved and moved[-1].transforms))
    link = moved_links["picker_01/base_link"]

    def odometry_of_that_time():
        for odom in run.odom:
            if odom.header.stamp == link.header.stamp:
                return odom
        return None

    odom = run.user.until(odometry_of_that_time)
    place = odom.pose.pose.position
    assert (link.transform.translation.x, link.transform.translation.y) == (place.x, place.y)
    assert link.header.frame_id == odom.header.frame_id
    assert link.transform.rotation == odom.pose.pose.orientation


def by_child(links):
    """Return transforms by the names of their child frames."""
    return {link.child_frame_id: link for link in links}


def test_a_late_subscriber_gets_the_map_and_the_description(run):
    maps = run.user.hear("map", OccupancyGrid, profile(topics.LATCHED))
    texts = run.user.hear("picker_01/robot_description", String, profile(topics.LATCHED))
    run.user.until(lambda: maps and texts)
    info = maps[0].info
    assert len(maps[0].data) == info.width * info.height
    assert set(maps[0].data) == {0, 100}, "cells are free or occupied"
    assert ElementTree.fromstring(texts[0].data).get("name") == "picker_01"


@pytest.mark.parametrize(
    "topic",
    [topics.ODOM, topics.SCAN, topics.ROBOT_DESCRIPTION, topics.GRID, topics.CLOCK],
    ids=lambda topic: topic.name,
)
def test_topics_have_the_qualities_that_ros_users_expect(run, topic):
    """What the network says of a topic is what `topics.py` says."""
    name = "/" + topic.of("picker_01").lstrip("/")
    (publisher,) = run.user.until(lambda: run.user.node.get_publishers_info_by_topic(name))
    assert publisher.topic_type == topic.type
    is_reliable = publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    is_latched = publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert is_reliable == topic.qos.reliable
    assert is_latched == topic.qos.latched


def test_a_robot_leaves_its_bin_and_takes_it_again(run):
    done = run.user.call("picker_01/uncouple", Trigger)
    assert done.success, done.message
    again = run.user.call("picker_01/couple", Trigger)
    assert again.success, again.message
    assert again.message == "picker_01: coupled bin_01"


def test_a_bin_out_of_reach_is_refused_with_the_reason(run):
    """A robot leaves its bin, drives half a metre, and cannot couple the bin from there."""
    assert run.user.call("picker_01/uncouple", Trigger).success
    begin = run.odom[-1].pose.pose.position.x
    drive_on(run, lambda: run.odom[-1].pose.pose.position.x > begin + 0.5)
    answer = run.user.call("picker_01/couple", Trigger)
    assert not answer.success
    assert answer.message


def test_only_the_robots_of_the_parameter_are_driven(run):
    names = [name for name, _ in run.user.node.get_topic_names_and_types()]
    assert [name for name in names if name.endswith("/cmd_vel")] == ["/picker_01/cmd_vel"]
