"""The moment of a decision: `orchard fork --bisect` finds the last one from which it ends well.

Theory of operation. First the futures of up to twelve kept moments are lived. From the last of
these moments that has a good future, the next one has none: between the two lies the decision.
Then the moment in the middle replaces one of the two, until they are next to each other.

Where the event model can do the futures, it does this search in seconds. The simulator then lives
the futures of the last good and the first bad moment only. If these end as they were expected to,
this is the answer: of the other moments only the event model has futures. If not, the simulator
searches by itself.
"""

import re
from collections.abc import Callable, Collection, Sequence
from functools import cache
from operator import gt, lt
from pathlib import Path
from typing import Any

from orchard.discrete.harvest import get_ready
from orchard.field.scenario import TICKS_PER_SECOND, check
from orchard.fork.changes import NotNow
from orchard.futures.forecasts import FORECAST, can_forecast
from orchard.futures.fork import changes_of
from orchard.futures.futures import SHOWN, Branch, Futures, mean_of, well_ended
from orchard.futures.moments import Future, WatchedRun, snapshot_at
from orchard.futures.options import ForkOptions
from orchard.sim.snapshot import Snapshot, ticks_of
from orchard.study.words import interval_words
from orchard.terminal.output import console, print_error, print_line, table
from orchard.terminal.values import clock

MOST_MOMENTS = 12  # whose futures are lived first; the search then goes on between two of them
NEAR = TICKS_PER_SECOND  # ticks: the search ends when the good and the bad moment are so near
MINUTE = 60 * TICKS_PER_SECOND  # ticks
EXPECTED = (
    "expected jam, collision, or a figure of the summary that is too small or too large, "
    "such as bins_per_hour<20"
)
_CONDITION = re.compile(r"([a-z_]+)([<>])(\d+(?:\.\d+)?)")


class Bisection:
    """The search for the last moment from which some future ends well.

    A moment is good if one of its futures at least ends well, and bad if none does.
    """

    def __init__(
        self, live_at: Callable[[int], Sequence[Future]], ends_badly: Callable[[Future], bool]
    ) -> None:
        """`live_at`: returns the futures of a moment, none if the changes cannot be made there."""
        self._live_at = live_at
        self.ends_badly = ends_badly
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
        return sum(not self.ends_badly(future) for future in self.lived[tick])

    @property
    def answer(self) -> tuple[int | None, int | None]:
        """The last good moment, and the first bad one after it."""
        return self.last_good, self.first_bad

    @property
    def edges(self) -> list[int]:
        """The ticks of the moments on which the answer rests."""
        good = self.last_good
        if good is None:
            return sorted({min(self.lived), max(self.lived)})
        bad = self.first_bad
        return [good] if bad is None else [good, bad]

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
    # Ticks.
    moments = _first_moments(folder, chosen.at)
    ends_badly = badly(condition, _figures_at(folder, moments[0]))

    @cache
    def begun_at(tick: int) -> list[Snapshot]:
        return _begun(chosen, snapshot_at(folder, tick, print_error), futures)

    expected = Bisection(lambda tick: [], ends_badly)
    if _can_be_expected(chosen):
        expected = expected_search(moments, begun_at, futures, ends_badly)
    bisection = confirmed_search(expected, moments, begun_at, futures)
    good = bisection.last_good
    print_line(decision_words(condition, bisection))
    _show(bisection, expected)
    if chosen.picture is not None:
        _draw(bisection, expected, chosen.picture)
    return {
        "condition": condition,
        "decided_seconds": None if good is None else good / TICKS_PER_SECOND,
        "futures": _by_seconds(bisection),
        "expected_futures": _by_seconds(expected),
    }


def _by_seconds(bisection: Bisection) -> dict[float, list[Future]]:
    """Return the futures of each moment, by its simulated time, s."""
    lived = sorted(bisection.lived.items())
    return {tick / TICKS_PER_SECOND: of_moment for tick, of_moment in lived}


class _NotKnownError(Exception):
    """Raised for a future that the event model cannot do."""


def _can_be_expected(chosen: ForkOptions) -> bool:
    """Whether the event model gives what the condition asks for, of whole harvests."""
    condition = chosen.bisect or ""
    parts = _CONDITION.fullmatch(condition)
    is_given = condition == "jam" or (parts is not None and parts[1] in FORECAST)
    return is_given and can_forecast(chosen)


def expected_search(
    moments: Sequence[int],
    begun_at: Callable[[int], list[Snapshot]],
    futures: Futures,
    ends_badly: Callable[[Future], bool],
) -> Bisection:
    """Return the search by the event model; without any moment if it cannot do one of the futures.

    `moments`: ticks at which it begins. `begun_at`: returns the first moments of the futures.
    """

    def expected_at(tick: int) -> list[Future]:
        begun = begun_at(tick)
        known = [future for future in futures.forecast(begun) if future is not None]
        if len(known) < len(begun):
            raise _NotKnownError
        return known

    # The model is compiled here, because else each of the processes would compile it for itself.
    get_ready(check(begun.scenario) for begun in begun_at(moments[0])[:1])
    bisection = Bisection(expected_at, ends_badly)
    try:
        bisection.lived = {tick: expected_at(tick) for tick in moments}
        bisection.search()
    except _NotKnownError:
        return Bisection(expected_at, ends_badly)
    return bisection


