"""The whole protocol on a simulated network: `python -m chaos.simulated` carries out thousands of such schedules."""

from dataclasses import replace

import pytest

from chaos.simulated.clients import CLIENTS
from chaos.simulated.mutations import cut_out
from chaos.simulated.network import Delays
from chaos.simulated.schedule import CLIENT, RUN_PY, SCENARIOS, Fault, Plan, carry_out, draw, shrink
from orchard.wire.keys import PHYSICS


def plan(*faults: Fault, ticks: int = 60, hosts: int = 2, **others) -> Plan:
    return Plan(1, SCENARIOS[2], ticks, hosts, others.pop("has_logger", False), others.pop("has_router", False), Delays(), faults, **others)


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_runs_with_faults_keep_their_promises(first):
    verdicts = [carry_out(draw(seed)) for seed in range(first, first + 10)]
    assert {verdict.plan.seed: verdict.complaints for verdict in verdicts if verdict.complaints} == {}


def test_the_same_seed_gives_the_same_schedule():
    one, other = (carry_out(draw(36), is_traced=True) for _ in range(2))
    assert one.lines == other.lines
    assert one.seconds == other.seconds


@pytest.mark.parametrize("what", sorted(CLIENTS))
def test_a_foreign_client_breaks_no_promise(what):
    assert carry_out(plan(Fault(what, CLIENT, 10, 0.0, 0.5))).complaints == []


@pytest.mark.parametrize("others", [{"has_logger": True}, {"has_router": True}, {"mode": "realtime"}], ids=str)
def test_a_run_without_faults_ends_well_and_soon(others):
    verdict = carry_out(plan(**others))
    assert verdict.complaints == []
    assert verdict.seconds < 15.0


@pytest.mark.parametrize("seed", [20, 67, 91])
def test_a_run_without_faults_refuses_nothing(seed):
    """A request that comes while its host recalls the same mail is no late one."""
    end = carry_out(replace(draw(seed), faults=(), ticks=10)).end
    assert end is not None
    assert end.summary["messages_refused"] == {}


def test_a_mutation_is_found_and_shrinks_to_the_faults_that_it_needs():
    with cut_out("a host never doubts its mail"):
        seed = next(seed for seed in range(40) if carry_out(draw(seed)).complaints)
        small = shrink(draw(seed))
        assert carry_out(small).complaints == ["another hash than local mode"]
    assert len(small.faults) <= len(draw(seed).faults)
    assert carry_out(small).complaints == []


# -- what schedules have found


@pytest.mark.parametrize("delay", [0.1, 0.5, 0.8])
def test_a_run_that_is_resumed_before_its_first_tick_waits_for_all_its_agents(delay):
    assert carry_out(plan(Fault("kill", RUN_PY, -1, delay))).complaints == []


@pytest.mark.parametrize("tick", [58, 59, 60])
def test_a_host_that_is_started_again_as_the_run_ends_does_not_wait_for_physics(tick):
    verdict = carry_out(plan(Fault("kill", "agents_1", tick)))
    assert verdict.complaints == []
    assert verdict.seconds < 15.0


def test_physics_that_is_killed_goes_on_from_its_snapshot():
    assert carry_out(plan(Fault("kill", PHYSICS, 150), ticks=200)).complaints == []
