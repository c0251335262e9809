"""A picker whose sensors err, driven by its agent: its odometry drifts, its measured pose stays
near the truth, and frames join both.
"""

import math

import pytest
from conftest import BEGIN_SECONDS, scene
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from orchard_ros2.plain import topics
from orchard_ros2.publishers import profile

ERRING = """
rows: 3
sensors:
  gnss: {white: 0.01, bias: 0.02}
  odometry: {distance: 0.05, heading: 0.001}
"""
VARIANCE = 0.01**2 + 0.02**2  # m^2
FAR = 8.0  # m, of driving


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("erring")
    (folder / "erring.yaml").write_text(ERRING)
    words = [str(folder / "erring.yaml"), "--mode", "realtime", "--speed", "4"]
    with scene(folder, words, ["-p", "ground_truth:=true", "-p", "robots:=[picker_01]"]) as made:
        user = made.user
        made.odom = user.hear("picker_01/odom", Odometry, 10)
        made.truth = user.hear("picker_01/ground_truth", Odometry, 10)
        made.poses = user.hear("picker_01/pose", PoseWithCovarianceStamped, 10)
        user.until(lambda: made.odom and made.truth and made.poses, BEGIN_SECONDS)
        user.until(lambda: math.dist(xy(made.truth[0]), xy(made.truth[-1])) > FAR, 60)
        yield made


def xy(message):
    return message.pose.pose.position.x, message.pose.pose.position.y


def tick(header):
    return header.stamp.sec * 10 + header.stamp.nanosec // 10**8


def by_tick(messages):
    return {tick(message.header): message for message in messages}


def pairs(one, other):
    """The messages of the same ticks: in real time one of them may be missing."""
    one, other = by_tick(one), by_tick(other)
    return [(one[tick], other[tick]) for tick in sorted(one.keys() & other.keys())]


def test_the_measured_pose_is_as_near_to_the_truth_as_it_says(run):
    matched = pairs(run.poses, run.truth)
    off = [math.dist(xy(pose), xy(truth)) for pose, truth in matched]
    assert 0.0 < max(off) < 6.0 * math.sqrt(VARIANCE)
    for pose, truth in matched:
        assert (
            pose.header == truth.header
            and pose.header.frame_id == "map"
            and truth.child_frame_id == "picker_01/base_link"
        )
        assert pose.pose.covariance[[0, 7, 14, 21, 28, 35]] == pytest.approx(
            [VARIANCE, VARIANCE, *[1e-6] * 4]
        )


def test_odometry_is_smooth_and_drifts(run):
    """It moves by the velocity in its own message, which is not the true one."""
    odom = by_tick(run.odom)
    steps = [(message, odom[tick + 1]) for tick, message in odom.items() if tick + 1 in odom]
    assert steps
    for before, after in steps:
        assert math.dist(xy(before), xy(after)) == pytest.approx(
            0.1 * abs(after.twist.twist.linear.x), abs=1e-9
        )
        assert after.header.frame_id == "picker_01/odom"
    scales = [
        odom.twist.twist.linear.x / truth.twist.twist.linear.x
        for odom, truth in pairs(run.odom, run.truth)
        if truth.twist.twist.linear.x
    ]
    assert scales[0] != 1.0 and scales == pytest.approx([scales[0]] * len(scales))


def test_only_erring_scenarios_have_these_topics(run):
    """Only erring scenarios and the parameter have these topics.

    The bins and carriers are not among the robots that ROS sees here.
    """
    names = {name for name, _ in run.user.node.get_topic_names_and_types()}
    assert {name for name in names if name.endswith(("/pose", "/ground_truth"))} == {
        "/picker_01/pose",
        "/picker_01/ground_truth",
    }
    for topic in (topics.POSE, topics.GROUND_TRUTH):
        (publisher,) = run.user.node.get_publishers_info_by_topic("/" + topic.of("picker_01"))
        assert (
            publisher.topic_type == topic.type
            and publisher.qos_profile.reliability == profile(topic.qos).reliability
        )


def test_frames_lead_from_map_to_the_measured_pose(run):
    """tf2_msgs has no wheel: this is skipped where it is not installed."""
    kind = pytest.importorskip("tf2_msgs.msg").TFMessage
    fixed, moved = (
        run.user.hear("/tf_static", kind, profile(topics.LATCHED)),
        run.user.hear("/tf", kind, profile(topics.TF.qos)),
    )
    run.user.until(lambda: fixed and len(moved) > 5)
    assert [link.child_frame_id for link in fixed[0].transforms] == ["picker_01/laser"]
    poses, checked = by_tick(run.poses), 0
    for links in ({link.child_frame_id: link for link in message.transforms} for message in moved):
        drift, reckoned = links.get("picker_01/odom"), links["picker_01/base_link"]
        if drift and (pose := poses.get(tick(drift.header))):
            yaw = 2.0 * math.atan2(drift.transform.rotation.z, drift.transform.rotation.w)
            there, at = drift.transform.translation, reckoned.transform.translation
            x, y = (
                there.x + math.cos(yaw) * at.x - math.sin(yaw) * at.y,
                there.y + math.sin(yaw) * at.x + math.cos(yaw) * at.y,
            )
            assert drift.header.frame_id == "map" and (x, y) == pytest.approx(xy(pose), abs=1e-9)
            checked += 1
    assert checked
