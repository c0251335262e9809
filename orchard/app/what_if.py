"""What if? The time line of a run that has ended: from a moment on, a fork of it goes on with something changed."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
from nicegui import ui

from orchard.app.charts import History
from orchard.app.draft import Draft, entries, flat
from orchard.app.elements import button, heading, several
from orchard.app.form import Control
from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.sim.snapshot import ticks_of

CHANGING = (
    "carriers",
    "dispatch",
    "picking_rate",
    "people.workers",
    "people.visitors",
    "seed",
)  # some of what may change under way
MOMENTS = 8  # that are named on a time line


class Fork(NamedTuple):
    """A run that goes on from a moment of another one."""

    parent: str
    seconds: float
    words: list[str]  # for `orchard fork`
    history: History  # up to the moment


GoOn = Callable[[Scenario, Fork], Awaitable[None]]


def moment(seconds: float) -> str:
    """Return a moment as it is named on a time line: 2:30."""
    return "{}:{:02d}".format(*divmod(round(seconds), 60))


def what_if(snapshots: Path, scenario: Scenario, history: History, go_on: GoOn) -> None:
    """Add the time line of a run that has left keyframes, some settings that may change, and the button. `go_on`: starts a fork."""
    known, draft = [round(tick * TIME_STEP, 1) for tick in ticks_of(snapshots)], Draft(scenario)
    if not known:
        return
    heading(3, "What if from here?")
    with ui.element("div").classes("moments"):
        named = [{"value": at, "label": moment(at)} for at in known[:: 1 + len(known) // MOMENTS]]
        time = ui.slider(
            min=known[0], max=int(max(history["seconds"], default=0)), value=known[len(known) // 2]
        ).classes("grow")
        time.props(
            f'data-field=moment aria-label="Moment from which the run goes on, s" :marker-labels="{named}"'
        )
        ui.label().bind_text_from(time, "value", moment).classes("figure").props("data-view=moment")
    with ui.element("div").classes("what-if"):
        controls = {path: Control(entries()[path], draft, "fork-") for path in CHANGING}
        with ui.element("div").classes("field"):
            ui.label("Stop").classes("field-label")
            robots = [name for name in lay_out(scenario).names if KINDS[kind_of(name)].robot]
            stop = several(robots, [], "fork-stop", "Robots that stand from then on")
    for path, control in controls.items():
        control.show(draft.values[path])
        if path in scenario.chosen:
            control.show_chosen(scenario.chosen[path])

    async def start() -> None:
        for path, control in controls.items():
            control.complain(draft.problems.get(path, ""))
        if draft.scenario is not None:
            changed = {
                path: draft.values[path]
                for path, value in flat(scenario).items()
                if draft.values[path] != value
            }
            sets = [
                f"--set={path}={msgspec.json.encode(value).decode()}"
                for path, value in changed.items()
            ]
            words = [
                str(snapshots),
                f"--at={time.value}",
                *sets,
                *(f"--stop={robot}" for robot in stop.value),
            ]
            count = sum(seconds <= time.value for seconds in history["seconds"])
            before = {name: values[:count] for name, values in history.items()}
            await go_on(draft.scenario, Fork(snapshots.stem, time.value, words, before))

    button("What if from here", start, "fork", "fork_right", "unelevated")
