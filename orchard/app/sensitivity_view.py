"""What does the result hang on? The values that are moved, a bar, the answer and its tornado."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import run, ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.command import STATE_COLOURS
from orchard.app.desks import Desk
from orchard.app.elements import StartAndStop, button, heading, labelled, note, table
from orchard.app.sensitivity_run import (
    FAR_LABEL,
    MOVED_LABEL,
    Sensitivities,
    SensitivityRun,
    movable,
)
from orchard.app.study_run import BUDGET_LABEL, HORIZON_LABEL
from orchard.app.study_view import HORIZONS, last_words
from orchard.field.scenario import Scenario
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.words import HEADS, legend, rows_of

QUESTION = "What does it hang on?"
HINT = (
    "Moves the values that you know only roughly, all at once, and tells which of them matters. So"
    " you know what to measure first."
)
# Between two looks at the command.
LOOK_SECONDS = 0.3
CHANGED = "Stopped, because something that it asks about was changed. Ask again."
# How a field for a text looks.
TEXT = "dense outlined autocomplete=off input-class=figure"


class SensitivityView:
    """The fields, Start and Stop, the bar, and what was found.

    All pages share one sensitivity at a time. The page that has started it stops it when an input
    changes.
    """

    def __init__(
        self, sensitivities: Sensitivities, desk: Desk, drafted: Callable[[], Scenario | None]
    ) -> None:
        """`drafted`: gives the form's scenario; None if it is invalid."""
        self._sensitivities = sensitivities
        self._desk = desk
        self._drafted = drafted
        self._settings = desk.sensitivity
        # The one that this page has started.
        self._own: SensitivityRun | None = None
        # The one that is shown with its answer.
        self._shown: SensitivityRun | None = None
        with ui.element("div").props("data-view=hangs"):
            with ui.element("div").classes("study-buttons"):
                self._fields = ui.element("div")
                self._buttons = StartAndStop(
                    sensitivities,
                    self._fields,
                    QUESTION,
                    self._start,
                    ("hangs-start", "hangs-stop"),
                )
                self._badge = ui.badge().props("data-view=hangs-state")
                ui.label(HINT).classes("study-hint")
            self._trouble = note("data-problem=hangs role=alert")
            self._bar = ui.linear_progress(value=0.0, show_value=False, size="8px")
            self._bar.props('rounded instant-feedback aria-label="Runs that are done"')
            self._answer = note("data-view=hangs-answer role=status", "answer")
            self._notes = note("data-view=hangs-notes", "classes")
            self._picture = ui.html("", sanitize=False).classes("study-picture")
            self._picture.props("data-view=hangs-picture")
            self._table = ui.element("div").classes("summary sides").props("data-view=hangs-table")
            self._report = button("Save the report", self._download, "hangs-report", "download")
            with ui.expansion("Move other values, or further").classes("experts") as more:
                more.props("data-view=hangs-more")
                with ui.element("div").classes("study-fields"):
                    self._build_fields()
        self._enter()
        ui.timer(LOOK_SECONDS, self._watch)

    # -- the fields

    def _build_fields(self) -> None:
        settings = self._settings
        with labelled(MOVED_LABEL):
            moved = ui.select(
                movable(),
                value=list(settings.moved),
                multiple=True,
                with_input=True,
                on_change=self._moved_chosen,
            )
            moved.classes("several").props(
                "dense outlined options-dense use-chips data-field=hangs-moved"
                f' aria-label="{MOVED_LABEL}" display-value-html=false'
            )
        with labelled(FAR_LABEL):
            self._text(settings.far, "far", FAR_LABEL).props('placeholder="the usual shares"')
        with labelled(HORIZON_LABEL):
            horizon = ui.toggle(HORIZONS, value=settings.horizon, on_change=self._enters("horizon"))
            horizon.props("dense no-caps unelevated data-field=hangs-horizon")
        with labelled(BUDGET_LABEL):
            budget = self._text(settings.budget, "budget", BUDGET_LABEL)
            budget.classes("number").props("inputmode=decimal")

    def _text(self, value: str, name: str, label: str) -> ui.input:
        """Add a field for a text. `name`: of the setting."""
        text = ui.input(value=value, on_change=self._enters(name))
        return text.props(f'{TEXT} data-field=hangs-{name} aria-label="{label}"')

    def _enters(self, name: str) -> Callable[[ValueChangeEventArguments[Any]], None]:
        """Return a function that takes what a user has changed. `name`: of a setting."""

        def enter(event: ValueChangeEventArguments[Any]) -> None:
            # A cleared field holds None.
            self._enter(**{name: event.value or ""})

        return enter

    def _moved_chosen(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take which values are moved, in the order of the file."""
        self._enter(moved=tuple(path for path in movable() if path in event.value))

    def _enter(self, **settings: Any) -> None:
        """Take what a user has changed, and tell what is wrong with it."""
        self._settings = replace(self._settings, **settings)
        self._desk.sensitivity = self._settings
        self._trouble.set_text(self._settings.problem)
        self._update_buttons()

    # -- user actions

    def _start(self) -> None:
        self._trouble.set_text(self._try_to_start())
        self._update_buttons()

    def _try_to_start(self) -> str:
        """Start it. Return why it was not started; '' if it was."""
        scenario = self._drafted()
        if scenario is None:
            return "The form has an invalid value"
        problem = self._settings.problem_with(scenario)
        if problem:
            return problem
        try:
            self._sensitivities.start(partial(SensitivityRun, scenario, self._settings))
        except (OSError, RuntimeError) as error:
            return f"The study was not started: {error}"
        self._own = self._sensitivities.command
        return ""

    def _download(self) -> None:
        # Its packages are an extra.
        from orchard.study.sensitivity.files import document

        if self._shown is not None and self._shown.result is not None:
            content = document(self._shown.result)
            ui.download.content(content, "sensitivity.html", "text/html")

    # -- updates

    def _stop_if_changed(self) -> None:
        """Stop what this page has started, if it asks about something else by now."""
        own = self._own
        if own is None or own.is_over or own.asked_to_stop:
            return
        if own.scenario != self._drafted() or own.settings != self._settings:
            own.stop()
            self._trouble.set_text(CHANGED)

    def _update_buttons(self) -> None:
        command = self._sensitivities.command
        self._buttons.update(not self._settings.problem)
        self._badge.set_visibility(command is not None)
        self._report.set_visibility(_has_effects(command))
        if command is None:
            self._bar.set_visibility(False)
            return
        state = command.state
        self._badge.set_text(state)
        self._badge.props(f"color={STATE_COLOURS[state]}")
        self._bar.set_visibility(not state.is_over)
        self._bar.set_value(command.share)

    async def _watch(self) -> None:
        """Show what is new."""
        self._stop_if_changed()
        self._update_buttons()
        command = self._sensitivities.command
        if command is None or command is self._shown:
            return
        if not command.is_over:
            self._show_words(_progress_words(command))
            return
        self._shown = command
        if command.result is None:
            self._show_words(last_words(command))
            return
        await self._show_result(command.result)

    def _show_words(self, words: str) -> None:
        """Show these words, and nothing of an answer before."""
        if self._answer.text == words:
            return
        self._answer.set_text(words)
        self._notes.set_text("")
        self._picture.set_content("")
        self._table.clear()

    async def _show_result(self, result: SensitivityResult) -> None:
        self._show_words(result.answer)
        self._notes.set_text("\n".join(result.notes))
        if not result.effects:
            return
        with self._table:
            heading(3, "What is moved")
            table(rows_of(result), HEADS)
            ui.label(legend(result)).classes("path")
        # The server gives None while it shuts down.
        self._picture.set_content(await run.io_bound(_tornado_of, result) or "")


def _has_effects(command: SensitivityRun | None) -> bool:
    """Whether there is an answer with the effect of each value."""
    if command is None or not command.is_over or command.result is None:
        return False
    return bool(command.result.effects)


def _progress_words(command: SensitivityRun) -> str:
    """Return what it has done so far."""
    if command.has_begun:
        return f"{100.0 * command.share:.0f} % of the runs are done."
    return "\n".join(["The runs begin.", *command.output.lines[-1:]])


def _tornado_of(result: SensitivityResult) -> str:
    """Return the picture of a result as SVG."""
    # Its packages are an extra.
    from orchard.study.picture import inline_drawing
    from orchard.study.sensitivity.files import TITLE
    from orchard.study.sensitivity.picture import figure

    return inline_drawing(figure(result), TITLE)
