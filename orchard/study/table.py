"""The table of a study: for the terminal, for pages as words, and as CSV with every figure."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from orchard.study.result import Check, Interval, Model, Row, Standing, StudyResult
from orchard.study.words import interval_words, key_words, number_words, value_words

NONE = "-"  # in place of a figure that there is not
COLUMNS: dict[str, Callable[[Row], str]] = {
    "bins/h": lambda row: _interval(row.bins_per_hour) or "jammed",
    "harvest, s": lambda row: _interval(row.harvest_seconds),
    "a bin": lambda row: _interval(row.cost_per_bin),
    "behind, %": lambda row: _behind(row),
    "wait, s": lambda row: f"{row.picker_waiting_seconds:.0f}",
    "busy": lambda row: f"{100.0 * row.carrier_utilisation:.0f} %",
    "bound": lambda row: number_words(row.bound_bins_per_hour) + _share_of_bound(row),
    "limit": lambda row: row.bottleneck,
    "optimum, s": lambda row: _optimum(row),
    "checked": lambda row: _check(row.check),
}
MARKS: dict[Standing, str] = {
    "best": "*",
    "equal": "=",
    "unknown": "?",
    "worse": "",
    "alone": "",
    "jammed": "",
}
OF_MARKS = (
    "* the {answer}; = within {within:g} % of the best, for certain; ? the runs do not tell. "
)
OF_RUNS = (
    "{runs} of each by the {model}, on the same seeds; ± interval of {confidence:g} % confidence. "
)
OF_BEHIND = "behind: the best mean{given}, which has -. "
OF_COLUMNS = (
    "wait: of a picker that stands at its row's end, for an empty bin. "
    "busy: carriers outside the queue. bound: the limit without traffic, and what sets it."
)
OPTIMUM = " optimum: no harvest without traffic is shorter, which is proven; and how far above it this one is."
CHECKED = " checked: by the simulator."
MODELS: dict[Model, str] = {"fast": "fast model", "full": "simulator"}
ONLY_IF_KNOWN = (
    "harvest, s",
    "a bin",
    "optimum, s",
    "checked",
)  # columns that are left out if they have nothing in any row
OF_JAMMED = ("bins/h", "bound", "limit", "checked")  # known if runs jammed
WRAPPED = (
    "bins/h",
    "harvest, s",
    "a bin",
    "behind, %",
    "bound",
    "optimum, s",
    "checked",
)  # where the terminal is narrow


def words(result: StudyResult) -> tuple[list[str], list[list[str]]]:
    """Return the heads of the columns, and the lines, with marks in the first cells. `legend` explains them."""
    known = {
        head: [_cell(head, row) for row in result.table]
        for head in COLUMNS
        if head not in _unasked(result)
    }
    shown = {
        head: cells
        for head, cells in known.items()
        if head not in ONLY_IF_KNOWN or set(cells) != {NONE}
    }
    columns = {
        key_words(key): [value_words(row.setting[key], key) for row in result.table]
        for key in result.compared
    } | shown
    lines = zip(*columns.values(), result.table, strict=True)
    return list(columns), [
        [f"{first} {MARKS[row.standing]}".rstrip(), *rest] for first, *rest, row in lines
    ]


def legend(result: StudyResult) -> str:
    """Return what the marks, the intervals and the columns mean."""
    count = max((row.replications for row in result.table), default=0)
    runs, model = (
        f"{count} run{'s' if count != 1 else ''}",
        MODELS[result.table[0].model if result.table else "fast"],
    )
    words = {
        "within": 100.0 * result.within,
        "confidence": 100.0 * result.confidence,
        "runs": runs,
        "model": model,
        "answer": f"best for each {_given(result)}" if result.given else "answer",
        "given": f" for the same {_given(result)}" if result.given else "",
    }
    parts = [
        OF_MARKS if _has_choices(result) else "",
        OF_RUNS,
        OF_BEHIND if _has_choices(result) else "",
        OF_COLUMNS,
        OPTIMUM if any(row.proven_seconds for row in result.table) else "",
        CHECKED if any(row.check for row in result.table) else "",
    ]
    return "".join(parts).format(**words)


def as_table(result: StudyResult) -> Table:
    """Return the table for a terminal of 80 characters and more; some cells wrap where it is narrow."""
    heads, lines = words(result)
    table = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=legend(result), caption_justify="left"
    )
    for head in heads:
        table.add_column(
            head.replace(", ", "\n"),
            no_wrap=head in COLUMNS and head not in WRAPPED,
            overflow="fold",
        )
    for line, row in zip(lines, result.table, strict=True):
        table.add_row(*map(escape, line), style="bold" if row.standing == "best" else "")
    return table


def _has_choices(result: StudyResult) -> bool:
    """Whether the settings are compared, and not only shown beside each other."""
    return all(row.standing != "alone" for row in result.table)


def _given(result: StudyResult) -> str:
    return " and ".join(map(key_words, result.given))


def _unasked(result: StudyResult) -> list[str]:
    """The columns that tell nothing new.

    They are a harvest's length if the goal is its rate, and how far behind a setting alone is.
    """
    length = ["harvest, s"] if result.goal == "bins_per_hour" else []
    is_compared = len(result.table) > 1 and _has_choices(result)
    return length if is_compared else [*length, "behind, %"]


def _cell(head: str, row: Row) -> str:
    return (
        NONE if row.bins_per_hour is None and head not in OF_JAMMED else COLUMNS[head](row) or NONE
    )


def _behind(row: Row) -> str:
    """How far behind the best mean a setting is, in percent, to a tenth; '' of the best mean."""
    if row.behind is None:
        return ""
    figure = f"{100.0 * row.behind:.1f}"
    if row.lead is None:
        return figure
    return f"{figure} ±{100.0 * (row.lead.high - row.lead.mean):.1f}"


def _interval(interval: Interval | None) -> str:
    return interval_words(interval, sign=" ±")


def _share_of_bound(row: Row) -> str:
    return (
        ""
        if row.bins_per_hour is None
        else f" ({100.0 * row.bins_per_hour.mean / row.bound_bins_per_hour:.0f}%)"
    )


def _optimum(row: Row) -> str:
    if row.proven_seconds is None or row.harvest_seconds is None:
        return ""
    return f"{number_words(row.proven_seconds)} (+{100.0 * (row.harvest_seconds.mean / row.proven_seconds - 1.0):.0f}%)"


def _check(check: Check | None) -> str:
    if check is None:
        return ""
    if check.jammed == check.replications:
        return "jammed"
    return f"{_interval(check.bins_per_hour)} {round(100.0 * check.difference, 1) + 0.0:+.1f} %"  # never -0.0


# -- CSV


def save_csv(result: StudyResult, path: Path) -> None:
    """Write every figure as CSV, a line for each setting, with its name in JSON. Raises OSError."""
    lines = [dict(_flat(_figures(row))) for row in result.table]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
        writer.writeheader()
        writer.writerows(lines)


def _figures(row: Row) -> dict[str, Any]:
    share = row.bins_per_hour and row.bins_per_hour.mean / row.bound_bins_per_hour
    return row.setting | asdict(row) | {"share_of_bound": share, "setting": None}


def _flat(figures: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """What is known of figures, by column: the mean in `bins_per_hour` is in `bins_per_hour_mean`."""
    for name, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}_")
        elif value is not None:
            yield before + name, value
