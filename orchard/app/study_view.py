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

REDRAW_SECONDS = 1.0  # s between two pictures
Take = Callable[[Scenario, str], Awaitable[None]]
HINT = (
    "Tries numbers of carriers in the orchard of the form, as many as it takes, and tells how many"
    " are worth it. Choose policies or routes to compare them, too; all else, and the prices, are"
    " in the form."
)
HORIZONS = {"long": "the long run", "harvest": "one harvest"}
LAST_WORDS = 12  # lines of a study that failed


class StudyView:
    """The fields, Start and Stop, and what the study has found.

    All pages share one study at a time.
    """

    def __init__(
        self, studies: Studies, desk: Desk, drafted: Callable[[], Scenario | None], take: Take
    ) -> None:
        """`drafted`: gives the form's scenario, None if invalid. `take`: sets the form to a
        scenario with a name.
        """
        self._studies, self._desk, self._drafted, self._take = studies, desk, drafted, take
        self._settings = desk.study
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
            self._picture = (
                ui.html("", sanitize=False)
                .classes("study-picture")
                .props("data-view=study-picture")
            )
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
        with ui.element("div").classes("study-field") as box:
            ui.label(name).classes("field-label")
        return box

    def _choice(self, name: str, field: str) -> None:
        names, chosen = CHOICES[field], list(getattr(self._settings, field))

        def choose(event: ValueChangeEventArguments[Any]) -> None:
            self._enter(**{field: tuple(name for name in names if name in event.value)})

        with self._labelled(name):
            several(names, chosen, f"study-{field}", name, choose)

    # -- user actions

    def _enter(self, **settings: Any) -> None:
        self._desk.study = self._settings = replace(self._settings, **settings)
        problem = self._settings.problem
        self._trouble.set_text(f"Time to take: {problem}" if problem else "")
        self._update_buttons()

    def _start(self) -> None:
        self._trouble.set_text(self._started())
        self._update_buttons()

    def _started(self) -> str:
        scenario, settings = self._drafted(), self._settings
        if scenario is None or settings.problem:
            return "The form has an invalid value"
        try:
            self._studies.start(partial(StudyRun, scenario, settings))
        except (OSError, RuntimeError) as error:
            return f"The study was not started: {error}"
        return ""

    def _download(self) -> None:
        from orchard.study.report import document  # its packages are an extra

        if (study := self._studies.command) is not None and (result := study.result) is not None:
            ui.download.content(document(result), "study.html", "text/html")

    async def _use(self, result: StudyResult, number: int) -> None:
        setting = result.table[number].setting
        await self._take(with_changes(check(result.scenario), **setting), setting_words(setting))

    # -- updates

    def _update_buttons(self) -> None:
        study = self._studies.command
        self._buttons.update(not self._settings.problem)
        self._badge.set_visibility(study is not None)
        self._report.set_visibility(
            study is not None and study.is_over and study.result is not None
        )
        if study is not None:
            self._badge.set_text(study.state)
            self._badge.props(f"color={STATE_COLOURS[study.state]}")

    async def _watch(self) -> None:
        """Show what is new of the study.

        Whether it is over is read first: then the result is the last one.
        """
        self._update_buttons()
        if (study := self._studies.command) is None:
            return
        is_over, result = study.is_over, study.result
        if self._shown == (study, result, is_over):
            return
        self._shown = study, result, is_over
        last = "\n".join(study.said[1][-LAST_WORDS:])
        without = (
            f"There is no answer. The last messages:\n{last}" if is_over else "The study begins."
        )
        self._answer.set_text(result.answer if result else without)
        self._notes.set_text("\n".join(result.notes) if result else "")
        self._picture.set_content((await run.io_bound(_drawn, result) or "") if result else "")
        self._table.clear()
        if result is not None and is_over:
            self._show_table(result)

    def _show_table(self, result: StudyResult) -> None:
        heads, lines = words(result)

        def act(number: int) -> None:
            said = setting_words(result.table[number].setting)
            use = button(
                "Set the form",
                partial(self._use, result, number),
                f"study-use-{number}",
                props="flat dense",
            )
            use.props["aria-label"] = f"Set the form to {said}"

        with self._table:
            heading(3, "Settings")
            ui.label("Set the form to a setting, and run it: then you can watch it.").classes(
                "path"
            )
            table(lines, heads, act)
            ui.label(legend(result)).classes("path")


def _drawn(result: StudyResult) -> str:
    from orchard.study.picture import inline_svg  # its packages are an extra

    return inline_svg(result)
