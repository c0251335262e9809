"""How many carriers? The answer, its picture that grows, settings to watch, and what to compare."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import run, ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.also_compared import COMPARED_LABEL, comparable
from orchard.app.changed_since import changed_settings, changed_values, changed_words
from orchard.app.command import STATE_COLOURS, PageCommand
from orchard.app.desks import Desk
from orchard.app.elements import StartAndStop, button, heading, labelled, note, several, table
from orchard.app.own_classes import CHOICES
from orchard.app.page_words import BUDGET_LABEL, DEADLINE_LABEL, in_page_words
from orchard.app.study_run import HORIZON_LABEL, Studies, StudyRun
from orchard.field.scenario import Scenario, check, with_changes
from orchard.study.result import StudyResult
from orchard.study.table import heads_and_lines, legend
from orchard.study.words import setting_words

# Between two pictures.
REDRAW_SECONDS = 1.0
#: Sets the form to a scenario, under a name.
Take = Callable[[Scenario, str], Awaitable[None]]
HOW_MANY = "How many carriers?"
WHICH_FLEET = "Which fleet?"
HINT = (
    "Tries numbers of carriers with your rows, people and prices, as many as it takes, and tells"
    " how many are worth it. The answer grows while you look."
)
HINT_OF_FLEETS = (
    "Tries numbers of people and carriers together, and tells which of them are done in time at"
    " the least cost; without prices, with the fewest. The answer grows while you look."
)
HINT_OF_OWN_PEOPLE = (
    "Tries numbers of carriers with your people, and tells how many are done in time at the least"
    " cost. Enter “Price of a picker”, and numbers of people are tried, too."
)
UNITS = {"h": "hours of work", "d": "days"}
HORIZONS = {"long": "the long run", "harvest": "one harvest"}
# Characters of the part of an answer that is shown large.
LONGEST_HEADLINE = 60
NOT_STARTED = "The study was not started"
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
            with ui.element("div").classes("study-buttons"):
                self._fields = ui.element("div").classes("study-fields")
                self._buttons = StartAndStop(
                    studies, self._fields, HOW_MANY, self._start, ("study-start", "study-stop")
                )
                self._badge = ui.badge().props("data-view=study-state")
                self._build_deadline()
                self._hint = ui.label(HINT).classes("study-hint")
            self._trouble = note("data-problem=study role=alert")
            # When a study ends is not known: it takes as many runs as it needs to be sure.
            self._bar = ui.linear_progress(show_value=False, size="6px")
            self._bar.props('indeterminate rounded aria-label="The study goes on"')
            self._bar.props("data-view=study-bar")
            self._changed = note("data-view=study-changed role=status", "study-changed")
            with ui.element("div").props("data-view=answer role=status"):
                self._headline = note("", "answer-headline")
                self._answer = note("", "answer")
            self._notes = note("data-view=study-notes", "classes")
            self._picture = ui.html("", sanitize=False).classes("study-picture")
            self._picture.props("data-view=study-picture")
            self._table = ui.element("div").classes("summary sides").props("data-view=study-table")
            self._report = button("Save the report", self._download, "study-report", "download")
            # The buttons lock the fields, so these were made before them. Their place is here.
            more = ui.expansion("Compare more, such as people, trailers, policies, routes").classes(
                "experts"
            )
            self._fields.move(more.props("data-view=study-more"))
            with self._fields:
                self._build_fields()
        self._enter()
        ui.timer(REDRAW_SECONDS, self._watch)

    # -- the fields

    def _build_fields(self) -> None:
        self._build_compared()
        self._choice("Dispatch policies", "dispatch")
        self._choice("Routes", "route")
        with labelled(HORIZON_LABEL):
            self._horizon = ui.toggle(
                HORIZONS,
                value=self._settings.horizon,
                on_change=self._enter_horizon,
            )
            self._horizon.props("dense no-caps unelevated data-field=horizon")
        with labelled(BUDGET_LABEL):
            text = ui.input(
                value=self._settings.budget,
                on_change=self._enter_budget,
            ).classes("number")
            text.props(
                "dense outlined autocomplete=off inputmode=decimal data-field=study-budget"
                f' aria-label="{BUDGET_LABEL}"'
            )
            text.props("input-class=figure")

    def _build_compared(self) -> None:
        """Add the fields for one more setting to compare, and its values."""
        with labelled(COMPARED_LABEL), ui.element("div").classes("field-body"):
            setting = ui.select(
                {"": "nothing", **comparable()},
                value=self._settings.compared,
                with_input=True,
                on_change=self._compared_chosen,
            )
            setting.props(
                "dense outlined options-dense data-field=study-compared"
                f' aria-label="{COMPARED_LABEL}"'
            )
            text = ui.input(
                value=self._settings.compared_values,
                placeholder="such as 4-8",
                on_change=self._compared_typed,
            )
            text.props(
                "dense outlined autocomplete=off data-field=study-compared-values"
                f' aria-label="{COMPARED_LABEL}: values" input-class=figure'
            )

    def _compared_chosen(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take which setting is compared, too."""
        self._enter(compared=event.value or "")

    def _compared_typed(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take the values of that setting."""
        self._enter(compared_values=event.value or "")

    def _build_deadline(self) -> None:
        """Add the field for the time by which the harvest must be done."""
        box = labelled(DEADLINE_LABEL)
        with box, ui.element("div").classes("field-body"):
            text = ui.input(
                value=self._settings.deadline,
                placeholder="any time",
                on_change=self._deadline_typed,
            ).classes("number")
            text.props(
                "dense outlined autocomplete=off inputmode=decimal data-field=study-deadline"
                f' aria-label="{DEADLINE_LABEL}" input-class=figure'
            )
            unit = ui.toggle(
                UNITS,
                value=self._settings.deadline_unit,
                on_change=self._deadline_unit_chosen,
            )
            unit.props("dense no-caps unelevated data-field=study-deadline-unit")

    def _deadline_typed(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take the text of the deadline."""
        # A cleared field is no text.
        self._enter(deadline=event.value or "")

    def _deadline_unit_chosen(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take whether the deadline is in hours of work or in days."""
        self._enter(deadline_unit=event.value)

    def _choice(self, name: str, field: str) -> None:
        """Add a choice of rules. `field`: of the settings, and of the scenario."""
        rules = CHOICES[field]
        chosen = list(getattr(self._settings, field))

        def choose(event: ValueChangeEventArguments[Any]) -> None:
            self._enter(**{field: tuple(rule for rule in rules if rule in event.value)})

        with labelled(name):
            several(rules, chosen, f"study-{field}", name, choose)

    # -- user actions

    def _enter(self, **settings: Any) -> None:
        """Take what a user has changed, and tell what is wrong with it."""
        self._settings = replace(self._settings, **settings)
        self._desk.study = self._settings
        self._trouble.set_text(self._settings.problem)
        # A deadline is that of one harvest.
        self._horizon.set_enabled(not self._settings.has_deadline)
        self._update_buttons()

    def _enter_horizon(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take whether a harvest or the long run is asked for."""
        self._enter(horizon=event.value)

    def _enter_budget(self, event: ValueChangeEventArguments[Any]) -> None:
        """Take the time that the study may take."""
        self._enter(budget=event.value or "")

    def _start(self) -> None:
        self._trouble.set_text(self._try_to_start())
        self._update_buttons()

    def _try_to_start(self) -> str:
        """Start the study. Return why it was not started; '' if it was."""
        scenario = self._drafted()
        settings = self._settings
        if scenario is None:
            return "The form has an invalid value"
        problem = settings.problem_with(scenario)
        if problem:
            return problem
        try:
            self._studies.start(partial(StudyRun, scenario, settings))
        except (OSError, RuntimeError) as error:
            return f"{NOT_STARTED}: {error}"
        return ""

    def _forget_what_is_mended(self) -> None:
        """Take away why a study was refused, once nothing is wrong with what is entered."""
        scenario = self._drafted()
        refused = self._trouble.text and not self._trouble.text.startswith(NOT_STARTED)
        if refused and scenario is not None and not self._settings.problem_with(scenario):
            self._trouble.set_text("")

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

    def _name_question(self) -> None:
        """Say on the button and beside it what is tried. It hangs on prices of the form, too."""
        scenario = self._drafted()
        if not self._settings.has_deadline:
            question, hint = HOW_MANY, HINT
        elif scenario is None or self._settings.compares_pickers(scenario):
            question, hint = WHICH_FLEET, HINT_OF_FLEETS
        else:
            question, hint = HOW_MANY, HINT_OF_OWN_PEOPLE
        self._buttons.name(question)
        self._hint.set_text(hint)

    def _update_buttons(self) -> None:
        self._name_question()
        study = self._studies.command
        self._buttons.update(not self._settings.problem)
        self._badge.set_visibility(study is not None)
        self._bar.set_visibility(study is not None and not study.is_over)
        has_answer = study is not None and study.is_over and study.result is not None
        self._report.set_visibility(has_answer)
        if study is not None:
            state = study.state
            self._badge.set_text(state)
            self._badge.props(f"color={STATE_COLOURS[state]}")

    async def _watch(self) -> None:
        """Show what is new of the study."""
        self._forget_what_is_mended()
        self._update_buttons()
        study = self._studies.command
        if study is None:
            return
        self._changed.set_text(self._changed_since(study))
        # This is read before the result: once the study is over, its result is the last one.
        is_over = study.is_over
        result = study.result
        if result is None:
            words = _without_answer(study, is_over)
            if self._answer.text != words:
                self._show_no_answer(words)
            return
        if self._shown == (study, result, is_over):
            return
        self._shown = study, result, is_over
        headline, rest = answer_in_two(result.answer, ", " if result.deadline else ": ")
        self._headline.set_text(headline)
        self._answer.set_text(rest)
        self._notes.set_text("\n".join(map(in_page_words, result.notes)))
        # The server gives None while it shuts down.
        self._picture.set_content(await run.io_bound(_picture_of, result) or "")
        self._table.clear()
        if is_over:
            self._show_table(result)

    def _changed_since(self, study: StudyRun) -> str:
        """Return what the user has changed since the study was asked; '' if nothing is."""
        scenario = self._drafted()
        if scenario is None:
            return ""
        varied = {"carriers"}
        if study.settings.compares_pickers(study.scenario):
            varied.add("pickers")
        if study.result is not None and study.result.table:
            varied.update(study.result.table[0].setting)
        labels = changed_values(study.scenario, scenario, varied)
        labels += changed_settings(study.settings, self._settings)
        return changed_words(labels)

    def _show_no_answer(self, words: str) -> None:
        """Show why there is no answer yet, and nothing of the study before."""
        self._headline.set_text("")
        self._answer.set_text(words)
        self._notes.set_text("")
        self._picture.set_content("")
        self._table.clear()

    def _show_table(self, result: StudyResult) -> None:
        """Add the table of an answer. A button in each line sets the form to its setting."""
        heads, lines = heads_and_lines(result)

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


def answer_in_two(answer: str, end: str = ": ") -> tuple[str, str]:
    """Return the first words of an answer, which are shown large, and the rest of it.

    `end`: what stands after the first words.

    >>> answer_in_two("3 carriers: 11.27 bins an hour; one more gains less than 2 %.")
    ('3 carriers', '11.27 bins an hour; one more gains less than 2 %.')
    """
    headline, colon, rest = answer.partition(end)
    if not colon or len(headline) > LONGEST_HEADLINE:
        return "", answer
    return headline, rest


def _without_answer(study: StudyRun, is_over: bool) -> str:
    """Return why a study has no answer."""
    if not is_over:
        return "\n".join(["The study begins.", *study.output.lines[-1:]])
    return last_words(study)


def last_words(command: PageCommand) -> str:
    """Return what a command without an answer has printed last."""
    last = "\n".join(map(in_page_words, command.output.lines[-LAST_WORDS:]))
    return f"There is no answer. The last messages:\n{last}"


def _picture_of(result: StudyResult) -> str:
    """Return the picture of a result as SVG."""
    # Its packages are an extra.
    from orchard.study.picture import inline_svg

    return inline_svg(result)
