"""The large part of the page: plan, picture, summary and messages, one at a time."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec
from nicegui import ui

from orchard.app.charts import Charts
from orchard.app.command import STATE_COLOURS, RunState
from orchard.app.desks import Desk
from orchard.app.draft import title_of
from orchard.app.elements import heading, note, table, tiles
from orchard.app.harvest_run import Run
from orchard.app.picture import Frame
from orchard.app.preview import PlanView
from orchard.app.runs_view import RunsView
from orchard.app.study_run import Studies
from orchard.app.study_view import StudyView, Take
from orchard.app.what_if import GoOn
from orchard.field.scenario import Scenario
from orchard.report.summary import (
    Headline,
    Outcome,
    as_table,
    clock,
    limit_sentence,
    sentence,
    share_picked,
    six_figures,
)

VIEWS = ["Plan", "Picture", "Summary", "Messages", "Runs", "Study"]


class ProgressView:
    """State, progress bar and figures of a run."""

    def __init__(self) -> None:
        with ui.element("div").classes("progress") as self._box:
            self._badge = ui.badge().props("data-view=state")
            self._title = ui.label().classes("run-title").props("data-view=run-title")
            self._bar = ui.linear_progress(value=0, show_value=False, size="10px").classes("grow")
            self._bar.props('rounded instant-feedback aria-label="Progress of the run"')
            self._words = ui.label().classes("figure-line").props("data-view=progress")
        self._box.set_visibility(False)

    def show(self, run: Run, state: RunState) -> None:
        self._box.set_visibility(True)
        colour = f"color={STATE_COLOURS[state]}"
        self._badge.set_text(state)
        self._badge.props(colour)
        self._title.set_text(title_of(run.scenario))
        known = run.headline
        self._bar.set_value(1.0 if state is RunState.finished else known.fraction if known else 0.0)
        is_unknown = not known and not state.is_over
        self._bar.props(
            f"{colour} {'indeterminate' if is_unknown else ''}",
            remove="" if is_unknown else "indeterminate",
        )
        self._words.set_text(_progress(known, state) if known else "starting" if is_unknown else "")


def _progress(known: Headline, state: RunState) -> str:
    left = math.inf if state.is_over else known.seconds_left()
    parts = [
        f"simulated {clock(known.sim_seconds)} at {known.times_real_time:g} x real time",
        f"{share_picked(known.metres_picked, known.rows * known.row_length)} picked",
        f"bins delivered {known.bins_delivered}/{known.bins}",
        *([f"{clock(left)} left"] if left < math.inf else []),
    ]
    return ", ".join(parts)


class MessagesView:
    """The lines that a run prints."""

    def __init__(self) -> None:
        self._log = ui.log(max_lines=500).classes("messages").props("data-view=messages tabindex=0")
        self._run: Run | None = None
        self._shown = 0

    def show(self, run: Run, state: RunState) -> None:
        if run is not self._run:
            self._log.clear()
            self._run, self._shown = run, 0
        count, lines = run.said
        if new := count - self._shown:
            for line in lines[-new:]:
                self._log.push(line)
            self._shown = count


class PictureView:
    """The Rerun viewer in a frame: the live picture during a run, the recording after it."""

    def __init__(self) -> None:
        self._hint = note("", "hint")
        self._link = ui.link("Open in a new tab", "", new_tab=True).classes("corner")
        self._frame = Frame("Picture of the run")
        for element in (self._frame, self._link):
            element.bind_visibility_from(self._hint, "text", lambda words: not words)
        self._figures = Charts()
        self._shown: tuple[Run, bool] | None = None  # the run in the frame, and whether it was over
        self.is_seen = False  # the viewer is large: it loads only when the user selects the picture
        self._hint.set_text("The live picture appears here when a harvest runs.")

    def show(self, run: Run, state: RunState) -> None:
        """Point the frame at a run once its servers answer: a new address would reload the viewer."""
        now = run, state.is_over
        if not self.is_seen or self._shown == (run, True):
            return
        self._figures.show({"": run.course})
        if now == self._shown:
            return
        ready = run.picture.address
        if ready:
            self._frame.props(f'src="{ready}"')
            self._link.props(f'href="{ready}"')
        self._shown = now if ready else None
        self._hint.set_text("" if ready else _without_picture(run, state))


def _without_picture(run: Run, state: RunState) -> str:
    if not state.is_over:
        return (
            "The picture is being prepared."
            if run.settings.live
            else "The recording appears here when the run is over."
        )
    return (
        "The recording is being opened."
        if run.files.recording.exists()
        else "No recording was made."
    )


class SummaryView:
    """The summary of a run: the result as a headline, what limits it, six figures, the charts, and all figures folded away."""

    def __init__(self) -> None:
        self._run: Run | None = None
        with ui.element("div") as self._box:
            ui.label("The summary appears here when a harvest has ended.").classes("hint")

    def show(self, run: Run, state: RunState) -> None:
        if not state.is_over or run is self._run:
            return
        self._run, summary, title = run, run.summary, title_of(run.scenario)
        outcome = None if summary is None else msgspec.convert(summary, Outcome)
        self._box.clear()
        with self._box, ui.element("div").props("data-view=result"):
            heading(3, sentence(outcome) if outcome else title)
            ui.label(limit_sentence(outcome) if outcome else "")
            ui.label(f"{title}, {run.settings.mode}, {state}, {run.files.name}").classes("path")
            with ui.element("div").classes("tiles"):
                tiles(six_figures(summary) if summary else [])
            Charts().show({"": run.course})
        with self._box, ui.element("div").classes("summary").props("data-view=summary"):
            if summary is not None:
                names, values = (column.cells for column in as_table(summary).columns)
                with ui.expansion("All figures").props("data-action=all-figures"):
                    table(
                        [(str(name), str(value)) for name, value in zip(names, values, strict=True)]
                    )
                if run.files.recording.exists():
                    ui.label(f"Recording: {run.files.recording}").classes("path")
            elif state is RunState.stopped:
                ui.label("The run was stopped before it wrote a summary.").classes("hint")
            else:
                ui.label("There is no summary. The last messages of the run:").classes("hint")
                ui.label("\n".join(run.said[1][-12:])).classes("last-words")


View = TypeVar("View")


class Stage:
    """The large part of the page. All views stay loaded; one is visible."""

    def __init__(
        self,
        folder: Path,
        studies: Studies,
        desk: Desk,
        drafted: Callable[[], Scenario | None],
        take: Take,
        go_on: GoOn,
    ) -> None:
        """`folder`: of the runs. `desk`, `drafted` and `take`: as for `StudyView`. `go_on`: as for `what_if`."""
        with ui.element("section").classes("stage").props('aria-label="Plan, picture and results"'):
            self._choice = ui.toggle(VIEWS, value="Plan", on_change=self._turned).classes(
                "stage-choice"
            )
            self._choice.props("dense no-caps unelevated data-field=stage")
            self.plan = self._panel("Plan", PlanView)
            self._picture = self._panel("Picture", PictureView)
            self._summary = self._panel("Summary", SummaryView)
            self._messages = self._panel("Messages", MessagesView)
            self._past = self._panel("Runs", lambda: RunsView(folder, take, go_on))
            self._panel("Study", lambda: StudyView(studies, desk, drafted, take))

    def _panel(self, name: str, build: Callable[[], View]) -> View:
        with ui.element("div").classes("panel") as panel:
            view = build()
        panel.bind_visibility_from(self._choice, "value", value=name)
        return view

    def _turned(self) -> None:
        if self._choice.value == "Runs":
            self._past.refresh()

    def turn_to_study(self) -> None:
        self._choice.set_value("Study")

    def show(self, run: Run, state: RunState) -> None:
        self._picture.is_seen = self._choice.value == "Picture"
        for view in (self._picture, self._summary, self._messages):
            view.show(run, state)

    def turn_to_run(self, run: Run, state: RunState) -> None:
        view = "Summary" if state.is_over else "Picture" if run.settings.live else "Messages"
        if run.fork is not None and run.summary is not None:
            self._past.refresh(run.fork.parent, run.files.name)
            view = "Runs"
        self._choice.set_value(view)
