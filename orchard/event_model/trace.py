"""A trace: what each robot did when, in words, one line an op. `orchard trace` prints it."""

from collections.abc import Iterator
from typing import Any

from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.steps import Say, Unload

# m between a line and the row or queue that it belongs to.
NEAR = 1e-3
# What a robot does during an op of a kind.
WORDS = {
    c.END: "has done its plan",
    c.DRIVE: "drives",
    c.TURN: "turns",
    c.PAUSE: "asks its bin, or waits",
    c.NEED: "claims places",
    c.FREE: "gives places back",
    c.ALONE_IN: "waits for its partner to go",
    c.DELIVER: "leaves the empty bin for the picker",
    c.FETCH_EMPTY: "waits for an empty bin",
    c.TAKE_BIN: "couples the full bin",
    c.LEAVE_BIN: "leaves the full bin",
    c.UNLOAD: "unloads",
    c.HOME: "is free for the next call",
    c.BEGIN_ROW: "comes to fruit",
    c.END_ROW: "has picked its part of the row",
    c.MAY_CHARGE: "looks at its battery",
    c.CHARGE: "wants a charger",
    c.CHARGED: "waits until its battery is full",
    c.HAUL: "is away at the load-out",
}


def trace(layout: Layout) -> Iterator[str]:
    """Do a harvest, and yield what each robot began when: time, robot, what it does, and where.

    Raises NotImplementedError for what the event model does not know, and PolicyFault.
    """
    harvest = EventHarvest(layout, is_logged=True).run()
    model = harvest.model
    for entry in model.log[: model.desk[0].logged]:
        words = _words(harvest, int(entry.op))
        yield f"{_clock(int(entry.tick))}  {harvest.names[entry.robot]:<11} {words}"


def _clock(tick: int) -> str:
    """Return the time of a tick as h:mm:ss.t."""
    # 600 tenths of a second are a minute.
    minutes, tenths = divmod(round(10 * tick * TIME_STEP), 600)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"


def _words(harvest: EventHarvest, number: int) -> str:
    """Return what a robot does in an op, and where."""
    op = harvest.model.ops[number]
    step = harvest.program.steps[number]
    words = WORDS[int(op.kind)]
    if op.kind == c.PAUSE and isinstance(step, Unload):
        return "finds that its bin is empty"
    if op.kind in (c.BEGIN_ROW, c.END_ROW, c.LEAVE_BIN):
        row = harvest.model.passes[op.arg].row + 1
        doing = f": {step.doing}" if isinstance(step, Say) else ""
        return f"{words} in row {row}{doing}"
    if op.kind == c.DRIVE:
        return _drive_words(harvest, op)
    places = harvest.program.places.names_of(int(op.places))
    return f"{words}: {', '.join(places)}" if places else words


def _drive_words(harvest: EventHarvest, op: Any) -> str:
    """Return along what a robot drives, and up to where."""
    layout = harvest.layout
    line = harvest.model.lines[op.line]
    end = line.sign * op.target
    if line.axis == 1:
        return f"drives along x = {line.other:.2f} to y = {end:.2f}"
    along = f"y = {line.other:.2f}"
    for lane in layout.lanes:
        if abs(lane.y - line.other) < NEAR:
            along = f"row {lane.number}"
    for number, y in enumerate(harvest.program.queue_lines, 1):
        if abs(y - line.other) < NEAR:
            along = f"line {number} of the queue"
    verb = "drives"
    if op.speed == 0.0:
        verb = "picks"
    return f"{verb} along {along} to x = {end:.2f}"
