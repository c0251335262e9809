"""What drives a robot: sessions that come and go, each agent's part by itself, another client in
its agent's place, or nothing.

Advice is a client's velocity for a robot whose agent goes on; it counts in place of the agent's. A
hold is a velocity that stands until a tick without the agent's being asked. `Run` is physics and a
host in this process (tests/support/recorded_messages.py).
"""

from collections import Counter

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SHORT, SMALL, local_hash
from recorded_messages import KEYS, RUN, Clock, Run

from orchard.contract.agent import STATES, Action, Hold
from orchard.contract.messages import Couple, Uncouple, pack
from orchard.field.geometry import Twist
from orchard.net import host as hosts
from orchard.net.bus import Sample
from orchard.net.refusals import Refused
from orchard.server.commands import WATCHDOG_TICKS, Advised, UnownedCommands
from orchard.sim.world import NONE
from orchard.wire.messages import Advice, Angular, Linear, Odometry, Velocities, Velocity, read

NAME = "picker_01"


def advice(tick: int, x: float = 0.3, turn: float = 0.0) -> Advice:
    return Advice(RUN, tick, Linear(x), Angular(turn))


def driving(tick: int, x: float = 0.0, deeds=()) -> Velocity:
    return Velocity(RUN, tick, Linear(x), Angular(0.0), deeds=list(deeds))


def test_advice_counts_for_half_a_second():
    """After that the agent's velocity counts again."""
    advised = Advised()
    advised.take(NAME, advice(7), 7)
    counts = [NAME in advised.actions(tick, {}, {}) for tick in range(7, 7 + WATCHDOG_TICKS + 2)]
    assert counts == [True] * WATCHDOG_TICKS + [False] * 2


@pytest.mark.parametrize(
    ("tick", "reason"),
    [(7 - WATCHDOG_TICKS, "past tick"), (5, "past tick"), (8, "future tick")],
    ids=["old", "overtaken", "future"],
)
def test_old_overtaken_or_future_advice_is_refused(tick, reason):
    """At tick 7 the newest advice is that of tick 6."""
    advised = Advised()
    advised.take(NAME, advice(6), 6)
    with pytest.raises(Refused, match=reason):
        advised.take(NAME, advice(tick), 7)


@given(st.floats(-1.0, 1.0), st.floats(-0.3, 0.3))
def test_advice_replaces_only_velocity_and_hold(x, turn):
    """The rest of the agent's action stays."""
    action = Action(
        Twist(1.0),
        [Couple("bin_01")],
        doing="picking row 1",
        state="picking",
        steps_done=3,
        hold=Hold(50),
    )
    advised = Advised()
    advised.take(NAME, advice(3, x, turn), 3)
    (got,) = advised.actions(3, {NAME: action}, {}).values()
    assert got.twist == Twist(x, 0.0, turn)
    assert got.hold is None
    assert got.deeds == action.deeds
    assert got.doing == "picking row 1"
    assert got.state == "picking"
    assert got.steps_done == 3


def test_deeds_of_an_unasked_agent_are_not_done_again():
    """The agent is not asked at tick 3, so advice goes with its last action: without its deeds,
    which were done when it was asked.
    """
    advised = Advised()
    advised.take(NAME, advice(3), 3)
    (got,) = advised.actions(
        3, {}, {NAME: Action(Twist(1.0), [Uncouple()], doing="leaving")}
    ).values()
    assert got.deeds == []
    assert got.doing == "leaving"


@pytest.fixture
def run():
    return Run(SMALL, RUN, 100)


def one_tick(run, *samples: tuple[str, bytes]) -> list[str]:
    """Do one step of physics, in which these samples arrive. Return the agents that were asked."""
    harvest = run.physics.run
    harvest.drivers.begin(harvest.engine.observe(), 0.0)
    for key, payload in samples:
        run.physics.bus.inbox.put(Sample(key, payload))
        run.physics.arrivals.take(0.0)
    asked = list(harvest.engine.lookahead._due)
    harvest.step()
    harvest.report()
    return asked


def speed(run) -> float:
    """Return the forward velocity of the robot, m/s."""
    world = run.physics.run.engine.world
    return float(world.twist[world.index[NAME], 0])


def test_advice_wakes_the_agent_of_a_robot_that_holds(run):
    """Advice moves a robot whose agent holds, so the agent is asked again."""
    engine = run.physics.run.engine
    one_tick(run)
    # A tick in which the agent says that it drives at 1 m/s until tick 90.
    engine.observe()
    engine.due(())
    engine.advance({NAME: Action(Twist(1.0), hold=Hold(90))}, {})
    assert NAME not in one_tick(run)
    assert speed(run) == 1.0
    one_tick(run, (KEYS.of("advice", NAME), pack(advice(engine.tick))))
    assert speed(run) == 0.3
    assert NAME in one_tick(run), "it does not hold what it did not want"
    assert run.physics.run.refusal_totals.counts == {}


