"""The picture of a study: bins an hour with its band under the bound, and beneath it what a bin costs.

The first key with the most numbers runs along the axis; each combination of other keys is a line with a mark of its own, to be read in
grey. Values that are no numbers stand side by side, as points with their intervals.
"""

import io
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from orchard.study.result import Interval, Row, StudyResult
from orchard.study.words import axis_words, interval_words, setting_words, value_words

INK, QUIET = (
    "#24301f",
    "#5f6958",
)  # of words and of axes; on a page the ink is that of the page's words
COLOURS = (
    "#3f8f4a",
    "#d9822b",
    "#4a86d0",
    "#a65cc0",
    "#95851c",
    "#d1495b",
)  # of lines, on light and on dark
MARKS, DASHES = "osD^vP", ("-", "--", "-.", (0, (5, 1)), (0, (3, 1, 1, 1, 1, 1)), ":")
WIDTH, HEIGHT, HEIGHT_WITH_COST = 8.0, 4.4, 6.6  # inches
DODGE = 0.16  # between the points of two lines at one value that is no number, as a share of the way to the next
DEAREST = 3.0  # times the least cost, up to which costs are shown
MOST_TICKS = 24  # values that are all named along the axis
MOST_LINES = 6  # more are not shown: those with the best settings are
FONTS = ["system-ui", "DejaVu Sans", "sans-serif"]
DRAWING = (
    threading.Lock()
)  # matplotlib's settings hold for all threads, and two pages may draw at once


@dataclass(frozen=True)
class Curve:
    """The settings that differ only in the key along the axis."""

    rest: dict[str, Any]
    rows: list[Row]  # in the order of the axis

    @property
    def known(self) -> list[Row]:
        """The rows that did not all jam."""
        return [row for row in self.rows if row.bins_per_hour is not None]


class Content:
    """What the picture of a study shows: the key along the axis, and the lines."""

    def __init__(self, result: StudyResult) -> None:
        self.result = result
        keys = result.compared
        self.key = max(
            keys,
            key=lambda key: (
                self._is_numeric(key),
                len(result.varied[key]) if self._is_numeric(key) else 0,
            ),
            default="",
        )
        self.is_numeric = self._is_numeric(self.key)
        self.others = [key for key in keys if key != self.key]

    def _is_numeric(self, key: str) -> bool:
        values = self.result.varied.get(key, [])
        return len(values) > 1 and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        )

    @cached_property
    def values(self) -> list[Any]:
        """What stands along the axis, in its order."""
        values = self.result.varied.get(self.key, [])
        return sorted(values) if self.is_numeric else list(values)

    @cached_property
    def lines(self) -> list[Curve]:
        """The lines, at most MOST_LINES of them: those that reach most of the goal."""
        rows: dict[str, list[Row]] = {}  # by the values of all other keys, which may be sections
        for row in sorted(self.result.table, key=self.place):
            rows.setdefault(repr([row.setting.get(key) for key in self.others]), []).append(row)
        made = [
            Curve({key: some[0].setting.get(key) for key in self.others}, some)
            for some in rows.values()
        ]
        best = sorted(made, key=self._reached)[:MOST_LINES]
        return [line for line in made if line in best]

    def _reached(self, line: Curve) -> float:
        sign = -1.0 if self.result.goal == "bins_per_hour" else 1.0
        figures = (getattr(row, self.result.goal) for row in line.known)
        return min(
            (sign * figure.mean for figure in figures if figure is not None), default=float("inf")
        )

    def place(self, row: Row) -> float:
        """Where a row stands along the axis."""
        value = row.setting.get(self.key)
        return (
            float(value)
            if self.is_numeric and value is not None
            else float(self.values.index(value))
            if self.values
            else 0.0
        )


def figure(result: StudyResult) -> Figure:
    """Return the picture of a study, complete or not."""
    content = Content(result)
    has_cost = any(row.cost_per_bin is not None for row in result.table)
    drawing = Figure(
        figsize=(WIDTH, HEIGHT_WITH_COST if has_cost else HEIGHT), layout="constrained"
    )
    drawing.patch.set_alpha(0.0)
    top, *beneath = drawing.subplots(
        2 if has_cost else 1,
        1,
        sharex=True,
        squeeze=False,
        height_ratios=[3, 2] if has_cost else None,
    ).flat
    _draw_rates(top, content)
    for axes in beneath:
        _draw_costs(axes, content)
    for axes in (top, *beneath):
        _style(axes)
    _draw_axis([top, *beneath][-1], content)
    return drawing


