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

# Errors of positions, m: of each tick (white), and slow (bias); of odometry, as shares.
ERRING = """
rows: 3
sensors:
  gnss: {white: 0.01, bias: 0.02}
  odometry: {distance: 0.05, heading: 0.001}
"""
VARIANCE = 0.01**2 + 0.02**2  # m^2, of both errors together
EXACT = 1e-6  # m^2 and rad^2: what the bridge says of what is exact
FAR = 8.0  # m, which the picker drives before the tests look
# A normal error beyond so many deviations does not occur in a run.
DEVIATIONS = 6.0
STEP = 0.1  # s


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of which a user has heard some metres; all tests of the module share it."""
    folder = tmp_path_factory.mktemp("erring")
    (folder / "erring.yaml").write_text(ERRING)
    words = [str(folder / "erring.yaml"), "--mode", "realtime", "--speed", "4"]
    with scene(folder, words, ["-p", "ground_truth:=true", "-p", "robots:=[picker_01]"]) as run:
        user = run.user
        run.odom = user.hear("picker_01/odom", Odometry, 10)
        run.truth = user.hear("picker_01/ground_truth", Odometry, 10)
        run.poses = user.hear("picker_01/pose", PoseWithCovarianceStamped, 10)
        user.until(lambda: run.odom and run.truth and run.poses, BEGIN_SECONDS)
        user.until(lambda: math.dist(xy(run.truth[0]), xy(run.truth[-1])) > FAR, 60)
        yield run


def xy(message):
    """Return the place in a message, m."""
    return message.pose.pose.position.x, message.pose.pose.position.y


def tick_of(header):
    """Return the tick of a message."""
    return header.stamp.sec * 10 + header.stamp.nanosec // 10**8


def by_tick(messages):
    """Return messages by their ticks."""
    return {tick_of(message.header): message for message in messages}


def pairs(messages, others):
    """Return the messages of the same ticks: in real time one of them may be missing."""
    of_tick = by_tick(messages)
    others_of_tick = by_tick(others)
    both = sorted(of_tick.keys() & others_of_tick.keys())
    return [(of_tick[tick], others_of_tick[tick]) for tick in both]


def test_the_measured_pose_is_as_near_to_the_truth_as_it_says(run):
    matched = pairs(run.poses, run.truth)
    errors = [math.dist(xy(pose), xy(truth)) for pose, truth in matched]
    assert 0.0 < max(errors) < DEVIATIONS * math.sqrt(VARIANCE)
    for pose, truth in matched:
        assert pose.header == truth.header
        assert pose.header.frame_id == "map"
        assert truth.child_frame_id == "picker_01/base_link"
        # Of x, y, z and the three angles: the diagonal of a matrix of 6 x 6.
        variances = pose.pose.covariance[[0, 7, 14, 21, 28, 35]]
        assert variances == pytest.approx([VARIANCE, VARIANCE, EXACT, EXACT, EXACT, EXACT])


def test_odometry_is_smooth_and_drifts(run):
    """It moves by the velocity in its own message, which is the true one times a factor."""
    odometry = by_tick(run.odom)
    steps = []
    for tick, message in odometry.items():
        if tick + 1 in odometry:
            steps.append((message, odometry[tick + 1]))
    assert steps
    for before, after in steps:
        step = STEP * abs(after.twist.twist.linear.x)
        assert math.dist(xy(before), xy(after)) == pytest.approx(step, abs=1e-9)
        assert after.header.frame_id == "picker_01/odom"
    factors = []
    for odom, truth in pairs(run.odom, run.truth):
        if truth.twist.twist.linear.x:
            factors.append(odom.twist.twist.linear.x / truth.twist.twist.linear.x)
    assert factors[0] != 1.0
    assert factors == pytest.approx([factors[0]] * len(factors))


def test_only_the_robots_that_are_seen_have_these_topics(run):
    """Bins and carriers are not among the robots that ROS sees here."""
    names = {name for name, _ in run.user.node.get_topic_names_and_types()}
    assert {name for name in names if name.endswith(("/pose", "/ground_truth"))} == {
        "/picker_01/pose",
        "/picker_01/ground_truth",
    }
    for topic in (topics.POSE, topics.GROUND_TRUTH):
        (publisher,) = run.user.node.get_publishers_info_by_topic("/" + topic.of("picker_01"))
        assert publisher.topic_type == topic.type
        assert publisher.qos_profile.reliability == profile(topic.qos).reliability


def test_frames_lead_from_map_to_the_measured_pose(run):
    """map -> picker_01/odom -> picker_01/base_link ends at the measured pose of the same tick.

    tf2_msgs has no wheel: the test is skipped where it is not installed.
    """
    kind = pytest.importorskip("tf2_msgs.msg").TFMessage
    fixed = run.user.hear("/tf_static", kind, profile(topics.LATCHED))
    moved = run.user.hear("/tf", kind, profile(topics.TF.qos))
    run.user.until(lambda: fixed and len(moved) > 5)
    assert [link.child_frame_id for link in fixed[0].transforms] == ["picker_01/laser"]
    poses = by_tick(run.poses)
    checked = 0
    for message in moved:
        links = {link.child_frame_id: link for link in message.transforms}
        drift = links.get("picker_01/odom")
        if drift is None or tick_of(drift.header) not in poses:
            # In real time a pose may be missing.
            continue
        assert drift.header.frame_id == "map"
        pose = poses[tick_of(drift.header)]
        end = end_of_chain(drift.transform, links["picker_01/base_link"].transform)
        assert end == pytest.approx(xy(pose), abs=1e-9)
        checked += 1
    assert checked


def end_of_chain(first, second):
    """Return the x and y at which two transforms end, one after the other."""
    yaw = 2.0 * math.atan2(first.rotation.z, first.rotation.w)
    ahead = second.translation.x
    left = second.translation.y
    x = first.translation.x + math.cos(yaw) * ahead - math.sin(yaw) * left
    y = first.translation.y + math.sin(yaw) * ahead + math.cos(yaw) * left
    return x, y
