"""The figures of runs over simulated time, as charts, one line for each run."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from nicegui import ui

from orchard.field.scenario import Scenario
from orchard.report.metrics import shares

#: Figures of a run over time, by name, as its summary has them.
History = Mapping[str, Sequence[float]]
#: Each point: simulated minutes, value.
Points = list[list[float]]
#: Title of a chart -> the points of its line.
Course = Mapping[str, Points]
BINS = "Bins delivered"
WAITING = "Pickers that wait, %"
BUSY = "Carriers at work, %"


def course_of(history: History, scenario: Scenario, since: float = 0.0) -> Course:
    """Return figures of a run over time, for the samples after `since`, s.

    `history`: as in the summary, as far as the run has got.
    """

    def points(values: Iterable[float]) -> Points:
        shown = []
        for seconds, value in zip(history["seconds"], values, strict=True):
            if seconds > since:
                shown.append([round(seconds / 60.0, 2), round(value, 1)])
        return shown

    waited = shares(history, "pickers_waited_seconds", scenario.pickers)
    busy = shares(history, "carriers_busy_seconds", scenario.carrier_count)
    return {
        BINS: points(history["bins_delivered"]),
        WAITING: points(100.0 * share for share in waited),
        BUSY: points(100.0 * share for share in busy),
    }


# Colours of the lines. Each one is clear on a light and on a dark page.
COLOURS = [
    "#5a9e54",
    "#d9822b",
    "#4a90d9",
    "#b062c4",
    "#c9a227",
    "#d1495b",
]
# Colour of axes and their names, on a light and on a dark page.
INK = "#7d8778"
# Title of a chart -> where its line steps, as ECharts names it; "" draws a line without steps.
STEPS = {BINS: "end", WAITING: "", BUSY: ""}
# How the mark of a moment looks.
MARK = {
    "silent": True,
    "symbol": "none",
    "label": {"show": False},
    "lineStyle": {"color": INK},
}


class Charts:
    """A chart for each of STEPS."""

    def __init__(self) -> None:
        self._shown: Mapping[str, Course] = {}
        self._legend = ui.element("div").classes("legend")
        with ui.element("div").classes("charts"):
            self._charts = {title: _chart(title) for title in STEPS}

    def show(self, courses: Mapping[str, Course], marks: Sequence[float] = ()) -> None:
        """Draw these runs, by name, and mark moments, s.

        A figure that is known of none of them has no chart.
        """
        if courses == self._shown:
            return
        self._shown = dict(courses)
        self._show_legend(courses)
        marked_moments = MARK | {"data": [{"xAxis": round(at / 60.0, 2)} for at in marks]}
        for title, (box, chart) in self._charts.items():
            # A run has the same number here as in the legend, and so the same colour.
            series = []
            for number, (name, course) in enumerate(courses.items()):
                if course[title]:
                    series.append(_line(name, course[title], STEPS[title], number))
            box.set_visibility(bool(series))
            marks_only = {"type": "line", "data": [], "markLine": marked_moments}
            chart.options["series"] = [*series, marks_only]
            chart.update()

    def _show_legend(self, names: Iterable[str]) -> None:
        """Show the colour of each run. A run without a name stands alone, and needs no legend."""
        self._legend.clear()
        with self._legend:
            for number, name in enumerate(filter(None, names)):
                with ui.element("div").classes("legend-entry"):
                    ui.element("div").classes("legend-mark").style(f"background:{colour(number)}")
                    ui.label(name)


def colour(number: int) -> str:
    """Return the colour of the run with this number. After the last colour comes the first."""
    return COLOURS[number % len(COLOURS)]


def _chart(title: str) -> tuple[ui.element, ui.echart]:
    """Add an empty chart, which is hidden. Return its box and itself."""
    with ui.element("figure").classes("chart") as box:
        with ui.element("figcaption"):
            ui.label(title)
        chart = (
            ui.echart(_options())
            .props(f'role=img aria-label="{title}, over simulated minutes"')
            .classes("chart-area")
        )
    box.set_visibility(False)
    return box, chart


def _options() -> dict[str, Any]:
    """Return the options of an empty chart, as ECharts takes them."""
    ink = {"color": INK}
    axis = {"type": "value", "axisLabel": ink, "splitLine": {"lineStyle": ink | {"opacity": 0.25}}}
    along = {
        "name": "min",
        "nameLocation": "middle",
        "nameGap": 22,
        "nameTextStyle": ink,
        "splitLine": {"show": False},
    }
    return {
        "animation": False,
        "grid": {"left": 38, "right": 14, "top": 14, "bottom": 38},
        "tooltip": {"trigger": "axis", "confine": True},
        "xAxis": axis | along,
        "yAxis": axis | {"min": 0, "minInterval": 1},
        "series": [],
    }


def _line(name: str, points: Points, step: str, number: int) -> dict[str, Any]:
    """Return the line of one run, as ECharts takes it."""
    return {
        "type": "line",
        "showSymbol": False,
        "lineStyle": {"width": 2},
        "color": colour(number),
        "name": name,
        "step": step or False,
        "data": points,
    }