def _draw_rates(axes: Axes, content: Content) -> None:
    axes.set_ylabel(
        "bins an hour" + (" in the long run" if content.result.horizon == "long" else "")
    )
    for number, line in enumerate(content.lines):
        places, colour = _places(content, line, number), COLOURS[number % len(COLOURS)]
        bounds = [row.bound_bins_per_hour for row in line.rows]
        said = "bound" if number == 0 else None
        look: dict[str, Any] = (
            {"lw": 1, "ls": (0, (1, 2))}
            if content.is_numeric
            else {"ls": "", "marker": "_", "ms": 16}
        )
        axes.plot(places, bounds, color=colour, label=said, **look)
        _draw_figures(axes, content, line, number, [row.bins_per_hour for row in line.rows])
        checked = [
            (place, row.check)
            for place, row in zip(places, line.rows, strict=True)
            if row.check is not None
        ]
        if checked:
            means = [check.bins_per_hour for _, check in checked]
            label = (
                "simulator"
                if not any(text == "simulator" for text in axes.get_legend_handles_labels()[1])
                else None
            )
            axes.errorbar([place for place, _ in checked], [one.mean for one in means], _halves(means), color=INK, ls="", marker="d", ms=8,
                          mfc="none", capsize=4, lw=1, zorder=5, label=label)  # fmt: skip
        jammed = [
            place for place, row in zip(places, line.rows, strict=True) if row.bins_per_hour is None
        ]
        if jammed:
            axes.plot(
                jammed,
                [0.0] * len(jammed),
                color=colour,
                ls="",
                marker="x",
                ms=8,
                mew=2,
                clip_on=False,
                label="jammed",
            )
    axes.set_ylim(bottom=0.0)
    if content.lines:
        axes.legend(frameon=False, fontsize=9, loc="best", labelcolor=INK)


def _draw_costs(axes: Axes, content: Content) -> None:
    """What a bin costs. Where it is far above the least, the line leaves the picture."""
    axes.set_ylabel("cost of a bin")
    for number, line in enumerate(content.lines):
        _draw_figures(axes, content, line, number, [row.cost_per_bin for row in line.rows])
    costs = [row.cost_per_bin.mean for row in content.result.table if row.cost_per_bin is not None]
    axes.set_ylim(0.0, 1.1 * min(max(costs), DEAREST * min(costs)) or 1.0)


def _draw_figures(
    axes: Axes, content: Content, line: Curve, number: int, figures: Sequence[Interval | None]
) -> None:
    places = _places(content, line, number)
    known = [(place, one) for place, one in zip(places, figures, strict=True) if one is not None]
    if not known:
        return
    along, shown = [place for place, _ in known], [one for _, one in known]
    look: dict[str, Any] = {
        "color": COLOURS[number % len(COLOURS)],
        "marker": MARKS[number % len(MARKS)],
        "ms": 5,
        "zorder": 3,
    }
    name = (
        setting_words(line.rest)
        if line.rest
        else "fast model"
        if line.rows[0].model == "fast"
        else "simulator"
    )
    if content.is_numeric:
        axes.fill_between(
            along,
            [one.low for one in shown],
            [one.high for one in shown],
            color=look["color"],
            alpha=0.18,
            lw=0,
        )
        axes.plot(
            along,
            [one.mean for one in shown],
            lw=1.8,
            ls=DASHES[number % len(DASHES)],
            label=name,
            **look,
        )
    else:
        axes.errorbar(
            along,
            [one.mean for one in shown],
            _halves(shown),
            ls="",
            capsize=5,
            lw=1.4,
            label=name,
            **look,
        )
    for place, one, row in zip(places, figures, line.rows, strict=True):
        if row.standing == "best" and one is not None:
            axes.plot(
                [place],
                [one.mean],
                marker="o",
                ms=14,
                mfc="none",
                mec=INK,
                mew=1.5,
                ls="",
                zorder=4,
                label=None if "best" in axes.get_legend_handles_labels()[1] else "best",
            )
            axes.annotate(
                interval_words(one),
                (place, one.mean),
                xytext=(10, -16),
                textcoords="offset points",
                fontsize=9,
                color=INK,
            )