def test_a_robot_that_is_stopped_stands_whatever_is_advised(run):
    run.physics.run.engine.stop([NAME])
    one_tick(run, (KEYS.of("advice", NAME), pack(advice(0))))
    assert speed(run) == 0.0


# The key of a message, the message, and why it is refused.
NO_ADVICE = [
    (KEYS.of("advice", "nobody_01"), advice(0), "no such robot"),
    (KEYS.of("advice", "traffic"), advice(0), "no such robot"),
    (KEYS.of("advice", NAME), Advice(RUN, 0, Linear(0.0, 0.5), Angular(0.0)), "out of bounds"),
    (KEYS.of("advice", NAME), Advice("other", 0, Linear(0.5), Angular(0.0)), "other run"),
]


@pytest.mark.parametrize(("key", "message", "reason"), NO_ADVICE)
def test_advice_that_cannot_be_is_refused(run, key, message, reason):
    one_tick(run, (key, pack(message)))
    assert run.physics.run.refusal_totals.counts == {reason: 1}
    assert speed(run) == 0.0


# Of every 300 ticks, those for which advice drives; in the others it lets go.
LETS_GO = 250


class Outside:
    """A client that drives a picker by advice.

    It hears what the agent wants, speeds up slowly to half of that, and lets go every now and then.
    """

    def __init__(self, run: Run) -> None:
        self._net = run.net
        self._speed = 0.0
        self.speeds = []
        # Physics publishes velocities and poses only while a session subscribes to them.
        heard = ("orchard/*/*", KEYS.of("velocity", NAME), KEYS.of("pose", NAME))
        run.physics.bus.is_heard = lambda keys: keys in heard
        run.net.on_put = self.hear

    def hear(self, key: str, payload: bytes) -> None:
        if key == KEYS.of("pose", NAME):
            self.speeds.append(read(payload, Odometry).twist.linear.x)
        elif (
            key == KEYS.of("velocity", NAME)
            and (wanted := read(payload, Velocity)).tick % 300 < LETS_GO
        ):
            self._speed = min(self._speed + 0.02, 0.5 * wanted.linear.x)
            self._net.put(
                None,
                KEYS.of("advice", NAME),
                pack(advice(wanted.tick, self._speed, 0.5 * wanted.angular.z)),
            )


def test_a_harvest_with_outside_velocities_finishes():
    run = Run(SHORT, RUN, 20_000)
    outside = Outside(run)
    end = run.to_the_end()
    assert end.why == "harvested"
    assert end.summary["rows_picked"] == 3
    assert end.summary["bins_delivered"] == 3
    assert end.summary["violations"] == []
    assert end.summary["messages_refused"] == {}
    assert end.summary["collisions"] == 0
    assert 0.4 < max(outside.speeds[:LETS_GO]) <= 0.5, (
        "it speeds up to half of what the agent wants"
    )
    assert max(outside.speeds) == 1.0, "where it lets go, the agent drives"


def test_a_deed_comes_with_the_velocity_of_an_unowned_robot(run):
    """No session owns the picker. Its bin is uncoupled at one tick, and coupled at the next."""
    world = run.physics.run.engine.world
    one_tick(run)
    one_tick(run, (KEYS.of("velocity", NAME), pack(driving(1, deeds=[Uncouple()]))))
    assert world.coupled[world.index[NAME]] == NONE
    bin_ = run.engine.layout.starts[world.index[NAME]].bin
    one_tick(run, (KEYS.of("velocity", NAME), pack(driving(2, deeds=[Couple(bin_)]))))
    assert world.coupled[world.index[NAME]] == world.index[bin_]


def test_a_deed_is_done_once_beside_a_bare_velocity():
    unowned = UnownedCommands(Clock())
    unowned.take(NAME, driving(0, deeds=[Uncouple()]))
    unowned.take(NAME, driving(0, 0.5))
    assert unowned.actions(0)[NAME] == Action(Twist(0.5), [Uncouple()])
    unowned.begin(1)
    assert unowned.actions(1)[NAME] == Action(Twist(0.5))


def coming(drivers, session, names):
    """Let a session join with these agents."""
    for name in names:
        drivers.token(name, session, True)
    assert drivers.join(names, session) == {}


def going(drivers, session, names):
    """Let a session's tokens go."""
    for name in names:
        drivers.token(name, session, False)


