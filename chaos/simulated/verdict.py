"""The verdict on a schedule: what was promised, and did not hold.

Each function `_of_...` yields a sentence for each complaint of one kind.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from chaos.simulated.census import OF_HARVEST
from chaos.simulated.course import summary_digest
from chaos.simulated.harvest import HARVESTED, harvest_of
from chaos.simulated.plan import RUN_PY, Plan, leave_limit
from chaos.simulated.processes import KILLED
from chaos.simulated.schedule import Schedule
from chaos.simulated.written import faults_of_recording, faults_of_tables
from orchard.net.refusals import TAKEN
from orchard.server.loop import WARN_SECONDS
from orchard.wire.keys import LOGGER, PHYSICS

# Words of lines that users read.
# A process may end so if physics was away for long.
NO_PHYSICS = (
    "no router answers there",
    "no reply; is the physics process running",
)
NEVER_BACK = "no host has come back"
MISSED_END = "physics is gone; waited for"
# The reason of a refusal: an owner has answered a tick twice.
TWICE = "answered already"
# Clients that send what only others may send.
SPEAK_FOR_OTHERS = ("lie", "repeat", "nonsense")
# s, virtual, that hosts may take to come at the beginning.
START_SECONDS = 6.0
# s in which a run without faults starts and ends.
START_AND_END_SECONDS = 3.0
# s that a tick takes at most in such a run, without the time that its messages are under way.
TICK_SECONDS = 0.015
# Messages of a tick that wait for each other: so many times the longest delay a tick takes besides.
MESSAGES_OF_A_TICK = 8.0
# s after which all hosts are back after a fault.
BACK_SECONDS = 12.0
# Ticks between a fault and an event of the harvest that is near.
NEAR_TICKS = 20


@dataclass
class Verdict:
    """What came of a schedule.

    `complaints`: what was promised and did not hold; empty for a good one.
    """

    plan: Plan
    summary: dict[str, Any] = field(default_factory=dict)  # of the run; empty if run.py has none
    seconds: float = 0.0  # virtual
    complaints: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # the trace, if it was wanted
    occurred: dict[str, list[str]] = field(default_factory=dict)  # kind -> what has occurred of it
    is_near: bool = False  # whether a fault fell near an event of the harvest


class Outcome(NamedTuple):
    """What is counted of a schedule."""

    seed: int
    complaints: list[str]
    occurred: dict[str, list[str]]  # as in Verdict
    is_near: bool


def judge(schedule: Schedule) -> Verdict:
    """Judge a schedule that is over."""
    world = schedule.world
    plan = schedule.plan
    summary, why = schedule.run_py.result
    verdict = Verdict(plan, summary or {}, world.scheduler.now, lines=world.network.lines)
    verdict.complaints += [f"crash: {crash}" for crash in world.crashes]
    verdict.occurred = _occurred(schedule, verdict.summary)
    verdict.is_near = _is_near(schedule)
    # The stored figures of a scene are those of local mode. If the program has changed, they are
    # stale, and nothing that is compared with them counts.
    verdict.complaints += [
        f"local mode harvests {plan.scene!r} otherwise: {difference}"
        for difference in harvest_of(plan.scene).differences[:1]
    ]
    if summary is None:
        verdict.complaints.append(f"no end: {'; '.join([*world.lines[-3:], why])}")
    else:
        verdict.complaints += [*schedule.complaints, *schedule.progress.complaints]
        verdict.complaints += [
            *_of_end(schedule, summary, why),
            *_of_time(schedule, summary),
            *_of_agents(schedule, summary, why),
            *_of_course(schedule, summary),
            *_of_files(schedule, summary),
            *_of_commands(schedule),
            *_of_processes(schedule),
        ]
    return verdict


def _is_near(schedule: Schedule) -> bool:
    """Whether a fault has happened within NEAR_TICKS of an event of the harvest."""
    parts = schedule.observer.course.parts
    for inflicted in schedule.inflicted:
        for event in parts[inflicted.part].events:
            if event.what in OF_HARVEST and abs(inflicted.tick - event.tick) <= NEAR_TICKS:
                return True
    return False


def _occurred(schedule: Schedule, summary: dict[str, Any]) -> dict[str, list[str]]:
    """Return what has occurred, by its kind: "deeds" -> "couple", ... `summary`: of the run."""
    plan = schedule.plan
    census = schedule.world.network.census
    faults = set()
    for inflicted in schedule.inflicted:
        faults.add(f"{inflicted.fault.what}, {kind_of_process(inflicted.fault.who)}")
    if schedule.world.network.torn:
        faults.add("a payload changes, link")
    events = set(census.events)
    if summary.get("finished"):
        events.add(HARVESTED)
    begin = "from its first tick"
    if plan.begin:
        begin = "from a keyframe"
    found = {
        "messages": census.messages,
        "deeds": census.deeds,
        "requests": census.requests,
        "answers": census.answers,
        "events": events,
        "faults": faults,
        "refusals": set(summary.get("messages_refused", ())),
        "plans": {plan.scene, plan.mode, begin},
    }
    return {kind: sorted(names) for kind, names in found.items()}


def kind_of_process(name: str) -> str:
    """Return the name of a process without its number: "agents 2" gives "agents"."""
    return name.rstrip("0123456789 ")


def _of_end(schedule: Schedule, summary: dict[str, Any], why: str) -> Iterator[str]:
    """Complain about how the run has ended."""
    plan = schedule.plan
    for violation in summary["violations"][:1]:
        yield f"violated: {violation}"
    for broken in summary["broken_agents"][:1]:
        yield f"broken: {broken}"
    is_quit = plan.has("quit") or schedule.is_quit
    is_complete = why == "harvested" and summary["finished"]
    if why != "duration" and not is_complete and not (is_quit and why == "stopped"):
        yield f"ended by itself: {why}, at tick {summary['ticks']}"
    elif why == "duration" and summary["ticks"] != plan.end:
        yield f"wrong tick: {summary['ticks']} of {plan.end}"
    is_quiet = not plan.faults and not plan.tears
    if plan.mode == "lockstep" and is_quiet and summary["messages_refused"]:
        yield f"refused without a fault: {summary['messages_refused']}"
    elif (
        plan.mode == "lockstep"
        and TWICE in summary["messages_refused"]
        and not plan.has(*SPEAK_FOR_OTHERS)
    ):
        yield "an owner's only answer is refused"


def _of_time(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Complain about a run in lockstep without faults that is slow: something waits, though it need
    not.
    """
    plan = schedule.plan
    over_at = schedule.over_at
    if plan.mode != "lockstep" or plan.faults or plan.tears or over_at is None:
        return
    seconds_of_a_tick = TICK_SECONDS + MESSAGES_OF_A_TICK * plan.delays.there_and_back
    ticks = summary["ticks"] - plan.begin
    most = START_AND_END_SECONDS + plan.late + ticks * seconds_of_a_tick
    if over_at > most:
        yield f"slow: {over_at:.1f} s; at most {most:.1f} s"