def _places(content: Content, line: Curve, number: int) -> list[float]:
    aside = 0.0 if content.is_numeric else DODGE * (number - (len(content.lines) - 1) / 2)
    return [content.place(row) + aside for row in line.rows]


def _halves(shown: Sequence[Interval]) -> list[list[float]]:
    return [[one.mean - one.low for one in shown], [one.high - one.mean for one in shown]]


def _style(axes: Axes) -> None:
    axes.patch.set_alpha(0.0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(QUIET)
    axes.grid(axis="y", color=QUIET, alpha=0.25, lw=0.6)
    axes.tick_params(colors=INK, labelcolor=INK, color=QUIET)
    axes.yaxis.label.set_color(INK)


def _draw_axis(axes: Axes, content: Content) -> None:
    axes.set_xlabel(axis_words(content.key), color=INK)
    if not content.is_numeric:
        axes.set_xticks(
            range(len(content.values)),
            [
                value_words(value, content.key).replace("-", "-\n").replace(".", ".\n")
                for value in content.values
            ],
        )
        axes.set_xlim(-0.5, max(0.5, len(content.values) - 0.5))
    elif len(content.values) <= MOST_TICKS:
        axes.set_xticks(content.values, [value_words(value) for value in content.values])
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def save_futures(
    path: Path,
    rates: Mapping[float, Sequence[float]],
    shares: Mapping[float, float],
    decided: float | None,
) -> None:
    """Draw the futures of moments, min: their bins an hour, the share that end well, the last good moment. Raises as `save` does."""
    drawing = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    top, beneath = drawing.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for at, some in rates.items():
        top.plot([at] * len(some), some, ls="", marker="o", ms=4, color=COLOURS[0], alpha=0.6)
    top.set_ylabel("bins an hour")
    beneath.plot(
        [*shares], [100.0 * share for share in shares.values()], color=COLOURS[1], marker="o", ms=4
    )
    beneath.set_ylim(-5.0, 105.0)
    beneath.set_ylabel("end well, %")
    beneath.set_xlabel("the moment from which they begin, min", color=INK)
    for axes in (top, beneath):
        _style(axes)
        if decided is not None:
            axes.axvline(decided, color=INK, lw=1, ls="--")
    _save(drawing, path)


# -- files


def save(result: StudyResult, path: Path) -> None:
    """Write the picture, on white, in the format of its name, such as .svg or .png. Raises ValueError for another one, or OSError."""
    _save(figure(result), path)


def _save(drawing: Figure, path: Path) -> None:
    if (
        kind := path.suffix.removeprefix(".").lower()
    ) not in drawing.canvas.get_supported_filetypes():
        raise ValueError(f"{path}: a picture's name ends in .svg or .png")
    drawing.patch.set(alpha=1.0, facecolor="white")
    path.write_bytes(_written(drawing, kind))


def inline_svg(result: StudyResult) -> str:
    """Return the picture as an element of a page, in the colour of the page's words; it says what it shows."""
    svg = re.sub(
        r"<metadata>.*?</metadata>", "", _written(figure(result), "svg").decode(), flags=re.DOTALL
    )
    svg = re.sub(
        r' width="[\d.]+pt" height="[\d.]+pt"', ' role="img"', svg[svg.index("<svg") :], count=1
    )
    title = "Bins an hour of each setting" + (
        ", and what a bin costs" if any(row.cost_per_bin for row in result.table) else ""
    )
    return (
        svg.replace(">", f' aria-label="{title}">', 1)
        .replace(INK, "currentColor")
        .replace(QUIET, "#7d8778")
    )


def _written(drawing: Figure, kind: str) -> bytes:
    """A picture as the bytes of a file, the same each time: SVG with its words as text, without a date."""
    with (
        DRAWING,
        matplotlib.rc_context(
            {"svg.fonttype": "none", "svg.hashsalt": "orchard", "font.sans-serif": FONTS}
        ),
    ):
        file = io.BytesIO()
        drawing.savefig(
            file, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None
        )
    return file.getvalue()
