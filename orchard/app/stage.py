"""The stage: plan, picture, summary or messages, one at a time."""

from collections.abc import Callable
from typing import TypeVar

from nicegui import ui

from orchard.app.preview import PlanView
from orchard.app.runner import RunReport
from orchard.app.watch import MessagesView, PictureView, SummaryView

VIEWS = ("Plan", "Picture", "Summary", "Messages")
View = TypeVar("View")


class Stage:
    """The large part of the page. All its views stay loaded; only one is seen."""

    def __init__(self) -> None:
        with ui.element("div").classes("stage"):
            self._choice = ui.toggle(list(VIEWS), value="Plan").props("dense no-caps unelevated data-field=stage").classes("stage-choice")
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
        """Whether nothing more will come of a run."""
        return report.is_over and self._picture.is_settled(report.run)

    def show(self, report: RunReport) -> None:
        """Bring all that is seen of a run up to date."""
        self._picture.is_seen = self._choice.value == "Picture"
        for view in (self._picture, self._summary, self._messages):
            view.show(report)

    def turn_to_run(self, report: RunReport) -> None:
        """A run is new on this page."""
        live = "Picture" if report.run.order.live else "Messages"
        self._choice.set_value("Summary" if report.is_over else live)

    def turn_to_end(self) -> None:
        """A run has ended while one looked."""
        self._choice.set_value("Summary")
