"""The report of a study: one HTML file that holds everything, to be sent to somebody else.

The template is report.html in this folder.
"""

import json
import shlex
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from orchard.field.scenario import check, to_yaml
from orchard.report.summary import clock
from orchard.study.picture import inline_svg
from orchard.study.result import StudyResult
from orchard.study.table import heads_and_lines, legend, payment_lines
from orchard.study.words import GOALS, key_words, value_words

HORIZONS = {
    "harvest": "one harvest, with its beginning and its end",
    "long": "a long harvest, without its beginning and its end",
}
ENDS = {
    "certain": "the answer was certain",
    "budget": "the time that it was given was used",
    "stopped": "it was stopped",
    "seeds": "the most replications were made",
}


def save(result: StudyResult, path: Path) -> None:
    """Write the report as one HTML file. Raises OSError."""
    path.write_text(document(result), encoding="utf-8")


def document(result: StudyResult) -> str:
    """Return the report: answer, picture, table, how it was made, and the scenario.

    All words are escaped.
    """
    heads, lines = heads_and_lines(result)
    payments = []
    if result.best_row is not None:
        payments = payment_lines(result.best_row)
    return page(
        answer=result.answer,
        # Matplotlib has escaped its words.
        picture=Markup(inline_svg(result)),
        of_table="Settings",
        heads=heads,
        lines=lines,
        best=[number for number, row in enumerate(result.table) if row.standing == "best"],
        legend=legend(result),
        payments=payments,
        made=_made(result),
        notes=result.notes,
        scenario=to_yaml(check(result.scenario)),
    )


def page(**parts: Any) -> str:
    """Return a report of these parts, which report.html names. All words are escaped."""
    environment = Environment(
        loader=PackageLoader("orchard.study", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template("report.html").render(**parts)


def _made(result: StudyResult) -> dict[str, Any]:
    """Return how the study was made: label -> words."""
    varied = {}
    for key, values in result.varied.items():
        varied[f"{key_words(key)} tried"] = ", ".join(value_words(value, key) for value in values)
    runs = 0
    for row in result.table:
        runs += row.replications
        if row.check is not None:
            runs += row.check.replications
    return varied | {
        "goal": GOALS[result.goal],
        "horizon": HORIZONS[result.horizon],
        "confidence": f"{100.0 * result.confidence:g} %",
        "runs": f"{runs:,} in {clock(result.wall_seconds)}",
        "ended because": ENDS[result.stopped_by],
        "again": command(result),
        "version": result.version,
    }


def command(result: StudyResult) -> str:
    """Return the command that does the study again, for the scenario in a file of this name."""
    parts = ["orchard study scenario.yaml"]
    for key, values in result.varied.items():
        listed = ",".join(map(_typed, values))
        parts.append(f"--vary {shlex.quote(f'{key}={listed}')}")
    if result.deadline:
        parts.append(result.deadline_option)
    else:
        parts += [f"--goal {result.goal}", f"--horizon {result.horizon}"]
    parts += [f"--confidence {result.confidence}", f"--within {result.within}"]
    # Agents of the user's own need the full model.
    if {row.model for row in result.table} == {"full"}:
        parts.append("--model full")
    return " ".join(parts)


def _typed(value: Any) -> str:
    """Return a value as a user types it behind `--vary`."""
    if isinstance(value, str):
        return value
    return json.dumps(value)
