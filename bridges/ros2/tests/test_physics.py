"""Whether the physics of a run is there, by its tokens: functions of data, in virtual time."""

import pytest
from orchard_ros2 import physics
from orchard_ros2.physics import BEGIN_SECONDS, GOES_SECONDS, PhysicsWatch

BEGIN = 100.0  # s, the virtual time at which each test begins


class Clock:
    """Virtual time, s. `at`: time -> a function that is called then, while something sleeps."""

    def __init__(self):
        self.now = BEGIN
        self.at = {}

    def sleep(self, seconds):
        """Let time pass, and do what is due by then."""
        self.now += seconds
        for due in list(self.at):
            if due <= self.now:
                self.at.pop(due)()


@pytest.fixture
def clock(monkeypatch):
    """The clock by which a watch waits."""
    clock = Clock()
    monkeypatch.setattr(physics, "monotonic", lambda: clock.now)
    monkeypatch.setattr(physics, "sleep", clock.sleep)
    return clock


@pytest.fixture
def watch(clock):
    """The physics of an open run, with one token."""
    watch = PhysicsWatch(are_names_reused=False)
    watch.note_token("one", is_up=True)
    return watch


def test_an_end_counts_once_the_token_is_gone(watch):
    watch.note_end("harvested")
    assert watch.why_over == ""
    watch.note_token("one", is_up=False)
    assert watch.why_over == "the run is over: harvested"


def test_a_token_that_goes_without_an_end_ends_nothing(watch):
    watch.note_token("one", is_up=False)
    assert not watch.is_up and watch.why_over == ""


def test_an_end_long_before_the_token_goes_does_not_count(watch, clock):
    """Any client may publish an end in an open run. Physics alone takes its token away."""
    watch.note_end("forged")
    clock.now += GOES_SECONDS
    watch.note_token("one", is_up=False)
    assert watch.why_over == ""


def test_of_two_tokens_one_is_enough(watch):
    watch.note_token("two", is_up=True)
    watch.note_token("one", is_up=False)
    assert watch.is_up


def test_a_query_waits_for_the_run_after_a_reset(watch, clock):
    """Physics comes back 7 s after the reset. A second query does not wait again."""
    watch.note_reset()
    clock.at[BEGIN + 7.0] = lambda: watch.note_token("two", is_up=True)
    watch.await_newest_run()
    assert clock.now == pytest.approx(BEGIN + 7.0, abs=0.1)
    watch.await_newest_run()
    assert clock.now == pytest.approx(BEGIN + 7.0, abs=0.1)


def test_a_query_waits_once_for_a_run_that_does_not_come(watch, clock):
    """A query gives up after BEGIN_SECONDS. A second query does not wait again."""
    watch.note_reset()
    watch.await_newest_run()
    assert clock.now == pytest.approx(BEGIN + BEGIN_SECONDS, abs=0.1)
    watch.await_newest_run()
    assert clock.now == pytest.approx(BEGIN + BEGIN_SECONDS, abs=0.1)


@pytest.mark.parametrize(
    ("are_names_reused", "has_begun"),
    [(True, True), (False, False)],
    ids=["secured run", "open run"],
)
def test_a_token_of_the_same_name_is_new_in_a_secured_run(clock, are_names_reused, has_begun):
    """In an open run it is the old one, which was only cut off for a moment."""
    watch = PhysicsWatch(are_names_reused)
    watch.note_token("one", is_up=True)
    watch.note_request()
    assert not watch.has_begun_again
    watch.note_token("one", is_up=False)
    watch.note_token("one", is_up=True)
    assert watch.has_begun_again == has_begun


def test_a_reset_that_was_asked_for_ends_with_a_new_token(watch, clock):
    """Physics comes back 3 s after the request."""
    watch.note_request()
    clock.at[BEGIN + 3.0] = lambda: watch.note_token("two", is_up=True)
    watch.await_requested_run()
    assert watch.has_begun_again
    assert clock.now == pytest.approx(BEGIN + 3.0, abs=0.1)
