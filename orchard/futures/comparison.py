"""The futures of one moment, as it was and with changes: `orchard fork --futures`.

Where the event model can do them all, it answers first: a future takes it milliseconds, where the
simulator takes seconds. What it expected then stands beside what the simulator gives.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from orchard.field.scenario import TICKS_PER_SECOND, check
from orchard.futures.forecasts import EXPECTED_END, can_forecast
from orchard.futures.fork import changes_of
from orchard.futures.futures import CONFIDENCE, SHOWN, Branch, Futures, mean_of, well_ended
from orchard.futures.moments import Future, snapshot_at
from orchard.futures.options import ForkOptions
from orchard.sim.snapshot import Snapshot
from orchard.study.comparing import interval
from orchard.study.runs import faults_of
from orchard.study.words import interval_words
from orchard.terminal.output import console, print_error, print_line, table
from orchard.terminal.values import clock

AS_IT_WAS = "as it was"


def compare_futures(chosen: ForkOptions, folder: Path, futures: Futures) -> dict[str, Any]:
    """Print the futures of a moment as it was and, if something is changed, with that.

    `folder`: has the keyframes of the run. Returns all futures, for the summary. Raises
    SnapshotError, ScenarioError or ValueError.
    """
    moment = snapshot_at(folder, chosen.at or 0, print_error)
    changed = Branch(changes_of(chosen, check(moment.scenario)), chosen.stop or [])
    branches = {AS_IT_WAS: Branch({})}
    if any(changed):
        branches[changed.words] = changed
    begun = futures.of(moment, *branches.values())
    names = list(branches)
    expected = _by_branch(names, _expected(chosen, begun, futures))
    if changed.words in expected:
        before = expected[AS_IT_WAS]
        words = difference_words(changed.words, before, expected[changed.words])
        print_line(f"Expected by the event model: {words} The simulator now does the same futures.")
    of_branch = _by_branch(names, futures.live(begun))
    if changed.words in of_branch:
        before = of_branch[AS_IT_WAS]
        print_line(difference_words(changed.words, before, of_branch[changed.words]))
    _show(of_branch, expected)
    for note in fault_notes(of_branch):
        print_error(note)
    return {
        "at_seconds": moment.tick / TICKS_PER_SECOND,
        "futures": of_branch,
        "expected_futures": expected,
    }


def _expected(chosen: ForkOptions, begun: Sequence[Snapshot], futures: Futures) -> list[Future]:
    """Return what the event model expects of futures; none if it cannot do one of them.

    `begun`: their first moments.
    """
    if not can_forecast(chosen):
        return []
    known = [future for future in futures.forecast(begun) if future is not None]
    return known if len(known) == len(begun) else []


def fault_notes(of_branch: Mapping[str, Sequence[Future]]) -> list[str]:
    """Return the first fault of each branch in which a class of the user's own failed.

    The figures of such futures are not those of the class as it was meant. `of_branch`: what is
    changed -> its futures.
    """
    notes = []
    for words, futures in of_branch.items():
        with_faults = [faults for faults in map(faults_of, futures) if faults]
        if with_faults:
            count = f"{len(with_faults)} of {len(futures)} futures had faults"
            notes.append(f"{words}: {count}: {with_faults[0][0]}")
    return notes


def _by_branch(names: Sequence[str], futures: Sequence[Future]) -> dict[str, list[Future]]:
    """Return the futures of each branch, by its name; nothing without futures.

    `futures`: branch by branch, equally many of each.
    """
    count = len(futures) // len(names)
    of_branch = {}
    for number, name in enumerate(names):
        if futures:
            of_branch[name] = list(futures[number * count : (number + 1) * count])
    return of_branch


def _show(of_branch: dict[str, list[Future]], expected: dict[str, list[Future]]) -> None:
    """Print the table of all futures.

    `of_branch`: what is changed -> its futures. `expected`: the same by the event model, or none.
    """
    shown = table(None, "", *of_branch)
    _add_row(shown, EXPECTED_END, "sim_seconds", expected)
    for key, head in SHOWN.items():
        _add_row(shown, head, key, of_branch)
    counts = [f"{len(well_ended(lived))} of {len(lived)}" for lived in of_branch.values()]
    shown.add_row("ended well", *counts)
    console.print(shown)


def _add_row(shown: Table, head: str, key: str, of_branch: dict[str, list[Future]]) -> None:
    """Add the means of a figure to a table; no row without futures."""
    if of_branch:
        means = [mean_of(key, futures) for futures in of_branch.values()]
        shown.add_row(head, *(interval_words(mean, " ±") for mean in means))


def difference_words(words: str, before: Sequence[Future], changed: Sequence[Future]) -> str:
    """Return by how much earlier the futures end with a change, in pairs of one seed.

    `words`: what is changed. `before`, `changed`: the futures without and with it, (n,) each.
    """
    earlier_by = [
        was["sim_seconds"] - future["sim_seconds"]
        for was, future in zip(before, changed, strict=True)
        if was["ended"] == future["ended"] == "harvested"
    ]
    if not earlier_by:
        return f"With {words} no pair of futures is harvested to its end."
    earlier = interval(earlier_by, CONFIDENCE)
    mean = round(TICKS_PER_SECOND * earlier.mean)
    half_width = round(TICKS_PER_SECOND * (earlier.high - earlier.mean))
    direction = "earlier" if mean >= 0 else "later"
    return (
        f"With {words} the harvest ends {clock(abs(mean))} ± {clock(half_width)} min {direction} "
        f"({_pairs_words(len(earlier_by), len(before))})."
    )


def _pairs_words(count: int, of_all: int) -> str:
    """Return on how many pairs a difference rests, in words."""
    if count > 1:
        words = f"{count} pairs of futures, {100 * CONFIDENCE:g} % confidence"
    else:
        words = "one pair of futures"
    if count < of_all:
        words += f"; {of_all - count} more are not harvested to their end"
    return words