def _of_agents(schedule: Schedule, summary: dict[str, Any], why: str) -> Iterator[str]:
    """Complain about lost agents, if no host was away for long, and about sessions that are not
    back.
    """
    plan = schedule.plan
    world = schedule.world
    lost = [line for line in world.lines if "no longer waited for" in line]
    if plan.mode == "lockstep" and lost and not plan.may_lose:
        yield f"lost: {lost[0]}"
    yield from schedule.observer.course.forgotten[:1]
    # Physics says every WARN_SECONDS that it waits.
    lines = [line for line in world.lines if line.startswith(PHYSICS) and "waiting for" in line]
    waited = len(lines) * WARN_SECONDS
    if waited > plan.away + START_SECONDS:
        yield f"physics has waited {waited:g} s for hosts"
    sessions = plan.hosts
    if plan.has_bare_client:
        sessions += 1
    is_whole = summary["hosts"] == sessions or any(NEVER_BACK in line for line in lost)
    if not is_whole and why == "duration" and not schedule.has_just_suffered(BACK_SECONDS):
        yield f"{summary['hosts']} of {sessions} sessions at the end"


def _of_course(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Complain about a run that is not that of local mode: its hash, figures, events and
    messages.
    """
    plan = schedule.plan
    world = schedule.world
    course = schedule.observer.course
    if not plan.has_hash or world.loop is None:
        return
    reference = course.parts[-1].reference
    tick = summary["ticks"]
    course.want_figures(tick)
    if course.is_whole:
        if summary["hash"] != reference.hash_at(tick).hex():
            yield "another hash than local mode"
        figures = world.loop.run.account.figures.figures()
        if summary_digest(summary, figures) != reference.figures_at(tick):
            yield "another summary than local mode"
    # A client that publishes what others have said may publish figures, too.
    yield from course.differences(with_figures=not plan.has(*SPEAK_FOR_OTHERS))


def _of_files(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Complain about tables and recordings in which a tick is missing, or is twice."""
    if schedule.plan.has_tables:
        yield from faults_of_tables(schedule, summary)
    yield from faults_of_recording(schedule, summary)


def _of_commands(schedule: Schedule) -> Iterator[str]:
    """Complain about what drivers and operators asked for, and did not get."""
    yield from schedule.world.wrong_begins
    yield from _of_resets(schedule)
    yield from _of_quitting(schedule)
    yield from _of_refusals(schedule)
    yield from schedule.observer.complaints
    yield from _of_stops(schedule)
    # With several pauses a client cannot tell which of them let the run stand or go on.
    if sum(fault.what == "pause" for fault in schedule.plan.faults) == 1:
        for client in schedule.clients:
            yield from client.complaints


def _of_stops(schedule: Schedule) -> Iterator[str]:
    """Complain about emergency stops and resets that physics said were on the disk, and that are
    missing in the course of the run.

    The snapshot of such a tick may have been torn by a fault: then it may be missing.
    """
    course = schedule.observer.course
    for client in schedule.clients:
        for what, stopped in client.stops:
            is_kept = stopped.kept and stopped.tick not in schedule.torn
            if is_kept and not course.has(stopped.tick, what, stopped.changed):
                yield f"what was kept is forgotten: {what}: tick {stopped.tick}"


def _of_resets(schedule: Schedule) -> Iterator[str]:
    """Complain about a run that has not begun again, though physics has said that it would, and
    had the time for it.
    """
    promised = sum(client.resets for client in schedule.clients)
    done = schedule.observer.course.resets
    is_quit = schedule.plan.has("quit")
    if promised > done and not is_quit and not _has_physics_died(schedule):
        yield f"{promised} resets were promised, and {done} done"


def _of_quitting(schedule: Schedule) -> Iterator[str]:
    """Complain about a run that lasts to its end, though physics has said that it ends at once."""
    is_promised = any(client.quits for client in schedule.clients)
    _, why = schedule.run_py.result
    if is_promised and why == "duration" and not _has_physics_died(schedule):
        yield "the run was to end, and has gone on"


def _has_physics_died(schedule: Schedule) -> bool:
    """Whether what physics has promised may be forgotten."""
    return any(one.fault.who in (PHYSICS, RUN_PY) for one in schedule.inflicted)


def _of_refusals(schedule: Schedule) -> Iterator[str]:
    """Complain about refusals of hosts that physics counts more often than they have happened."""
    if schedule.world.loop is None:
        return
    there = schedule.world.loop.run.refusal_totals.there
    for process in schedule.world.processes.values():
        for host in process.hosts:
            for reason, count in there.get(host.bus.id, {}).items():
                happened = host.refusals.counts[reason]
                if count > happened:
                    yield f"{count} times {reason!r}, and not {happened}"


def _of_processes(schedule: Schedule) -> Iterator[str]:
    """Complain about how the processes have ended: all that were started, also those that were
    started again.
    """
    plan = schedule.plan
    lines = schedule.world.lines
    supervisor = schedule.run_py.supervisor
    for process in schedule.world.processes.values():
        name = process.spec.name
        why = ""
        if process.complaints:
            why = process.complaints[-1]
        if process.code is None:
            yield f"{name} still runs {leave_limit(plan):g} s after the end"
        elif process.code not in (0, KILLED) and not _may_end_so(plan, name, why):
            yield f"{name} ended with code {process.code}: {why}"
    if not plan.has("freeze"):
        yield from (line for line in lines if line.startswith(f"{PHYSICS} has not ended"))
    for name in sorted(set(supervisor.restarted)):
        told = sum(line.startswith(f"{name} ended with code") for line in lines)
        if told < supervisor.restarted.count(name):
            yield f"{name} has died, and the user does not know it"
    for name in (*supervisor.given_up, *schedule.elsewhere.given_up):
        yield f"{name} was given up"


def _may_end_so(plan: Plan, name: str, why: str) -> bool:
    """Whether a process may end with an error in a plan. `why`: the last line of its log."""
    if name == LOGGER or any(words in why for words in NO_PHYSICS):
        return True
    is_taken = TAKEN in why and plan.may_take
    return is_taken or (MISSED_END in why and plan.may_miss_the_end)
