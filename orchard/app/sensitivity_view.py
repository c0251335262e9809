"""What does the result hang on? The values that are moved, a bar, the answer and its tornado."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import run, ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.answer_view import INVALID, LOOK_SECONDS, AnswerView
from orchard.app.desks import Desk
from orchard.app.elements import button, labelled
from orchard.app.page_words import BUDGET_LABEL
from orchard.app.sensitivity_run import (
    FAR_LABEL,
    MOVED_LABEL,
    Sensitivities,
    SensitivityRun,
    movable,
)
from orchard.app.study_run import HORIZON_LABEL
from orchard.app.study_view import HORIZONS
from orchard.field.scenario import Scenario
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.words import HEADS, legend, rows_of

QUESTION = "What does it hang on?"
HINT = (
    "Moves the values that you know only roughly, all at once, and tells which of them matters. So"
    " you know what to measure first."
)
# How a field for a text looks.
TEXT = "dense outlined autocomplete=off input-class=figure"


class SensitivityView(AnswerView):
    """The fields and the answer. All pages share one sensitivity at a time."""

    def __init__(
        self, sensitivities: Sensitivities, desk: Desk, drafted: Callable[[], Scenario | None]
    ) -> None:
        """`drafted`: gives the form's scenario; None if it is invalid."""
        self._desk = desk
        self._drafted = drafted
        self._settings = desk.sensitivity
        super().__init__(sensitivities, "hangs", QUESTION, HINT)
        self._report = button("Save the report", self._download, "hangs-report", "download")
        self._report.set_visibility(False)
        with ui.expansion("Move other values, or further").classes("experts") as more:
            more.props("data-view=hangs-more")
            with ui.element("div").classes("study-fields"):
                self._build_fields()
        self._update()
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
                f' aria-label="{MOVED_LABEL}"'
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
        self._update()

    # -- the question

    @property
    def _problem(self) -> str:
        return self._settings.problem

    def _problem_now(self) -> str:
        scenario = self._drafted()
        if scenario is None:
            return INVALID
        return self._settings.problem_with(scenario)

    def _begin(self) -> None:
        scenario = self._drafted()
        assert scenario is not None
        self._commands.start(partial(SensitivityRun, scenario, self._settings))

    def _is_as_asked(self, own: SensitivityRun) -> bool:
        return own.scenario == self._drafted() and own.settings == self._settings

    def _progress(self, command: SensitivityRun) -> tuple[float, str]:
        if not command.has_begun:
            return 0.0, ""
        return command.share, f"{100.0 * command.share:.0f} % of the runs are done."

    # -- the answer

    def _show_words(self, words: str) -> None:
        self._report.set_visibility(False)
        super()._show_words(words)

    async def _show_result(self, command: SensitivityRun) -> None:
        result = command.result
        has_effects = result is not None and bool(result.effects)
        self._report.set_visibility(has_effects)
        if result is None or not has_effects:
            return
        self._show_table("What is moved", HEADS, rows_of(result), legend(result))
        # The server gives None while it shuts down.
        self._picture.set_content(await run.io_bound(_tornado_of, result) or "")

    def _download(self) -> None:
        """Let the browser save the report of the answer that is shown."""
        # Its packages are an extra.
        from orchard.study.sensitivity.files import document

        shown = self._shown
        if isinstance(shown, SensitivityRun) and shown.result is not None:
            ui.download.content(document(shown.result), "sensitivity.html", "text/html")


def _tornado_of(result: SensitivityResult) -> str:
    """Return the picture of a result as SVG."""
    # Its packages are an extra.
    from orchard.study.picture import inline_drawing
    from orchard.study.sensitivity.files import TITLE
    from orchard.study.sensitivity.picture import figure

    return inline_drawing(figure(result), TITLE)
