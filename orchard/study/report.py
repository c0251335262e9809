"""The report of a study: one HTML file that holds all of it, for a reader without anything else."""

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
    return page(
        answer=result.answer,
        picture=Markup(inline_svg(result)),  # matplotlib has escaped its words
        of_table="Settings",
        heads=heads,
        lines=lines,
        best=[number for number, row in enumerate(result.table) if row.standing == "best"],
        legend=legend(result),
        payments=payment_lines(result.best_row) if result.best_row is not None else [],
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
    varied = {
        f"{key_words(key)} tried": ", ".join(value_words(value, key) for value in values)
        for key, values in result.varied.items()
    }
    runs = sum(
        row.replications + (row.check.replications if row.check else 0) for row in result.table
    )
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
    told = {
        key: ",".join(one if isinstance(one, str) else json.dumps(one) for one in values)
        for key, values in result.varied.items()
    }
    varied = [f"--vary {shlex.quote(f'{key}={values}')}" for key, values in told.items()]
    options = [
        f"--goal {result.goal}",
        f"--horizon {result.horizon}",
        f"--confidence {result.confidence}",
        f"--within {result.within}",
    ]
    if result.deadline:
        options = [result.deadline_option, *options[2:]]
    models = (
        ["--model full"] if {row.model for row in result.table} == {"full"} else []
    )  # as it must be for agents of the user's own
    return " ".join(["orchard study scenario.yaml", *varied, *options, *models])
