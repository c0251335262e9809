"""What a run has written: tables and recordings hold each tick once, with what happened in it.

A step from tick k leads to tick k + 1. Tables and recordings have the bodies after it with tick
k + 1, and its events and messages with tick k.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from chaos.simulated.census import EVENTS
from chaos.simulated.plan import RUN_PY, Plan
from chaos.simulated.schedule import Schedule
from orchard.contract.events import Event, Frame, LetterEvent
from orchard.wire.keys import LOGGER, PHYSICS

# Of an event: its tick, what happened, and the body that did it.
Said = tuple[int, str, str]


def faults_of_tables(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with the tables of a run. They hold its last part."""
    part = schedule.observer.course.parts[-1]
    if schedule.plan.has("full disk") or not part.steps:
        return
    ticks, rows = _tables(schedule.tables)
    loop = schedule.world.loop
    assert loop is not None, "physics has done steps, so it has begun"
    bodies = len(loop.run.engine.layout.names)
    first = min(part.steps)
    last = summary["ticks"]
    # Each tick has a row for each body.
    wanted = []
    for tick in range(first + 1, last + 1):
        wanted += [tick] * bodies
    if ticks != wanted:
        odd = first_difference(ticks, wanted)
        yield f"tables: {len(ticks)} rows of bodies, not {len(wanted)}: tick {odd}"
    events = said(part.events)
    if rows != events:
        odd = first_difference(rows, events)
        yield f"tables: {len(rows)} events, not {len(events)}: {odd}"


def first_difference(found: Sequence[object], wanted: Sequence[object]) -> str:
    """Return the first thing that differs, in words; None stands for the end of a sequence."""
    for is_there, should_be in zip([*found, None], [*wanted, None], strict=False):
        if is_there != should_be:
            return f"{is_there}, not {should_be}"
    return ""


def _tables(folder: Path) -> tuple[list[int], list[Said]]:
    """Return the tick of each row of bodies, and the events."""
    # Not at the top: few schedules have tables, and pyarrow takes some time to load.
    import pyarrow.parquet as pq

    ticks = pq.read_table(folder / "bodies.parquet", columns=["tick"])["tick"].to_pylist()
    events = pq.read_table(folder / "events.parquet").to_pylist()
    return ticks, [(row["tick"], row["what"], row["who"]) for row in events]


def said(events: Sequence[Event]) -> list[Said]:
    """Return what tables and recordings must say of events of physics."""
    return [(event.tick, event.what, event.who) for event in events if event.what in EVENTS]


def faults_of_recording(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with what the loggers of a run passed on to be written."""
    plan = schedule.plan
    world = schedule.world
    # After a reset, a fork, or a start of physics from a snapshot, ticks come again, and a frame
    # does not say of which of both it is.
    if len(schedule.observer.course.parts) > 1 or world.begins != 1:
        return
    for queue in world.frames:
        frames = []
        for _ in range(len(queue)):
            frame = queue.take()
            if frame is not None:
                frames.append(frame)
        if frames and not _may_lack_frames(plan):
            ticks = [frame.tick for frame in frames]
            wanted = list(range(plan.begin + 1, summary["ticks"] + 1))
            if ticks != wanted:
                yield f"recording: tick {first_difference(ticks, wanted)}"
                return
        yield from _of_frames(schedule, frames)


def _may_lack_frames(plan: Plan) -> bool:
    """Whether frames may be lost on their way to a logger, or by it."""
    if any(fault.who in (LOGGER, PHYSICS, RUN_PY) for fault in plan.faults):
        return True
    # A client says that the run is over, though it is not. A logger that has heard that leaves as
    # soon as the token of physics goes.
    if plan.has("false end"):
        return True
    # A router of its own may be killed, and a payload that has changed on its way is dropped.
    return plan.has_router or bool(plan.tears)


def _of_frames(schedule: Schedule, frames: Sequence[Frame]) -> Iterator[str]:
    """Yield a frame that is there twice, and one without the events and messages of its step.

    Physics has begun once, and the run has one part.
    """
    steps = schedule.observer.course.parts[0].steps
    for before, frame in pairwise(frames):
        if frame.tick <= before.tick:
            yield f"recording: tick {frame.tick} after tick {before.tick}"
            return
        # A frame after a gap has the events of all steps since the one before.
        if frame.tick != before.tick + 1:
            continue
        step = steps.get(frame.tick - 1)
        if step is None:
            continue
        if said(frame.events) != said(step.events):
            yield f"recording: other events than in the run: tick {frame.tick - 1}"
            return
        sent = []
        for event in frame.events:
            if isinstance(event, LetterEvent):
                sent.append((event.tick, event.what, event.who))
        if sent != step.sent:
            yield f"recording: other messages than in the run: tick {frame.tick - 1}"
            return
