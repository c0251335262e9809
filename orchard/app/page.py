"""The page: the form on the left; the run, the stage and the derived figures on the right."""

from pathlib import Path
from typing import Any

from nicegui import run, ui

from orchard.app.draft import Draft
from orchard.app.files import FileButtons, complain
from orchard.app.form import ClassesView, Form
from orchard.app.preview import FiguresView
from orchard.app.run_controls import RunControls
from orchard.app.runner import Runner, RunReport
from orchard.app.views import ProgressView, Stage
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

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
            self.files = FileButtons(self._take, lambda: self.draft.scenario)
        with ui.element("main").classes("page"):
            with ui.element("aside").classes("form"):
                self.form = Form(self._set)
                self.classes = ClassesView(self._drop_classes)
            with ui.element("div").classes("right"):
                self._build_run()
                with ui.element("div").classes("middle"):
                    self.stage = Stage()
                    with ui.element("div").classes("figures"):
                        self.figures = FiguresView()

    def _build_run(self) -> None:
        with ui.element("div").classes("run-card"):
            with ui.element("div").classes("wishes"):
                self.wishes = RunControls(self._mark, self.runner.run.order if self.runner.run else None)
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

    def _mark(self) -> None:
        self._changed = True

    def _start(self) -> None:
        if self.draft.scenario is None:
            return
        try:
            self.runner.start(self.wishes.order(self.draft.scenario))
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
        self.classes.show(self.draft)
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
        wrong = len(self.draft.problems) + len(self.wishes.pace.problems)
        self.trouble.set_text(f"{wrong} field{'s have' if wrong > 1 else ' has'} an invalid value")
        self.trouble.set_visibility(wrong > 0)
        going = self.runner.run if self.runner.is_busy else None
        self.start_button.set_visibility(going is None)
        self.start_button.set_enabled(not wrong)
        self.stop_button.set_visibility(going is not None)
        self.stop_button.set_enabled(going is not None and not going.asked_to_stop)
        self.files.allow_saving(self.draft.scenario is not None)

    def _watch(self) -> None:
        """Update the views of the run."""
        self._update_buttons()
        if self.runner.run is None:
            return
        now, before = self.runner.run.report(), self._seen
        if before is None or before.run is not now.run:
            self.stage.turn_to_run(now)
        elif now.is_over and not before.is_over:
            self.stage.turn_to_end()
        elif before.is_over and self.stage.is_settled(now):
            return
        self._seen = now
        self.progress.show(now)
        self.stage.show(now)
