"""The picture of a study: bins an hour with their intervals, below their bounds, and the cost of a
bin.

Along the horizontal axis are the values of one key that varies: the one with the most numbers. The
settings with the same values of all other keys are a line. Lines differ in marks and dashes too, so
that they can be told apart in a grey print. If the key has values that are no numbers, the settings
are points side by side, with error bars.
"""

import io
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from orchard.study.kinds_of_files import MAKER
from orchard.study.result import Interval, Row, StudyResult
from orchard.study.spread import is_number
from orchard.study.table import MODELS
from orchard.study.words import axis_words, interval_words, setting_words, value_words

Array = npt.NDArray[np.float64]

# Colours of words and of axes. On a page INK is replaced by the colour of the page's words.
INK = "#24301f"
QUIET = "#5f6958"
# Colours, marks and dashes of lines. The colours can be read on light and on dark.
COLOURS = ("#3f8f4a", "#d9822b", "#4a86d0", "#a65cc0", "#95851c", "#d1495b")
MARKS = "osD^vP"
DASHES = ("-", "--", "-.", (0, (5, 1)), (0, (3, 1, 1, 1, 1, 1)), ":")
# Size of the picture, inches.
WIDTH = 8.0
HEIGHT = 4.4
HEIGHT_WITH_COST = 6.6
# Distance of the points of two lines at the same value that is no number, as a share of the
# distance of two values.
DODGE = 0.16
# Costs are shown up to this many times the least one.
DEAREST = 3.0
# Up to so many values are all named along the axis.
MOST_TICKS = 24
# At most so many lines are shown: those with the best settings.
MOST_LINES = 6
FONTS = ["system-ui", "DejaVu Sans", "sans-serif"]
# Kind of file -> its metadata: they name the maker. Without a date an SVG is the same each time.
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": MAKER},
    "svg": {"Creator": [MAKER], "Date": None},
}
# matplotlib's settings hold for all threads, and two pages may draw at once.
DRAWING = threading.Lock()


@dataclass(frozen=True)
class Curve:
    """A line of the picture: settings that differ only in the key along the axis."""

    #: Their common values of the other keys.
    rest: dict[str, Any]
    #: In the order of the axis.
    rows: list[Row]

    @property
    def known(self) -> list[Row]:
        """The rows that did not all jam."""
        return [row for row in self.rows if row.bins_per_hour is not None]


@dataclass(frozen=True)
class LineLook:
    """How a line is drawn, so that it differs from the others."""

    colour: str
    mark: str
    dash: Any
    #: How far points stand beside their value on the axis, as those of several lines do.
    aside: float

    @property
    def of_points(self) -> dict[str, Any]:
        """The colour and the marks, as matplotlib takes them."""
        return {"color": self.colour, "marker": self.mark, "ms": 5, "zorder": 3}


