"""The verdict on a schedule: what was promised, and did not hold."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from chaos.simulated.clients import RUN
from chaos.simulated.plan import MOST_TICKS, SCENARIOS, Plan
from chaos.simulated.processes import KILLED, SimulatedSupervisor, World
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.run import read_end
from orchard.wire.keys import LOGGER
from orchard.wire.messages import End

LEAVE_LIMIT = 30.0  # s of virtual time within which all processes end after physics: a host that misses the end waits 20 s
NOBODY_THERE = "no router answers there", "no reply; is the physics process running"  # why a process may end: physics was away for long


@dataclass
class Verdict:
    """What came of a schedule. `complaints`: what was promised and did not hold; empty for a good one."""

    plan: Plan
    end: End | None = None
    seconds: float = 0.0  # virtual
    complaints: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # the trace, if it was wanted


@lru_cache(maxsize=len(SCENARIOS))
def hashes_of(scenario: int) -> list[str]:
    """Return the hash of local mode at each tick."""
    local = Local(Scenario(**SCENARIOS[scenario]))
    hashes: list[str] = []
    while len(hashes) <= MOST_TICKS:
        hashes.append(local.engine.hash)
        local.tick()
    return hashes


def judge(plan: Plan, world: World, supervisor: SimulatedSupervisor) -> Verdict:
    """Judge a schedule that is over."""
    verdict = Verdict(plan, read_end(world.folder / "end", RUN), world.scheduler.now, lines=world.network.lines)
    verdict.complaints += [f"crash: {crash}" for crash in world.crashes]
    if verdict.end is None:
        verdict.complaints.append(f"no end: {'; '.join(world.lines[-3:])}")
    else:
        verdict.complaints += [*_of_end(plan, verdict.end), *_of_processes(world, supervisor)]
    return verdict


def _of_end(plan: Plan, end: End) -> Iterator[str]:
    """Complain about how the run has ended."""
    for violation in end.summary["violations"][:1]:
        yield f"violated: {violation}"
    for broken in end.summary["broken_agents"][:1]:
        yield f"broken: {broken}"
    may_quit = any(fault.what == "quit" for fault in plan.faults)
    if end.why != "duration" and not (may_quit and end.why == "stopped"):
        yield f"ended by itself: {end.why}, at tick {end.tick}"
    elif end.why == "duration" and end.tick != plan.ticks:
        yield f"wrong tick: {end.tick} of {plan.ticks}"
    if not plan.faults and end.summary["messages_refused"]:
        yield f"refused without a fault: {end.summary['messages_refused']}"
    if plan.has_hash and end.hash != hashes_of(SCENARIOS.index(plan.scenario))[end.tick]:
        yield "another hash than local mode"


def _of_processes(world: World, supervisor: SimulatedSupervisor) -> Iterator[str]:
    """Complain about how the processes have ended: all that were started, also those that were started again."""
    for name, running in supervisor.running.items():
        if running.popen.poll() is None:
            yield f"{name} still runs {LEAVE_LIMIT:g} s after the end"
    for process in world.processes.values():
        why = process.complaints[-1] if process.complaints else ""
        is_lost = any(words in why for words in NOBODY_THERE) or process.spec.name == LOGGER
        if process.code not in (None, 0, KILLED) and not is_lost:
            yield f"{process.spec.name} ended with code {process.code}: {why}"
    for name in supervisor.given_up:
        yield f"{name} was given up"
