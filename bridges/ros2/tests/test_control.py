"""A run is paused, stepped, reset and ended from ROS. Its bridge is in the namespace `north`."""

import pytest
from conftest import BEGIN_SECONDS, scene
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a bridge that drives picker_01; all tests of the module share it."""
    orchard_words = ["--rows", "3", "--mode", "realtime", "--without", "picker_01"]
    bridge_words = ["-r", "__ns:=/north", "-p", "driven:=[picker_01]"]
    with scene(tmp_path_factory.mktemp("control"), orchard_words, bridge_words) as run:
        run.clock = run.user.hear("clock", Clock, 10)
        run.user.until(lambda: run.clock, BEGIN_SECONDS)
        yield run


def called(run, service):
    """Call a service that must succeed. Return the state that it answers, and its tick."""
    answer = run.user.call(f"north/{service}", Trigger)
    assert answer.success, answer.message
    state, _, tick = answer.message.partition(", tick ")
    return state, int(tick)


def newest_tick(run):
    """Return the tick of the newest message on /clock."""
    clock = run.clock[-1].clock
    return clock.sec * 10 + clock.nanosec // 10**8


def test_a_paused_run_is_stepped_and_goes_on(run):
    state, paused_at = called(run, "set_simulation_state/paused")
    assert state == "paused"
    assert called(run, "step_simulation") == ("paused", paused_at + 1)
    assert called(run, "get_simulation_state") == ("paused", paused_at + 1)
    run.user.until(lambda: newest_tick(run) == paused_at + 1)
    state, _ = called(run, "set_simulation_state/playing")
    assert state == "playing"
    run.user.until(lambda: newest_tick(run) > paused_at + 5)


def test_a_run_that_plays_is_not_stepped(run):
    answer = run.user.call("north/step_simulation", Trigger)
    assert not answer.success
    assert "pause" in answer.message


def test_a_run_that_is_reset_begins_again(run):
    """Its clock goes back, and on from there."""
    run.user.until(lambda: newest_tick(run) > 20)
    called(run, "reset_simulation")
    run.user.until(lambda: newest_tick(run) < 15, 60)
    run.user.until(lambda: newest_tick(run) > 15)


def test_a_reset_answers_when_the_new_run_stands_at_tick_0(run):
    """It stands until its bridge drives picker_01 again. Services answer also just after that."""
    for _ in range(3):
        run.user.until(lambda: called(run, "get_simulation_state")[1] > 5)
        assert called(run, "reset_simulation") == ("stopped", 0)
        called(run, "get_simulation_state")
        called(run, "set_simulation_state/playing")


def test_topics_are_in_the_namespace_and_the_clock_is_not(run):
    names = {name for name, _ in run.user.node.get_topic_names_and_types()}
    assert {"/north/picker_01/odom", "/north/map", "/clock"} <= names
    assert "/picker_01/odom" not in names


def test_quitting_ends_the_run_and_the_bridge(run):
    """It must be the last test of the module: the run is over after it."""
    state, _ = called(run, "set_simulation_state/quitting")
    assert state == "quitting"
    assert run.bridge.wait(30) == 0
    assert "the run is over: stopped" in (run.folder / "bridge.log").read_text()