class Content:
    """What the picture of a study shows: the key along the axis, and the lines."""

    def __init__(self, result: StudyResult) -> None:
        self.result = result
        self.key = max(result.compared, key=self._number_count, default="")
        self.is_numeric = self._number_count(self.key) > 0
        self.others = [key for key in result.compared if key != self.key]

    def _number_count(self, key: str) -> int:
        """Return how many numbers a key has; 0 if not all of its values are numbers."""
        values = self.result.varied.get(key, [])
        if len(values) > 1 and all(map(is_number, values)):
            return len(values)
        return 0

    @cached_property
    def values(self) -> list[Any]:
        """What stands along the axis, in its order."""
        values = self.result.varied.get(self.key, [])
        if self.is_numeric:
            return sorted(values)
        return list(values)

    @cached_property
    def lines(self) -> list[Curve]:
        """The lines, at most MOST_LINES of them: those with the best values of the goal."""
        # By the values of all other keys, as text: a section of a scenario cannot be a key.
        curves: dict[str, Curve] = {}
        for row in sorted(self.result.table, key=self.place):
            rest = {key: row.setting.get(key) for key in self.others}
            curve = curves.setdefault(repr(rest), Curve(rest, []))
            curve.rows.append(row)
        best = sorted(curves.values(), key=self._reached)[:MOST_LINES]
        return [curve for curve in curves.values() if curve in best]

    def _reached(self, line: Curve) -> float:
        """Return the best value of the goal on a line, less is better; inf if all jammed."""
        nearest = inf
        for row in line.known:
            figure = getattr(row, self.result.goal)
            if figure is None:
                continue
            if self.result.goal == "bins_per_hour":
                nearest = min(nearest, -figure.mean)
            else:
                nearest = min(nearest, figure.mean)
        return nearest

    def place(self, row: Row) -> float:
        """Return where a row stands along the axis."""
        value = row.setting.get(self.key)
        if self.is_numeric and value is not None:
            return float(value)
        if not self.values:
            return 0.0
        return float(self.values.index(value))

    def look(self, number: int) -> LineLook:
        """Return how a line is drawn. `number`: of the line, from 0."""
        # The points of all lines at a value are centred on it.
        aside = 0.0
        if not self.is_numeric:
            middle = (len(self.lines) - 1) / 2
            aside = DODGE * (number - middle)
        return LineLook(
            colour=COLOURS[number % len(COLOURS)],
            mark=MARKS[number % len(MARKS)],
            dash=DASHES[number % len(DASHES)],
            aside=aside,
        )

    def places(self, line: Curve, look: LineLook) -> list[float]:
        """Return where the rows of a line stand along the axis, (n,)."""
        return [self.place(row) + look.aside for row in line.rows]


def figure(result: StudyResult) -> Figure:
    """Return the picture of a study, complete or not."""
    content = Content(result)
    height = HEIGHT
    if result.has_costs:
        height = HEIGHT_WITH_COST
    drawing = Figure(figsize=(WIDTH, height), layout="constrained")
    drawing.patch.set_alpha(0.0)
    if result.has_costs:
        rates, costs = drawing.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        _draw_rates(rates, content)
        _draw_costs(costs, content)
        style_axes(rates)
        style_axes(costs)
        _draw_axis(costs, content)
    else:
        rates = drawing.subplots()
        _draw_rates(rates, content)
        style_axes(rates)
        _draw_axis(rates, content)
    return drawing


def _draw_rates(axes: Axes, content: Content) -> None:
    """Draw the bins an hour of all lines, under their bounds."""
    unit = "bins an hour"
    if content.result.horizon == "long":
        unit += " in the long run"
    axes.set_ylabel(unit)
    for number, line in enumerate(content.lines):
        look = content.look(number)
        _draw_bounds(axes, content, line, look)
        _draw_figures(axes, content, line, look, "bins_per_hour")
        _draw_checks(axes, content, line, look)
        _draw_jams(axes, content, line, look)
    axes.set_ylim(bottom=0.0)
    if content.lines:
        axes.legend(frameon=False, fontsize=9, loc="best", labelcolor=INK)


def _draw_bounds(axes: Axes, content: Content, line: Curve, look: LineLook) -> None:
    """Draw the bound of each setting of a line: dotted, or as dashes beside each other."""
    bounds = [row.bound_bins_per_hour for row in line.rows]
    style: dict[str, Any] = {"ls": "", "marker": "_", "ms": 16}
    if content.is_numeric:
        style = {"lw": 1, "ls": (0, (1, 2))}
    label = _once(axes, "bound")
    axes.plot(content.places(line, look), bounds, color=look.colour, label=label, **style)


def _draw_checks(axes: Axes, content: Content, line: Curve, look: LineLook) -> None:
    """Draw what the simulator says of the settings that it has checked."""
    places = []
    rates = []
    for place, row in zip(content.places(line, look), line.rows, strict=True):
        if row.check is not None:
            places.append(place)
            rates.append(row.check.bins_per_hour)
    if not places:
        return
    axes.errorbar(
        places,
        means_of(rates),
        half_widths(rates),
        color=INK,
        ls="",
        marker="d",
        ms=8,
        mfc="none",
        capsize=4,
        lw=1,
        zorder=5,
        label=_once(axes, "simulator"),
    )


