"""The moment of a decision: `orchard fork --bisect` finds the last one from which it ends well.

Theory of operation. First the futures of up to twelve kept moments are lived. From the last of
these moments that has a good future, the next one has none: between the two lies the decision.
Then the moment in the middle replaces one of the two, until they are next to each other.
"""

import re
from collections.abc import Callable, Collection, Sequence
from operator import gt, lt
from pathlib import Path
from typing import Any

from orchard.field.scenario import TICKS_PER_SECOND, check
from orchard.fork import NotNow
from orchard.futures.fork import changes_of
from orchard.futures.futures import SHOWN, Branch, Futures, mean_of, well_ended
from orchard.futures.moments import Future, WatchedRun, snapshot_at
from orchard.futures.options import ForkOptions
from orchard.sim.snapshot import Snapshot, ticks_of
from orchard.study.words import interval_words
from orchard.terminal.output import console, print_error, print_line, table
from orchard.terminal.values import clock

MOST_MOMENTS = 12  # from which futures begin, before the last good one is searched for
NEAR = TICKS_PER_SECOND  # ticks, to which it is found
MINUTE = 60 * TICKS_PER_SECOND  # ticks
EXPECTED = (
    "expected jam, collision, or a figure of the summary that is too small or too large, "
    "such as bins_per_hour<20"
)
_CONDITION = re.compile(r"([a-z_]+)([<>])(\d+(?:\.\d+)?)")


class Bisection:
    """The search for the last moment from which some future ends well."""

    def __init__(
        self, live_at: Callable[[int], Sequence[Future]], ends_badly: Callable[[Future], bool]
    ) -> None:
        """`live_at`: returns the futures of a moment, none if nothing can be changed there."""
        self._live_at = live_at
        self._ends_badly = ends_badly
        self.lived: dict[int, list[Future]] = {}  # tick of a moment -> its futures

    def search(self) -> None:
        """Live the futures of the moments between the last good and the first bad one."""
        while True:
            good = self.last_good
            bad = self.first_bad
            if good is None or bad is None or bad - good <= NEAR:
                return
            middle = (good + bad) // 2
            self.lived[middle] = list(self._live_at(middle))

    def good_count(self, tick: int) -> int:
        """Return how many futures of a moment end well."""
        return sum(not self._ends_badly(future) for future in self.lived[tick])

    @property
    def last_good(self) -> int | None:
        """The tick of the last moment with a future that ends well; None without any."""
        good = [tick for tick in self.lived if self.good_count(tick)]
        return max(good, default=None)

    @property
    def first_bad(self) -> int | None:
        """The tick of the first moment after the last good one; None without any."""
        good = self.last_good
        bad = [tick for tick in self.lived if good is not None and tick > good]
        return min(bad, default=None)


def bisect_futures(chosen: ForkOptions, folder: Path, futures: Futures) -> dict[str, Any]:
    """Print the last moment from which some future ends well, and the futures of all moments.

    `folder`: has the keyframes of the run. Returns what was tried, for the summary. Raises
    SnapshotError, ScenarioError or ValueError.
    """
    condition = chosen.bisect or ""
    moments = _first_moments(folder, chosen.at)
    ends_badly = badly(condition, _figures_at(folder, moments[0]))

    def begun_at(tick: int) -> list[Snapshot]:
        return _begun(chosen, snapshot_at(folder, tick, print_error), futures)

    bisection = Bisection(lambda tick: futures.live(begun_at(tick)), ends_badly)
    bisection.lived = _lived_together({tick: begun_at(tick) for tick in moments}, futures)
    bisection.search()
    good = bisection.last_good
    print_line(decision_words(condition, bisection))
    _show(bisection)
    if chosen.picture is not None:
        _draw(bisection, chosen.picture)
    lived = sorted(bisection.lived.items())
    return {
        "condition": condition,
        "decided_seconds": None if good is None else good / TICKS_PER_SECOND,
        "futures": {tick / TICKS_PER_SECOND: of_moment for tick, of_moment in lived},
    }


