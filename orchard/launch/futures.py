"""The futures of a run: how it may go on from a moment, as it was and with changes, and until when it could still have ended well.

A future is a run in local mode from that moment to its end. Each has a seed of its own, for all that is random from there on.
"""

import re
from collections.abc import Callable, Collection, Sequence
from functools import partial
from itertools import chain, islice
from operator import gt, lt
from pathlib import Path
from typing import Any, NamedTuple

import typer
from rich.progress import Progress

from orchard.field.problems import ScenarioError
from orchard.field.repeatable import draw
from orchard.field.scenario import TICKS_PER_SECOND, check, with_changes
from orchard.fork import NotNow, forked
from orchard.launch import terminal
from orchard.launch.fork import Future, WatchedRun, changes_of, check_end, clock, live, snapshot_at
from orchard.launch.options import ForkOptions
from orchard.launch.runs import Runs, check_writable
from orchard.launch.study import failures, stoppable
from orchard.report.summary import write_summary
from orchard.server.options import last_tick
from orchard.sim.restore import world_from
from orchard.sim.snapshot import KEYFRAME, Snapshot, SnapshotError, ticks_of
from orchard.study.comparing import interval
from orchard.study.result import Interval
from orchard.study.settings import Setting
from orchard.study.words import interval_words
from orchard.study.workers import Workers, processes

CONFIDENCE = 0.95
MOST_MOMENTS = 12  # from which futures begin, before the last good one is searched for
FUTURES = 8
NEAR = TICKS_PER_SECOND  # ticks, to which it is found
SHOWN = {
    "sim_seconds": "ends at, s",
    "bins_per_hour": "bins/h",
    "picker_waiting_seconds": "wait, s",
    "collisions": "collisions",
}
MINUTE = 60 * TICKS_PER_SECOND
CONDITION = re.compile(r"([a-z_]+)([<>])(\d+(?:\.\d+)?)")
EXPECTED = "expected jam, collision, or a figure of the summary that is too small or too large, such as bins_per_hour<20"


class Branch(NamedTuple):
    """What is changed at a moment: dotted path -> value, and the robots that stand from then on."""

    changes: dict[str, Any]
    stop: Sequence[str] = ()


class Futures:
    """Lives futures side by side."""

    def __init__(
        self, chosen: ForkOptions, workers: Workers, is_stopped: Callable[[], bool], shown: Progress
    ) -> None:
        self._count, self._workers, self._is_stopped = (
            chosen.futures or FUTURES,
            workers,
            is_stopped,
        )
        self._duration = chosen.duration
        self._live, self._shown, self._task = (
            partial(live, last_tick(chosen.duration)),
            shown,
            shown.add_task("", total=0),
        )

    def of(self, moment: Snapshot, *branches: Branch) -> list[Snapshot]:
        """Return the first moments of all futures, branch by branch on the same seeds. Raises ScenarioError for what cannot change."""
        scenario = check(moment.scenario)
        is_random = any(
            Setting({}, with_changes(scenario, **branch.changes)).is_random for branch in branches
        )
        drawn = [
            int(draw(scenario.seed, "future", number)[0] * 2**53) for number in range(self._count)
        ]
        seeds = drawn if is_random else [scenario.seed]
        begun = [
            forked(moment, {**branch.changes, "seed": seed}, branch.stop)
            for branch in branches
            for seed in seeds
        ]
        for one in begun[:: len(seeds)]:
            check_end(world_from(one), self._duration)
        return begun

    def live(self, begun: Sequence[Snapshot]) -> list[Future]:
        """Return what these futures give. Raises typer.Exit if the user stops the command."""
        done = dict[int, Future]()
        self._shown.update(self._task, completed=0, total=len(begun))
        for (number, _), future in self._workers.do(
            self._live, list(enumerate(begun)), lambda: not self._is_stopped()
        ):
            done[number] = future
            self._shown.advance(self._task)
        if len(done) < len(begun):
            terminal.print_error("stopped; nothing is kept")
            raise typer.Exit(terminal.FAILED)
        return [done[number] for number in range(len(begun))]


