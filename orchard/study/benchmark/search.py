"""Looks for better schedules than the best known ones, by a local search over the order of bins:
`python -m orchard.study.benchmark.search FOLDER TRIES INSTANCE...`.

It begins with the order in which the best known schedule serves the pickers, and tries changes of
it in the event model. It tries whole harvests again and again, which no policy can do. A better
schedule replaces the one in the file. A still better one may exist.
"""

import sys
from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from orchard.field.layout import Layout, lay_out
from orchard.study.benchmark.instances import (
    Instance,
    InstanceDraw,
    KnownSchedule,
    as_file,
    instances,
    recorded,
)
from orchard.study.benchmark.make_set import InOrder
from orchard.study.benchmark.play import Played, play

# A change moves a bin by at most so many places in the order.
FARTHEST = 3


def searched(instance: Instance, tries: int) -> Instance:
    """Return an instance with the best schedule of each draw after so many changes of its order."""
    draws = []
    for draw in instance.draws:
        better = _better(lay_out(instance.of_seed(draw.seed)), draw, tries)
        draws.append(replace(draw, best=better or draw.best))
    return replace(instance, draws=draws)


def _better(layout: Layout, draw: InstanceDraw, tries: int) -> KnownSchedule | None:
    """Return a schedule that is shorter than the best known one; None if none was found."""
    known = draw.best
    if known is None:
        return None
    random = np.random.default_rng(draw.seed)
    order = [recorded_order.picker for recorded_order in known.orders]
    best = play(layout, True, InOrder(order).orders)
    for _ in range(tries):
        changed = _changed(order, random)
        harvest = play(layout, True, InOrder(changed).orders)
        # An order that takes equally long is kept too: changes of it may be better.
        if _seconds(harvest) <= _seconds(best):
            order = changed
            best = harvest
    seconds = round(_seconds(best), 1)
    if seconds >= known.seconds:
        return None
    found_by = f"a local search of {tries} changes, from {known.found_by}"
    return KnownSchedule(seconds, found_by, True, recorded(best.decisions))


def _seconds(harvest: Played) -> float:
    """Return how long a harvest takes; infinity if it is never finished."""
    if harvest.seconds is None:
        return inf
    return harvest.seconds


def _changed(order: Sequence[str], random: np.random.Generator) -> list[str]:
    """Return an order in which a bin has moved by some places, or two have changed places."""
    changed = [*order]
    place = int(random.integers(len(order)))
    step = int(random.integers(1, FARTHEST + 1)) * int(random.choice([-1, 1]))
    new_place = min(max(place + step, 0), len(order) - 1)
    # Both kinds of change are equally likely.
    if random.random() < 0.5:
        changed.insert(new_place, changed.pop(place))
        return changed
    changed[place] = order[new_place]
    changed[new_place] = order[place]
    return changed


def main(folder: Path, tries: int, names: Sequence[str]) -> None:
    """Search for each instance that is named, and write its file if a schedule is better."""
    known = instances()
    for name in names:
        instance = searched(known[name], tries)
        (folder / f"{name}.json").write_bytes(as_file(instance))
        for draw in instance.draws:
            if draw.best is not None:
                score = 100.0 * draw.proven_seconds / draw.best.seconds
                print(f"{name}: {draw.best.seconds} s, {score:.1f} %, {draw.best.found_by}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