def test_nothing_is_kept_of_a_session_without_agents(run):
    """When another session has taken the last of its agents, the bus retires its key `seen`."""
    drivers = run.physics.run.drivers
    retired = run.physics.bus.retired
    first, other = drivers.roster.names[:2]
    coming(drivers, "first", [first, other])
    going(drivers, "first", [first, other])
    coming(drivers, "second", [first])
    assert retired == [], "the first holds one still"
    coming(drivers, "third", [other])
    assert retired == [KEYS.of("seen", session="first")]


def test_nothing_is_kept_of_a_session_that_is_not_waited_for(run):
    drivers = run.physics.run.drivers
    retired = run.physics.bus.retired
    names = drivers.roster.names[:2]
    coming(drivers, "first", names)
    drivers.release({names[0]})
    assert retired == []
    drivers.release({names[1]})
    assert retired == [KEYS.of("seen", session="first")]


def test_a_silent_session_loses_also_agents_that_hold(run):
    """Session first owns worker_01, which is asked, and traffic, which holds and is not asked."""
    drivers = run.physics.run.drivers
    silent = ["worker_01", "traffic"]
    other = ["picker_01"]
    coming(drivers, "first", silent)
    coming(drivers, "second", other)
    engine = run.physics.run.engine
    engine.observe()
    engine.due(())
    engine.advance({name: Action(hold=Hold(500)) for name in (*silent, *other)}, {})
    engine.wake(["worker_01", *other])
    drivers.begin(engine.observe(), 0.0)
    assert drivers.answers.missing == {"worker_01", "picker_01"}
    # Session second has answered.
    drivers.answers.missing.discard("picker_01")
    drivers.give_up()
    assert sorted(drivers.roster.owners) == ["picker_01"]
    assert sorted(drivers.lost) == ["traffic", "worker_01"]


TICKS = 30
# Ticks of a run in which each message of a robot is wrong.
FEW = 8
# The column of the state "broken" in the counts of ticks in each state.
BROKEN = STATES.index("broken")


def with_a_fault(payload: bytes, fault: dict) -> bytes:
    """Return a message in which the part of a robot is wrong."""
    message = msgpack.unpackb(payload)
    message["velocities"].get("picker_01", {}).update(fault)
    return msgpack.packb(message)


# Fields of a robot's part that no such part may have: of another type, too large, or unknown.
FAULTS = {
    "a truth as a number of steps": {"steps_done": True},
    "a number as a velocity": {"twist": 5},
    "too fast": {"twist": [101.0]},
    "an unknown field": {"unknown": 1},
    "an unknown deed": {"deeds": [{"type": "dig"}]},
    "bytes as a text": {"doing": b"bytes"},
    "a text too long": {"doing": "x" * 201},
    "a robot that moves sideways": {"twist": [0.0, 1.0]},
    "too many requests": {"requests": [["traffic", {"type": "where"}]] * 501},
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_refused_part_stops_this_robot_and_delays_no_other(fault, monkeypatch, caplog):
    """The messages of a host have a part for each robot. That of picker_01 is wrong at each tick.

    Physics asks for it again, up to 5 times. That is soon, and long before its patience of 4 s is
    over, after which the host would lose its agents (`lost`).
    """
    run = Run(SMALL.model_copy(update={"rows_to_pickers": "balanced"}), "run1", FEW)
    run.physics.run.drivers.answers._patience = 4.0
    send = run.host.bus.publish

    def publish(key, payload, newest_wins=False):
        if key.endswith("/velocities"):
            payload = with_a_fault(payload, fault)
        send(key, payload, newest_wins)

    monkeypatch.setattr(run.host.bus, "publish", publish)
    end = run.to_the_end()
    assert end.tick == FEW
    assert end.why == "duration"
    assert not any(key.endswith("/lost") for key, _ in run.net.sent), (
        "physics never waited for it in vain"
    )
    world = run.engine.world
    account = run.engine.states.counts.ticks
    assert run.physics.run.refusal_totals.counts.total() >= FEW
    assert "picker_01: " in caplog.text
    assert world.distance[world.index["picker_01"]] == 0.0
    assert world.distance[world.index["picker_02"]] > 0.1
    assert account["picker_01"][BROKEN] == FEW
    assert account["picker_02"][BROKEN] == 0


def test_velocities_too_large_for_one_message_go_in_several(monkeypatch):
    """A message may have 1,000 bytes here. The first one has the memories of all agents, too."""
    monkeypatch.setattr(hosts, "MAX_PAYLOAD", 1000)
    run = Run(SMALL, "run1", TICKS)
    assert run.to_the_end().hash == local_hash(SMALL, TICKS)
    answers = Counter(
        read(payload, Velocities).tick
        for key, payload in run.net.sent
        if key.endswith("/velocities")
    )
    assert answers[0] > 2
    assert run.physics.run.refusal_totals.counts.total() == 0
