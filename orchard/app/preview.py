"""What a scenario looks like before it is run: the plan to scale, and figures of it."""

from nicegui import ui

from orchard.app.elements import heading, tiles
from orchard.field.kinds import KINDS
from orchard.field.layout import X_WEST, Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.report.bounds import Bounds, schedule_seconds
from orchard.report.limits import limit_of_question
from orchard.report.plan import COLOURS, orchard_plan
from orchard.report.rare_truck import notes_on_truck
from orchard.report.summary import clock

# How many carriers there are if the user leaves that to the program.
CARRIERS = "7 for every 10 pickers; the study tells how many are worth it"
# A plan that is this many times as deep as wide is shown as wide as the page.
DEEP = 2.0
# Name in the legend -> what has that colour in the plan.
PLACES = {
    "tree": "tree",
    "driveway": "driveway",
    "unloading bay": "bay",
    "road of deliveries": "D",
    "road of full bins": "F",
}

#: Name, value with its unit, and a note on its meaning.
Figure = tuple[str, str, str]


def figures(layout: Layout, limit: Bounds) -> list[Figure]:
    """Return the derived figures of an orchard."""
    carriers = layout.scenario.carriers
    bin_count = sum(start.kind == "bin" for start in layout.starts)
    return [
        _limit_figure(layout, limit),
        ("Bottleneck", limit.bottleneck, "the part that allows least"),
        ("Schedule", clock(schedule_seconds(layout)), "this harvest without traffic"),
        ("Carriers", str(layout.scenario.carrier_count), "as set" if carriers else CARRIERS),
        ("Bins", str(bin_count), f"one for each robot; the harvest fills {layout.bins}"),
        _tree_figure(layout),
        *_truck_figures(layout),
        (
            "Harvest field",
            f"{layout.east - X_WEST:g} x {layout.top - layout.bottom:.1f} m",
            "from fence to fence",
        ),
    ]


def _limit_figure(layout: Layout, limit: Bounds) -> Figure:
    meaning = "what this policy allows in a long harvest without traffic"
    # With a spread each seed draws other times for the rows.
    if layout.scenario.picking.is_drawn:
        meaning += ", in rows that take their mean times"
    return "Limit", f"{limit.bins_per_hour:.1f} bins/h", meaning


def _tree_figure(layout: Layout) -> Figure:
    trees = [len(line.trees_x) for line in layout.lines]
    fewest = min(trees)
    most = max(trees)
    in_each_line = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    return "Trees", str(sum(trees)), f"{len(trees)} lines of {in_each_line}"


def _truck_figures(layout: Layout) -> list[Figure]:
    """Return what a user should know of a truck that comes more rarely than the harvest lasts."""
    truck = layout.scenario.load_out.truck
    figures = []
    for note in notes_on_truck(layout):
        figures.append(("Truck", f"every {clock(truck.every or 0.0)}", note))
    return figures


def derive(scenario: Scenario) -> tuple[list[Figure], dict[str, float]]:
    """Return the derived figures of an orchard, and what each part of it allows, bins/s."""
    limit = limit_of_question(scenario)
    return figures(lay_out(scenario), limit), limit.terms


class PlanView:
    """The plan of the orchard, seen from above, with its legend."""

    def __init__(self) -> None:
        self._plan = ui.html("", sanitize=False).classes("plan").props("data-view=plan")
        self._full_width = ui.switch("Full width", on_change=self._turn_wide).classes("corner")
        self._full_width.props("dense size=sm data-field=full-width")
        self._is_deep = False
        with ui.element("div").classes("legend"):
            for name, kind in KINDS.items():
                _legend_entry(name, "rgb({},{},{})".format(*kind.colour))
            for name, place in PLACES.items():
                _legend_entry(name, COLOURS[place])

    def _turn_wide(self) -> None:
        """Show the plan as wide as the page, or all of it at once again."""
        self._plan.classes(toggle="wide")

    def show(self, layout: Layout) -> None:
        """Show the plan of an orchard. All of a deep one at once would be a stripe."""
        self._plan.set_content(orchard_plan(layout))
        self._plan.classes(remove="stale")
        is_deep = layout.top - layout.bottom > DEEP * (layout.east - X_WEST)
        # What the user has turned since stays as long as the plan is of the same shape.
        if is_deep != self._is_deep:
            self._is_deep = is_deep
            self._full_width.set_value(is_deep)

    def fade(self) -> None:
        """Mark the plan as that of the last valid scenario, because a value is invalid now."""
        self._plan.classes("stale")


def _legend_entry(name: str, colour: str) -> None:
    with ui.element("div").classes("legend-entry"):
        ui.element("div").classes("legend-mark").style(f"background:{colour}")
        ui.label(name)


class FiguresView:
    """The derived figures, and what each part of the harvest allows in the long run as bars."""

    def __init__(self) -> None:
        self._tiles = ui.element("div").classes("tiles")
        self._bars = ui.element("div").classes("bars")

    def show(self, derived: list[Figure], rates: dict[str, float]) -> None:
        """Show the figures, and what each part allows, bins/s: what `derive` returns."""
        self._tiles.clear()
        with self._tiles:
            tiles(derived)
        self._bars.clear()
        least = min(rates.values())
        most = max(rates.values())
        with self._bars:
            heading(2, "What each part allows without traffic, bins/h").classes("bars-title")
            for name, rate in rates.items():
                style = "bar least" if rate == least else "bar"
                with ui.element("div").classes(style):
                    ui.label(name).classes("bar-name")
                    with ui.element("div").classes("bar-track"):
                        # At least 1 %, so that a bar is seen.
                        percent = max(1.0, 100 * rate / most)
                        ui.element("div").classes("bar-fill").style(f"width:{percent:.1f}%")
                    ui.label(f"{3600.0 * rate:.1f}").classes("bar-value")
