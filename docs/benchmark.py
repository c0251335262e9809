"""The table and the pictures of docs/benchmark.md, which `make docs` writes.

`orchard benchmark --summary docs/benchmark.json` measures the scores, and
`python examples/learning_curves.py` how a policy learns.
"""

import json
import re
from pathlib import Path
from statistics import fmean

import msgspec
from matplotlib.figure import Figure

from docs.svg import svg_of
from orchard.study.benchmark.scores import BenchmarkResult

PAGE = Path(__file__).with_name("benchmark.md")
INK = "#24301f"
DOT = "#7ea3cf"
# The dots of a policy stand on so much of the height of its line, in the order of their scores, so
# that no dot hides another one.
SPREAD = 0.6
# Policies beside which the learned ones stand, and their colours.
BESIDE = {"rolling": "#24301f", "predictive": "#7a5b2e", "nearest": "#9aa08f"}
HEAD = "| policy | score, % | its worst orchard |\n|---|---|---|\n"


def result() -> BenchmarkResult:
    """Return what the command found."""
    return msgspec.convert(
        json.loads(PAGE.with_name("benchmark.json").read_text()), BenchmarkResult
    )


def document() -> str:
    """Return docs/benchmark.md with the lines of the table as they were measured."""
    lines = "".join(_line(policy, score) for policy, score in result().scores.items())
    # The head of the table, and the lines that follow it.
    table = rf"({re.escape(HEAD)})(\|.*\n)*"
    return re.sub(table, lambda match: match[1] + lines, PAGE.read_text())


def _line(policy: str, score: float) -> str:
    worst = min(result().of(policy), key=lambda harvests: harvests.score)
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
    return svg_of(drawing)


def learning_picture() -> str:
    """Return the picture of learning as SVG: the score in the orchards for the test, by seeds.

    A curve has points of minutes, decisions and score, as `examples/learning_curves.py` writes
    them.
    """
    measured = json.loads(PAGE.with_name("learning.json").read_text())
    drawing = Figure(figsize=(8.6, 3.6), layout="constrained")
    axes = drawing.subplots()
    for points in measured["curves"].values():
        minutes = [at for at, _, _ in points]
        scores = [100.0 * score for _, _, score in points]
        axes.plot(minutes, scores, color=DOT, marker="o", markersize=3.0, linewidth=1.2)
    for policy, color in BESIDE.items():
        score = 100.0 * test_score(policy)
        axes.axhline(score, color=color, linewidth=1.0, linestyle="--")
        axes.annotate(f"{policy} {score:.1f}", (1.01, score), xycoords=("axes fraction", "data"))
    axes.set_xlabel("minutes of learning, of one core; a line is a seed")
    axes.set_ylabel("score in the test split, %")
    axes.spines[["top", "right"]].set_visible(False)
    return svg_of(drawing)


def test_score(policy: str) -> float:
    """Return the score of a policy in the orchards for the test, 0 to 1."""
    harvests = [each for each in result().of(policy) if each.orchard.endswith("-test")]
    return fmean(each.score for each in harvests)
