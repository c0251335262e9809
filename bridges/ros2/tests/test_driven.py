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


def seconds(message):
    return message.header.stamp.sec + message.header.stamp.nanosec / 1e9


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("driven")
    (folder / "orchard.yaml").write_text("{rows: 3, carrying: {battery: {hours: 1}}, chargers: 1}")
    words = [str(folder / "orchard.yaml"), "--mode", "realtime", "--without", "picker_01"]
    with scene(folder, words, ["-p", "driven:=[picker_01]"]) as made:
        user = made.user
        made.odom = user.hear("picker_01/odom", Odometry, 10)
        made.clock = user.hear("clock", Clock, 10)
        made.orders = user.node.create_publisher(TwistStamped, "picker_01/cmd_vel", 10)
        user.until(lambda: made.odom, BEGIN_SECONDS)
        yield made


def order(run, forward, turn=0.0):
    """Publish a velocity for each tick that is heard, until the robot has it."""
    message = TwistStamped()
    message.twist.linear.x, message.twist.angular.z = forward, turn

    def has_it():
        run.orders.publish(message)
        twist = run.odom[-1].twist.twist
        return (twist.linear.x, twist.angular.z) == (forward, turn)

    run.user.until(has_it)


def test_the_robot_drives_as_it_is_told(run):
    order(run, 0.5)
    before = run.odom[-1]
    run.user.until(lambda: len(run.odom) > 40 or order(run, 0.5))
    order(run, -0.25)
    after = next(odom for odom in run.odom if odom.twist.twist.linear.x == -0.25)
    assert after.pose.pose.position.x > before.pose.pose.position.x
    assert (after.header.frame_id, after.child_frame_id) == (
        "picker_01/odom",
        "picker_01/base_link",
    )


def test_a_velocity_is_limited_to_what_the_robot_can_do(run):
    """A velocity is limited to what the robot can do and none at all is ignored."""
    message = TwistStamped()

    def told(forward, then):
        message.twist.linear.x = forward
        run.orders.publish(message)
        return run.odom[-1].twist.twist.linear.x == then

    run.user.until(lambda: told(-1e9, -1.0))
    run.user.until(lambda: told(math.nan, 0.0))
    assert "cmd_vel is not finite" in (run.folder / "bridge.log").read_text()


def test_nonsense_on_the_keys_is_told_and_passed_over(run):
    with connected(run.endpoint, "orchard") as client:
        me = {"run": client.ask("layout")["run"]}
        for key, message in (
            ("picker_01/pose", me),
            ("picker_01/scan", me | {"ranges": 3}),
            ("clock", me),
            ("events", me | {"events": [7]}),
        ):
            client.put(key, message)
        run.user.until(
            lambda: "a malformed message is passed over" in (run.folder / "bridge.log").read_text()
        )
    before = len(run.odom)
    run.user.until(lambda: len(run.odom) > before + 5)


def test_a_robot_whose_commander_falls_silent_stands(run):
    order(run, 0.25)
    last = seconds(run.odom[-1])
    still = run.user.until(
        lambda: [
            odom for odom in run.odom if seconds(odom) > last and odom.twist.twist.linear.x == 0.0
        ]
    )
    assert (
        seconds(still[0]) - last <= WATCHDOG + 0.3
    )  # a step on the way there, one that is finished, and one that shows it
    run.user.until(lambda: seconds(run.odom[-1]) > seconds(still[0]) + 1.0)
    assert run.odom[-1].twist.twist.linear.x == 0.0


def test_the_scan_sees_the_rows_beside_the_robot(run):
    scans = run.user.hear("picker_01/scan", LaserScan, qos_profile_sensor_data)
    scan = run.user.until(lambda: scans and scans[-1])
    near = [distance for distance in scan.ranges if math.isfinite(distance)]
    assert (
        len(scan.ranges) == 180
        and near
        and all(scan.range_min <= distance <= scan.range_max for distance in near)
    )
    assert scan.header.frame_id == "picker_01/laser"


def test_a_carrier_tells_the_charge_of_its_battery(run):
    heard = run.user.hear("carrier_01/battery_state", BatteryState, 10)
    first = run.user.until(lambda: heard and heard[0])
    assert first.present and 0.5 < first.percentage <= 1.0 and math.isnan(first.voltage)
    run.user.until(lambda: heard[-1].percentage < first.percentage)


