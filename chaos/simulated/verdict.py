"""The verdict on a schedule: what was promised, and did not hold."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from chaos.simulated.plan import MOST_TICKS, SCENARIOS, Plan
from chaos.simulated.processes import KILLED
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.net.refusals import TAKEN
from orchard.net.requests import AGAIN_SECONDS, TRIES
from orchard.server.loop import WARN_SECONDS
from orchard.wire.keys import LOGGER, PHYSICS

if TYPE_CHECKING:
    from chaos.simulated.schedule import Schedule

NOBODY_THERE = (
    "no router answers there",
    "no reply; is the physics process running",
)  # why a process may end: physics was away for long
NEVER_BACK = "no host has come back"
TWICE = "answered already"  # the reason of a refusal
SPEAK_FOR_OTHERS = "lie", "repeat", "nonsense"
MISSED_END = "physics is gone; waited for"
START_SECONDS = 6.0  # s that hosts may take to come
LOST_SECONDS = 12.0  # s after which all hosts are back from what happened


def leave_limit(plan: Plan) -> float:
    """Return the seconds of virtual time within which all processes end after physics: a host that starts just then asks TRIES times.

    A client that does not answer makes a question last.
    """
    mute = sum(fault.seconds for fault in plan.faults if fault.what == "mute")
    return 15.0 + mute + TRIES * (AGAIN_SECONDS + plan.delays.there_and_back)


@dataclass
class Verdict:
    """What came of a schedule. `complaints`: what was promised and did not hold; empty for a good one."""

    plan: Plan
    summary: dict[str, Any] = field(default_factory=dict)  # of the run; empty if run.py has none
    seconds: float = 0.0  # virtual
    complaints: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # the trace, if it was wanted


@lru_cache(maxsize=2 * len(SCENARIOS))
def hashes_of(scenario: int, seed: int) -> list[str]:
    """Return the hash of local mode at each tick."""
    local = Local(Scenario(**SCENARIOS[scenario] | {"seed": seed}))
    hashes: list[str] = []
    while len(hashes) <= MOST_TICKS:
        hashes.append(local.engine.hash)
        local.tick()
    return hashes


def judge(schedule: "Schedule") -> Verdict:
    """Judge a schedule that is over."""
    world, plan = schedule.world, schedule.plan
    summary, why = schedule.run_py.result
    verdict = Verdict(plan, summary or {}, world.scheduler.now, lines=world.network.lines)
    verdict.complaints += [f"crash: {crash}" for crash in world.crashes]
    if summary is None:
        verdict.complaints.append(f"no end: {'; '.join([*world.lines[-3:], why])}")
    else:
        verdict.complaints += [*schedule.complaints, *schedule.progress.complaints]
        verdict.complaints += [
            *_of_end(plan, summary, why),
            *_of_hash(schedule, summary, why),
            *_of_processes(schedule),
        ]
    return verdict


def _of_end(plan: Plan, summary: dict[str, Any], why: str) -> Iterator[str]:
    """Complain about how the run has ended."""
    for violation in summary["violations"][:1]:
        yield f"violated: {violation}"
    for broken in summary["broken_agents"][:1]:
        yield f"broken: {broken}"
    if why != "duration" and not (plan.has("quit") and why == "stopped"):
        yield f"ended by itself: {why}, at tick {summary['ticks']}"
    elif why == "duration" and summary["ticks"] != plan.ticks:
        yield f"wrong tick: {summary['ticks']} of {plan.ticks}"
    if plan.mode == "lockstep" and not plan.faults and summary["messages_refused"]:
        yield f"refused without a fault: {summary['messages_refused']}"
    elif (
        plan.mode == "lockstep"
        and TWICE in summary["messages_refused"]
        and not plan.has(*SPEAK_FOR_OTHERS)
    ):
        yield "an owner's only answer is refused"


def _of_hash(schedule: "Schedule", summary: dict[str, Any], why: str) -> Iterator[str]:
    """Complain about lost agents, if no host was away for long, and about another hash, if none was lost."""
    plan, world = schedule.plan, schedule.world
    lost = [line for line in world.lines if "no longer waited for" in line]
    if plan.mode == "lockstep" and lost and not plan.may_lose:
        yield f"lost: {lost[0]}"
    waited = (
        sum("waiting for" in line and line.startswith(PHYSICS) for line in world.lines)
        * WARN_SECONDS
    )
    if waited > plan.away + START_SECONDS:
        yield f"physics has waited {waited:g} s for hosts"
    if plan.has_hash and not lost and world.engine is not None:
        seed = world.engine.layout.scenario.seed
        if summary["hash"] != hashes_of(SCENARIOS.index(plan.scenario), seed)[summary["ticks"]]:
            yield "another hash than local mode"
    sessions = plan.hosts + plan.has_bare_client
    is_whole = summary["hosts"] == sessions or any(NEVER_BACK in line for line in lost)
    if not is_whole and why == "duration" and not schedule.has_just_suffered(LOST_SECONDS):
        yield f"{summary['hosts']} of {sessions} sessions at the end"


def _of_processes(schedule: "Schedule") -> Iterator[str]:
    """Complain about how the processes have ended: all that were started, also those that were started again."""
    plan, lines, supervisor = schedule.plan, schedule.world.lines, schedule.run_py.supervisor
    for process in schedule.world.processes.values():
        name, why = process.spec.name, process.complaints[-1] if process.complaints else ""
        is_lost = (
            any(words in why for words in NOBODY_THERE)
            or name == LOGGER
            or (TAKEN in why and plan.may_take)
        )
        if process.code is None:
            yield f"{name} still runs {leave_limit(plan):g} s after the end"
        elif (
            process.code not in (0, KILLED)
            and not is_lost
            and not (MISSED_END in why and plan.may_miss_the_end)
        ):
            yield f"{name} ended with code {process.code}: {why}"
    if not plan.has("freeze"):
        yield from (line for line in lines if line.startswith(f"{PHYSICS} has not ended"))
    for name in sorted(set(supervisor.restarted)):
        if sum(
            line.startswith(f"{name} ended with code") for line in lines
        ) < supervisor.restarted.count(name):
            yield f"{name} has died, and the user does not know it"
    for name in (*supervisor.given_up, *schedule.elsewhere.given_up):
        yield f"{name} was given up"