def run_futures(chosen: ForkOptions, runs: Runs) -> int:
    """Live the futures that a user asks for, print and write what they give. Return the exit code."""
    with (
        terminal.own_classes_run(),
        terminal.exit_on_errors(ScenarioError, SnapshotError, OSError, ValueError),
        failures(),
    ):
        folder = runs.snapshots(chosen.run, KEYFRAME)
        for path in filter(None, (chosen.summary, chosen.picture)):
            check_writable(path)
        with (
            terminal.as_typed(),
            stoppable() as is_stopped,
            processes() as workers,
            terminal.bar() as shown,
        ):
            futures = Futures(chosen, workers, is_stopped, shown)
            found = (
                _compared(chosen, folder, futures)
                if chosen.bisect is None
                else _bisected(chosen, folder, futures)
            )
        if chosen.summary is not None:
            write_summary(chosen.summary, found)
    return terminal.FINISHED


# -- two branches


def _compared(chosen: ForkOptions, folder: Path, futures: Futures) -> dict[str, Any]:
    """Print the futures of a moment as it was and, if something is changed, with that. Return all of them."""
    moment = snapshot_at(folder, chosen.at or 0, terminal.print_error)
    changed = Branch(changes_of(chosen, check(moment.scenario)), chosen.stop or [])
    branches = {"as it was": Branch({}), **({_words(changed): changed} if any(changed) else {})}
    found = futures.live(futures.of(moment, *branches.values()))
    count = len(found) // len(branches)
    lived = {words: found[i * count : (i + 1) * count] for i, words in enumerate(branches)}
    shown = terminal.table(None, "", *branches)
    for key, head in SHOWN.items():
        shown.add_row(head, *(interval_words(_mean(key, some), " ±") for some in lived.values()))
    shown.add_row("ended well", *(f"{len(_well(some))} of {len(some)}" for some in lived.values()))
    first, *rest = lived.items()
    for words, some in rest:
        terminal.print_line(_difference(words, first[1], some))
    terminal.console.print(shown)
    return {"at_seconds": moment.tick / TICKS_PER_SECOND, "futures": lived}


def _words(branch: Branch) -> str:
    return ", ".join(
        [
            *(f"{key}={value}" for key, value in branch.changes.items()),
            *(f"{name} stopped" for name in branch.stop),
        ]
    )


def _difference(words: str, before: Sequence[Future], now: Sequence[Future]) -> str:
    """The answer: by how much earlier the futures end, in pairs of one seed."""
    both = [
        pair
        for pair in zip(before, now, strict=True)
        if all(one["ended"] == "harvested" for one in pair)
    ]
    pairs = [(was["sim_seconds"], one["sim_seconds"]) for was, one in both]
    if not pairs:
        return f"With {words} no pair of futures is harvested to its end."
    earlier = interval([was - one for was, one in pairs], CONFIDENCE)
    half, mean = round(10 * (earlier.high - earlier.mean)), round(10 * earlier.mean)
    count = (
        f"{len(pairs)} pairs of futures, {100 * CONFIDENCE:g} % confidence"
        if len(pairs) > 1
        else "one pair of futures"
    )
    count += (
        f"; {len(before) - len(pairs)} more are not harvested to their end"
        if len(pairs) < len(before)
        else ""
    )
    return f"With {words} the harvest ends {clock(abs(mean))} ± {clock(half)} min {'earlier' if mean >= 0 else 'later'} ({count})."


def _well(futures: Sequence[Future]) -> list[Future]:
    return [one for one in futures if one["ended"] in ("harvested", "duration")]


def _mean(key: str, futures: Sequence[Future]) -> Interval | None:
    values = [float(one[key]) for one in _well(futures)]
    return interval(values, CONFIDENCE) if values else None


# -- the moment of the decision


def badly(condition: str, known: Collection[str]) -> Callable[[Future], bool]:
    """Return what tells whether a future ends badly. `known`: the figures. Raises ValueError for a condition that is none."""
    if condition == "jam":
        return lambda future: not _well([future])
    if condition == "collision":
        return lambda future: future["collisions"] > 0
    found = CONDITION.fullmatch(condition)
    if found is None or found[1] not in known:
        raise ValueError(f"--bisect {condition}: {EXPECTED}")
    key, compare, limit = found[1], lt if found[2] == "<" else gt, float(found[3])
    return lambda future: not _well([future]) or bool(compare(future[key], limit))


