"""The part of bench/results.md about environments for learning.

`python -m bench.learning --many` measures it, and keeps the figures in bench/learning.json. So
`make bench` writes them again without measuring them.
"""

import json
import re
from pathlib import Path
from statistics import median

FIGURES = Path(__file__).with_name("learning.json")
TITLE = "## Learning"
# Before this part.
NEXT = "## Method"


def learning() -> str:
    """Return the part as Markdown."""
    measured = json.loads(FIGURES.read_text())
    before, after = measured["load"]
    rows = []
    for name, seconds in measured["seconds"].items():
        rows.append(_row(name, seconds))
    table = "\n".join(["| many at once | steps/s, median | best |", "|---|---|---|", *rows])
    return (
        f"{TITLE}\n\n{table}\n\nA step is a decision in one orchard, of rows/pickers/carriers, or"
        " an action of one agent of a warehouse. Actions are random. *Sends at once*: a carrier"
        " leaves whenever one can. Rates are those of processor time, on one core. The machine had"
        f" much other work (load before {before:.1f}, after {after:.1f}), so compare ratios. The"
        " work of a step is not the same: in a warehouse each step is a move of a cell, and in an"
        " orchard robots work from one decision to the next. `python -m bench.learning --many`"
        " measures this again."
    )


def _row(name: str, seconds: list[float] | str) -> str:
    if isinstance(seconds, str):
        return f"| {name} | {seconds} | - |"
    return f"| {name} | {1.0 / median(seconds):,.0f} | {1.0 / min(seconds):,.0f} |"


def with_learning(text: str) -> str:
    """Return the text of bench/results.md with this part as it was measured."""
    without = re.sub(rf"{TITLE}\n.*?(?={NEXT}\n)", "", text, flags=re.DOTALL)
    return without.replace(f"{NEXT}\n", f"{learning()}\n\n{NEXT}\n", 1)
