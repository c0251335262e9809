"""The large part of the page: plan, picture, summary and messages, one at a time."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from nicegui import ui

from orchard.app.charts import Charts
from orchard.app.command import STATE_COLOURS, RunState
from orchard.app.draft import title_of
from orchard.app.elements import heading, note, table, tiles
from orchard.app.getting_ready import compiled_count, getting_ready_words
from orchard.app.harvest_run import HarvestCommand
from orchard.app.page_words import in_page_words
from orchard.app.picture import IFrame
from orchard.app.preview import PlanView
from orchard.app.runs_view import RunsView
from orchard.app.study_view import Take
from orchard.app.what_if import GoOn, what_if
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

# Lines of a run without a summary, which are shown.
LAST_LINES = 12
VIEWS = ["Plan", "Picture", "Summary", "Messages", "Runs"]


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

    def show(self, run: HarvestCommand, state: RunState) -> None:
        """Show how far a run is, once its first figures have come."""
        self._box.set_visibility(True)
        colour = f"color={STATE_COLOURS[state]}"
        self._badge.set_text(state)
        self._badge.props(colour)
        self._title.set_text(title_of(run.scenario))
        headline = run.headline
        is_starting = headline is None and not state.is_over
        self._bar.set_value(_fraction(headline, state))
        if is_starting:
            self._bar.props(f"{colour} indeterminate")
        else:
            self._bar.props(colour, remove="indeterminate")
        if headline is not None:
            self._words.set_text(_progress(headline, state))
        else:
            self._words.set_text(_getting_ready(run) if is_starting else "")


def _getting_ready(run: HarvestCommand) -> str:
    """Return what a run has done before its first figures."""
    return getting_ready_words(run.output.lines, compiled_count())


def _fraction(headline: Headline | None, state: RunState) -> float:
    """Return how much of a run is done, 0 to 1."""
    if state is RunState.finished:
        return 1.0
    if headline is None:
        return 0.0
    return headline.fraction


def _progress(headline: Headline, state: RunState) -> str:
    """Return how far a run is, in a line."""
    all_metres = headline.rows * headline.row_length
    parts = [
        f"simulated {clock(headline.sim_seconds)} at {headline.times_real_time:g} x real time",
        f"{share_picked(headline.metres_picked, all_metres)} picked",
        f"bins delivered {headline.bins_delivered}/{headline.bins}",
    ]
    # Infinite: nothing is left, or it is not known how much.
    seconds_left = math.inf if state.is_over else headline.seconds_left()
    if seconds_left < math.inf:
        parts.append(f"{clock(seconds_left)} left")
        parts += [headline.done_words] if headline.done_words else []
    return ", ".join(parts)


class MessagesView:
    """The lines that a run prints."""

    def __init__(self) -> None:
        self._log = ui.log(max_lines=500).classes("messages").props("data-view=messages tabindex=0")
        self._run: HarvestCommand | None = None
        self._shown = 0

    def show(self, run: HarvestCommand, state: RunState) -> None:
        """Show the lines that a run has printed since the last call."""
        if run is not self._run:
            self._log.clear()
            self._run = run
            self._shown = 0
        count, lines = run.output
        new_count = count - self._shown
        if new_count:
            for line in lines[-new_count:]:
                self._log.push(line)
            self._shown = count


class PictureView:
    """The Rerun viewer in a frame: the live picture during a run, the recording after it."""

    def __init__(self) -> None:
        self._hint = note("", "hint")
        self._link = ui.link("Open in a new tab", "", new_tab=True).classes("corner")
        self._frame = IFrame("Picture of the run")
        for element in (self._frame, self._link):
            element.bind_visibility_from(self._hint, "text", lambda words: not words)
        self._figures = Charts()
        # The run in the frame, and whether it was over.
        self._shown: tuple[HarvestCommand, bool] | None = None
        # The viewer is large: it loads only when the user selects the picture.
        self.is_seen = False
        self._hint.set_text("The live picture appears here when a harvest runs.")

    def show(self, run: HarvestCommand, state: RunState) -> None:
        """Point the frame at a run once its servers answer.

        A new address would reload the viewer, so it is set once.
        """
        current = run, state.is_over
        # Nothing changes any more once the recording of a run is in the frame.
        if not self.is_seen or self._shown == (run, True):
            return
        self._figures.show({"": run.course})
        if self._shown == current:
            return
        address = run.picture.address
        if address:
            self._frame.props(f'src="{address}"')
            self._link.props(f'href="{address}"')
            self._shown = current
            self._hint.set_text("")
        else:
            self._shown = None
            self._hint.set_text(_without_picture(run, state))


def _without_picture(run: HarvestCommand, state: RunState) -> str:
    """Return why there is no picture of a run yet, or none at all."""
    if not state.is_over:
        if run.settings.live:
            return "The picture is being prepared."
        return "The recording appears here when the run is over."
    if run.files.recording.exists():
        return "The recording is being opened."
    return "No recording was made."


class SummaryView:
    """The summary of a run: the result as a headline, what limits it, six figures and the charts.

    Below them stands its time line, from which the run can go on. All figures are folded away.
    """

    def __init__(self, go_on: GoOn) -> None:
        """`go_on`: as for `what_if`."""
        self._go_on = go_on
        self._run: HarvestCommand | None = None
        with ui.element("div") as self._box:
            ui.label("The summary appears here when a harvest has ended.").classes("hint")

    def show(self, run: HarvestCommand, state: RunState) -> None:
        """Show the summary of a run, once it is over."""
        if not state.is_over or run is self._run:
            return
        self._run = run
        self._box.clear()
        with self._box, ui.element("div").props("data-view=result"):
            _show_result(run, state)
        if run.summary is not None:
            with self._box:
                self._add_what_if(run, run.summary)
        with self._box, ui.element("div").classes("summary").props("data-view=summary"):
            if run.summary is not None:
                _show_all_figures(run, run.summary)
            elif state is RunState.stopped:
                ui.label("The run was stopped before it wrote a summary.").classes("hint")
            else:
                ui.label("There is no summary. The last messages of the run:").classes("hint")
                _, lines = run.output
                last = map(in_page_words, lines[-LAST_LINES:])
                ui.label("\n".join(last)).classes("last-words")

    def _add_what_if(self, run: HarvestCommand, summary: dict[str, Any]) -> None:
        """Add the time line of a run, from which a fork can go on."""
        snapshots = run.files.folder / f"{run.files.name}.snapshots"
        # In the view "Runs" there may be a second time line, whose elements have other names.
        what_if(snapshots, run.scenario, summary["history"], self._go_on, where="this-")


def _show_result(run: HarvestCommand, state: RunState) -> None:
    """Add the result of a run as a headline, what limits it, and its main figures."""
    title = title_of(run.scenario)
    if run.summary is None:
        heading(3, title)
        ui.label("")
        figures = []
    else:
        outcome = msgspec.convert(run.summary, Outcome)
        heading(3, in_page_words(sentence(outcome)))
        ui.label(limit_sentence(outcome))
        figures = six_figures(run.summary)
    ui.label(f"{title}, {run.settings.mode}, {state}, {run.files.name}").classes("path")
    with ui.element("div").classes("tiles"):
        tiles(figures)
    Charts().show({"": run.course})


def _show_all_figures(run: HarvestCommand, summary: dict[str, Any]) -> None:
    """Add all figures of a summary, folded away, and where the recording is."""
    names, values = (column.cells for column in as_table(summary).columns)
    rows = [(str(name), str(value)) for name, value in zip(names, values, strict=True)]
    with ui.expansion("All figures").props("data-action=all-figures"):
        table(rows)
    if run.files.recording.exists():
        ui.label(f"Recording: {run.files.recording}").classes("path")


View = TypeVar("View")


class Stage:
    """The large part of the page. All views stay loaded; one is visible."""

    def __init__(
        self,
        folder: Path,
        take: Take,
        go_on: GoOn,
    ) -> None:
        """`folder`: of the runs. `go_on`: as for `what_if`. `take`: sets the form to a scenario."""
        with ui.element("section").classes("stage").props('aria-label="Plan, picture and results"'):
            self._choice = ui.toggle(VIEWS, value="Plan", on_change=self._turned).classes(
                "stage-choice"
            )
            self._choice.props("dense no-caps unelevated data-field=stage")
            self.plan = self._panel("Plan", PlanView)
            self._picture = self._panel("Picture", PictureView)
            self._summary = self._panel("Summary", lambda: SummaryView(go_on))
            self._messages = self._panel("Messages", MessagesView)
            self._past = self._panel("Runs", lambda: RunsView(folder, take, go_on))

    def _panel(self, name: str, build: Callable[[], View]) -> View:
        with ui.element("div").classes("panel") as panel:
            view = build()
        panel.bind_visibility_from(self._choice, "value", value=name)
        return view

    def _turned(self) -> None:
        if self._choice.value == "Runs":
            self._past.refresh()

    def show(self, run: HarvestCommand, state: RunState) -> None:
        """Show a run in all views."""
        self._picture.is_seen = self._choice.value == "Picture"
        for view in (self._picture, self._summary, self._messages):
            view.show(run, state)

    def turn_to_run(self, run: HarvestCommand, state: RunState) -> None:
        """Show the view that tells most of a run: of a fork that has ended, its comparison."""
        if run.fork is not None and run.summary is not None:
            self._past.refresh(run.fork.parent, run.files.name)
            self._choice.set_value("Runs")
        elif state.is_over:
            self._choice.set_value("Summary")
        else:
            self._choice.set_value("Picture" if run.settings.live else "Messages")
