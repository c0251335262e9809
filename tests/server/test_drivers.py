"""Physics' side of the sessions that drive, without a network: what it keeps of those that come and go."""

from local_runs import SMALL
from recorded_messages import KEYS, Run

from orchard.contract.agent import Action, Hold


def coming(drivers, session, names):
    """A session comes, and owns agents."""
    for name in names:
        drivers.token(name, session, True)
    assert drivers.join(names, session) == {}


def going(drivers, session, names):
    for name in names:
        drivers.token(name, session, False)


def test_nothing_is_kept_of_a_session_whose_last_agent_is_with_another():
    run = Run(SMALL, "run1", 10)
    drivers, retired = run.physics.run.drivers, run.physics.bus.retired
    one, other = drivers.roster.names[:2]
    coming(drivers, "first", [one, other])
    going(drivers, "first", [one, other])
    coming(drivers, "second", [one])
    assert retired == [], "the first holds one still"
    coming(drivers, "third", [other])
    assert retired == [KEYS.of("seen", session="first")]


def test_nothing_is_kept_of_a_session_that_is_not_waited_for():
    run = Run(SMALL, "run1", 10)
    drivers, retired = run.physics.run.drivers, run.physics.bus.retired
    names = drivers.roster.names[:2]
    coming(drivers, "first", names)
    drivers.release({names[0]})
    assert retired == []
    drivers.release({names[1]})
    assert retired == [KEYS.of("seen", session="first")]


def test_a_session_that_is_silent_for_too_long_loses_also_its_agents_that_hold():
    run = Run(SMALL, "run1", 10)
    drivers = run.physics.run.drivers
    silent, other = ["worker_01", "traffic"], ["picker_01"]
    coming(drivers, "first", silent), coming(drivers, "second", other)
    engine = run.physics.run.engine
    engine.observe(), engine.due(())
    engine.advance({name: Action(hold=Hold(500)) for name in (*silent, *other)}, {})
    engine.wake(["worker_01", *other])
    drivers.begin(engine.observe(), 0.0)
    assert drivers.answers.missing == {"worker_01", "picker_01"}
    drivers.answers.missing.discard("picker_01")  # it has answered
    drivers.give_up()
    assert sorted(drivers.roster.owners) == ["picker_01"]
    assert sorted(drivers.lost) == ["traffic", "worker_01"]
