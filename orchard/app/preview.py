"""What a scenario looks like before it is run: the plan to scale, and the figures that follow from
it.
"""

from nicegui import ui

from orchard.app.elements import heading, tiles
from orchard.field.kinds import KINDS
from orchard.field.layout import X_WEST, Layout
from orchard.report.bounds import Bounds, schedule_seconds
from orchard.report.limits import limit_of_question
from orchard.report.plan import COLOURS, orchard_plan
from orchard.report.summary import clock

CARRIERS = "7 for every 10 pickers; the study tells how many are worth it"  # by default
DEEP = 2.0  # from this many times its width on, a plan is shown as wide as the page


def figures(layout: Layout, limit: Bounds) -> list[tuple[str, str, str]]:
    """Return the derived figures of an orchard: name, value with its unit, and a note on its
    meaning.
    """
    scenario, trees = layout.scenario, [len(line.trees_x) for line in layout.lines]
    each = "{}" if min(trees) == max(trees) else "{} to {}"
    bins = sum(start.kind == "bin" for start in layout.starts)
    return [
        (
            "Limit",
            f"{limit.bins_per_hour:.1f} bins/h",
            "what this policy allows in a long harvest without traffic" + _in_which_rows(layout),
        ),
        ("Bottleneck", limit.bottleneck, "the part that allows least"),
        ("Schedule", clock(schedule_seconds(layout)), "this harvest without traffic"),
        ("Carriers", str(scenario.carrier_count), "as set" if scenario.carriers else CARRIERS),
        ("Bins", str(bins), f"one for each robot; the harvest fills {layout.bins}"),
        ("Trees", str(sum(trees)), f"{len(trees)} lines of {each.format(min(trees), max(trees))}"),
        (
            "Harvest field",
            f"{layout.east - X_WEST:g} x {layout.top - layout.bottom:.1f} m",
            "from fence to fence",
        ),
    ]


def _in_which_rows(layout: Layout) -> str:
    """Return in words which rows a limit is of, if each seed draws other rows."""
    is_drawn = layout.scenario.picking.spread.distribution != "none"
    return ", in rows that take their mean times" if is_drawn else ""


def derive(layout: Layout) -> tuple[list[tuple[str, str, str]], dict[str, float]]:
    """Return the derived figures of an orchard, and what each part of its harvest allows,
    bins/s.
    """
    limit = limit_of_question(layout.scenario)
    return figures(layout, limit), limit.terms


class PlanView:
    """The plan of the orchard, seen from above, with its legend."""

    def __init__(self) -> None:
        self._plan = ui.html("", sanitize=False).classes("plan").props("data-view=plan")
        self._full_width = ui.switch(
            "Full width", on_change=lambda: self._plan.classes(toggle="wide")
        ).classes("corner")
        self._full_width.props("dense size=sm data-field=full-width")
        self._is_deep = False
        with ui.element("div").classes("legend"):
            places = {
                "tree": "tree",
                "driveway": "driveway",
                "bay": "unloading bay",
                "D": "road of deliveries",
                "F": "road of full bins",
            }
            kinds = {name: "rgb({},{},{})".format(*kind.colour) for name, kind in KINDS.items()}
            for name, colour in (
                kinds | {words: COLOURS[name] for name, words in places.items()}
            ).items():
                with ui.element("div").classes("legend-entry"):
                    ui.element("div").classes("legend-mark").style(f"background:{colour}")
                    ui.label(name)

    def show(self, layout: Layout) -> None:
        self._plan.set_content(orchard_plan(layout))
        self._plan.classes(remove="stale")
        is_deep = layout.top - layout.bottom > DEEP * (layout.east - X_WEST)
        if is_deep != self._is_deep:  # all of it at once would be a stripe
            self._is_deep = is_deep
            self._full_width.set_value(is_deep)

    def fade(self) -> None:
        """Mark the plan as stale: the input is invalid, so the plan shows the last valid
        scenario.
        """
        self._plan.classes("stale")


class FiguresView:
    """The derived figures, and what each part of the harvest allows in the long run as bars."""

    def __init__(self) -> None:
        self._tiles = ui.element("div").classes("tiles")
        self._bars = ui.element("div").classes("bars")

    def show(self, derived: list[tuple[str, str, str]], rates: dict[str, float]) -> None:
        """Show what `derive` has found."""
        self._tiles.clear()
        with self._tiles:
            tiles(derived)
        self._bars.clear()
        with self._bars:
            heading(2, "What each part allows without traffic, bins/h").classes("bars-title")
            for name, rate in rates.items():
                with ui.element("div").classes(
                    "bar least" if rate == min(rates.values()) else "bar"
                ):
                    ui.label(name).classes("bar-name")
                    with ui.element("div").classes("bar-track"):
                        ui.element("div").classes("bar-fill").style(
                            f"width:{max(1.0, 100 * rate / max(rates.values())):.1f}%"
                        )
                    ui.label(f"{3600.0 * rate:.1f}").classes("bar-value")
