"""What if? The time line of a run that has ended.

From a moment on, a fork of the run goes on with something changed. A fork begins from a keyframe: a
snapshot that the run has kept in a folder beside its other files.
"""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
from nicegui import ui

from orchard.app.charts import History
from orchard.app.control import Control
from orchard.app.draft import Draft
from orchard.app.elements import button, heading, several
from orchard.app.entries import entries, flat
from orchard.field.kinds import ROBOTS
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.report.summary import clock
from orchard.sim.snapshot import ticks_of

# Some of what may change under way.
CHANGING = (
    "carriers",
    "dispatch",
    "picking_rate",
    "people.workers",
    "people.visitors",
    "seed",
)
# Moments that are named on a time line.
MOMENTS = 8


class Fork(NamedTuple):
    """A run that goes on from a moment of another one.

    `seconds`: the moment. `words`: what follows `orchard fork` on its command line. `history`: of
    the other run, up to the moment.
    """

    parent: str
    seconds: float
    words: list[str]
    history: History


#: Starts a fork, with its scenario.
GoOn = Callable[[Scenario, Fork], Awaitable[None]]


def moment(seconds: float) -> str:
    """Return a moment as it is named on a time line: 2:30, or 3:42:00 after hours.

    >>> moment(150.0), moment(13_320.0)
    ('2:30', '3:42:00')
    """
    return clock(seconds).partition(" ")[0]


def what_if(
    snapshots: Path, scenario: Scenario, history: History, go_on: GoOn, where: str = ""
) -> None:
    """Add the time line of a run that has left keyframes, what may change, and the button.

    `snapshots`: the folder with the keyframes. `history`: of the run. `go_on`: starts a fork.
    `where`: goes before the names of all elements for tests.
    """
    kept = [round(tick * TIME_STEP, 1) for tick in ticks_of(snapshots)]
    if not kept:
        return
    draft = Draft(scenario)
    heading(3, "What if from here?")
    time = _time_line(kept, int(max(history["seconds"], default=0)), where)
    with ui.element("div").classes("what-if"):
        controls = {path: Control(entries()[path], draft, f"{where}fork-") for path in CHANGING}
        with ui.element("div").classes("field"):
            ui.label("Stop").classes("field-label")
            robots = lay_out(scenario).names_of(*ROBOTS)
            stop = several(robots, [], f"{where}fork-stop", "Robots that stand from then on")
    for path, control in controls.items():
        control.show(draft.values[path])
        if path in scenario.chosen:
            control.show_chosen(scenario.chosen[path])

    async def start() -> None:
        for control in controls.values():
            control.complain()
        if draft.scenario is not None:
            changes = [*_changes(scenario, draft), *(f"--stop={robot}" for robot in stop.value)]
            words = [str(snapshots), f"--at={time.value}", *changes]
            before = _until(history, time.value)
            await go_on(draft.scenario, Fork(snapshots.stem, time.value, words, before))

    button("What if from here", start, f"{where}fork", "fork_right", "unelevated")


def _time_line(kept: list[float], end: int, where: str) -> ui.slider:
    """Add a time line. `kept`: the moments with a keyframe, s. `end`: of the run, s.

    `where`: as for `what_if`.
    """
    # Of so many moments one is named.
    step = 1 + len(kept) // MOMENTS
    labels = [{"value": seconds, "label": moment(seconds)} for seconds in kept[::step]]
    with ui.element("div").classes("moments"):
        time = ui.slider(min=kept[0], max=end, value=kept[len(kept) // 2]).classes("grow")
        time.props(
            f'data-field={where}moment aria-label="Moment from which the run goes on, s" '
            f':marker-labels="{labels}"'
        )
        shown = ui.label().bind_text_from(time, "value", moment)
        shown.classes("figure").props(f"data-view={where}moment")
    return time


def _changes(scenario: Scenario, draft: Draft) -> list[str]:
    """Return what is entered in a draft that a scenario has not, as options of `orchard fork`."""
    changes = []
    for path, value in flat(scenario).items():
        if draft.values[path] != value:
            changes.append(f"--set={path}={msgspec.json.encode(draft.values[path]).decode()}")
    return changes


def _until(history: History, seconds: float) -> History:
    """Return the history of a run up to a moment."""
    count = sum(at <= seconds for at in history["seconds"])
    return {name: values[:count] for name, values in history.items()}
