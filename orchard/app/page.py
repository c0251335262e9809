"""The page: presets, files and link on top, the form on the left, run, answer and results on the
right.
"""

from copy import copy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import events, run, ui

from orchard.app.desks import Desk
from orchard.app.draft import Draft, counted_fields
from orchard.app.elements import StartAndStop, button, dialog, note, while_alive
from orchard.app.entries import label_of
from orchard.app.estimate import EstimateView
from orchard.app.farm_view import FarmView
from orchard.app.form import Form
from orchard.app.harvest_run import SETTINGS, HarvestCommand, Harvests, RunSettings
from orchard.app.link import query_of
from orchard.app.own_classes import from_elsewhere, may_run
from orchard.app.preview import FiguresView, derive
from orchard.app.questions import Questions
from orchard.app.run_controls import RunControls
from orchard.app.sensitivity_view import SensitivityView
from orchard.app.study_view import StudyView
from orchard.app.views import ProgressView, Stage
from orchard.app.what_if import Fork
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import Scenario, parse, to_yaml
from orchard.field.shipped import DEFAULT, shipped
from orchard.field.yaml_file import LARGEST_FILE

STYLE = Path(__file__).with_name("style.css")
# Between two checks for changed input.
REDRAW_SECONDS = 0.1
# Between two updates of the run.
WATCH_SECONDS = 0.3
# These seconds a browser may be too busy to answer, for example while it loads the Rerun viewer.
PATIENCE = 30.0
# Bytes of a file that the page reads. `parse` tells of one above LARGEST_FILE how large it may be.
LARGEST_UPLOAD = 10 * LARGEST_FILE
# Characters of the name of a file, as the page shows it.
LONGEST_NAME = 100
NOT_OPENED = "This file was not opened"
TOO_LARGE = "The file is too large for a scenario, or it is not a .yaml file."
THE_LINK = "the link"
NOT_ALL_UNDERSTOOD = "Not all of the link was understood"
FIRST = (
    "Enter your rows, and ask how many carriers they need. Or press Run: "
    "watch the harvest under Picture; Summary tells how well it went."
)


@dataclass(frozen=True)
class Entered:
    """What a page shows the consequences of: what is entered, and the run that goes on."""

    values: dict[str, Any]
    scenario: Scenario | None
    problems: dict[str, str]
    settings: RunSettings
    going: HarvestCommand | None


