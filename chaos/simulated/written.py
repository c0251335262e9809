"""What a run has written: tables and recordings hold each tick once, with what happened in it."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from chaos.simulated.census import EVENTS
from chaos.simulated.plan import RUN_PY
from chaos.simulated.schedule import Schedule
from orchard.contract.events import Event, Frame, LetterEvent
from orchard.wire.keys import LOGGER, PHYSICS

Said = tuple[int, str, str]  # of an event: its tick, what happened, and the body that did it


def faults_of_tables(schedule: Schedule, summary: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with the tables of the last part of a run, which are in one folder."""
    part = schedule.observer.course.parts[-1]
    if schedule.plan.has("full disk") or not part.steps:
        return
    ticks, rows = _tables(schedule.tables)
    bodies = len(schedule.world.loop.run.engine.layout.names) if schedule.world.loop else 0
    first = min(part.steps)
    last = summary["ticks"]
    wanted = [tick for tick in range(first + 1, last + 1) for _ in range(bodies)]
    if ticks != wanted:
        yield f"tables: {len(ticks)} rows of bodies, not {len(wanted)}: {_first_odd(ticks, wanted)}"
    if rows != (events := said(part.events)):
        yield f"tables: {len(rows)} events, not {len(events)}"


def _first_odd(ticks: Sequence[int], wanted: Sequence[int]) -> str:
    pairs = zip([*ticks, None], [*wanted, None], strict=False)
    return next((f"tick {one}, not {other}" for one, other in pairs if one != other), "")


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
    course = schedule.observer.course
    if len(course.parts) > 1:
        return
    for queue in world.frames:
        frames = [frame for _ in range(len(queue)) if (frame := queue.take()) is not None]
        is_disturbed = any(fault.who in (LOGGER, PHYSICS, RUN_PY) for fault in plan.faults)
        # A logger that has heard a false end leaves as soon as the token of physics goes.
        is_disturbed = is_disturbed or plan.has("false end") or plan.has_router or bool(plan.tears)
        if not is_disturbed and world.begins == 1 and frames:
            ticks = [frame.tick for frame in frames]
            wanted = list(range(plan.begin + 1, summary["ticks"] + 1))
            if ticks != wanted:
                yield f"recording: {_first_odd(ticks, wanted)}"
                return
        if world.begins == 1:
            yield from _of_frames(schedule, frames)


def _of_frames(schedule: Schedule, frames: Sequence[Frame]) -> Iterator[str]:
    """Yield a frame that is there twice, and one without the events and messages of its step.

    Physics has begun once.
    """
    steps = schedule.observer.course.parts[0].steps
    for before, frame in pairwise(frames):
        if frame.tick <= before.tick:
            yield f"recording: tick {frame.tick} after tick {before.tick}"
            return
        step = steps.get(frame.tick - 1) if frame.tick == before.tick + 1 else None
        if step is not None and said(frame.events) != said(step.events):
            yield f"recording: other events than in the run: tick {frame.tick - 1}"
            return
        sent = [
            (event.tick, event.what, event.who)
            for event in frame.events
            if isinstance(event, LetterEvent)
        ]
        if step is not None and sent != step.sent:
            yield f"recording: other messages than in the run: tick {frame.tick - 1}"
            return
