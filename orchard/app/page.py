"""The page: presets and files on top; the form on the left; the run, the stage and the derived figures on the right."""

from pathlib import Path
from typing import Any

from nicegui import events, run, ui

from orchard.app.draft import Draft
from orchard.app.form import Form
from orchard.app.own_classes import from_elsewhere, may_run, own_classes
from orchard.app.preview import FiguresView
from orchard.app.run_controls import ROOT, RunControls
from orchard.app.runner import Runner, RunReport
from orchard.app.views import ProgressView, Stage
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import LARGEST_FILE, Scenario, load, parse, to_yaml

STYLE = Path(__file__).with_name("style.css")
REDRAW_SECONDS = 0.1  # s between two checks for changed input
WATCH_SECONDS = 0.3  # s between two updates of the run


class Page:
    """The page in one browser. All pages share one runner."""

    def __init__(self, runner: Runner, scenario: Scenario) -> None:
        self.runner, self.draft = runner, Draft(scenario)
        self._changed = True
        self._seen: RunReport | None = None  # the report on the stage
        self._build()
        self.form.show(self.draft.values)
        ui.timer(REDRAW_SECONDS, self._redraw)
        ui.timer(WATCH_SECONDS, self._watch)

    # -- layout

    def _build(self) -> None:
        ui.add_css(STYLE)
        ui.colors(primary="#3f7d3a", positive="#3f7d3a", warning="#c77700", negative="#b3261e")
        with ui.header().classes("top"):
            ui.label("Kiwifruit orchard").classes("top-title")
            ui.element("div").classes("grow")
            self._build_files()
        with ui.element("main").classes("page"):
            with ui.element("aside").classes("form"):
                self.form = Form(self._set, self._drop_classes)
            with ui.element("div").classes("right"):
                self._build_run()
                with ui.element("div").classes("middle"):
                    self.stage = Stage()
                    with ui.element("div").classes("figures"):
                        self.figures = FiguresView()

    def _build_files(self) -> None:
        """Build the buttons for the presets, Open and Save."""
        for name, scenario in presets().items():
            ui.button(name.capitalize(), on_click=lambda scenario=scenario: self._take(scenario)).props(f"flat no-caps data-preset={name}")
        ui.element("div").classes("divider")
        limit = 10 * LARGEST_FILE  # bytes; a larger file is not read, `parse` reports a smaller one above LARGEST_FILE
        self._upload = ui.upload(on_upload=self._open, on_rejected=self._rejected, max_file_size=limit, auto_upload=True)
        self._upload.props("accept=.yaml,.yml").classes("hidden")
        ui.button("Open", icon="folder_open", on_click=lambda: self._upload.run_method("pickFiles")).props("flat no-caps data-action=open")
        self._save = ui.button("Save", icon="download", on_click=self._download).props("flat no-caps data-action=save")

    def _build_run(self) -> None:
        with ui.element("div").classes("run-card"):
            with ui.element("div").classes("wishes"):
                self.wishes = RunControls(self._mark, self.runner.run.settings if self.runner.run else None)
                self.start_button = ui.button("Run", icon="play_arrow", on_click=self._start)
                self.start_button.props("no-caps unelevated data-action=run")
                self.stop_button = ui.button("Stop", icon="stop", on_click=self._stop)
                self.stop_button.props("no-caps unelevated color=negative data-action=stop")
            self.trouble = ui.label().classes("field-problem").props("data-view=trouble role=alert")
            self.progress = ProgressView()

    # -- user actions

    def _set(self, path: str, value: Any) -> None:
        self.draft.set(path, value)
        self._mark()

    def _drop_classes(self) -> None:
        self.draft.drop_classes()
        self._mark()

    def _take(self, scenario: Scenario) -> None:
        self.draft.take(scenario)
        self.form.show(self.draft.values)
        self._mark()

    async def _open(self, event: events.UploadEventArguments) -> None:
        content = await event.file.read()
        self._upload.reset()
        try:
            scenario = parse(content.decode("utf-8-sig"), event.file.name)
        except UnicodeDecodeError:
            complain("This file was not opened", [f"{event.file.name}: not UTF-8 text"])
        except ScenarioError as error:
            complain("This file was not opened", [str(problem) for problem in error.problems])
        else:
            await self._offer(scenario, event.file.name)

    async def _offer(self, scenario: Scenario, file: str) -> None:
        """Take a scenario from a file. If it names own classes, the user is asked first: to check them already runs them."""
        classes = own_classes(scenario)
        if refused := from_elsewhere(classes, Path.cwd()):
            complain("This file was not opened", [f"{file}: {words}" for words in refused])
        elif not classes or await may_run(classes, file):
            self._take(scenario)
            ui.notify(f"{file} opened", type="positive")

    def _rejected(self) -> None:
        complain("This file was not opened", ["The file is too large for a scenario, or it is not a .yaml file."])

    def _download(self) -> None:
        if self.draft.scenario is not None:
            ui.download.content(to_yaml(self.draft.scenario), "orchard.yaml", "application/yaml")

    def _mark(self) -> None:
        self._changed = True

    def _start(self) -> None:
        if self.draft.scenario is None:
            return
        try:
            self.runner.start(self.draft.scenario, self.wishes.settings)
        except (OSError, RuntimeError, ValueError) as error:
            complain("The harvest was not started", [str(error)])
        self._watch()

    def _stop(self) -> None:
        if self.runner.run is not None:
            self.runner.run.stop()
        self._watch()

    # -- updates

    async def _redraw(self) -> None:
        """Update plan, figures and problems if the input has changed."""
        if not self._changed:
            return
        self._changed = False
        self.form.follow(self.draft)
        self._update_buttons()
        if (scenario := self.draft.scenario) is None:
            self.stage.plan.fade()
            return
        if (layout := await run.io_bound(lay_out, scenario)) is None:
            return  # the server is shutting down
        self.stage.plan.show(layout)
        self.figures.show(layout)

    def _update_buttons(self) -> None:
        """Update the buttons and the number of invalid fields."""
        wrong = len(self.draft.problems) + len(self.wishes.settings.problems)
        self.trouble.set_text(f"{wrong} field{'s have' if wrong > 1 else ' has'} an invalid value")
        self.trouble.set_visibility(wrong > 0)
        going = self.runner.run if self.runner.is_busy else None
        self.start_button.set_visibility(going is None)
        self.start_button.set_enabled(not wrong)
        self.stop_button.set_visibility(going is not None)
        self.stop_button.set_enabled(going is not None and not going.asked_to_stop)
        self._save.set_enabled(self.draft.scenario is not None)

    def _watch(self) -> None:
        """Update the views of the run."""
        self._update_buttons()
        if self.runner.run is None:
            return
        now, before = self.runner.run.report(), self._seen
        if before is None or before.run is not now.run or now.is_over != before.is_over:
            self.stage.turn_to_run(now)
        elif before.is_over and self.stage.is_settled(now):
            return
        self._seen = now
        self.progress.show(now)
        self.stage.show(now)


def presets() -> dict[str, Scenario]:
    """Return the presets by name: the default scenario, and each file in `config/` except orchard.yaml, which holds the default."""
    ready = {path.stem: load(path) for path in sorted((ROOT / "config").glob("*.yaml")) if path.stem != "orchard"}
    return {"default": Scenario()} | ready


def complain(title: str, lines: list[str]) -> None:
    """Open a dialog with a title and error lines. Nothing else changes."""
    with ui.dialog(value=True) as dialog, ui.card().classes("complaint").props("data-view=complaint"):
        ui.label(title).classes("group-title")
        for line in lines:
            ui.label(line).classes("complaint-line")
        ui.button("OK", on_click=dialog.close).props("no-caps unelevated").classes("self-end")