class Page:
    """A page in one browser, which begins with what was entered there last.

    All pages share one run, and one study of each kind.
    """

    def __init__(self, runs: Harvests, questions: Questions, desk: Desk) -> None:
        """`desk`: what was entered in this browser, and takes what is entered here."""
        self.runs = runs
        self.questions = questions
        self.desk = desk
        self.draft = copy(desk.draft)
        # As it was when the page was drawn last.
        self._drawn: Entered | None = None
        # What the plan shows or will show, and what the figures do.
        self._planned: Entered | None = None
        self._derived: Entered | None = None
        # The run on the stage, and whether it was over.
        self._staged: tuple[HarvestCommand, bool] | None = None
        self._build()
        self.form.show()
        self._show_undo()
        ui.timer(REDRAW_SECONDS, self._redraw)
        ui.timer(REDRAW_SECONDS, self._draw_plan)
        ui.timer(REDRAW_SECONDS, self._draw_figures)
        ui.timer(WATCH_SECONDS, self._watch)

    # -- layout

    def _build(self) -> None:
        ui.add_css(STYLE)
        ui.colors(primary="#33692f", positive="#33692f", warning="#8f5600", negative="#b3261e")
        self._dark = ui.dark_mode(self.desk.dark)
        with ui.header().classes("top"):
            with ui.element("h1").classes("top-title grow"):
                ui.label("Kiwifruit orchard")
            self._build_files()
        with ui.element("div").classes("page"):
            self._build_run()
            with _section("form", "Settings of the orchard"):
                self.form = Form(self.draft)
            with _section("answer-card", "How many carriers?"):
                self.estimate = EstimateView()
                StudyView(self.questions.fleets, self.desk, self._drafted, self._offer)
            with _section("answer-card", "What does it hang on?"):
                SensitivityView(self.questions.sensitivities, self.desk, self._drafted)
            with (
                _section("answer-card", "Several blocks"),
                ui.expansion("Several blocks, one fleet").classes("experts") as farm,
            ):
                farm.props("data-view=farm")
                FarmView(self.questions.farms, self.desk, self._drafted, self._offer)
            with ui.element("div").classes("middle"):
                self.stage = Stage(self.runs.folder, self._offer, self._go_on)
                with _section("figures", "Figures before the run"):
                    self.figures = FiguresView()

    def _drafted(self) -> Scenario | None:
        """Return the scenario that is entered; None if it is invalid."""
        return self.draft.scenario

    def _build_files(self) -> None:
        # Their place has a width of its own: no other button may move from under a click.
        with ui.element("div").classes("undo-and-redo"):
            self._undo_button = button("Undo", self._undo, "undo", "undo")
            self._redo_button = button("", self._redo, "redo", "redo")
            self._redo_button.props["aria-label"] = "Redo"
        for file, scenario in shipped().items():
            name = "default" if file == DEFAULT else file
            words = name.replace("_", " ").capitalize()
            preset = ui.button(words, on_click=partial(self._take, scenario, words))
            preset.props(f"flat no-caps data-preset={name}")
        ui.element("div").classes("divider")
        self._upload = ui.upload(
            on_upload=while_alive(self._open),
            on_rejected=partial(complain, NOT_OPENED, [TOO_LARGE]),
            max_file_size=LARGEST_UPLOAD,
            auto_upload=True,
        )
        self._upload.props("accept=.yaml,.yml").classes("hidden")
        button("Open", self._pick_file, "open", "folder_open")
        self._save = button("Save", self._download, "save", "download")
        self._link = button("Link", self._show_link, "link", "link")
        dark = button("", self._turn_dark, "dark", "contrast")
        dark.props('aria-label="Dark or light" title="Dark or light"')

    def _pick_file(self) -> None:
        """Let the browser ask for a file."""
        self._upload.run_method("pickFiles")

    def _build_run(self) -> None:
        with _section("run-card", "The run"):
            with ui.element("div").classes("wishes-and-run"):
                with ui.expansion("How the run goes: mode, speed, end, picture") as self._how:
                    self.wishes = RunControls(self.desk.settings)
                self._how.classes("grow experts").props("data-view=how")
                self.buttons = StartAndStop(
                    self.runs,
                    self.wishes.box,
                    "Run",
                    lambda: self._start(self.draft.scenario),
                    ("run", "stop"),
                )
            self.first = ui.label(FIRST).classes("figure-line").props("data-view=first")
            self.trouble = note("data-view=trouble role=alert")
            self.progress = ProgressView()

    # -- user actions

    def open_link(self, linked: Draft | None, unknown: list[str]) -> None:
        """Show what a link holds.

        Another site may have made it: what was entered is replaced only if the user agrees.
        `linked`: None if the link names no setting. `unknown`: what of it was not understood.
        """
        is_news = linked is not None and linked.values != self.draft.values
        if linked is not None and is_news and not self.draft.is_untouched:
            self._ask_for(linked, unknown)
            return
        if unknown:
            complain(NOT_ALL_UNDERSTOOD, unknown)
        if linked is not None and is_news:
            self._replace(linked, THE_LINK)

    def _ask_for(self, linked: Draft, unknown: list[str]) -> None:
        """Ask whether a link may replace what was entered.

        One dialog says all: two would hide each other.
        """
        lines = [
            f"You have entered: {self.draft.title}.",
            f"The link has: {linked.title}.",
            "If you open it, Undo brings back what you have entered.",
        ]
        if unknown:
            lines += [f"{NOT_ALL_UNDERSTOOD}:", *unknown]

        def agree() -> None:
            question.close()
            self._replace(linked, THE_LINK)

        with (
            dialog("Open the orchard of the link?", lines, "link-question") as question,
            ui.row().classes("self-end"),
        ):
            button("Keep what I entered", question.close, "keep-entries")
            button("Open the link", agree, "open-link", props="unelevated")

    def _replace(self, draft: Draft, name: str) -> None:
        """Put another draft in place of what was entered. `name`: of what it comes from."""
        before = copy(self.draft)
        self.draft.become(draft)
        if not self.draft.is_same(before):
            self.desk.replaced.replace(before, name)
        self._show_replaced()

    def _take(self, scenario: Scenario, name: str) -> None:
        """Put a scenario in place of what was entered. `name`: of a preset, a file or a run."""
        self._replace(Draft(scenario), name)

    def _undo(self) -> None:
        """Bring back what was replaced last. Another page of the browser may have done it."""
        if self.desk.replaced.undoable:
            self.draft.become(self.desk.replaced.undo(copy(self.draft)))
            self._show_replaced()

    def _redo(self) -> None:
        """Bring back what was undone last."""
        if self.desk.replaced.redoable:
            self.draft.become(self.desk.replaced.redo(copy(self.draft)))
            self._show_replaced()

    def _show_replaced(self) -> None:
        """Show what is entered now, and the buttons that bring something back."""
        self.form.show()
        self._show_undo()

    def _show_undo(self) -> None:
        """Show each button if it brings something back, and say what."""
        undoable = self.desk.replaced.undoable
        self._undo_button.set_visibility(bool(undoable))
        if undoable:
            self._undo_button.set_text(f"Undo {undoable[-1].name}")
            self._undo_button.props["title"] = f"Bring back: {undoable[-1].draft.title}"
        redoable = self.desk.replaced.redoable
        self._redo_button.set_visibility(bool(redoable))
        if redoable:
            self._redo_button.props["title"] = f"Redo {redoable[-1].name}"
            self._redo_button.update()

    async def _open(self, event: events.UploadEventArguments) -> None:
        """Open a scenario file, or tell why it is not opened.

        The browser refuses a file that is too large. A program that takes its place may send one.
        """
        self._upload.reset()
        if event.file.size() > LARGEST_UPLOAD:
            complain(NOT_OPENED, [TOO_LARGE])
            return
        name = printable(event.file.name, LONGEST_NAME)
        content = await event.file.read()
        try:
            scenario = parse(content.decode("utf-8-sig"), name)
        except UnicodeDecodeError:
            complain(NOT_OPENED, [f"{name}: not UTF-8 text"])
        except ScenarioError as error:
            # The message names some problems, and counts the rest of them.
            complain(NOT_OPENED, str(error).splitlines())
        else:
            await self._offer(scenario, name)

    async def _offer(self, scenario: Scenario, file: str) -> None:
        """Take a scenario. Ask first if it names own classes: to check them already runs them."""
        if await _is_trusted(scenario, file):
            self._take(scenario, file)
            ui.notify(f"{file} opened", type="positive")

    async def _go_on(self, scenario: Scenario, fork: Fork) -> None:
        """Start a fork, which asks first as `_offer` does."""
        if await _is_trusted(scenario, fork.parent):
            self._start(scenario, fork)

    def _download(self) -> None:
        if self.draft.scenario is not None:
            ui.download.content(to_yaml(self.draft.scenario), "orchard.yaml", "application/yaml")

    async def _show_link(self) -> None:
        scenario = self.draft.scenario
        if scenario is None:
            return
        here = await ui.run_javascript("location.origin + location.pathname", timeout=PATIENCE)
        link = f"{here}?{query_of(scenario)}"
        with dialog("A link to this orchard", _left_out_of_link(scenario), "link-dialog"):
            field = ui.input(value=link).classes("w-full")
            field.props('readonly outlined dense data-view=link aria-label="Link"')
            copy_link = partial(ui.clipboard.write, link)
            button("Copy", copy_link, "copy", props="unelevated").classes("self-end")

    async def _turn_dark(self) -> None:
        """Turn to dark, or back to light. At first it is as the browser prefers."""
        self.desk.dark = not await ui.run_javascript(
            "document.body.classList.contains('body--dark')", timeout=PATIENCE
        )
        self._dark.set_value(self.desk.dark)

    def _start(self, scenario: Scenario | None, fork: Fork | None = None) -> None:
        """Start a run, unless something that is entered is invalid, or tell why it did not start.

        `scenario`: None if it is invalid.
        """
        settings = self.wishes.settings
        if scenario is None or settings.problems:
            return
        try:
            self.runs.start(partial(HarvestCommand, scenario, settings, fork=fork))
        except (OSError, RuntimeError) as error:
            complain("The harvest was not started", [str(error)])
        self._watch()

    # -- updates

    def _redraw(self) -> None:
        """Show at once what follows from what is entered, if it has changed."""
        draft = self.draft
        entered = Entered(
            values=draft.values,
            scenario=draft.scenario,
            problems=draft.problems,
            settings=self.wishes.settings,
            going=self.runs.going,
        )
        if entered == self._drawn:
            return
        self._drawn = entered
        self.desk.draft = draft
        self.desk.settings = entered.settings
        self.form.follow(entered.going.scenario if entered.going else None)
        self._update_buttons()
        self.estimate.show(entered.scenario)
        if entered.scenario is None:
            self.stage.plan.fade()

    async def _draw_plan(self) -> None:
        """Show the plan of what is entered, unless it is changed by then.

        It takes seconds for a hundred rows. What is wrong in the form does not wait for it.
        """
        entered = self._drawn
        if entered is None or entered is self._planned or entered.scenario is None:
            return
        self._planned = entered
        layout = await run.io_bound(lay_out, entered.scenario)
        # The server gives None while it shuts down.
        if layout is not None and entered is self._drawn:
            self.stage.plan.show(layout)

    async def _draw_figures(self) -> None:
        """Show the figures of what is entered, unless it is changed by then.

        They take longer than the plan, which does not wait for them.
        """
        entered = self._drawn
        if entered is None or entered is self._derived or entered.scenario is None:
            return
        self._derived = entered
        derived = await run.io_bound(derive, entered.scenario)
        if derived is not None and entered is self._drawn:
            self.figures.show(*derived)

    def _update_buttons(self) -> None:
        wrong = [label_of(path) for path in self.draft.problems]
        wrong += [SETTINGS[name] for name in self.wishes.settings.problems]
        words = f"{counted_fields(len(wrong))} an invalid value: {', '.join(wrong)}"
        self.trouble.set_text(words if wrong else "")
        if self.wishes.settings.problems:
            self._how.open()
        self.buttons.update(not wrong)
        for action in (self._save, self._link):
            action.set_enabled(self.draft.scenario is not None)

    def _watch(self) -> None:
        """Show how far the run is. Turn to it when it begins, and when it ends."""
        self._update_buttons()
        harvest = self.runs.command
        if harvest is None:
            return
        self.first.set_visibility(False)
        state = harvest.state
        staged = harvest, state.is_over
        if staged != self._staged:
            self.stage.turn_to_run(harvest, state)
        self._staged = staged
        self.progress.show(harvest, state)
        self.stage.show(harvest, state)


