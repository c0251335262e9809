"""The table of a study: for the terminal, for pages as words, and as CSV with every figure."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from orchard.field.scenario.sections import SPREADS
from orchard.report.costs import PAYMENTS
from orchard.study.plus_minus import do_robots_fail, plus_minus_words
from orchard.study.result import Interval, Model, Row, Standing, StudyResult
from orchard.study.words import (
    counted,
    interval_words,
    key_words,
    number_words,
    setting_words,
    value_words,
)

# In place of a figure that is not known.
NONE = "-"
# Standing -> the mark after the first cell of its row.
MARKS: dict[Standing, str] = {
    "best": "*",
    "equal": "=",
    "unknown": "?",
    "worse": "",
    "alone": "",
    "jammed": "",
}
# Standing -> the style of its row in a terminal.
STYLES: dict[Standing, str] = {"best": "bold"}
# Sentences of the legend, with places for texts: see `legend`.
LEGEND_OF_MARKS = (
    "* the {answer}; = within {within:g} % of the best, for certain; ? the runs do not tell."
)
LEGEND_OF_RUNS = "{runs} of each by the {model}, on the same seeds; {plus_minus}."
LEGEND_OF_BEHIND = "behind: how far behind the best mean{given}, which has -."
LEGEND_OF_DEADLINE = (
    "* the answer; ? not decided; in time: harvests that were done {deadline}, of those that were "
    "run by the {model}, on the same seeds; {plus_minus}."
)
LEGEND_OF_COLUMNS = (
    "wait: of a picker that stands at its row's end, for an empty bin. "
    "busy: carriers outside the queue. bound: the limit without traffic, and what sets it."
)
LEGEND_OF_RATES = "bins/h: as if each row took its mean time, as in the bound."
LEGEND_OF_ENDS = "ends: a harvest of the mean time, by the shift."
LEGEND_OF_OPTIMUM = (
    "optimum: the proven shortest harvest without traffic, and by how much this one is longer."
)
LEGEND_OF_CHECK = "checked: by the simulator."
MODELS: dict[Model, str] = {"fast": "fast model", "full": "simulator"}
# Columns that are left out if they have nothing in any row.
ONLY_IF_KNOWN = ("harvest, s", "ends", "in time", "a bin", "optimum, s", "checked")
# Columns that are known of a setting of which all runs jammed.
KNOWN_OF_JAMMED = ("bins/h", "bound", "limit", "checked")
# Columns in which cells wrap where the terminal is narrow.
WRAPPED = ("bins/h", "harvest, s", "ends", "a bin", "behind, %", "bound", "optimum, s", "checked")


# -- the cells of a row: words, "" if there is no figure


def _harvest(row: Row) -> str:
    """Return the length of the harvest, s."""
    return _interval(row.harvest_seconds)


def _ends(row: Row) -> str:
    """Return on which day a harvest ends, and when; '' if there are no days."""
    return row.ends or ""


def _rate(row: Row) -> str:
    """Return the bins an hour; "jammed" if all runs jammed."""
    return _interval(row.bins_per_hour) or "jammed"


def _cost(row: Row) -> str:
    """Return what a bin costs."""
    return _interval(row.cost_per_bin)


def _waiting(row: Row) -> str:
    """Return how long a picker waits, s."""
    return f"{row.picker_waiting_seconds:.0f}"


def _busy(row: Row) -> str:
    """Return which share of the time carriers are busy."""
    return f"{100.0 * row.carrier_utilisation:.0f} %"


def _bound(row: Row) -> str:
    """Return the limit without traffic, and which share of it the setting reaches."""
    return number_words(row.bound_bins_per_hour) + _share_of_bound(row)


def _limit(row: Row) -> str:
    """Return which part sets the limit."""
    return row.bottleneck


def _behind(row: Row) -> str:
    """Return how far behind the best mean a setting is, %, to a tenth; "" for the best one."""
    if row.behind is None:
        return ""
    figure = f"{100.0 * row.behind:.1f}"
    if row.lead is None:
        return figure
    return f"{figure} ±{100.0 * (row.lead.high - row.lead.mean):.1f}"


def _in_time(row: Row) -> str:
    """Return how many harvests were done by the deadline; '' if there is none."""
    if row.in_time is None:
        return ""
    return f"{row.in_time} of {row.replications}"


def _interval(interval: Interval | None) -> str:
    """Return an interval as '84.1 ±0.6', narrower than in a sentence; '' for None."""
    return interval_words(interval, sign=" ±")


def _share_of_bound(row: Row) -> str:
    """Return which share of its bound a setting reaches; "" if all of its runs jammed."""
    share = _share(row)
    if share is None:
        return ""
    return f" ({100.0 * share:.0f}%)"


def _share(row: Row) -> float | None:
    """Return the rate as a share of the bound; None if all runs jammed."""
    if row.bins_per_hour is None:
        return None
    return row.bins_per_hour.mean / row.bound_bins_per_hour


def _proven(row: Row) -> str:
    """Return the shortest harvest that is proven, s, and how far above it this one is."""
    if row.proven_seconds is None or row.harvest_seconds is None:
        return ""
    excess = row.harvest_seconds.mean / row.proven_seconds - 1.0
    return f"{number_words(row.proven_seconds)} (+{100.0 * excess:.0f}%)"


def _checked(row: Row) -> str:
    """Return the rate in the simulator, and by how much it differs from the fast model's."""
    check = row.check
    if check is None:
        return ""
    if check.jammed == check.replications:
        return "jammed"
    # Adding 0.0 makes 0.0 of -0.0.
    percent = round(100.0 * check.difference, 1) + 0.0
    return f"{_interval(check.bins_per_hour)} {percent:+.1f} %"