def confirmed_search(
    expected: Bisection,
    moments: Sequence[int],
    begun_at: Callable[[int], list[Snapshot]],
    futures: Futures,
) -> Bisection:
    """Return the search by the simulator, of as few moments as what is expected allows.

    `expected`: the search by the event model; without any moment if there is none.
    """

    def lived_at(tick: int) -> list[Future]:
        """Return the futures of a moment, done by the simulator."""
        return futures.live(begun_at(tick))

    bisection = Bisection(lived_at, expected.ends_badly)
    first = expected.edges if expected.lived else moments
    bisection.lived = _lived_together({tick: begun_at(tick) for tick in first}, futures)
    if expected.lived and bisection.answer != expected.answer:
        print_error("the simulator ends otherwise than the event model: it searches by itself")
        others = [tick for tick in moments if tick not in bisection.lived]
        bisection.lived |= _lived_together({tick: begun_at(tick) for tick in others}, futures)
    bisection.search()
    return bisection


def _first_moments(folder: Path, last: int | None) -> list[int]:
    """Return the ticks at which the search begins, with the last one, and about evenly apart.

    `last`: the tick up to which the user asks; None: that of the last snapshot.
    """
    known = [tick for tick in ticks_of(folder) if last is None or tick < last]
    if last is not None:
        known.append(last)
    if not known:
        # There is no keyframe: the code that reads one says so.
        return [0]
    # Rounded up, so that there are at most MOST_MOMENTS.
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

    def ends_badly(future: Future) -> bool:
        """Whether a future jams, or its figure is beyond the limit."""
        return not well_ended([future]) or bool(is_beyond(future[key], limit))

    return ends_badly


def _begun(chosen: ForkOptions, moment: Snapshot, futures: Futures) -> list[Snapshot]:
    """Return the first moments of the futures; none if what is asked cannot be changed then."""
    changes = changes_of(chosen, check(moment.scenario))
    try:
        return futures.of(moment, Branch(changes, chosen.stop or []))
    except NotNow:
        return []


def _lived_together(begun: dict[int, list[Snapshot]], futures: Futures) -> dict[int, list[Future]]:
    """Live the futures of several moments side by side. Return them by tick."""
    first_moments: list[Snapshot] = []
    for of_moment in begun.values():
        first_moments += of_moment
    # In the order of their first moments.
    lived = futures.live(first_moments)
    by_tick = {}
    for tick, of_moment in begun.items():
        by_tick[tick] = lived[: len(of_moment)]
        lived = lived[len(of_moment) :]
    return by_tick


def decision_words(condition: str, bisection: Bisection) -> str:
    """Return the answer: after which moment the run is decided."""
    good = bisection.last_good
    bad = bisection.first_bad
    count = max(len(of_moment) for of_moment in bisection.lived.values())
    if good is None:
        first = clock(min(bisection.lived))
        return f"{condition}: decided before {first}: none of {count} futures ends well."
    ending = "the future ends well"
    if count > 1:
        ending = f"some of {count} futures end well"
    if bad is None:
        return f"{condition}: not decided: {ending} from {clock(good)}, the last moment."
    return (
        f"{condition}: decided after {clock(good)}: {ending} from there, "
        f"and none from {clock(bad)}."
    )


def _show(bisection: Bisection, expected: Bisection) -> None:
    """Print the table of the futures of all moments.

    `expected`: what the event model has found. It is shown where the simulator has no futures.
    """
    shown = table(None, "from", "by", "end well", *SHOWN.values())
    for tick in sorted({*bisection.lived, *expected.lived}):
        if tick in bisection.lived:
            cells = _cells(bisection, tick, SHOWN)
            shown.add_row(clock(tick), "simulator", *cells)
        else:
            cells = _cells(expected, tick, FORECAST)
            shown.add_row(clock(tick), "event model", *cells)
    console.print(shown)


def _cells(search: Bisection, tick: int, figures: Collection[str]) -> list[str]:
    """Return the cells of the table that tell of a moment: how many futures end well, and means.

    `search`: has the futures of the moment. `figures`: those that the futures have.
    """
    of_moment = search.lived[tick]
    count = "not now"
    if of_moment:
        count = f"{search.good_count(tick)} of {len(of_moment)}"
    cells = [count]
    for key in SHOWN:
        mean = mean_of(key, of_moment) if key in figures else None
        cells.append(interval_words(mean, " ±"))
    return cells


def _draw(bisection: Bisection, expected: Bisection, picture: Path) -> None:
    """Draw the futures of all moments into a file. Raises OSError."""
    # matplotlib takes half a second to load.
    from orchard.study.picture import save_futures

    rates = {}
    shares = {}
    for tick in sorted({*bisection.lived, *expected.lived}):
        search = bisection if tick in bisection.lived else expected
        of_moment = search.lived[tick]
        minute = tick / MINUTE
        rates[minute] = [future["bins_per_hour"] for future in well_ended(of_moment)]
        shares[minute] = search.good_count(tick) / max(1, len(of_moment))
    good = bisection.last_good
    save_futures(picture, rates, shares, None if good is None else good / MINUTE)
