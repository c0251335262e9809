"""A trace: what each robot did when, in words, one line an op."""

from collections.abc import Iterator

from orchard.event_model import columns as c
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout
from orchard.plans.steps import Say

# What a robot does during an op of a kind.
WORDS = {
    c.END: "has done its plan",
    c.DRIVE: "drives",
    c.TURN: "turns",
    c.PAUSE: "asks, or waits",
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
}


def trace(layout: Layout) -> Iterator[str]:
    """Do a harvest, and yield what each robot began at which tick.

    Raises NotImplementedError for what the event model does not know.
    """
    harvest = EventHarvest(layout, is_logged=True).run()
    model = harvest.model
    for entry in model.log[: model.desk[0].logged]:
        kind = int(model.ops[entry.op].kind)
        yield f"{entry.tick:7d}  {harvest.names[entry.robot]:<11} {_words(harvest, entry.op, kind)}"


def _words(harvest: EventHarvest, op: int, kind: int) -> str:
    words = WORDS[kind]
    step = harvest.program.steps[op]
    if kind in (c.BEGIN_ROW, c.END_ROW) and isinstance(step, Say):
        return f"{words}: {step.doing}"
    row = harvest.model.ops[op]
    if kind == c.DRIVE:
        line = harvest.model.lines[row.line]
        axis = "x" if line.axis == 0 else "y"
        return f"{words} to {axis} = {line.sign * row.target:.2f}"
    places = harvest.program.names_of(int(row.places))
    return f"{words}: {', '.join(places)}" if places else words
