"""The large part of the page: plan, picture, summary and messages, one at a time."""

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from nicegui import ui

from orchard.app.preview import PlanView
from orchard.app.runner import Run, RunReport, RunState
from orchard.report.summary import as_table
from orchard.view.web import LOOPBACK, page_url

COLOURS = {"running": "primary", "stopping": "warning", "finished": "positive", "stopped": "warning", "failed": "negative"}  # of states


class ProgressView:
    """State, progress bar and figures of a run."""

    def __init__(self) -> None:
        with ui.element("div").classes("progress") as self._box:
            self._badge = ui.badge().props("data-view=state")
            self._bar = ui.linear_progress(value=0, show_value=False, size="10px").props("rounded instant-feedback").classes("grow")
            self._words = ui.label().classes("figure-line").props("data-view=progress")
        self._box.set_visibility(False)

    def show(self, report: RunReport) -> None:
        """Show the progress in a report."""
        colour = COLOURS[report.state]
        self._box.set_visibility(True)
        self._badge.set_text(report.state)
        self._badge.props(f"color={colour}")
        known = report.headline
        done = 1.0 if report.state is RunState.finished else known.fraction if known else 0.0
        self._bar.set_value(done)
        is_unknown = not known and not report.is_over
        self._bar.props(f"color={colour} {'indeterminate' if is_unknown else ''}", remove="" if is_unknown else "indeterminate")
        self._words.set_text(_progress(report))


def _progress(report: RunReport) -> str:
    if (known := report.headline) is None:
        return "" if report.is_over else "starting"
    minutes, seconds = divmod(round(known.sim_seconds), 60)
    return (f"simulated {minutes}:{seconds:02d} min at {known.times_real_time:g} x real time, "
            f"rows picked {known.rows_picked}/{known.rows}, bins delivered {known.bins_delivered}/{known.rows}")  # fmt: skip


class MessagesView:
    """The lines that a run prints."""

    def __init__(self) -> None:
        self._log = ui.log(max_lines=500).classes("messages").props("data-view=messages")
        self._run: Run | None = None
        self._shown = 0

    def show(self, report: RunReport) -> None:
        """Append the new lines of a run."""
        run = report.run
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
        self._hint = ui.label().classes("hint")
        self._link = ui.link("Open in a new tab", "", new_tab=True).classes("corner")
        self._frame = ui.element("iframe").classes("picture").props("data-view=picture allow=fullscreen")
        self._shown: tuple[Run, bool] | None = None  # the run in the frame, and whether it was over
        self._is_without_recording = False
        self.is_seen = False  # the viewer is large: it loads only when the user selects the picture
        self._show_hint("The live picture appears here when a harvest runs.")

    def is_settled(self, run: Run) -> bool:
        """Whether the frame shows the recording of a finished run, or no recording exists."""
        return self._is_without_recording or self._shown == (run, True)

    def show(self, report: RunReport) -> None:
        """Point the frame at a run once its servers answer. The frame then stays unchanged: a new address would reload the viewer."""
        run, now = report.run, (report.run, report.is_over)
        if now == self._shown or not self.is_seen:
            return
        ready = _is_open(run.port) and _is_open(run.port + 1)
        if ready:
            url = page_url(run.port) + ("&recording=1" if report.is_over else "")
            self._frame.props(f'src="{url}"')
            self._link.props(f'href="{url}"')
        self._shown = now if ready else None
        self._show_hint("" if ready else _without_picture(report))
        self._is_without_recording = not ready and report.is_over and not run.files.recording.exists()

    def _show_hint(self, words: str) -> None:
        self._hint.set_text(words)
        self._hint.set_visibility(bool(words))
        for element in (self._frame, self._link):
            element.set_visibility(not words)


def _without_picture(report: RunReport) -> str:
    if not report.is_over:
        return "The picture is being prepared." if report.run.settings.live else "The recording appears here when the run is over."
    return "The recording is being opened." if report.run.files.recording.exists() else "No recording was made."


def _is_open(port: int) -> bool:
    """Whether a server listens on a port of the loopback interface."""
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((LOOPBACK, port)) == 0


class SummaryView:
    """The summary of a run as a table."""

    def __init__(self) -> None:
        self._box = ui.element("div").classes("summary").props("data-view=summary")
        self._run: Run | None = None
        with self._box:
            ui.label("The summary appears here when a harvest has ended.").classes("hint")

    def show(self, report: RunReport) -> None:
        """Show the summary once, when the run is over."""
        if not report.is_over or report.run is self._run:
            return
        self._run = report.run
        self._box.clear()
        with self._box:
            if report.summary is not None:
                _table(report.summary, report.run.files.recording)
            elif report.state is RunState.stopped:
                ui.label("The run was stopped before it wrote a summary.").classes("hint")
            else:
                ui.label("There is no summary. The last messages of the run:").classes("hint")
                ui.label("\n".join(report.run.said[1][-12:])).classes("last-words")


def _table(summary: dict[str, Any], recording: Path) -> None:
    with ui.element("table"):
        names, values = (column.cells for column in as_table(summary).columns)
        for name, value in zip(names, values, strict=True):
            with ui.element("tr"):
                with ui.element("th"):
                    ui.label(str(name))
                with ui.element("td"):
                    ui.label(str(value))
    if recording.exists():
        ui.label(f"Recording: {recording}").classes("path")


View = TypeVar("View")


class Stage:
    """The large part of the page. All views stay loaded; one is visible."""

    def __init__(self) -> None:
        with ui.element("div").classes("stage"):
            self._choice = ui.toggle(["Plan", "Picture", "Summary", "Messages"], value="Plan").classes("stage-choice")
            self._choice.props("dense no-caps unelevated data-field=stage")
            self.plan = self._panel("Plan", PlanView)
            self._picture = self._panel("Picture", PictureView)
            self._summary = self._panel("Summary", SummaryView)
            self._messages = self._panel("Messages", MessagesView)

    def _panel(self, name: str, build: Callable[[], View]) -> View:
        with ui.element("div").classes("panel") as panel:
            view = build()
        panel.bind_visibility_from(self._choice, "value", value=name)
        return view

    def is_settled(self, report: RunReport) -> bool:
        """Whether the run is over and its views need no further update."""
        return report.is_over and self._picture.is_settled(report.run)

    def show(self, report: RunReport) -> None:
        """Update the views of a run."""
        self._picture.is_seen = self._choice.value == "Picture"
        for view in (self._picture, self._summary, self._messages):
            view.show(report)

    def turn_to_run(self, report: RunReport) -> None:
        """Select the view of a run that is new on this page, or has ended."""
        live = "Picture" if report.run.settings.live else "Messages"
        self._choice.set_value("Summary" if report.is_over else live)
