"""Lookahead: an agent that holds is asked when its hold ends, not earlier; no result changes.

A hold says until which tick a velocity stands, and which zones the engine watches for the agent
meanwhile (`Hold`). `Lookahead` asks the agents whose hold has ended; `IgnoredHolds` asks all;
`CheckedHolds` asks all, and names each whose answer is not the one that it held.
"""

import logging
import math

import numpy as np
import pytest
from drawn_scenarios import SCENARIOS
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from local_runs import SMALL, local_hash, played
from stage import Stage, empty_orchard

from orchard.behaviour.carrier import HeardCall, hear_calls
from orchard.behaviour.picker import Picker
from orchard.behaviour.walker import Person, WalkerMemory, ticks_within
from orchard.contract.agent import MOST_HOLD, Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Call, No, StateRequest, Uncouple
from orchard.contract.zone import Zone, is_left_freer
from orchard.field.geometry import STILL, Twist
from orchard.field.scenario import LaserSettings, People, Scenario
from orchard.local import Local
from orchard.plans.steps import DriveTo
from orchard.sim.kernels.holds import begin_holds
from orchard.sim.lookahead import CheckedHolds, IgnoredHolds, Lookahead

AHEAD = Zone(0.0, 2.0, -0.5, 0.5)


class Holder:
    """Gives one velocity and one hold whenever it is asked, and acts at given ticks.

    It notes at which ticks it is asked. `until`: for how many ticks it holds. `acts`: tick -> what
    else its action has. `zones`: those of its hold.
    """

    Memory = dict
    holds = True

    def __init__(self, twist=STILL, until=10**9, acts=None, **zones):
        self.twist = twist
        self.until = until
        self.zones = zones
        self.acts = acts or {}
        self.asked = []

    def tick(self, seen, mail, memory):
        self.asked.append(seen.tick)
        answers = [(heard, No("no")) for heard in mail.requests]
        hold = Hold(min(seen.tick + self.until, 10**10), **self.zones)
        return Action(
            self.twist, memory=memory, answers=answers, hold=hold, **self.acts.get(seen.tick, {})
        )


def stage_of(scenario=None, **agents):
    """Return a stage on which these agents act, and all others hold."""
    stage = Stage(scenario or empty_orchard())
    stage.local.agents = {name: Holder() for name in stage.local.agents} | agents
    return stage


def asked_in(ticks, agent, scenario=None, name="picker_01", **others):
    """Run for some ticks, with an agent for the body `name`. Return the ticks at which it was
    asked.
    """
    stage = stage_of(scenario, **{name: agent}, **others)
    stage.run(ticks / 10)
    return agent.asked


def same_run(scenario, ticks):
    """Assert that holds change neither the hash nor a figure of a run.

    Return the share of agents that were asked.
    """
    engines = {}
    for holds in (Lookahead, IgnoredHolds):
        stage = Stage(scenario, holds=holds, is_hashed=True)
        stage.run(ticks / 10)
        engines[holds] = stage.local.engine
    with_holds = engines[Lookahead]
    without = engines[IgnoredHolds]
    assert with_holds.hash == without.hash
    assert with_holds.states.figures() == without.states.figures()
    assert without.asked_share == 1.0
    return with_holds.asked_share


@given(SCENARIOS, st.integers(50, 400))
@settings(max_examples=8)
def test_holds_change_no_result(scenario, ticks):
    same_run(scenario, ticks)


@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_holds_change_no_result_and_few_are_asked(dispatch):
    scenario = Scenario(rows=3, row_length=40.0, picking_speed=1.0, dispatch=dispatch)
    assert same_run(scenario, 1700) <= 0.15


def test_holds_change_no_result_of_a_bin_with_its_picker():
    """A bin of 27.1 m is full 2.9 m before the end of a row of 30 m."""
    same_run(
        empty_orchard(
            rows=3, carriers=3, row_length=30.0, metres_per_bin=27.1, dispatch="predictive"
        ),
        1500,
    )