def _first_moments(folder: Path, last: int | None) -> list[int]:
    """Return the ticks at which the search begins, with the last one, and about evenly apart.

    `last`: the tick up to which the user asks; None: that of the last snapshot.
    """
    known = [tick for tick in ticks_of(folder) if last is None or tick < last]
    if last is not None:
        known.append(last)
    if not known:
        # There is no keyframe: whoever reads it says so.
        return [0]
    step = -(-len(known) // MOST_MOMENTS)
    return sorted({*known[::step], known[-1]})


def _figures_at(folder: Path, tick: int) -> list[str]:
    """Return the names of the figures of a run that are numbers. Raises SnapshotError."""
    figures = WatchedRun(snapshot_at(folder, tick, print_error)).figures.figures()
    return [key for key, figure in figures.items() if isinstance(figure, int | float)]


def badly(condition: str, known: Collection[str]) -> Callable[[Future], bool]:
    """Return what tells whether a future ends badly.

    `known`: the names of the figures. Raises ValueError for a condition that is none.
    """
    if condition == "jam":
        return lambda future: not well_ended([future])
    if condition == "collision":
        return lambda future: future["collisions"] > 0
    parts = _CONDITION.fullmatch(condition)
    if parts is None or parts[1] not in known:
        raise ValueError(f"--bisect {condition}: {EXPECTED}")
    key = parts[1]
    is_beyond = lt if parts[2] == "<" else gt
    limit = float(parts[3])
    return lambda future: not well_ended([future]) or bool(is_beyond(future[key], limit))


def _begun(chosen: ForkOptions, moment: Snapshot, futures: Futures) -> list[Snapshot]:
    """Return the first moments of the futures; none if what is asked cannot be changed then."""
    changes = changes_of(chosen, check(moment.scenario))
    try:
        return futures.of(moment, Branch(changes, chosen.stop or []))
    except NotNow:
        return []


def _lived_together(begun: dict[int, list[Snapshot]], futures: Futures) -> dict[int, list[Future]]:
    """Live the futures of several moments side by side. Return them by tick."""
    lived = iter(futures.live([first for of_moment in begun.values() for first in of_moment]))
    return {tick: [next(lived) for _ in of_moment] for tick, of_moment in begun.items()}


def decision_words(condition: str, bisection: Bisection) -> str:
    """Return the answer: after which moment the run is decided."""
    good = bisection.last_good
    bad = bisection.first_bad
    count = max(len(of_moment) for of_moment in bisection.lived.values())
    if good is None:
        first = clock(min(bisection.lived))
        return f"{condition}: decided before {first}: none of {count} futures ends well."
    ending = f"some of {count} futures end well" if count > 1 else "the future ends well"
    if bad is None:
        return f"{condition}: not decided: {ending} from {clock(good)}, the last moment."
    return (
        f"{condition}: decided after {clock(good)}: {ending} from there, "
        f"and none from {clock(bad)}."
    )


def _show(bisection: Bisection) -> None:
    """Print the table of the futures of all moments."""
    shown = table(None, "from", "end well", *SHOWN.values())
    for tick, of_moment in sorted(bisection.lived.items()):
        count = f"{bisection.good_count(tick)} of {len(of_moment)}" if of_moment else "not now"
        means = [interval_words(mean_of(key, of_moment), " ±") for key in SHOWN]
        shown.add_row(clock(tick), count, *means)
    console.print(shown)


def _draw(bisection: Bisection, picture: Path) -> None:
    """Draw the futures of all moments into a file. Raises OSError."""
    # matplotlib takes half a second to load.
    from orchard.study.picture import save_futures

    rates = {}
    shares = {}
    for tick, of_moment in sorted(bisection.lived.items()):
        minute = tick / MINUTE
        rates[minute] = [future["bins_per_hour"] for future in well_ended(of_moment)]
        shares[minute] = bisection.good_count(tick) / max(1, len(of_moment))
    good = bisection.last_good
    save_futures(picture, rates, shares, None if good is None else good / MINUTE)
