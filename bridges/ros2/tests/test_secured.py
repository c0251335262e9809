"""Secured runs: a bridge drives, pauses and resets what its role allows, and no more, even if its
own files claim more.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys

import pytest
from conftest import BEGIN_SECONDS, FOLDER, block, bridging, scene, wait_until_it_says
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

TICKS = 10  # for which orders to drive must move nothing
FIND_SECONDS = 60.0  # within which the processes find each other, and a command ends


def page():
    """The words of the page's three commands (make roles, run, bridge), without the program."""
    return [line.split()[1:] for line in block("ros2 secured").splitlines()]


def make_roles(folder):
    """Make the roles of the page, and the role `looker` of a bridge that only looks.

    Return the folder that has a folder for each.
    """
    words = [*shlex.split(os.environ["ORCHARD"]), *page()[0], "--rows", "3", "--bridge", "looker"]
    folder.mkdir(exist_ok=True)
    subprocess.run(words, cwd=folder, check=True, capture_output=True, timeout=FIND_SECONDS)
    return folder / "roles"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("secured")
    roles = make_roles(folder)
    _, orchard_words, bridge_words = page()
    # The scene chooses a free port: the page's endpoint goes, which is the last option of the
    # run's command and the first parameter of the bridge's.
    orchard_words = orchard_words[: orchard_words.index("--listen")]
    parameters = bridge_words[bridge_words.index("-p") + 2 :]
    parameters = [word.replace("secure:=", f"secure:={folder}/") for word in parameters]
    with scene(folder, [*orchard_words, "--rows", "3"], parameters) as secured:
        secured.roles = roles
        secured.odom = secured.user.hear("picker_01/odom", Odometry, 10)
        secured.clock = secured.user.hear("clock", Clock, 10)
        secured.user.until(lambda: secured.odom, BEGIN_SECONDS)
        yield secured


def forward(speed):
    message = TwistStamped()
    message.twist.linear.x = speed
    return message


def publish_until(run, orders, speed, is_enough):
    """Publish orders to drive forward, in m/s, again and again until `is_enough` says so."""

    def publish_and_look():
        orders.publish(forward(speed))
        return is_enough()

    run.user.until(publish_and_look)


def drives(run, speed):
    """Check that the picker drives as fast as it is ordered to, in m/s, and then stops."""
    orders = run.user.node.create_publisher(TwistStamped, "picker_01/cmd_vel", 10)
    publish_until(run, orders, speed, lambda: run.odom[-1].twist.twist.linear.x == speed)
    run.user.until(lambda: run.odom[-1].twist.twist.linear.x == 0.0)  # nothing drives it any more


def test_it_drives_its_robot_and_sees_all_others(run):
    drives(run, 0.5)
    other = run.user.hear("picker_02/odom", Odometry, 10)
    run.user.until(lambda: other)


def test_it_pauses_the_run_and_resets_it_and_drives_on(run):
    assert run.user.call("set_simulation_state/paused", Trigger).success
    assert run.user.call("set_simulation_state/playing", Trigger).success
    run.user.until(lambda: run.clock[-1].clock.sec >= 2)
    answer = run.user.call("reset_simulation", Trigger)
    assert answer.success, answer.message
    run.user.until(lambda: run.clock[-1].clock.sec < 1, FIND_SECONDS)
    run.user.until(lambda: run.clock[-1].clock.sec > 1, FIND_SECONDS)
    drives(run, 0.25)


def test_a_claim_beyond_its_role_moves_and_controls_nothing(run):
    """One that claims more than its role moves nothing and controls nothing.

    Its own files say that it may; the run's router says no.
    """
    forged = shutil.copytree(run.roles / "looker", run.folder / "forged")
    claimed = json.loads((forged / "role.json").read_text()) | {
        "names": ["picker_01"],
        "duty": "operating-bridge",
    }
    (forged / "role.json").write_text(json.dumps(claimed))
    words = ["-r", "__ns:=/forged", "-p", f"secure:={forged}", "-p", "driven:=[picker_01]"]
    with bridging(run.endpoint, words, run.folder / "forged.log"):
        seen = run.user.hear("forged/picker_01/odom", Odometry, 10)
        orders = run.user.node.create_publisher(TwistStamped, "forged/picker_01/cmd_vel", 10)
        run.user.until(lambda: seen and orders.get_subscription_count(), FIND_SECONDS)
        begin = len(seen)
        publish_until(run, orders, 1.0, lambda: len(seen) > begin + TICKS)
        assert {odom.twist.twist.linear.x for odom in seen[begin:]} == {0.0}
        assert not run.user.call("forged/set_simulation_state/paused", Trigger).success
        assert "playing" in run.user.call("get_simulation_state", Trigger).message


def test_one_that_may_only_look_is_told_so(run):
    with bridging(
        run.endpoint,
        ["-r", "__ns:=/looker", "-p", f"secure:={run.roles / 'looker'}"],
        run.folder / "looker.log",
    ):
        refused = run.user.call("looker/reset_simulation", Trigger, FIND_SECONDS)
        assert not refused.success and "the role looker may not control the run" in refused.message
        assert run.user.call("looker/get_simulation_state", Trigger).success


def test_a_robot_that_the_role_may_not_drive_is_named(run):
    words = ["-p", f"secure:={run.roles / 'looker'}", "-p", "advised:=[picker]"]
    with bridging(run.endpoint, words, run.folder / "greedy.log") as bridge:
        assert bridge.wait(FIND_SECONDS) == 2
    log = (run.folder / "greedy.log").read_text()
    assert "the role looker may drive none" in log
    assert "Traceback" not in log


def test_a_role_that_another_bridge_has_is_waited_for(run):
    """A second bridge with a role waits until the first one is gone, and the first one drives on.

    So a bridge that is killed and begun again waits for the few seconds for which it still counts.
    """
    log = run.folder / "second.log"
    with bridging(run.endpoint, ["-p", f"secure:={run.roles / 'ros2'}"], log) as second:
        wait_until_it_says("accepts the role ros2 yet", log, second)
    drives(run, 0.5)


def test_a_bridge_with_roles_of_another_run_is_told_so(run, tmp_path):
    """Each run's roles have an authority of their own, and neither accepts the other's."""
    other_roles = make_roles(tmp_path / "others")
    words = ["-p", f"secure:={other_roles / 'ros2'}"]
    with bridging(run.endpoint, words, tmp_path / "other.log") as bridge:
        assert bridge.wait(FIND_SECONDS) == 2
    log = (tmp_path / "other.log").read_text()
    assert "do not accept each other" in log
    assert "Traceback" not in log


@pytest.mark.parametrize(
    ("role", "endpoint", "words"),
    [
        ("ros2", "tcp/127.0.0.1:7447", "a secured run has an endpoint such as tls/127.0.0.1:7447"),
        ("spare", "tls/127.0.0.1:7447", "not the role of a bridge"),
        ("nowhere", "tls/127.0.0.1:7447", "no role.json in it"),
        ("", "tls/127.0.0.1:7447", "tls needs certificates"),
    ],
)
def test_what_does_not_fit_is_told_in_words(role, endpoint, words, run):
    parameters = ["-p", f"endpoint:={endpoint}"]
    if role:
        parameters += ["-p", f"secure:={run.roles / role}"]
    done = subprocess.run(
        [sys.executable, "-m", "orchard_ros2", "--ros-args", *parameters],
        cwd=FOLDER,
        capture_output=True,
        text=True,
        timeout=FIND_SECONDS,
    )
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr
