"""The picture of a sensitivity: how far each value moves the result, and its share of all variance.

The bars are a tornado: from the mean result at the low end of a value to that at the high end, the
greatest effect on top. Beside them stand the effects with their intervals.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from orchard.study.picture import (
    COLOURS,
    INK,
    QUIET,
    WIDTH,
    half_widths,
    means_of,
    style_axes,
    write_drawing,
)
from orchard.study.result import Interval
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.words import LUCK, UNFITTED, value_name
from orchard.study.words import UNITS

# Height of a value's bar, and of all else, inches.
HEIGHT_OF_BAR = 0.42
HEIGHT_OF_REST = 1.3
LOW_END = COLOURS[2]
HIGH_END = COLOURS[1]
# Distance of a value's name from the end of its bar, points.
ASIDE = 4.0
# How both kinds of effects are drawn. `aside`: how far from the middle of their bar, as a share of
# the distance between two bars; all else is as matplotlib takes it.
OF_TOTAL = {"aside": 0.12, "color": COLOURS[0], "marker": "o", "label": "in all"}
OF_FIRST_ORDER = {"aside": -0.12, "color": COLOURS[3], "marker": "s", "label": "by itself"}


def figure(result: SensitivityResult) -> Figure:
    """Return the picture of a sensitivity."""
    names = [value_name(effect.key) for effect in result.effects]
    names.append(LUCK)
    rest = [result.luck]
    if result.unfitted.mean:
        names.append(UNFITTED)
        rest.append(result.unfitted)
    count = len(names)
    height = HEIGHT_OF_BAR * count + HEIGHT_OF_REST
    drawing = Figure(figsize=(WIDTH, height), layout="constrained")
    moved, shares = drawing.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    _draw_tornado(moved, result)
    _draw_shares(shares, result, rest)
    for axes in (moved, shares):
        style_axes(axes)
        axes.grid(axis="x", color=QUIET, alpha=0.25, lw=0.6)
        axes.xaxis.label.set_color(INK)
    moved.set_yticks(range(count), names)
    moved.set_ylim(count - 0.5, -0.5)
    return drawing


def _draw_tornado(axes: Axes, result: SensitivityResult) -> None:
    """Draw a bar from the result at the low end of each value to that at the high end.

    Beside each end of a bar stands the value there. Where the ends are not known there is no bar.
    """
    for place, effect in enumerate(result.effects):
        if effect.at_low is None or effect.at_high is None:
            continue
        for at_end, colour in ((effect.at_low, LOW_END), (effect.at_high, HIGH_END)):
            width = at_end - result.mean
            axes.barh(place, width, left=result.mean, height=0.6, color=colour, alpha=0.85)
        ends = sorted([(effect.at_low, effect.low), (effect.at_high, effect.high)])
        _name_end(axes, place, ends[0], "right")
        _name_end(axes, place, ends[1], "left")
    axes.axvline(result.mean, color=INK, lw=1)
    axes.margins(x=0.18)
    unit = UNITS[result.goal]
    if result.effects[0].at_low is None:
        unit += " (the fit is too poor to tell the ends)"
    axes.set_xlabel(unit)


def _name_end(
    axes: Axes, place: int, end: tuple[float, float], aligned: Literal["left", "right"]
) -> None:
    """Write a value beside its end of a bar. `end`: the result there, and the value."""
    aside = -ASIDE
    if aligned == "left":
        aside = ASIDE
    axes.annotate(
        f"{end[1]:g}",
        (end[0], place),
        xytext=(aside, 0.0),
        textcoords="offset points",
        ha=aligned,
        va="center",
        fontsize=8,
        color=INK,
    )


def _draw_shares(axes: Axes, result: SensitivityResult, rest: Sequence[Interval]) -> None:
    """Draw the share of all variance that each value has: by itself, and in all.

    `rest`: the shares that come from no value, which are drawn below them.
    """
    effects = result.effects
    _draw_points(axes, [effect.total for effect in effects], OF_TOTAL)
    _draw_points(axes, [effect.first_order for effect in effects], OF_FIRST_ORDER)
    for place, share in enumerate(rest, start=len(effects)):
        bars = 100.0 * half_widths([share])
        axes.errorbar(
            [100.0 * share.mean], [place], xerr=bars, color=QUIET, ls="", marker="o", ms=5
        )
    axes.set_xlim(-3.0, 103.0)
    axes.set_xlabel("of what is unsure, %")
    axes.legend(frameon=False, fontsize=8, loc="lower right", labelcolor=INK)


def _draw_points(axes: Axes, shares: Sequence[Interval], look: Mapping[str, Any]) -> None:
    """Draw one kind of effect of all values, with its intervals.

    `look`: how far aside from its bar it is drawn, and its look as matplotlib takes it.
    """
    style = {"ls": "", "ms": 5, "capsize": 3, "lw": 1.2, **look}
    places = np.arange(len(shares)) + style.pop("aside")
    axes.errorbar(100.0 * means_of(shares), places, xerr=100.0 * half_widths(shares), **style)


def save(result: SensitivityResult, path: Path) -> None:
    """Write the picture, on white. Raises ValueError for another format, or OSError."""
    write_drawing(figure(result), path)
