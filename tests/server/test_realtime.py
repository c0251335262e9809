"""Realtime: the clock goes on, the newest velocity counts, and a robot without new ones stands.

First the rules alone: the barrier, which takes answers of agents, on a clock that the test sets.
Then whole runs over the simulated network.
"""

import signal

import msgspec
import pytest
from fleet import wait_for
from local_runs import SHORT, SMALL, TOY
from recorded_messages import RUN, Clock, heard_at, letter, roster
from recorded_messages import ReadQuery as Query

from orchard.contract.agent import Action, Heard
from orchard.contract.mail import given_by
from orchard.contract.messages import Couple, StateRequest, Yes, pack
from orchard.field.geometry import Twist
from orchard.net.mailbox import STALE_TICKS, LatestObservations, RealtimeMailbox
from orchard.net.refusals import Refused
from orchard.server.barriers import SLACK, Delays, LockstepBarrier, RealtimeBarrier
from orchard.server.commands import UnownedCommands
from orchard.wire.messages import (
    Angular,
    Answered,
    AskedOf,
    Linear,
    Received,
    Report,
    Seen,
    Velocity,
)

# s of wall time to a tick.
STEP = 0.125
COUPLE = Couple("bin_01")


def live(*held):
    """Return a barrier in realtime, and its clock. Session a holds picker_01, or as `held` says."""
    clock = Clock()
    return RealtimeBarrier(roster(*held or [("picker_01", "a")]), STEP, clock), clock


def driving(tick, x=1.0, owner="a", **more):
    """Return the arguments of `take` for an answer to a tick: forward at x, m/s."""
    return owner, tick, Report(Twist(x), **more)


def velocity(tick):
    return Velocity(RUN, tick, Linear(1.0), Angular(0.0))


def driven(barrier, clock, ticks):
    """Return the forward velocities of picker_01 in the next ticks, m/s, if no new answer comes."""
    speeds = []
    for _ in range(ticks):
        action = barrier.actions().get("picker_01", Action())
        speeds.append(action.twist.x)
        clock.now += STEP
        barrier.open(barrier.tick + 1)
    return speeds


def test_a_velocity_drives_on_for_half_a_second():
    """That is five ticks of 0.125 s, the one that begins at 0.5 s included. After the last of them
    it is too old to count, too.
    """
    barrier, clock = live()
    barrier.open(0)
    barrier.take("picker_01", *driving(0))
    assert driven(barrier, clock, 9) == [1.0] * 5 + [0.0] * 4
    with pytest.raises(Refused, match="past tick"):
        barrier.take("picker_01", *driving(3))


@pytest.mark.parametrize(
    ("first", "later", "steps"),
    [(0.01, 0.06, 4), (0.01, 0.02, 5), (0.09, 0.06, 5), (0.09, 0.02, 6)],
    ids=[
        "misses its own step",
        "misses it, and is in time for another",
        "half a second",
        "one step more",
    ],
)
def test_an_unheld_robot_moves_for_half_a_second_in_realtime(first, later, steps):
    """It moves for five steps of 0.1 s, one less or one more.

    The velocity for tick 0 comes 0.05 s after the pose of tick 0. `first`, `later`: s from a pose
    to the step of its tick, at tick 0 and at the later ones. They depend on when other agents
    answer.
    """
    clock = Clock()
    unowned = UnownedCommands(clock)
    moved = 0
    moments = [(0.05, "velocity comes"), (first, "step")]
    for tick in range(1, 10):
        moments.append((0.1 * tick + later, "step"))
    begun = clock.now
    tick = 0
    for moment, event in sorted(moments):
        clock.now = begun + moment
        if event == "velocity comes":
            unowned.take("picker_01", velocity(0))
        else:
            moved += "picker_01" in unowned.actions(tick)
            tick += 1
            unowned.begin(tick)
    assert moved == steps


@pytest.mark.parametrize("pause", [0.0001, 10.0], ids=["full speed", "a slow run"])
def test_an_unheld_robot_moves_for_half_a_second_in_lockstep(pause):
    """In lockstep it is half a second of simulated time, however long physics waits."""
    clock = Clock()
    unowned = UnownedCommands(clock, LockstepBarrier.watchdog)
    moved = 0
    unowned.take("picker_01", velocity(0))
    for tick in range(20):
        moved += "picker_01" in unowned.actions(tick)
        clock.now += pause
        unowned.begin(tick + 1)
    assert moved == 5
    with pytest.raises(Refused, match="past tick"):
        unowned.take("picker_01", velocity(15))


