"""What a scenario looks like before it is run: the plan to scale, and the derived figures."""

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.figures import Figure, figures, terms
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.report.plan import COLOURS, orchard_plan


class PlanView:
    """The plan from above."""

    def __init__(self) -> None:
        self._plan = ui.html("", sanitize=False).classes("plan").props("data-view=plan")
        ui.switch("Full width", on_change=self._widen).classes("corner").props("dense size=sm data-field=full-width")
        with ui.element("div").classes("legend"):
            for name, colour in _legend():
                with ui.element("div").classes("legend-entry"):
                    ui.element("div").classes("legend-mark").style(f"background:{colour}")
                    ui.label(name)

    def show(self, layout: Layout) -> None:
        self._plan.set_content(orchard_plan(layout))
        self._plan.classes(remove="stale")

    def _widen(self, event: ValueChangeEventArguments[bool | None]) -> None:
        """A long orchard is small where all of it is to be seen at once."""
        self._plan.classes(add="wide" if event.value else "", remove="" if event.value else "wide")

    def fade(self) -> None:
        """What is entered cannot be drawn: what is seen is of before."""
        self._plan.classes("stale")


def _legend() -> list[tuple[str, str]]:
    """What the plan's colours mean; those of the bodies are their kinds'."""
    kinds = [(name, "rgb({},{},{})".format(*kind.colour)) for name, kind in KINDS.items()]
    places = {"tree": "tree", "driveway": "driveway", "bay": "unloading bay", "D": "road of deliveries", "F": "road of full bins"}
    return kinds + [(words, COLOURS[name]) for name, words in places.items()]


class FiguresView:
    """The derived figures, and what each part of the harvest allows, as bars."""

    def __init__(self) -> None:
        self._tiles = ui.element("div").classes("tiles")
        self._bars = ui.element("div").classes("bars")

    def show(self, layout: Layout) -> None:
        self._tiles.clear()
        with self._tiles:
            for figure in figures(layout):
                _tile(figure)
        self._bars.clear()
        with self._bars:
            ui.label("What each part allows, bins/h").classes("bars-title")
            _bars(terms(layout))


def _tile(figure: Figure) -> None:
    with ui.element("div").classes("tile").props(f"data-figure='{figure.name}'"):
        ui.label(figure.name).classes("tile-name")
        ui.label(figure.value).classes("tile-value")
        ui.label(figure.note).classes("tile-note")


def _bars(rates: dict[str, float]) -> None:
    least, most = min(rates.values()), max(rates.values())
    for name, rate in rates.items():
        with ui.element("div").classes("bar least" if rate == least else "bar"):
            ui.label(name).classes("bar-name")
            with ui.element("div").classes("bar-track"):
                ui.element("div").classes("bar-fill").style(f"width:{max(1.0, 100 * rate / most):.1f}%")
            ui.label(f"{rate:.1f}").classes("bar-value")