def _bisected(chosen: ForkOptions, folder: Path, futures: Futures) -> dict[str, Any]:
    """Print the last moment from which some future ends well, and the futures of all moments that were tried. Return these."""
    known = [tick for tick in ticks_of(folder) if chosen.at is None or tick < chosen.at]
    known += [chosen.at] if chosen.at is not None else []
    first = snapshot_at(folder, known[0] if known else 0, terminal.print_error)
    figures = WatchedRun(first).figures.figures()
    is_bad = badly(
        chosen.bisect or "",
        [key for key, figure in figures.items() if isinstance(figure, int | float)],
    )
    lived: dict[int, list[Future]] = {}

    def ends_well(*ticks: int) -> bool:
        """Whether some future of the last of these moments ends well. Those at which what is asked cannot be changed have none."""
        begun = {
            tick: _begun(chosen, snapshot_at(folder, tick, terminal.print_error), futures)
            for tick in ticks
        }
        found = iter(futures.live([*chain(*begun.values())]))
        lived.update({tick: [*islice(found, len(some))] for tick, some in begun.items()})
        return any(not is_bad(one) for one in lived[ticks[-1]])

    ends_well(*dict.fromkeys([*known[:: -(-len(known) // MOST_MOMENTS)], known[-1]]))
    good = max(
        (tick for tick, some in lived.items() if any(not is_bad(one) for one in some)), default=None
    )
    bad = min((tick for tick in lived if good is not None and tick > good), default=None)
    while good is not None and bad is not None and bad - good > NEAR:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if ends_well(middle) else (good, middle)
    lived = dict(sorted(lived.items()))
    terminal.print_line(
        _decision(chosen.bisect or "", good, bad, min(lived), max(map(len, lived.values())))
    )
    _show(
        lived,
        {tick: sum(not is_bad(one) for one in some) for tick, some in lived.items()},
        good,
        chosen.picture,
    )
    decided = None if good is None else good / TICKS_PER_SECOND
    return {
        "condition": chosen.bisect,
        "decided_seconds": decided,
        "futures": {at / TICKS_PER_SECOND: some for at, some in lived.items()},
    }


def _show(
    lived: dict[int, list[Future]], well: dict[int, int], good: int | None, picture: Path | None
) -> None:
    """Show the futures of all moments. `well`: how many of them end well. `good`: the last moment from which some do."""
    shown = terminal.table(None, "from", "end well", *SHOWN.values())
    for tick, some in lived.items():
        means = (interval_words(_mean(key, some), " ±") for key in SHOWN)
        shown.add_row(clock(tick), f"{well[tick]} of {len(some)}" if some else "not now", *means)
    terminal.console.print(shown)
    if picture is not None:
        from orchard.study.picture import (
            save_futures,
        )  # not at the top: matplotlib takes half a second to load

        rates = {
            tick / MINUTE: [one["bins_per_hour"] for one in _well(some)]
            for tick, some in lived.items()
        }
        shares = {tick / MINUTE: count / max(1, len(lived[tick])) for tick, count in well.items()}
        save_futures(picture, rates, shares, None if good is None else good / MINUTE)


def _begun(chosen: ForkOptions, moment: Snapshot, futures: Futures) -> list[Snapshot]:
    try:
        return futures.of(
            moment, Branch(changes_of(chosen, check(moment.scenario)), chosen.stop or [])
        )
    except NotNow:
        return []


def _decision(condition: str, good: int | None, bad: int | None, first: int, count: int) -> str:
    some = f"some of {count} futures end well" if count > 1 else "the future ends well"
    if good is None:
        return f"{condition}: decided before {clock(first)}: none of {count} futures ends well."
    if bad is None:
        return f"{condition}: not decided: {some} from {clock(good)}, the last moment."
    return (
        f"{condition}: decided after {clock(good)}: {some} from there, and none from {clock(bad)}."
    )