def _draw_jams(axes: Axes, content: Content, line: Curve, look: LineLook) -> None:
    """Draw a cross at the foot for each setting of which all runs jammed."""
    places = []
    for place, row in zip(content.places(line, look), line.rows, strict=True):
        if row.bins_per_hour is None:
            places.append(place)
    if places:
        axes.plot(
            places,
            [0.0] * len(places),
            color=look.colour,
            ls="",
            marker="x",
            ms=8,
            mew=2,
            clip_on=False,
            label="jammed",
        )


def _draw_costs(axes: Axes, content: Content) -> None:
    """Draw what a bin costs. Where it is far above the least, the line leaves the picture."""
    axes.set_ylabel("cost of a bin")
    for number, line in enumerate(content.lines):
        _draw_figures(axes, content, line, content.look(number), "cost_per_bin")
    costs = [row.cost_per_bin.mean for row in content.result.table if row.cost_per_bin is not None]
    # A tenth of space above. Where all costs are 0 an axis up to 1 is drawn.
    top = 1.1 * min(max(costs), DEAREST * min(costs))
    axes.set_ylim(0.0, top or 1.0)


def _draw_figures(axes: Axes, content: Content, line: Curve, look: LineLook, name: str) -> None:
    """Draw a figure of each row of a line with its interval, and mark the best row.

    `name`: of the figure, as a row has it.
    """
    places = []
    figures = []
    best = []
    for place, row in zip(content.places(line, look), line.rows, strict=True):
        interval: Interval | None = getattr(row, name)
        if interval is None:
            continue
        places.append(place)
        figures.append(interval)
        if row.standing == "best":
            best.append((place, interval))
    if not figures:
        return
    means = means_of(figures)
    label = _name_of(line)
    if content.is_numeric:
        lows, highs = ends_of(figures)
        axes.fill_between(places, lows, highs, color=look.colour, alpha=0.18, lw=0)
        axes.plot(places, means, lw=1.8, ls=look.dash, label=label, **look.of_points)
    else:
        bars = half_widths(figures)
        axes.errorbar(places, means, bars, ls="", capsize=5, lw=1.4, label=label, **look.of_points)
    for place, interval in best:
        _mark_best(axes, place, interval)


def _mark_best(axes: Axes, place: float, interval: Interval) -> None:
    """Draw a ring around the figure of the best setting, and write the figure beside it."""
    axes.plot(
        [place],
        [interval.mean],
        marker="o",
        ms=14,
        mfc="none",
        mec=INK,
        mew=1.5,
        ls="",
        zorder=4,
        label=_once(axes, "best"),
    )
    axes.annotate(
        interval_words(interval),
        (place, interval.mean),
        xytext=(10, -16),
        textcoords="offset points",
        fontsize=9,
        color=INK,
    )


def _name_of(line: Curve) -> str:
    """Return the name of a line for the legend: what its settings share, or the model."""
    if line.rest:
        return setting_words(line.rest)
    return MODELS[line.rows[0].model]


def _once(axes: Axes, label: str) -> str | None:
    """Return a label; None if the legend has it already."""
    _, labels = axes.get_legend_handles_labels()
    if label in labels:
        return None
    return label


def means_of(intervals: Sequence[Interval]) -> Array:
    """Return the means of intervals, (n,)."""
    return np.array([interval.mean for interval in intervals])


def ends_of(intervals: Sequence[Interval]) -> Array:
    """Return the low ends of intervals and the high ones, (2, n)."""
    return np.array([(interval.low, interval.high) for interval in intervals]).T


def half_widths(intervals: Sequence[Interval]) -> Array:
    """Return how far intervals reach below and above their means, (2, n)."""
    lows, highs = ends_of(intervals)
    means = means_of(intervals)
    return np.array([means - lows, highs - means])


