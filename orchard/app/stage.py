"""The stage: plan, picture, summary or messages, one at a time."""

from nicegui import ui

from orchard.app.preview import PlanView
from orchard.app.runner import Run
from orchard.app.watch import MessagesView, PictureView, SummaryView

VIEWS = ("Plan", "Picture", "Summary", "Messages")


class Stage:
    """The large part of the page. All its views stay loaded; only one is seen."""

    def __init__(self) -> None:
        self._panels = {}
        with ui.element("div").classes("stage"):
            self._choice = ui.toggle(list(VIEWS), value="Plan").props("dense no-caps unelevated data-field=stage").classes("stage-choice")
            for name, build in zip(VIEWS, (PlanView, PictureView, SummaryView, MessagesView), strict=True):
                with ui.element("div").classes("panel") as panel:
                    self._panels[name] = build()
                panel.bind_visibility_from(self._choice, "value", value=name)

    @property
    def plan(self) -> PlanView:
        return self._panels["Plan"]

    @property
    def is_settled(self) -> bool:
        """Whether nothing more will come of a run that is over."""
        return self._panels["Picture"].is_settled

    def show(self, run: Run) -> None:
        """Bring all that is seen of a run up to date."""
        self._panels["Picture"].is_seen = self._choice.value == "Picture"
        for name in VIEWS[1:]:
            self._panels[name].show(run)

    def turn_to_run(self, run: Run) -> None:
        """A run is new on this page."""
        self._choice.set_value("Picture" if run.order.live and not run.is_over else "Summary" if run.is_over else "Messages")

    def turn_to_end(self) -> None:
        """A run has ended while one looked."""
        self._choice.set_value("Summary")
