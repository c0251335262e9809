"""How many carriers? What to compare, the picture that grows, the answer, and settings to watch."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import run, ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.command import STATE_COLOURS
from orchard.app.desks import Desk
from orchard.app.elements import StartAndStop, button, heading, note, several, table
from orchard.app.own_classes import CHOICES
from orchard.app.study_run import Studies, StudyRun
from orchard.field.scenario import Scenario, check, with_changes
from orchard.study.result import StudyResult
from orchard.study.table import legend, words
from orchard.study.words import setting_words

# Between two pictures.
REDRAW_SECONDS = 1.0
#: Sets the form to a scenario, under a name.
Take = Callable[[Scenario, str], Awaitable[None]]
HINT = (
    "Tries numbers of carriers in the orchard of the form, as many as it takes, and tells how many"
    " are worth it. Choose policies or routes to compare them, too; all else, and the prices, are"
    " in the form."
)
HORIZONS = {"long": "the long run", "harvest": "one harvest"}
# Lines of a study that failed, which are shown.
LAST_WORDS = 12


class StudyView:
    """The fields, Start and Stop, and what the study has found.

    All pages share one study at a time.
    """

    def __init__(
        self, studies: Studies, desk: Desk, drafted: Callable[[], Scenario | None], take: Take
    ) -> None:
        """`drafted`: gives the form's scenario; None if it is invalid."""
        self._studies = studies
        self._desk = desk
        self._drafted = drafted
        self._take = take
        self._settings = desk.study
        # The study, its result so far, and whether it was over.
        self._shown: tuple[StudyRun, StudyResult | None, bool] | None = None
        with ui.element("div").props("data-view=study"):
            ui.label(HINT).classes("study-hint")
            with ui.element("div").classes("study-fields") as self._fields:
                self._build_fields()
            with ui.element("div").classes("study-buttons"):
                self._buttons = StartAndStop(
                    studies, self._fields, "Start", self._start, ("study-start", "study-stop")
                )
                self._badge = ui.badge().props("data-view=study-state")
            self._trouble = note("data-problem=study role=alert")
            self._answer = ui.label().classes("answer").props("data-view=answer role=status")
            self._notes = ui.label().classes("classes").props("data-view=study-notes")
            self._picture = ui.html("", sanitize=False).classes("study-picture")
            self._picture.props("data-view=study-picture")
            self._table = ui.element("div").classes("summary sides").props("data-view=study-table")
            self._report = button("Save the report", self._download, "study-report", "download")
        self._enter()
        ui.timer(REDRAW_SECONDS, self._watch)

    # -- the fields

    def _build_fields(self) -> None:
        self._choice("Dispatch policies", "dispatch")
        self._choice("Routes", "route")
        with self._labelled("Horizon"):
            horizon = ui.toggle(
                HORIZONS,
                value=self._settings.horizon,
                on_change=lambda event: self._enter(horizon=event.value),
            )
            horizon.props("dense no-caps unelevated data-field=horizon")
        with self._labelled("Time to take, s"):
            text = ui.input(
                value=self._settings.budget,
                on_change=lambda event: self._enter(budget=event.value or ""),
            ).classes("number")
            text.props(
                "dense outlined autocomplete=off inputmode=decimal data-field=study-budget"
                ' aria-label="Time to take, s"'
            )
            text.props("input-class=figure")

    def _labelled(self, name: str) -> ui.element:
        """Add a field with a label. Return its box."""
        with ui.element("div").classes("study-field") as box:
            ui.label(name).classes("field-label")
        return box

    def _choice(self, name: str, field: str) -> None:
        """Add a choice of rules. `field`: of the settings, and of the scenario."""
        rules = CHOICES[field]
        chosen = list(getattr(self._settings, field))

        def choose(event: ValueChangeEventArguments[Any]) -> None:
            self._enter(**{field: tuple(rule for rule in rules if rule in event.value)})

        with self._labelled(name):
            several(rules, chosen, f"study-{field}", name, choose)

    # -- user actions

    def _enter(self, **settings: Any) -> None:
        """Take what a user has changed, and tell what is wrong with it."""
        self._settings = replace(self._settings, **settings)
        self._desk.study = self._settings
        problem = self._settings.problem
        self._trouble.set_text(f"Time to take, s: {problem}" if problem else "")
        self._update_buttons()

    def _start(self) -> None:
        self._trouble.set_text(self._try_to_start())
        self._update_buttons()

    def _try_to_start(self) -> str:
        """Start the study. Return why it was not started; '' if it was."""
        scenario = self._drafted()
        settings = self._settings
        if scenario is None or settings.problem:
            return "The form has an invalid value"
        try:
            self._studies.start(partial(StudyRun, scenario, settings))
        except (OSError, RuntimeError) as error:
            return f"The study was not started: {error}"
        return ""

    def _download(self) -> None:
        # Its packages are an extra.
        from orchard.study.report import document

        study = self._studies.command
        if study is not None and study.result is not None:
            ui.download.content(document(study.result), "study.html", "text/html")

    async def _use(self, result: StudyResult, number: int) -> None:
        """Set the form to a line of the table."""
        setting = result.table[number].setting
        await self._take(with_changes(check(result.scenario), **setting), setting_words(setting))

    # -- updates

    def _update_buttons(self) -> None:
        study = self._studies.command
        self._buttons.update(not self._settings.problem)
        self._badge.set_visibility(study is not None)
        has_answer = study is not None and study.is_over and study.result is not None
        self._report.set_visibility(has_answer)
        if study is not None:
            state = study.state
            self._badge.set_text(state)
            self._badge.props(f"color={STATE_COLOURS[state]}")

    async def _watch(self) -> None:
        """Show what is new of the study."""
        self._update_buttons()
        study = self._studies.command
        if study is None:
            return
        # This is read before the result: once the study is over, its result is the last one.
        is_over = study.is_over
        result = study.result
        if self._shown == (study, result, is_over):
            return
        self._shown = study, result, is_over
        if result is None:
            self._answer.set_text(_without_answer(study, is_over))
            self._notes.set_text("")
            self._picture.set_content("")
            self._table.clear()
            return
        self._answer.set_text(result.answer)
        self._notes.set_text("\n".join(result.notes))
        # The server gives None while it shuts down.
        self._picture.set_content(await run.io_bound(_picture_of, result) or "")
        self._table.clear()
        if is_over:
            self._show_table(result)

    def _show_table(self, result: StudyResult) -> None:
        """Add the table of an answer. A button in each line sets the form to its setting."""
        heads, lines = words(result)

        def add_button(number: int) -> None:
            use = button(
                "Set the form",
                partial(self._use, result, number),
                f"study-use-{number}",
                props="flat dense",
            )
            setting = setting_words(result.table[number].setting)
            use.props["aria-label"] = f"Set the form to {setting}"

        with self._table:
            heading(3, "Settings")
            advice = "Set the form to a setting, and run it: then you can watch it."
            ui.label(advice).classes("path")
            table(lines, heads, add_button)
            ui.label(legend(result)).classes("path")


def _without_answer(study: StudyRun, is_over: bool) -> str:
    """Return why a study has no answer."""
    if not is_over:
        return "The study begins."
    last = "\n".join(study.output.lines[-LAST_WORDS:])
    return f"There is no answer. The last messages:\n{last}"


def _picture_of(result: StudyResult) -> str:
    """Return the picture of a result as SVG."""
    # Its packages are an extra.
    from orchard.study.picture import inline_svg

    return inline_svg(result)