def test_the_newest_velocity_counts_although_it_is_late():
    barrier, clock = live()
    for tick in range(3):
        barrier.open(tick)
        clock.now += STEP
    barrier.take("picker_01", *driving(1, 0.5))
    assert barrier.actions()["picker_01"].twist == Twist(0.5)
    barrier.take("picker_01", *driving(2, 0.7))
    assert barrier.actions()["picker_01"].twist == Twist(0.7)
    for wrong, reason in [
        (driving(1), "past tick"),
        (driving(2), "answered already"),
        (driving(9), "future tick"),
    ]:
        with pytest.raises(Refused, match=reason):
            barrier.take("picker_01", *wrong)
    with pytest.raises(Refused, match="not the owner"):
        barrier.take("picker_01", *driving(2, owner="b"))


def test_an_exact_velocity_drives_one_step_from_its_pose():
    """An agent that must stop at an exact place says so (`once`): its velocity drives for one step,
    and only if the robot is still where the agent saw it.
    """
    barrier, clock = live()
    barrier.open(0)
    barrier.take("picker_01", *driving(0, once=True))
    assert driven(barrier, clock, 2) == [1.0, 0.0]
    barrier.take("picker_01", *driving(1, 0.5, once=True))
    assert driven(barrier, clock, 2) == [0.5, 0.0], "late, but the robot has stood since"
    barrier.take("picker_01", *driving(2, 0.5, once=True))
    assert driven(barrier, clock, 1) == [0.0], "late, and the robot has moved since"


def test_deeds_are_done_once_and_nothing_that_was_said_is_lost():
    """The answer to tick 0 comes after its step, with a deed and a memory. The answer to tick 1
    takes its place: the velocity is the new one, and deed and memory stay.
    """
    barrier, clock = live()
    barrier.open(0)
    barrier.take("picker_01", *driving(0, deeds=[COUPLE], memory=b"old"))
    clock.now += STEP
    barrier.open(1)
    barrier.take("picker_01", *driving(1))
    assert barrier.actions()["picker_01"].deeds == [COUPLE]
    assert barrier.reports["picker_01"].memory == b"old"
    barrier.open(2)
    assert barrier.actions()["picker_01"].deeds == []
    assert barrier.reports == {}


def test_letters_are_told_once_beside_a_bare_velocity():
    barrier, clock = live()
    barrier.open(0)
    answers = given_by(Action(answers=[(Heard("bin_01", 0, 0, StateRequest()), Yes())]))
    barrier.take("picker_01", *driving(0, requests=[("bin_01", StateRequest())], answers=answers))
    clock.now += STEP
    barrier.open(1)
    barrier.take("picker_01", *driving(1, 0.5))
    assert barrier.actions()["picker_01"].twist.x == 0.5
    assert len(barrier.reports["picker_01"].requests) == 1
    assert barrier.reports["picker_01"].answers == answers


def test_a_session_in_time_has_longer_than_one_that_was_late():
    """For a session that was in time physics waits SLACK longer than a tick; for one that missed
    the last tick it waits half a tick.

    bin_01 never answers. A tick that begins late by more than half a tick counts as late, and its
    delay is taken off the wait.
    """
    barrier, clock = live(("picker_01", "a"), ("bin_01", "b"))
    barrier.open(0)
    assert barrier.deadline == pytest.approx(clock.now + STEP + SLACK)
    barrier.take("picker_01", *driving(0))
    assert barrier.give_up() == set()
    barrier.actions()
    clock.now += STEP
    barrier.open(1, lag=0.15)
    assert barrier.deadline == pytest.approx(clock.now + STEP + SLACK - 0.15)
    barrier.take("picker_01", *driving(1))
    assert barrier.deadline == pytest.approx(clock.now + STEP / 2)
    barrier.actions()
    barrier.open(2, lag=10.0)
    assert barrier.deadline == pytest.approx(clock.now + STEP / 2), "the clock does not wait"
    figures = barrier.figures()
    assert figures["ticks_late"] == 2
    assert figures["velocities_missed"] == 2


def test_the_robot_of_a_session_that_is_gone_stands_at_once():
    barrier, _ = live()
    barrier.open(0)
    barrier.take("picker_01", *driving(0))
    barrier.release("picker_01")
    assert barrier.actions() == {}


def test_mail_is_heard_at_the_next_tick_whichever_that_is():
    box = RealtimeMailbox(RUN)
    query = Query(letter(tick=7))
    box.join(5)
    box.hear("picker_01", query)
    (heard,) = heard_at(box, 9)
    box.write("picker_01", Action(answers=[(heard, Yes())]))
    box.close()
    assert query.replies == [Received(RUN, 7), Answered(RUN, 9, Yes())]
    assert query.dropped
    assert heard_at(box, 10) == []