# Head of a column -> its cells; '' if there is no figure.
COLUMNS: dict[str, Callable[[Row], str]] = {
    "bins/h": _rate,
    "harvest, s": _harvest,
    "ends": _ends,
    "in time": _in_time,
    "a bin": _cost,
    "behind, %": _behind,
    "wait, s": _waiting,
    "busy": _busy,
    "bound": _bound,
    "limit": _limit,
    "optimum, s": _proven,
    "checked": _checked,
}


# -- the table, and what its marks mean


def heads_and_lines(result: StudyResult) -> tuple[list[str], list[list[str]]]:
    """Return the heads of the columns, and the lines. `legend` explains their marks."""
    # Head -> the cells of all rows.
    columns: dict[str, list[str]] = {}
    for key in result.compared:
        columns[key_words(key)] = [value_words(row.setting[key], key) for row in result.table]
    unasked = _unasked(result)
    for head in COLUMNS:
        cells = [_cell(head, row) for row in result.table]
        has_content = head not in ONLY_IF_KNOWN or set(cells) != {NONE}
        if head not in unasked and has_content:
            columns[head] = cells
    lines = []
    for row, cells_of_row in zip(result.table, zip(*columns.values(), strict=True), strict=True):
        first, *others = cells_of_row
        lines.append([f"{first} {MARKS[row.standing]}".rstrip(), *others])
    return list(columns), lines


def _cell(head: str, row: Row) -> str:
    """Return the cell of a row in a column."""
    has_jammed = row.bins_per_hour is None
    if has_jammed and head not in KNOWN_OF_JAMMED:
        return NONE
    return COLUMNS[head](row) or NONE


def legend(result: StudyResult) -> str:
    """Return what the marks, the intervals and the columns mean."""
    texts = {
        "within": 100.0 * result.within,
        "deadline": result.deadline,
        "answer": "answer",
        "given": "",
        **_run_texts(result),
    }
    given = " and ".join(map(key_words, result.given))
    if given:
        texts["answer"] = f"best for each {given}"
        texts["given"] = f" for the same {given}"
    return " ".join(_legend_sentences(result)).format(**texts)


def _run_texts(result: StudyResult) -> dict[str, str]:
    """Return how many runs of a setting there are at most, by which model, and how sure they are,
    in words.
    """
    most = max((row.replications for row in result.table), default=0)
    model: Model = "fast"
    if result.table:
        model = result.table[0].model
    harvests = most
    if result.horizon == "long":
        harvests = 0
    may_fail = do_robots_fail(result.scenario, result.varied)
    return {
        "runs": counted("runs", most),
        "model": MODELS[model],
        "plus_minus": plus_minus_words(result.confidence, harvests, may_fail),
    }


