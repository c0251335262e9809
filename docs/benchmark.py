"""The table and the picture of docs/benchmark.md: `orchard benchmark --summary docs/benchmark.json`
measures them, `make docs` writes them.
"""

import io
import json
import re
from pathlib import Path

import matplotlib
import msgspec
from matplotlib.figure import Figure

from orchard.study.benchmark.scores import BenchmarkResult

PAGE = Path(__file__).with_name("benchmark.md")
INK = "#24301f"
DOT = "#7ea3cf"
SPREAD = 0.6  # of the dots of a policy, as a share of its line
HEAD = "| policy | score, % | its worst orchard |\n|---|---|---|\n"


def result() -> BenchmarkResult:
    """Return what the command found."""
    return msgspec.convert(
        json.loads(PAGE.with_name("benchmark.json").read_text()), BenchmarkResult
    )


def document() -> str:
    """Return docs/benchmark.md with the lines of the table as they were measured."""
    lines = [_line(policy, score) for policy, score in result().scores.items()]
    return re.sub(
        rf"({re.escape(HEAD)})(\|.*\n)*", lambda found: found[1] + "".join(lines), PAGE.read_text()
    )


def _line(policy: str, score: float) -> str:
    worst = min(result().of(policy), key=lambda one: one.score)
    return f"| `{policy}` | {100.0 * score:.1f} | {worst.orchard}: {100.0 * worst.score:.1f} |\n"


def picture() -> str:
    """Return the picture as SVG: the score of each policy in each orchard, and its mean."""
    measured = result()
    drawing = Figure(figsize=(8.6, 3.6), layout="constrained")
    axes = drawing.subplots()
    policies = [*measured.scores]
    for place, policy in enumerate(policies):
        scores = sorted(100.0 * harvests.score for harvests in measured.of(policy))
        count = len(scores)
        heights = [place + SPREAD * (number / max(1, count - 1) - 0.5) for number in range(count)]
        axes.scatter(scores, heights, s=9.0, color=DOT, linewidths=0.0)
        error = 100.0 * measured.standard_error(policy)
        mean = 100.0 * measured.scores[policy]
        axes.errorbar(mean, place, xerr=error, fmt="|", color=INK, markersize=16.0, capsize=3.0)
    axes.set_yticks(range(len(policies)), policies)
    axes.invert_yaxis()
    axes.set_xlabel("score, %: proven time as a share of the harvest's; a dot is an orchard")
    axes.set_xlim(right=100.0)
    axes.spines[["top", "right"]].set_visible(False)
    written = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "benchmark", "svg.fonttype": "path"}):
        drawing.savefig(written, format="svg", metadata={"Date": None})
    return written.getvalue()