def style_axes(axes: Axes) -> None:
    """Give axes the colours of all pictures."""
    axes.patch.set_alpha(0.0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(QUIET)
    axes.grid(axis="y", color=QUIET, alpha=0.25, lw=0.6)
    axes.tick_params(colors=INK, labelcolor=INK, color=QUIET)
    axes.yaxis.label.set_color(INK)


def _draw_axis(axes: Axes, content: Content) -> None:
    """Name the values along the axis."""
    axes.set_xlabel(axis_words(content.key), color=INK)
    count = len(content.values)
    if not content.is_numeric:
        names = [value_words(value, content.key) for value in content.values]
        wrapped = [name.replace("-", "-\n").replace(".", ".\n") for name in names]
        axes.set_xticks(range(count), wrapped)
        axes.set_xlim(-0.5, max(0.5, count - 0.5))
    elif count <= MOST_TICKS:
        axes.set_xticks(content.values, [value_words(value) for value in content.values])
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def save_futures(
    path: Path,
    rates: Mapping[float, Sequence[float]],
    shares: Mapping[float, float],
    decided: float | None,
) -> None:
    """Draw the futures that `orchard fork --futures` has made from some moments of a run.

    `rates`: moment, min -> the bins an hour of its futures. `shares`: moment, min -> the share of
    its futures that end well. `decided`: the last moment, min, from which they do; None: there is
    none. Raises as `save` does.
    """
    drawing = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    top, beneath = drawing.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for minute, of_moment in rates.items():
        minutes = [minute] * len(of_moment)
        top.plot(minutes, of_moment, ls="", marker="o", ms=4, color=COLOURS[0], alpha=0.6)
    top.set_ylabel("bins an hour")
    percents = [100.0 * share for share in shares.values()]
    beneath.plot(list(shares), percents, color=COLOURS[1], marker="o", ms=4)
    beneath.set_ylim(-5.0, 105.0)
    beneath.set_ylabel("end well, %")
    beneath.set_xlabel("the moment from which they begin, min", color=INK)
    for axes in (top, beneath):
        style_axes(axes)
        if decided is not None:
            axes.axvline(decided, color=INK, lw=1, ls="--")
    write_drawing(drawing, path)


# -- files


def save(result: StudyResult, path: Path) -> None:
    """Write the picture, on white, in the format of its name, such as .svg or .png.

    Raises ValueError for another format, or OSError.
    """
    write_drawing(figure(result), path)


def write_drawing(drawing: Figure, path: Path) -> None:
    """Write a drawing, on white. Raises as `save` does."""
    kind = path.suffix.removeprefix(".").lower()
    if kind not in drawing.canvas.get_supported_filetypes():
        raise ValueError(f"{path}: a picture's name ends in .svg or .png")
    drawing.patch.set(alpha=1.0, facecolor="white")
    path.write_bytes(_file_of(drawing, kind))


def inline_svg(result: StudyResult) -> str:
    """Return the picture as an element of a page, in the colour of the page's words.

    The element has a title, which says what the picture shows.
    """
    title = "Bins an hour of each setting"
    if result.has_costs:
        title += ", and what a bin costs"
    return inline_drawing(figure(result), title)


def inline_drawing(drawing: Figure, title: str) -> str:
    """Return a drawing as an element of a page, in the colour of the page's words."""
    svg = _file_of(drawing, "svg").decode()
    # A page wants the element alone, as wide as its place, with a label for readers of the screen,
    # and in its own colours.
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', ' role="img"', svg, count=1)
    svg = svg.replace(">", f' aria-label="{title}">', 1)
    # All drawings have the same names of parts, and a page may have several drawings.
    own = re.sub(r"\W+", "-", title)
    for before_name in (' id="', 'href="#', "url(#"):
        svg = svg.replace(before_name, f"{before_name}{own}-")
    return svg.replace(INK, "currentColor").replace(QUIET, "#7d8778")


def _file_of(drawing: Figure, kind: str) -> bytes:
    """Return a drawing as the bytes of a file, the same each time.

    The words in an SVG are text, and not outlines of letters.
    """
    settings: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": "orchard",
        "font.sans-serif": FONTS,
    }
    metadata = METADATA.get(kind)
    with DRAWING, matplotlib.rc_context(settings):
        file = io.BytesIO()
        drawing.savefig(file, format=kind, dpi=150, metadata=metadata)
    return file.getvalue()