@given(SCENARIOS, st.data())
@settings(max_examples=4)
def test_holds_change_no_stopped_reset_and_handed_over_run(scenario, data):
    ticks = sorted(data.draw(st.lists(st.integers(1, 200), min_size=4, max_size=4)))
    robot = data.draw(st.sampled_from(["picker", "carrier"]))
    hashes = [disturbed_run(scenario, holds, robot, ticks) for holds in (Lookahead, IgnoredHolds)]
    hashes.append(disturbed_run(scenario, CheckedHolds, robot, ticks))
    assert hashes[0] == hashes[1]
    assert hashes[0] == hashes[2]


def disturbed_run(scenario, holds, robot, ticks):
    """Stop robots, wake all agents, reset the robots, and resume the run, at these four ticks.

    Agents are waked as if other processes had taken them over. Return the hash after 220 ticks.
    """
    stopped, taken_over, reset, resumed = ticks
    local = Local(scenario, holds=holds)
    for _ in range(220):
        if local.engine.tick == stopped:
            local.engine.stop([robot])
        if local.engine.tick == taken_over:
            local.engine.wake(local.agents)
        if local.engine.tick == reset:
            local.engine.reset([robot])
        if local.engine.tick == resumed:
            local = Local.resume(local.snapshot(), holds=holds)
        local.tick()
    return local.engine.hash


def test_a_call_no_longer_repeated_is_forgotten():
    """The carrier heard it last at tick 20, and offered itself. At 201 the bin calls as if anew.

    The offer is then forgotten, however long the carrier held: LAST_TICK stands for none.
    """
    calls = {"bin_01": HeardCall(since=10, tick=20, offered=15)}
    hear_calls(calls, Mail([Heard("bin_01", 200, 0, Call(1, "east", 10))]), 201)
    assert calls["bin_01"].offered == LAST_TICK


def test_a_walker_turning_at_the_edge_holds_for_no_time():
    """A dog stays within 6 m of where it began. At the edge it may turn for as long as it likes,
    and not walk on for a tick.
    """
    seen = Observation(
        "dog_01", 60, 6.0 - 1e-9, 0.0, (0.0, 1.0), STILL, np.full(180, np.inf, dtype=np.float32)
    )
    assert ticks_within(seen, WalkerMemory(0.0, 0.0, 0), Twist(yaw=1.0)) == MOST_HOLD
    assert ticks_within(seen, WalkerMemory(0.0, 0.0, 0), Twist(1.0)) == 0


class Silent(Holder):
    """Gives no hold."""

    def tick(self, seen, mail, memory):
        super().tick(seen, mail, memory)
        return Action(memory=memory)


def test_an_agent_without_holds_is_asked_at_every_tick():
    assert asked_in(4, Silent()) == [0, 1, 2, 3]


def test_a_hold_ends_at_its_tick():
    """Its velocity is applied until then."""
    visitor = Holder(Twist(0.5), until=3)
    scenario = empty_orchard(people=People(workers=0, visitors=1))
    stage = stage_of(scenario, visitor_01=visitor)
    x, y, _ = stage.pose("visitor_01")
    stage.run(0.7)
    assert visitor.asked == [0, 3, 6]
    moved = stage.pose("visitor_01")
    assert math.hypot(moved[0] - x, moved[1] - y) == pytest.approx(0.5 * 0.7)


def test_no_agent_holds_for_longer_than_100_s():
    assert asked_in(MOST_HOLD + 2, Holder()) == [0, MOST_HOLD]


def test_mail_ends_a_hold_a_request_and_the_reply_to_an_own_one():
    """A request of tick 0 is heard at tick 1, and its reply at tick 2."""
    asker = Holder(acts={0: {"requests": [("bin_02", StateRequest())]}})
    bin_ = Holder()
    asked_in(5, asker, bin_02=bin_)
    assert bin_.asked == [0, 1], "it is asked for the request"
    assert asker.asked == [0, 2], "it is asked for the reply"


def test_a_refused_step_ends_a_hold():
    # Its bin stays, and soon holds it back: the last steps of the six ticks are refused. The picker
    # is asked right after the first of them.
    picker = Holder(Twist(1.0))
    stage = stage_of(picker_01=picker, bin_01=Holder())
    stage.run(0.6)
    refused = int(stage.world.refused[stage.world.index["picker_01"]])
    assert refused > 0
    assert picker.asked[:2] == [0, 6 - refused + 1]