def test_answers_come_when_they_come_and_silence_ends():
    box = RealtimeMailbox(RUN)
    box.join(5)
    box.deliver(5)
    # The request to picker_01 is answered, and that to picker_02 is not.
    one, _ = box.write(
        "bin_01", Action(requests=[("picker_01", StateRequest()), ("picker_02", StateRequest())])
    )
    assert box.is_settled(6, [AskedOf("picker_01", "bin_01", 7)]), "no tick waits for mail"
    box.replied(one, pack(Received(RUN, 5)))
    box.replied(one, pack(Answered(RUN, 11, Yes())))
    one.final = True
    assert [reply.body for reply in box.deliver(12)["bin_01"].replies] == [Yes()]
    assert box.deliver(5 + STALE_TICKS) == {}
    assert [reply.body for reply in box.deliver(6 + STALE_TICKS)["bin_01"].replies] == [None]
    with pytest.raises(Refused, match="past tick"):
        box.hear("bin_01", Query(letter(tick=1)))


def test_the_newest_tick_is_seen_and_a_repetition_is_no_news():
    latest = LatestObservations(RUN, ["traffic"], [])
    for tick in (3, 5, 5):
        latest.seen(pack(nothing_at(tick)))
        assert latest.tick == tick
    with pytest.raises(Refused, match="past tick"):
        latest.seen(pack(nothing_at(4)))


def test_what_is_seen_without_a_body_that_is_held_is_refused():
    latest = LatestObservations(RUN, ["picker_01"], ["picker_01"])
    with pytest.raises(Refused, match="bodies are missing"):
        latest.seen(pack(msgspec.structs.replace(nothing_at(3), due=["picker_01"])))
    with pytest.raises(Refused, match="another session"):
        latest.seen(pack(nothing_at(3)))
    assert latest.tick == -1


def test_delays_are_told_by_the_share_that_is_below():
    """Delays are counted by tenths of a millisecond. `below(50)` is the delay, ms, below which half
    of them are, rounded up. Of 0 to 99 ms and one of 7 s, 99 % are below 99.1 ms.
    """
    delays = Delays()
    assert delays.below(50) == 0.0
    for milliseconds in range(100):
        delays.add(milliseconds / 1000 + 1e-5)
    delays.add(7.0)
    assert (delays.below(50), delays.below(99)) == (50.1, 99.1)


def nothing_at(tick):
    """Return the message of a tick at which an agent sees nothing."""
    return Seen(RUN, tick, ["traffic"], [], b"", b"", {}, {}, [])


def test_the_clock_goes_on_while_a_host_hangs(fleet):
    fleet.physics(SMALL, "--mode", "realtime", "--speed", "2")
    someone = fleet.client()
    clock = someone.hear("orchard/clock")
    poses = someone.hear("orchard/worker_01/pose")
    fleet.host("--without", "worker_01", agents="calling_agents:cast")
    hung = fleet.host("--only", "worker_01", agents="calling_agents:steady")
    wait_for(poses, lambda pose: pose["twist"]["linear"]["x"] == 0.5)
    hung.signal(signal.SIGSTOP)
    begun = fleet.scheduler.now
    # The newest tick: no later one waits to be read.
    first = wait_for(clock, lambda message: clock.empty())["tick"]
    last = wait_for(clock, lambda message: message["tick"] >= first + 25)["tick"]
    # At --speed 2 there are 20 ticks a second.
    assert (last - first) / 20 == pytest.approx(fleet.scheduler.now - begun, abs=0.3)
    wait_for(poses, lambda pose: pose["tick"] >= last - 5 and pose["twist"]["linear"]["x"] == 0.0)
    hung.signal(signal.SIGCONT)
    wait_for(poses, lambda pose: pose["tick"] > last and pose["twist"]["linear"]["x"] == 0.5)
    fleet.stop()


def test_a_robot_whose_link_is_cut_stands_and_drives_again(fleet):
    """The link is down for 5 s, which are 100 ticks at --speed 2; the robot stands within 1 s."""
    fleet.physics(SMALL, "--mode", "realtime", "--speed", "2")
    poses = fleet.client().hear("orchard/worker_01/pose")
    fleet.host("--without", "worker_01", agents=TOY)
    fleet.host("--only", "worker_01", agents="calling_agents:steady")
    down = wait_for(poses, lambda pose: pose["twist"]["linear"]["x"] == 0.5)["tick"]
    fleet.network.cut(fleet.hosts[1].name, 5.0)
    stands = wait_for(poses, lambda pose: pose["twist"]["linear"]["x"] == 0.0)["tick"]
    drives = wait_for(poses, lambda pose: pose["twist"]["linear"]["x"] == 0.5)["tick"]
    assert stands <= down + 20
    assert 100 <= drives - down < 150, "the clock goes on"
    fleet.stop()


@pytest.mark.soak
def test_a_whole_harvest_in_realtime(fleet):
    fleet.physics(SHORT, "--mode", "realtime", "--speed", "10")
    ends = fleet.client().hear("orchard/end")
    fleet.share(2)
    fleet.end(10_000.0)
    summary = ends.get()["summary"]
    assert summary["finished"]
    assert summary["bins_delivered"] == 3
    assert summary["mode"] == "realtime"
    assert {"ticks_late", "velocities_missed"} <= summary.keys()
