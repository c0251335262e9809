"""The whole protocol on a simulated network: `python -m chaos.simulated` carries out thousands of
such schedules.

A schedule is a run with faults, in virtual time. Its plan says what happens:
`Fault(what, process, tick, delay, seconds)` happens `delay` s after a tick, for some seconds; tick
-1 is before the first one. Its verdict has complaints, one for each promise that was broken. Delays
of faults, and seeds of plans, are such that they hit the moment that a test names: found by trial.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf

import pytest
from command_line import python

from chaos.simulated import __main__ as command
from chaos.simulated.bare_client import BARE_CLIENT
from chaos.simulated.clients import CLIENTS
from chaos.simulated.drawing import WITH_WALKERS, draw
from chaos.simulated.link import Delays
from chaos.simulated.mutations import cut_out
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan
from chaos.simulated.trial import carry_out, shrink
from orchard.server.account import RunAccount
from orchard.wire.keys import PHYSICS


def plan(*faults: Fault, ticks: int = 60, hosts: int = 2, **others) -> Plan:
    """Return a plan with these faults and nothing else. `others`: its other fields."""
    # In realtime the bare client drives a body, so the scene must have people.
    walks = others.get("has_bare_client") and others.get("mode") == "realtime"
    given = {
        "scene": WITH_WALKERS if walks else "rolling",
        "has_logger": False,
        "has_router": False,
        "delays": Delays(),
    } | others
    return Plan(seed=1, ticks=ticks, hosts=hosts, faults=faults, **given)


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_runs_with_faults_keep_their_promises(first):
    verdicts = [carry_out(draw(seed)) for seed in range(first, first + 10)]
    assert {
        verdict.plan.seed: verdict.complaints for verdict in verdicts if verdict.complaints
    } == {}


def test_the_same_seed_gives_the_same_schedule():
    first, again = (carry_out(draw(36), is_traced=True) for _ in range(2))
    assert first.lines == again.lines
    assert first.seconds == again.seconds


@pytest.mark.parametrize("what", sorted(CLIENTS))
def test_a_foreign_client_breaks_no_promise(what):
    # No recorded run is reset.
    assert (
        carry_out(plan(Fault(what, CLIENT, 10, 0.0, 0.5), has_logger=what != "reset")).complaints
        == []
    )


@pytest.mark.parametrize(
    "others", [{"has_logger": True}, {"has_router": True}, {"mode": "realtime"}], ids=str
)
def test_a_run_without_faults_ends_well_and_soon(others):
    verdict = carry_out(plan(**others))
    assert verdict.complaints == []
    # Of virtual time: to load, 6 s of simulation at most, and to end.
    assert verdict.seconds < 15.0


# With these seeds, without faults, a request comes in that moment.
@pytest.mark.parametrize("seed", [20, 67, 91])
def test_a_run_without_faults_refuses_nothing(seed):
    """A request that comes while its host recalls the same mail is no late one."""
    assert carry_out(replace(draw(seed), faults=(), ticks=10)).summary["messages_refused"] == {}


def test_a_mutation_is_found_and_shrinks_to_its_faults():
    drawn = [draw(seed) for seed in range(40)]
    with cut_out("a host never doubts its mail"):
        smallest = next(plan for plan in drawn if carry_out(plan).complaints)
        small = shrink(smallest)
        (complaint,) = carry_out(small).complaints
        assert complaint.startswith("other events or messages than in local mode: tick ")
    assert len(small.faults) <= len(smallest.faults)
    assert carry_out(small).complaints == []


# The two hosts.
ONE = "agents 1"
OTHER = "agents 2"
# Physics is killed again and again, until the host has asked it for its run.
AGAIN_AND_AGAIN = [Fault("kill", PHYSICS, 10, delay) for delay in (0.05, 0.5, 1.0)]
# It begins at a snapshot of tick 180, just before a picker leaves a full bin.
LEAVES_A_BIN = plan(begin=180)
LOSES_A_HOST = plan(Fault("think", ONE, 20, 0.0, 30.0), patience=4.0, ticks=300)
AWAY = plan(Fault("think", ONE, 20, 0.0, 5.0), patience=4.0, ticks=300, delays=Delays(2e-2))
LATE_KILL = Fault("kill", PHYSICS, 250)
STOPS_AND_DIES = plan(
    Fault("stop robots", CLIENT, 10, 0.0, 3.0), Fault("kill", PHYSICS, 10, 0.13), ticks=300
)
# A net is a part of the protocol that keeps a promise. It is named by what the program does without
# it, as in chaos/simulated/mutations.py. For each: a plan that breaks the promise if the net is cut
# out.
MISSED = {
    "physics never sends a tick again": plan(has_router=True, has_bare_client=True),
    "requests of the future are not kept": plan(ticks=200, hosts=3, scene="crowd"),
    "physics waits for no session to leave": plan(
        Fault("cut", ONE, 60, 0.0, 0.3), is_elsewhere=True
    ),
    "a pause makes agents late": plan(
        Fault("think", ONE, 10, 1e-3, 27.0), Fault("pause", CLIENT, 10, 1e-3, 18.0)
    ),
    "a question is sent once": plan(
        Fault("mute", CLIENT, 10, 0.0, 50.0),
        Fault("kill", ONE, 10, 0.05),
        *AGAIN_AND_AGAIN,
        has_router=True,
        hosts=1,
    ),
    "no snapshot is written": plan(Fault("kill", PHYSICS, 280), ticks=300, delays=Delays(1.5e-2)),
    "realtime: old velocities drive on": plan(
        Fault("think", BARE_CLIENT, 50, 0.0, 2.0), ticks=200, mode="realtime", has_bare_client=True
    ),
    "deeds are lost": LEAVES_A_BIN,
    "deeds are done twice": LEAVES_A_BIN,
    "deeds are done a tick late": LEAVES_A_BIN,
    "a silent session keeps its agents that were not asked": LOSES_A_HOST,
    "an agent is not woken": LOSES_A_HOST,
    "what comes quietly wakes nobody": plan(),
    "one snapshot is kept": plan(
        Fault("torn snapshot", PHYSICS, 280), ticks=300, delays=Delays(1e-2)
    ),
    "a snapshot of another run counts": plan(Fault("foreign snapshot", PHYSICS, 40)),
    "figures are kept before the step is reported": plan(
        Fault("kill", PHYSICS, 280), ticks=300, delays=Delays(1e-2)
    ),
    "an emergency stop is not kept": STOPS_AND_DIES,
    "a snapshot forgets which robots are stopped": STOPS_AND_DIES,
    "a paused run does one step too many": replace(
        plan(Fault("pause", CLIENT, 10, 0.0, 0.5)), seed=4
    ),
    "a robot that is reset is not kept": plan(
        Fault("stop robots", CLIENT, 10, 0.0, 0.5), Fault("kill", PHYSICS, 10, 0.7), ticks=300
    ),
    "what a full disk has not taken counts as kept": plan(
        Fault("full disk", PHYSICS, 5, 0.0, 500.0),
        Fault("stop robots", CLIENT, 10, 0.0, 5.0),
        Fault("kill", PHYSICS, 10, 0.5),
        ticks=100,
    ),
    "realtime: a deed is done again": plan(
        Fault("think", ONE, 24, 0.0, 1.0), hosts=1, begin=180, mode="realtime"
    ),
    "a paused run does one step too few": replace(
        plan(Fault("pause", CLIENT, 20, 0.0, 0.5)), seed=2
    ),
    "a pause comes two steps late": plan(Fault("pause", CLIENT, 20, 0.0, 0.5)),
    "a run does not end when it is asked to": plan(Fault("quit", CLIENT, 20)),
    "advice drives for one tick too long": plan(Fault("advise", CLIENT, 10, 0.0, 0.5)),
    "the session of a key is not checked": plan(Fault("lie", CLIENT, 10, 0.0, 0.5)),
    "a reset keeps the seed": replace(plan(Fault("reset", CLIENT, 20)), seed=2),
    "letters are published with the next tick": plan(has_logger=True),
    "of two resets the second one keeps the seed": plan(
        Fault("reset", CLIENT, 10), Fault("reset", CLIENT, 30)
    ),
    "a promised reset does not happen": plan(Fault("reset", CLIENT, 20)),
    "events are published with the next tick": plan(has_logger=True, begin=180),
    "a snapshot forgets which agents were lost": replace(AWAY, faults=(*AWAY.faults, LATE_KILL)),
    "a snapshot forgets what was refused": plan(
        Fault("nonsense", CLIENT, 10, 0.0, 0.5), LATE_KILL, ticks=300, delays=Delays(1e-2)
    ),
    "refusals of a session are added up": plan(
        Fault("late letters", CLIENT, 10, 0.0, 0.5), ticks=200, delays=Delays(1e-2)
    ),
    "a session that is given up keeps its agents": LOSES_A_HOST,
    "a host that is told that it is lost does not join again": AWAY,
    "physics is given up at once": plan(Fault("kill", PHYSICS, 20)),
    "a run begins before it is kept": replace(
        plan(
            Fault("reset", CLIENT, 20),
            Fault("kill", PHYSICS, 20, 0.2, message=3),
            delays=Delays(5e-3),
        ),
        seed=2,
    ),
    "physics keeps the letters of all ticks": plan(ticks=300),
    "a join of a taken agent is not tried again": plan(Fault("vanish", ONE, 40, 0.0, 10.0)),
    "the answer of the session before counts": plan(
        Fault("think", OTHER, 3, 0.0, 3.0), Fault("kill", ONE, 3, 0.1)
    ),
}


@pytest.mark.parametrize("net", MISSED)
def test_a_net_that_is_cut_out_is_missed(net):
    with cut_out(net):
        assert carry_out(MISSED[net]).complaints != []
    assert carry_out(MISSED[net]).complaints == []


# -- one fault after the other, in the middle of a run

FAULTS = {
    "a host before its first tick": [Fault("kill", ONE, -1, 0.3)],
    "both hosts": [Fault("kill", ONE, 40), Fault("kill", OTHER, 40)],
    "a host again and again": [Fault("kill", ONE, tick) for tick in (10, 25, 26)],
    "a host sleeps": [Fault("freeze", ONE, 40, seconds=1.0)],
    "a host sleeps for longer than its lease": [Fault("freeze", ONE, 40, seconds=4.0)],
    "a host vanishes with its machine": [Fault("vanish", ONE, 40)],
    "a link is silent": [Fault("silence", ONE, 40, seconds=1.0)],
    "a link is silent for longer than its lease": [Fault("silence", ONE, 40, seconds=4.0)],
    "all links are silent": [Fault("silence", who, 40, seconds=10.0) for who in (ONE, OTHER)],
    "a link is cut": [Fault("cut", ONE, 40, seconds=5.0)],
    "physics as soon as it is there": [Fault("kill", PHYSICS, -1, 0.3)],
    "physics": [Fault("kill", PHYSICS, 40)],
    "physics and a host": [Fault("kill", PHYSICS, 40), Fault("kill", ONE, 40)],
    "physics, and its newest snapshot is torn": [Fault("torn snapshot", PHYSICS, 140)],
    "physics beside a router": [Fault("kill", PHYSICS, 40)],
    "beside a router the links of physics and of a host": [
        Fault("cut", PHYSICS, 40, seconds=5.0),
        Fault("cut", OTHER, 100, seconds=5.0),
    ],
    "the router twice, and once with a host": [
        Fault("kill", ROUTER, 40),
        Fault("kill", ROUTER, 100),
        Fault("kill", ONE, 100),
    ],
}


@pytest.mark.parametrize("what", FAULTS)
def test_whatever_happens_the_run_goes_on_to_the_same_hash(what):
    assert carry_out(plan(*FAULTS[what], ticks=150, has_router="router" in what)).complaints == []


@pytest.mark.parametrize(
    "fault",
    [
        Fault("kill", who, tick)
        for who, tick in ((ONE, 100), (PHYSICS, 100), (ROUTER, 100), (ROUTER, 299))
    ],
)
def test_in_realtime_too_a_run_goes_on_and_ends_well(fault):
    """The run ends well even if the router is down at its end."""
    verdict = carry_out(
        plan(fault, ticks=300, mode="realtime", has_router=fault.who == ROUTER, has_logger=True)
    )
    assert verdict.complaints == []
    assert verdict.summary["distance_metres"]["picker"] > 5.0


# -- what schedules have found


@pytest.mark.parametrize("delay", [0.1, 0.5, 0.8])
def test_a_run_resumed_before_its_first_tick_waits_for_agents(delay):
    assert carry_out(plan(Fault("kill", RUN_PY, -1, delay))).complaints == []


@pytest.mark.parametrize("tick", [58, 59, 60])
def test_a_host_started_as_the_run_ends_does_not_wait(tick):
    verdict = carry_out(plan(Fault("kill", OTHER, tick)))
    assert verdict.complaints == []
    assert verdict.seconds < 15.0


@pytest.mark.parametrize("delay", [0.0002, 0.002, 0.02, 0.1])
def test_physics_that_dies_after_the_end_keeps_nothing_waiting(delay):
    """The run ends at tick 60. Physics dies soon after that, before or after all have heard it."""
    verdict = carry_out(plan(Fault("kill", PHYSICS, 60, delay)))
    assert verdict.complaints == []
    assert verdict.seconds < 15.0


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.006])
def test_a_harvest_whose_physics_dies_at_its_end_is_over(monkeypatch, delay):
    """Physics writes no snapshot at the end of a harvest.

    If it was started again, it would go back to an older tick, without the hosts that have left.
    """
    over = RunAccount.why_over
    monkeypatch.setattr(
        RunAccount, "why_over", lambda self, ticks: over(self, ticks) and "harvested"
    )
    verdict = carry_out(replace(plan(Fault("kill", PHYSICS, 60, delay)), delays=Delays(5e-3)))
    assert verdict.complaints == ["ended by itself: harvested, at tick 60"]
    assert verdict.seconds < 5.0


@pytest.mark.parametrize("delay", [0.005, 0.01, 0.02, 0.05])
def test_a_request_to_end_during_a_reset_is_not_forgotten(delay):
    """A host hears of the reset late, for its link is silent. Meanwhile run.py is killed, and the
    run asked to end.
    """
    verdict = carry_out(
        plan(
            Fault("silence", OTHER, 20, 0.0, 0.3),
            Fault("reset", CLIENT, 20),
            Fault("kill", RUN_PY, 20, delay),
        )
    )
    assert verdict.complaints == []
    assert verdict.seconds < 60.0


# Of runs that are reset and whose disk is full. With seed 2 the client that resets the run changes
# the scenario, too.
RESET_AND_FULL = {
    "ticks": 150,
    "delays": Delays(4e-3),
}


def test_a_reset_that_the_death_of_physics_would_undo_is_refused():
    """The disk is full, so no snapshot would know of the reset; and then physics is killed."""
    faults = (
        Fault("full disk", PHYSICS, 50, 0.0, 500.0),
        Fault("reset", CLIENT, 100, 0.04),
        Fault("kill", PHYSICS, 100, 0.4),
    )
    verdict = carry_out(replace(plan(*faults, **RESET_AND_FULL), seed=2), is_traced=True)
    assert verdict.complaints == []
    assert any("not kept: no snapshot can be written" in line for line in verdict.lines)


def test_hosts_build_agents_again_if_a_reset_was_not_kept():
    """The disk is full just after the reset, so physics begins with the old seed again.

    If the hosts kept their agents, agents of two scenarios would drive in one run.
    """
    faults = (
        Fault("reset", CLIENT, 0, 0.04),
        Fault("full disk", PHYSICS, 0, 0.12, 500.0),
        Fault("kill", PHYSICS, 0, 1.5),
    )
    assert (
        carry_out(
            replace(plan(Fault("think", OTHER, 0, 0.0, 1.0), *faults, **RESET_AND_FULL), seed=2)
        ).complaints
        == []
    )


def test_a_stop_in_the_tick_of_a_reset_is_of_no_step():
    """The reset ends the run before the step with the stop is done. Seed 2571 draws that."""
    assert carry_out(draw(2571)).complaints == []


@pytest.mark.parametrize("seed", [2495])
def test_a_reset_that_begins_in_another_process_was_wanted(seed):
    """A client asks for a reset of the run, and physics begins it again.

    As seed 2495 draws, run.py is killed just then. The physics of the next run.py begins the run
    again once more. No oracle may take that for a reset for which nobody has asked.
    """
    assert carry_out(draw(seed)).complaints == []


@pytest.mark.parametrize("seed", [1, 2])
def test_a_host_waits_for_physics_beside_a_false_client(seed):
    """Physics never refuses to tell its run, so a refusal comes from another client."""
    faults = (
        Fault("false answers", CLIENT, 20, 0.0, 8.0),
        Fault("kill", PHYSICS, 20, 0.1),
        Fault("kill", ONE, 20, 0.1),
    )
    alone = plan(*faults, has_router=True, has_bare_client=True)
    assert carry_out(replace(alone, seed=seed)).complaints == []


@pytest.mark.parametrize("delay", [0.15, 0.25, 0.4])
def test_a_run_that_ends_again_early_waits_for_its_hosts(delay):
    """The run goes on from a snapshot near its end, before its hosts are back."""
    faults = Fault("kill", PHYSICS, 150), Fault("kill", RUN_PY, 150, delay)
    assert carry_out(plan(*faults, ticks=200, delays=Delays(5e-3))).complaints == []


def test_no_schedule_begins_after_the_time_is_over(monkeypatch):
    """The clock is 1 s later at each look, and 20 s are allowed. The schedules before that are the
    same as without a limit, in the same order.
    """
    times = iter(range(1000))
    monkeypatch.setattr(command, "outcome_of", lambda seed: seed)
    with ThreadPoolExecutor(2) as workers:
        within = list(command._in_turn(workers, range(50), 20, lambda: next(times)))
        without = list(command._in_turn(workers, range(50), inf))
    assert within == list(range(20))
    assert without == list(range(50))


def test_the_command_carries_out_schedules_in_several_processes():
    assert "6 schedules" in python("-m", "chaos.simulated", "--count", 6).stdout