def _legend_sentences(result: StudyResult) -> list[str]:
    """Return the sentences of the legend, in which texts are to be filled in."""
    sentences = [LEGEND_OF_RUNS]
    if result.deadline:
        sentences = [LEGEND_OF_DEADLINE]
    elif _has_choices(result):
        sentences = [LEGEND_OF_MARKS, LEGEND_OF_RUNS, LEGEND_OF_BEHIND]
    sentences.append(LEGEND_OF_COLUMNS)
    if _are_speeds_drawn(result):
        sentences.append(LEGEND_OF_RATES)
    if any(row.ends for row in result.table):
        sentences.append(LEGEND_OF_ENDS)
    if any(row.proven_seconds for row in result.table):
        sentences.append(LEGEND_OF_OPTIMUM)
    if any(row.check for row in result.table):
        sentences.append(LEGEND_OF_CHECK)
    return sentences


def as_table(result: StudyResult) -> Table:
    """Return the table for a terminal of 80 characters and more.

    Some cells wrap where the terminal is narrow.
    """
    heads, lines = heads_and_lines(result)
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
        table.add_row(*map(escape, line), style=STYLES.get(row.standing, ""))
    return table


def _are_speeds_drawn(result: StudyResult) -> bool:
    """Whether the seed draws in some settings how fast rows, pickers or bins are."""
    picking = result.scenario.get("picking", {})
    distributions = set[str]()
    for name in SPREADS:
        distributions.add(picking.get(name, {}).get("distribution", "none"))
        distributions.update(result.varied.get(f"picking.{name}.distribution", []))
    return distributions != {"none"}


def _has_choices(result: StudyResult) -> bool:
    """Whether the settings are compared, and not only shown beside each other."""
    return all(row.standing != "alone" for row in result.table)


def _unasked(result: StudyResult) -> list[str]:
    """Return the heads of columns to leave out: the length of a harvest if the goal is the rate,
    which says the same, and `behind` where no settings are compared.
    """
    unasked = []
    if result.goal == "bins_per_hour" and not result.deadline:
        unasked.append("harvest, s")
    is_compared = len(result.table) > 1 and _has_choices(result)
    if result.deadline or not is_compared:
        unasked.append("behind, %")
    return unasked


# -- payments: what the cost of a bin consists of


def payment_lines(row: Row) -> list[tuple[str, str, str]]:
    """Return for each payment its words, its mean amount for a bin, and its share of all."""
    whole = sum(row.paid.values())
    lines = []
    for purpose, amount in row.paid.items():
        share = NONE
        if whole:
            share = f"{100.0 * amount / whole:.0f} %"
        lines.append((PAYMENTS[purpose], number_words(amount), share))
    return lines


def payments_table(row: Row) -> Table:
    """Return the table of the payments for a bin with a setting, for a terminal."""
    table = Table(box=SIMPLE_HEAD, padding=0, show_edge=False)
    table.add_column(f"paid with {setting_words(row.setting)}", overflow="fold")
    table.add_column("a bin", justify="right")
    table.add_column("share", justify="right")
    for cells in payment_lines(row):
        table.add_row(*map(escape, cells))
    return table


# -- CSV


def save_csv(result: StudyResult, path: Path) -> None:
    """Write every figure as CSV. Raises OSError.

    Each setting is a line, and each figure a column with its name in the study's JSON.
    """
    lines = []
    # The keys are the columns, in the order in which the lines bring them.
    columns: dict[str, None] = {}
    for row in result.table:
        line = dict(_flat(_figures(row)))
        lines.append(line)
        columns |= dict.fromkeys(line)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns))
        writer.writeheader()
        writer.writerows(lines)


def _figures(row: Row) -> dict[str, Any]:
    """Return the figures of a row: name -> figure. Each value of the setting is a figure too.

    The key `setting` itself is None, which `_flat` leaves out.
    """
    return row.setting | asdict(row) | {"share_of_bound": _share(row), "setting": None}


def _flat(figures: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the column and the value of each figure that is not None.

    A figure with parts has a column for each: `bins_per_hour_mean` has the mean of `bins_per_hour`.
    `before`: the names that lead there, as "bins_per_hour_".
    """
    for name, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}_")
        elif value is not None:
            yield before + name, value
