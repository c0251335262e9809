"""What a scenario looks like before it is run: the plan to scale, and the figures that follow from it."""

import math
from dataclasses import dataclass

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.draft import entries
from orchard.field.kinds import KINDS
from orchard.field.layout import TOP, TREES_X, X_MAX, Layout
from orchard.report.bounds import Bounds
from orchard.report.plan import COLOURS, orchard_plan


@dataclass(frozen=True)
class Figure:
    """A named value with its unit, and a note on its meaning."""

    name: str
    value: str
    note: str = ""


def figures(layout: Layout) -> list[Figure]:
    """Return the derived figures of an orchard, formatted for the page."""
    scenario, bounds = layout.scenario, Bounds(layout)
    bins = sum(start.kind == "bin" for start in layout.starts)
    trees = len(layout.tree_lines) * len(TREES_X)
    enough = math.ceil(round(bounds.enough_carriers, 6))
    return [
        Figure("Bound", f"{bounds.bins_per_hour:.1f} bins/h", "upper bound of this orchard in a long harvest"),
        Figure("Bottleneck", bounds.bottleneck, "the part with the lowest bound"),
        Figure("Carriers", str(scenario.carrier_count), "as set" if scenario.carriers else "7 for every 10 pickers"),
        Figure("Enough carriers", str(enough), _enough_note(enough)),
        Figure("Bins", str(bins), f"one for each robot; the harvest fills {scenario.rows}"),
        Figure("Trees", str(trees), f"{len(layout.tree_lines)} lines of {len(TREES_X)}"),
        Figure("Harvest field", f"{2 * X_MAX:.0f} x {TOP - layout.bottom:.1f} m", "from fence to fence"),
    ]


def _enough_note(enough: int) -> str:
    most = entries()["carriers"].high
    return "more would not speed up the harvest" if enough <= most else f"more would not help; at most {most:g} can be set"


def terms(layout: Layout) -> dict[str, float]:
    """Return the upper bound that each part (pickers, carriers, unloading) sets for the harvest, bins/h."""
    return {name: 3600.0 * rate for name, rate in Bounds(layout).terms.items()}


class PlanView:
    """The plan of the orchard, seen from above, with its legend."""

    def __init__(self) -> None:
        self._plan = ui.html("", sanitize=False).classes("plan").props("data-view=plan")
        ui.switch("Full width", on_change=self._widen).classes("corner").props("dense size=sm data-field=full-width")
        with ui.element("div").classes("legend"):
            for name, colour in _legend():
                with ui.element("div").classes("legend-entry"):
                    ui.element("div").classes("legend-mark").style(f"background:{colour}")
                    ui.label(name)

    def show(self, layout: Layout) -> None:
        """Draw the plan of an orchard."""
        self._plan.set_content(orchard_plan(layout))
        self._plan.classes(remove="stale")

    def _widen(self, event: ValueChangeEventArguments[bool | None]) -> None:
        """Switch between the whole plan, in which a long orchard is small, and the full width."""
        self._plan.classes(add="wide" if event.value else "", remove="" if event.value else "wide")

    def fade(self) -> None:
        """Mark the plan as stale: the input is invalid, so the plan shows the last valid scenario."""
        self._plan.classes("stale")


def _legend() -> list[tuple[str, str]]:
    """Names and colours of the legend. A body has the colour of its kind."""
    kinds = [(name, "rgb({},{},{})".format(*kind.colour)) for name, kind in KINDS.items()]
    places = {"tree": "tree", "driveway": "driveway", "bay": "unloading bay", "D": "road of deliveries", "F": "road of full bins"}
    return kinds + [(words, COLOURS[name]) for name, words in places.items()]


class FiguresView:
    """The derived figures, and the upper bound of each part of the harvest as bars."""

    def __init__(self) -> None:
        self._tiles = ui.element("div").classes("tiles")
        self._bars = ui.element("div").classes("bars")

    def show(self, layout: Layout) -> None:
        """Show the figures of an orchard."""
        self._tiles.clear()
        with self._tiles:
            for figure in figures(layout):
                _tile(figure)
        self._bars.clear()
        with self._bars:
            ui.label("Upper bound of each part, bins/h").classes("bars-title")
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
