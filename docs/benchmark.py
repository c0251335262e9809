"""The table of docs/benchmark.md: `orchard benchmark --summary docs/benchmark.json` measures it,
`make docs` writes it.
"""

import json
import re
from pathlib import Path

import msgspec

from orchard.study.benchmark.scores import BenchmarkResult

PAGE = Path(__file__).with_name("benchmark.md")
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