def test_time_is_the_clocks(run):
    node = Node("sleeper", parameter_overrides=[Parameter("use_sim_time", value=True)])
    run.user.executor.add_node(node)
    now = run.user.until(lambda: node.get_clock().now().nanoseconds)
    run.user.until(
        lambda: now in [stamp.clock.sec * 10**9 + stamp.clock.nanosec for stamp in run.clock]
    )
    run.user.executor.remove_node(node)
    node.destroy_node()


def test_frames_hang_below_map_where_odometry_has_them(run):
    """tf2_msgs has no wheel: this is skipped where it is not installed."""
    kind = pytest.importorskip("tf2_msgs.msg").TFMessage
    fixed, moved = (
        run.user.hear("/tf_static", kind, profile(topics.LATCHED)),
        run.user.hear("/tf", kind, profile(topics.TF.qos)),
    )
    links = {
        link.child_frame_id: link for link in run.user.until(lambda: fixed and fixed[0].transforms)
    }
    assert links["picker_01/odom"].header.frame_id == "map"
    assert (
        links["picker_01/laser"].header.frame_id == "picker_01/base_link"
        and links["picker_01/laser"].transform.translation.x == 1.25
    )
    link = next(
        link
        for link in run.user.until(lambda: moved and moved[-1].transforms)
        if link.child_frame_id == "picker_01/base_link"
    )
    odom = run.user.until(
        lambda: [odom for odom in run.odom if odom.header.stamp == link.header.stamp]
    )[0]
    place = odom.pose.pose.position
    assert (link.transform.translation.x, link.transform.translation.y, link.header.frame_id) == (
        place.x,
        place.y,
        odom.header.frame_id,
    )
    assert link.transform.rotation == odom.pose.pose.orientation


def test_who_comes_late_gets_the_map_and_the_description(run):
    maps = run.user.hear("map", OccupancyGrid, profile(topics.LATCHED))
    texts = run.user.hear("picker_01/robot_description", String, profile(topics.LATCHED))
    run.user.until(lambda: maps and texts)
    info = maps[0].info
    assert {*maps[0].data} == {0, 100} and len(maps[0].data) == info.width * info.height
    assert ElementTree.fromstring(texts[0].data).get("name") == "picker_01"


@pytest.mark.parametrize(
    "topic",
    [topics.ODOM, topics.SCAN, topics.ROBOT_DESCRIPTION, topics.GRID, topics.CLOCK],
    ids=lambda topic: topic.name,
)
def test_topics_have_the_qualities_that_ros_users_expect(run, topic):
    (publisher,) = run.user.until(
        lambda: run.user.node.get_publishers_info_by_topic("/" + topic.of("picker_01").lstrip("/"))
    )
    assert publisher.topic_type == topic.type
    assert publisher.qos_profile.reliability == (
        ReliabilityPolicy.RELIABLE if topic.qos.reliable else ReliabilityPolicy.BEST_EFFORT
    )
    assert publisher.qos_profile.durability == (
        DurabilityPolicy.TRANSIENT_LOCAL if topic.qos.latched else DurabilityPolicy.VOLATILE
    )


def test_a_robot_leaves_its_bin_and_takes_it_again(run):
    done = run.user.call("picker_01/uncouple", Trigger)
    assert done.success, done.message
    again = run.user.call("picker_01/couple", Trigger)
    assert (again.success, again.message) == (True, "picker_01: coupled bin_01")


def test_a_bin_out_of_reach_is_refused_with_the_reason(run):
    """A bin out of reach is not coupled and the reason is told."""
    assert run.user.call("picker_01/uncouple", Trigger).success
    begin = run.odom[-1].pose.pose.position.x
    run.user.until(lambda: run.odom[-1].pose.pose.position.x > begin + 0.5 or order(run, 0.5))
    refused = run.user.call("picker_01/couple", Trigger)
    assert not refused.success and refused.message


def test_only_the_robots_of_the_parameter_are_driven(run):
    names = [name for name, _ in run.user.node.get_topic_names_and_types()]
    assert [name for name in names if name.endswith("/cmd_vel")] == ["/picker_01/cmd_vel"]
