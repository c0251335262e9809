"""A run is paused and stepped from ROS. Its bridge is in a namespace."""

import pytest
from conftest import BEGIN_SECONDS, scene
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with scene(
        tmp_path_factory.mktemp("control"),
        ["--rows", "3", "--mode", "realtime", "--without", "picker_01"],
        ["-r", "__ns:=/north", "-p", "driven:=[picker_01]"],
    ) as made:
        made.clock = made.user.hear("clock", Clock, 10)
        made.user.until(lambda: made.clock, BEGIN_SECONDS)
        yield made


def told(run, service):
    answer = run.user.call(f"north/{service}", Trigger)
    assert answer.success, answer.message
    state, _, tick = answer.message.partition(", tick ")
    return state, int(tick)


def ticks(run):
    return [stamp.clock.sec * 10 + stamp.clock.nanosec // 10**8 for stamp in run.clock]


def test_a_paused_run_is_stepped_and_goes_on(run):
    state, at = told(run, "set_simulation_state/paused")
    assert state == "paused"
    assert told(run, "step_simulation") == ("paused", at + 1)
    assert told(run, "get_simulation_state") == ("paused", at + 1)
    run.user.until(lambda: ticks(run)[-1] == at + 1)
    assert told(run, "set_simulation_state/playing")[0] == "playing"
    run.user.until(lambda: ticks(run)[-1] > at + 5)


def test_a_run_that_plays_is_not_stepped(run):
    refused = run.user.call("north/step_simulation", Trigger)
    assert not refused.success and "pause" in refused.message


def test_a_run_that_is_reset_begins_again(run):
    run.user.until(lambda: ticks(run)[-1] > 20)
    told(run, "reset_simulation")
    run.user.until(lambda: ticks(run)[-1] < 15, 60)
    run.user.until(lambda: ticks(run)[-1] > 15)


def test_a_reset_answers_when_the_new_run_stands_at_tick_0(run):
    """It stands until its bridge drives picker_01 again."""
    for _ in range(3):
        run.user.until(lambda: told(run, "get_simulation_state")[1] > 5)
        assert told(run, "reset_simulation") == ("stopped", 0)
        for service in ("get_simulation_state", "set_simulation_state/playing"):
            told(run, service)


def test_topics_are_in_the_namespace_and_the_clock_is_everybodys(run):
    names = {name for name, _ in run.user.node.get_topic_names_and_types()}
    assert {
        "/north/picker_01/odom",
        "/north/map",
        "/clock",
    } <= names and "/picker_01/odom" not in names


def test_quitting_ends_the_run_and_the_bridge(run):
    assert told(run, "set_simulation_state/quitting")[0] == "quitting"
    assert run.bridge.wait(30) == 0
    assert "the run is over: stopped" in (run.folder / "bridge.log").read_text()
