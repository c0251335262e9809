"""The table of a sensitivity as CSV, and all of it as a report."""

import csv
from dataclasses import asdict
from pathlib import Path
from typing import Any

from markupsafe import Markup

from orchard.field.scenario import check, to_yaml
from orchard.report.summary import clock
from orchard.study.picture import inline_drawing
from orchard.study.report import ENDS, HORIZONS, page
from orchard.study.result import Interval
from orchard.study.sensitivity.picture import figure
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.words import HEADS, LUCK, UNFITTED, legend, rows_of
from orchard.study.words import GOALS

TITLE = "How far each value moves the result, and its share of all variance"
# `orchard.study.kinds_of_files.TABLE` recognises a table by the first of them.
COLUMNS = (
    "moved",
    "low",
    "high",
    "at_low",
    "at_high",
    "first_order_mean",
    "first_order_low",
    "first_order_high",
    "total_mean",
    "total_low",
    "total_high",
)


def save_csv(result: SensitivityResult, path: Path) -> None:
    """Write every effect as a line, and then the luck of the seed and what the fit does not tell.

    Raises OSError.
    """
    lines = []
    for effect in result.effects:
        line: dict[str, Any] = {"moved": effect.key, "low": effect.low, "high": effect.high}
        line |= {"at_low": effect.at_low, "at_high": effect.at_high}
        line |= _columns("first_order", effect.first_order) | _columns("total", effect.total)
        lines.append(line)
    for name, share in ((LUCK, result.luck), (UNFITTED, result.unfitted)):
        lines.append({"moved": name} | _columns("first_order", share) | _columns("total", share))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(lines)


def _columns(name: str, share: Interval) -> dict[str, float]:
    """Return a share and its interval: column -> value."""
    return {f"{name}_{end}": value for end, value in asdict(share).items()}


def save_report(result: SensitivityResult, path: Path) -> None:
    """Write the report as one HTML file. Raises OSError."""
    path.write_text(document(result), encoding="utf-8")


def document(result: SensitivityResult) -> str:
    """Return the report: answer, tornado, table, how it was made, and the scenario."""
    return page(
        answer=result.answer,
        # Matplotlib has escaped its words.
        picture=Markup(inline_drawing(figure(result), TITLE)),
        of_table="What is moved",
        heads=HEADS,
        lines=rows_of(result),
        best=[],
        legend=legend(result),
        payments=[],
        made={
            "goal": GOALS[result.goal],
            "horizon": HORIZONS[result.horizon],
            "confidence": f"{100.0 * result.confidence:g} %",
            "runs": f"{result.runs:,} in {clock(result.wall_seconds)}",
            "ended because": ENDS[result.stopped_by],
            "version": result.version,
        },
        notes=result.notes,
        scenario=to_yaml(check(result.scenario)),
    )