def test_a_stop_ends_the_hold_of_what_moves():
    scenario = empty_orchard(tractor=True)
    tractor = Holder(Twist(0.5))
    stage = stage_of(scenario, tractor_01=tractor)
    stage.run(0.2)
    stage.local.engine.stop(["tractor_01"])
    stage.run(0.2)
    # The step from tick 2 was not done.
    assert tractor.asked == [0, 3]
    stage.local.engine.reset(["tractor_01"])
    stage.run(0.3)
    assert tractor.asked == [0, 3, 4]


def test_a_change_at_the_bar_ends_the_holds_of_both():
    picker = Holder(acts={0: {"deeds": [Uncouple()]}})
    bin_ = Holder()
    asked_in(4, picker, bin_01=bin_)
    assert picker.asked == bin_.asked
    assert bin_.asked == [0, 1]


def test_another_velocity_at_the_bar_ends_a_hold():
    stage = Stage(empty_orchard())
    bin_ = Holder()
    stage.local.agents["bin_01"] = bin_
    stage.give("picker_01", [DriveTo(x=-30.0, speed=0.1)])
    stage.run(0.3)
    # The picker drives since tick 0.
    assert bin_.asked == [0, 1]


def passed_by(x, y, **zones):
    """Return a worker that holds, with a visitor that starts at a place and walks north past it."""
    scenario = empty_orchard(people=People(workers=1, visitors=1))
    watcher = Holder(**zones)
    stage = stage_of(scenario, worker_01=watcher, visitor_01=Holder(Twist(0.5)))
    stage.put("worker_01", 0.0, -30.0)
    stage.put("visitor_01", x, y, "NORTH")
    return stage, watcher


def test_a_zone_that_becomes_occupied_or_free_ends_a_hold():
    """The visitor walks 5 cm a tick. It starts 3 m south, and passes 1 m ahead of the worker."""
    stage, watcher = passed_by(1.0, -33.0, watch=(AHEAD,))
    stage.run(13)
    entered, left = watcher.asked[1:]
    assert 30 < entered < left < 100
    # It is in the zone for the zone's width of 1 m and its own length of 0.55 m; up to six ticks
    # less or more, because a beam must meet it.
    assert left - entered == pytest.approx((1.0 + 0.55) / 0.05, abs=6)


def test_a_still_zone_ends_a_hold_at_each_change_in_it():
    stage, watcher = passed_by(1.0, -33.0, still=(AHEAD,))
    stage.run(13)
    # While the visitor is in the zone, ranges change at each tick, without a gap.
    assert len(watcher.asked) > 20
    assert watcher.asked[1:] == list(range(watcher.asked[1], watcher.asked[-1] + 1))


def test_another_freer_side_ends_a_hold():
    # The visitor is on the right of the worker, and walks to the left of it. So first the worker's
    # left is freer, within 3 m, and then its right. True: the left.
    stage, watcher = passed_by(1.5, -32.5, freer_within=3.0)
    sides = []
    for _ in range(110):
        sides.append(is_left_freer(stage.local.engine.observe()["worker_01"].scan, 3.0))
        stage.tick()
    changes = [tick for tick in range(1, 110) if sides[tick] != sides[tick - 1]]
    assert sides[0]
    assert changes
    assert watcher.asked == [0, *changes]


scans = arrays(
    np.float32,
    st.sampled_from([60, 180]),
    elements=st.one_of(st.just(np.inf), st.floats(0.0, 10.0, width=32)),
)


