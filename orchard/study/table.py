"""The table of a study: for the terminal, for pages as words, and as CSV with every figure."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from orchard.study.result import Check, Interval, Row, StudyResult
from orchard.study.words import interval_words, key_words, number_words, value_words

NONE = "-"  # in place of a figure that there is not
COLUMNS: dict[str, Callable[[Row], str]] = {
    "bins/h": lambda row: _interval(row.bins_per_hour) or "jammed",
    "harvest, s": lambda row: _interval(row.harvest_seconds),
    "a bin": lambda row: _interval(row.cost_per_bin),
    "wait, s": lambda row: f"{row.picker_waiting_seconds:.0f}",
    "busy": lambda row: f"{100.0 * row.carrier_utilisation:.0f} %",
    "bound": lambda row: number_words(row.bound_bins_per_hour) + _share_of_bound(row),
    "limit": lambda row: row.bottleneck,
    "lost to, s": lambda row: _largest_loss(row.lost_seconds),
    "runs": lambda row: f"{row.replications}" + (f", {row.jammed} jammed" if row.jammed and row.bins_per_hour else ""),
    "model": lambda row: row.model,
    "checked": lambda row: _check(row.check),
}
MEANING = (
    "* best; = cannot be told apart from it; ± interval of {confidence:g} % confidence; wait: of a picker for an empty bin; "
    "busy: carriers outside the queue; bound: the limit without traffic, bins/h, and what sets it; lost: the largest part; "
    "runs: by the {models} model; checked: bins/h by the simulator, and the difference"
)
ONLY_IF_KNOWN = ("a bin", "checked", "lost to, s")  # columns that are left out if they have nothing in any row
OF_ALL_JAMMED = ("bins/h", "bound", "limit", "runs", "model", "checked")  # known if all runs jammed
WRAPPED = ("bins/h", "harvest, s", "a bin", "bound", "lost to, s", "runs", "checked")  # where the terminal is narrow
LOSSES = ("structure", "traffic", "dispatch", "people_and_animals")  # in `lost_seconds`; `limit` is the rest


def words(result: StudyResult) -> tuple[list[str], list[list[str]]]:
    """Return the heads of the columns, and the lines, with marks in the first cells. `legend` explains them."""
    known = {head: [_cell(head, row) for row in result.table] for head in COLUMNS if head not in _unasked(result)}
    shown = {head: cells for head, cells in known.items() if head not in ONLY_IF_KNOWN or set(cells) != {NONE}}
    columns = {key_words(key): [value_words(row.setting[key]) for row in result.table] for key in result.varied} | shown
    lines = zip(*columns.values(), result.table, strict=True)
    return list(columns), [[f"{first} {_mark(row, result)}".rstrip(), *rest] for first, *rest, row in lines]


def legend(result: StudyResult) -> str:
    """Return what the marks, the intervals and the columns mean."""
    return MEANING.format(confidence=100.0 * result.confidence, models=" and the ".join(_models(result)))


def as_table(result: StudyResult) -> Table:
    """Return the table for a terminal of 80 characters and more; some cells wrap where it is narrow."""
    heads, lines = words(result)
    table = Table(box=SIMPLE_HEAD, padding=0, show_edge=False, caption=legend(result), caption_justify="left")
    for head in heads:
        table.add_column(head.replace(", ", "\n"), no_wrap=head in COLUMNS and head not in WRAPPED, overflow="fold")
    for line, row in zip(lines, result.table, strict=True):
        table.add_row(*map(escape, line), style="bold" if row.setting == result.best else "")
    return table


def _mark(row: Row, result: StudyResult) -> str:
    return "*" if row.setting == result.best else "=" if row.setting in result.indistinguishable else ""


def _models(result: StudyResult) -> list[str]:
    return sorted({row.model for row in result.table})


def _unasked(result: StudyResult) -> list[str]:
    """The columns that tell nothing new: a harvest's length, unless it is the goal, and a model that is one for all."""
    length = [] if result.goal == "harvest_seconds" else ["harvest, s"]
    return length if len(_models(result)) > 1 else [*length, "model"]


def _cell(head: str, row: Row) -> str:
    return NONE if row.bins_per_hour is None and head not in OF_ALL_JAMMED else COLUMNS[head](row) or NONE


def _interval(interval: Interval | None) -> str:
    return interval_words(interval, sign=" ±")


def _share_of_bound(row: Row) -> str:
    return "" if row.bins_per_hour is None else f" ({100.0 * row.bins_per_hour.mean / row.bound_bins_per_hour:.0f}%)"


def _largest_loss(lost: dict[str, float]) -> str:
    parts = {name: seconds for name, seconds in lost.items() if name in LOSSES and seconds > 0.0}
    largest = max(parts, key=lambda name: parts[name], default="")
    return f"{largest.partition('_')[0]} {parts[largest]:,.0f}" if largest else ""


def _check(check: Check | None) -> str:
    if check is None:
        return ""
    if check.jammed == check.replications:
        return "jammed"
    return f"{_interval(check.bins_per_hour)} {100.0 * check.difference:+.1f} %"


# -- CSV


def save_csv(result: StudyResult, path: Path) -> None:
    """Write every figure as CSV, a line for each setting, with its name in JSON. Raises OSError."""
    lines = [dict(_flat(_figures(row, result))) for row in result.table]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
        writer.writeheader()
        writer.writerows(lines)


def _figures(row: Row, result: StudyResult) -> dict[str, Any]:
    compared = next((asdict(one) for one in result.comparisons if one.setting == row.setting), {})
    ranked: dict[str, Any] = {"is_best": row.setting == result.best, "is_indistinguishable": row.setting in result.indistinguishable}
    ranked["share_of_bound"] = row.bins_per_hour and row.bins_per_hour.mean / row.bound_bins_per_hour
    return row.setting | asdict(row) | ranked | compared | {"setting": None}


def _flat(figures: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """What is known of figures, by column: the mean in `bins_per_hour` is in `bins_per_hour_mean`."""
    for name, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}_")
        elif value is not None:
            yield before + name, value
