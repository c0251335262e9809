"""The figures of runs over simulated time, as charts, one line for each run."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from nicegui import ui

from orchard.field.scenario import Scenario
from orchard.report.metrics import shares

History = Mapping[str, Sequence[float]]  # of a run, as in its summary
Points = list[list[float]]  # [simulated min, value]
Course = Mapping[str, Points]  # title of a chart -> its line
BINS, WAITING, BUSY = "Bins delivered", "Pickers that wait, %", "Carriers at work, %"


def course_of(history: History, scenario: Scenario, since: float = 0.0) -> Course:
    """Return figures of a run over time, from a moment on, s.

    `history`: as in the summary, as far as the run has got.
    """

    def points(values: Iterable[float]) -> Points:
        return [
            [round(s / 60.0, 2), round(value, 1)]
            for s, value in zip(history["seconds"], values, strict=True)
            if s > since
        ]

    waited = shares(history, "pickers_waited_seconds", scenario.pickers)
    busy = shares(history, "carriers_busy_seconds", scenario.carrier_count)
    percent = {
        WAITING: points(100.0 * share for share in waited),
        BUSY: points(100.0 * share for share in busy),
    }
    return {BINS: points(history["bins_delivered"]), **percent}


COLOURS = [
    "#5a9e54",
    "#d9822b",
    "#4a90d9",
    "#b062c4",
    "#c9a227",
    "#d1495b",
]  # of the runs, on light and on dark
INK = "#7d8778"  # of axes and names, on light and on dark
STEPS = {BINS: "end", WAITING: "", BUSY: ""}  # title of a chart -> the steps of its lines


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
        self._legend.clear()
        with self._legend:
            for number, name in enumerate(filter(None, courses)):
                with ui.element("div").classes("legend-entry"):
                    ui.element("div").classes("legend-mark").style(f"background:{colour(number)}")
                    ui.label(name)
        for title, (box, chart) in self._charts.items():
            lines = enumerate(
                (name, course[title]) for name, course in courses.items()
            )  # numbered as in the legend
            series = [
                _line(name, points, STEPS[title], number)
                for number, (name, points) in lines
                if points
            ]
            box.set_visibility(bool(series))
            look = {
                "silent": True,
                "symbol": "none",
                "label": {"show": False},
                "lineStyle": {"color": INK},
            }
            marked = look | {"data": [{"xAxis": round(at / 60.0, 2)} for at in marks]}
            chart.options["series"] = [*series, {"type": "line", "data": [], "markLine": marked}]
            chart.update()


def colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _chart(title: str) -> tuple[ui.element, ui.echart]:
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
    look = {"type": "line", "showSymbol": False, "lineStyle": {"width": 2}, "color": colour(number)}
    return look | {"name": name, "step": step or False, "data": points}
