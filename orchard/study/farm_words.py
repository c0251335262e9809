"""A farm in words: the answer, and the table for a terminal and for pages."""

from dataclasses import replace

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from orchard.study.answer_words import failed_words
from orchard.study.farm import FarmResult, FarmRow
from orchard.study.plus_minus import plus_minus_words
from orchard.study.settings import CARRIERS
from orchard.study.table import MARKS, STYLES
from orchard.study.words import counted, interval_words, key_words, setting_words, value_words


def answer(result: FarmResult) -> str:
    """Return the answer in words: the best setting, its time and its rate."""
    best = result.best_row
    count = len(result.blocks)
    if not result.table:
        return _sentence("No setting has been run in every block yet", failed_words(result.failed))
    if best is None:
        jams = f"Each setting jams in one of the {count} blocks"
        return _sentence(jams, failed_words(result.failed))
    names = ", ".join(result.blocks)
    words = (
        f"{setting_words(best.setting)}: {_hours(best)} h for {count} blocks ({names}) with"
        f" {counted('transfers', count - 1)} of {result.transfer_minutes:g} min,"
        f" {interval_words(best.bins_per_hour)} bins an hour"
    )
    within = f"{100.0 * result.within:g} %"
    unknown = result.settings_that_are("unknown")
    if unknown:
        others = "; ".join(map(setting_words, unknown))
        words += f"; more runs may tell whether within {within} of the shortest are: {others}"
    elif result.settings_that_are("equal") and best.setting.keys() == {CARRIERS}:
        words += f"; more carriers gain less than {within}"
    return _sentence(words, failed_words(result.failed))


def _sentence(*parts: str) -> str:
    """Return a sentence of these parts, but for those that are empty."""
    return f"{'; '.join(filter(None, parts))}."


def _hours(row: FarmRow) -> str:
    """Return the time of the farm in hours."""
    seconds = row.seconds
    assert seconds is not None
    hours = replace(
        seconds,
        mean=seconds.mean / 3600.0,
        low=seconds.low / 3600.0,
        high=seconds.high / 3600.0,
    )
    return interval_words(hours)


def heads_and_lines(result: FarmResult) -> tuple[list[str], list[list[str]]]:
    """Return the names of the columns, and the cells of each line."""
    keys = list(result.varied)
    heads = [*map(key_words, keys), *result.blocks, "farm, s", "bins/h"]
    lines = []
    for row in result.table:
        cells = [value_words(row.setting[key], key) for key in keys]
        if cells:
            cells[0] = f"{cells[0]} {MARKS[row.standing]}".rstrip()
        for seconds in (*row.blocks.values(), row.seconds):
            cells.append(interval_words(seconds, sign=" ±") or "jammed")
        cells.append(interval_words(row.bins_per_hour, sign=" ±") or "-")
        lines.append(cells)
    return heads, lines


def legend(result: FarmResult) -> str:
    """Return what the marks and figures of the table mean."""
    most = max(max(row.replications.values()) for row in result.table)
    return (
        f"* the answer; = within {100.0 * result.within:g} % of the shortest; ? the runs do not"
        f" tell. Harvests in s, up to {most} runs in each block;"
        f" {plus_minus_words(result.confidence, most, result.do_robots_fail)}."
    )


def as_table(result: FarmResult) -> Table:
    """Return the table of a farm for a terminal."""
    heads, lines = heads_and_lines(result)
    caption = legend(result)
    table = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left"
    )
    for head in heads:
        table.add_column(escape(head), overflow="fold")
    for row, cells in zip(result.table, lines, strict=True):
        table.add_row(*map(escape, cells), style=STYLES.get(row.standing, ""))
    return table