@given(scans, st.floats(0.1, 10.0))
def test_agents_and_physics_see_the_same_freer_side(ranges, reach):
    # The arguments of the kernel `begin_holds` are arrays of one agent, which has no hitch and
    # watches no zone. It writes into `was` whether the left is freer.
    was = np.zeros(1, dtype=bool)
    one = np.zeros(1, dtype=np.int64)
    none = np.full((1, 1), -1)
    begin_holds(
        ranges,
        one,
        np.zeros((1, 3)),
        np.full(1, -1),
        one,
        np.zeros((1, 3)),
        was,
        was.copy(),
        none,
        np.zeros((1, 1), dtype=bool),
        np.full(1, reach, dtype=np.float32),
        was,
        np.zeros((1, 2, 180)),
        np.array([0, len(ranges)]),
    )
    assert was[0] == is_left_freer(ranges, reach)


def test_a_steering_walker_is_asked_only_when_that_changes():
    """The worker turns away from a visitor that stands ahead: it is asked when it begins to turn
    and when it ends, and not while it turns.
    """
    stage = Stage(empty_orchard(people=People(workers=1, visitors=1)))
    stage.put("worker_01", 0.0, -30.0, "EAST")
    stage.put("visitor_01", 3.9, -30.3)
    stage.local.agents["visitor_01"] = Holder()
    asked = []
    does = []
    for _ in range(12):
        stage.tick()
        asked.append("worker_01" in stage.local.answers)
        does.append(stage.local.actions["worker_01"].doing)
    assert does.count("turning away") > 4
    assert sum(asked) < 4


def test_an_agent_that_takes_over_is_asked_at_once():
    first = Holder()
    second = Holder()
    played(played(SMALL, 2, worker_01=first), 4, worker_01=second)
    assert first.asked == [0]
    assert second.asked == [2]


class SlowPicker(Picker):
    """A picker that does something more at each tick."""

    def tick(self, seen, mail, memory):
        action = super().tick(seen, mail, memory)
        # It drives at every seventh tick only. The hold of its base class does not know that.
        if seen.tick % 7 != 0:
            action.twist = STILL
        return action


class HoldingVisitor(Person):
    """A person whose class says that it holds."""

    holds = True


def test_a_derived_class_is_asked_unless_it_says_it_holds():
    def times_asked(class_, name):
        """Let a class drive a body for 50 ticks. Return how often it was asked."""
        local = Local(SMALL)
        local.play(name, class_(local.engine.layout, name))
        times = 0
        for _ in range(50):
            local.tick()
            times += name in local.answers
        return times

    assert times_asked(SlowPicker, "picker_01") == 50
    assert times_asked(HoldingVisitor, "worker_01") < 25


@pytest.mark.parametrize(
    "hold",
    [5, Hold(-1), Hold(5, watch=(AHEAD,) * 9), Hold(5, watch=(Zone(float("nan"), 1.0, 0.0, 1.0),))],
)
def test_a_hold_that_is_none_breaks_the_agent(hold, caplog):
    class Wrong:
        Memory = dict
        holds = True

        def tick(self, seen, mail, memory):
            return Action(memory=memory, hold=hold)

    local = played(SMALL, 1, worker_01=Wrong())
    assert local.actions["worker_01"].state == "broken"
    assert "worker_01 raised an error at tick 0" in caplog.text


class Impatient:
    """Says that it stands for 60 s, and turns from tick 9 on."""

    Memory = dict
    holds = True

    def tick(self, seen, mail, memory):
        twist = Twist(yaw=0.5) if seen.tick >= 9 else STILL
        return Action(twist, memory=memory, hold=Hold(600))


def test_a_wrong_hold_is_named_with_its_difference(caplog):
    with caplog.at_level(logging.ERROR):
        local = played(Local(SMALL, holds=CheckedHolds), 12, worker_01=Impatient())
    assert caplog.text.count("holds wrongly") == 1
    assert "worker_01 holds wrongly, tick 9: its answer.twist" in caplog.text
    (violation,) = local.engine.violations()
    assert violation.startswith("worker_01 holds wrongly, tick 9: its answer.twist"), (
        "so the exit code of a run is 1"
    )


def test_built_in_agents_hold_rightly(caplog):
    scenario = Scenario(rows=3, picking_speed=1.0, laser=LaserSettings(noise=0.005))
    assert local_hash(scenario, 1300, holds=CheckedHolds) == local_hash(scenario, 1300)
    assert "holds wrongly" not in caplog.text