def _section(style: str, name: str) -> ui.element:
    """Add a part of the page. `style`: its class. `name`: for screen readers."""
    return ui.element("section").classes(style).props(f'aria-label="{name}"')


def _left_out_of_link(scenario: Scenario) -> list[str]:
    """Return a sentence for each part of a scenario that a link cannot hold."""
    sentences = []
    if scenario.own_classes:
        sentences.append("Your own classes are not in the link, because they are code.")
    if scenario.survey:
        sentences.append("The surveyed rows are not in the link: it opens rows that are alike.")
    return [f"{sentence} A file holds them: Save." for sentence in sentences]


async def _is_trusted(scenario: Scenario, file: str) -> bool:
    """Whether the own classes of a scenario may run here.

    Classes from elsewhere may not. For all others the user is asked.
    """
    classes = scenario.own_classes
    refused = from_elsewhere(classes, Path.cwd())
    if refused:
        complain(NOT_OPENED, [f"{file}: {sentence}" for sentence in refused])
        return False
    return not classes or await may_run(classes, file)


def complain(title: str, lines: list[str]) -> None:
    """Tell in a dialog what was refused, and why."""
    with dialog(title, lines) as opened:
        ui.button("OK", on_click=opened.close).props("no-caps unelevated").classes("self-end")
