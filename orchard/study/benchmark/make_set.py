"""Makes the files of the public instances: `python -m orchard.study.benchmark.make_set FOLDER`.

It proves the bounds, which takes long, and looks for the best schedules.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from math import factorial
from operator import attrgetter
from pathlib import Path

from msgspec.structs import replace

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.dispatch.ranking import MARGIN, free_carriers
from orchard.event_model.policies import AskedPolicy
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import DISPATCH_POLICIES, NEAREST, check, with_changes
from orchard.study.benchmark.bounds import bounds_of
from orchard.study.benchmark.families import PUBLIC_SECRETS, scenarios_of
from orchard.study.benchmark.instances import (
    Instance,
    KnownSchedule,
    as_file,
    instance_of,
    recorded,
)
from orchard.study.benchmark.play import Decide, play
from orchard.study.benchmark.seen import layout_seen, nothing_drawn

# Bins can be fetched in many orders. If there are at most so many, all are tried. Two bins of each
# of four pickers have 8! / 2!^4 = 2,520 orders.
MOST_ENUMERATED = 3000


def with_schedules(instance: Instance) -> Instance:
    """Return an instance with the best schedule of each seed that was found."""
    draws = []
    for draw in instance.draws:
        layout = lay_out(instance.of_seed(draw.seed))
        best = min(_tried(layout), key=attrgetter("seconds"))
        draws.append(replace(draw, best=best))
    return replace(instance, draws=draws)


def _tried(layout: Layout) -> Iterator[KnownSchedule]:
    """Yield the schedules of all policies, and in a small orchard those of all orders."""
    seen = nothing_drawn(layout.scenario)
    for policy in DISPATCH_POLICIES:
        if policy != NEAREST:
            asked = AskedPolicy(layout_seen(with_changes(seen, dispatch=policy)))
            yield from _schedule(layout, policy, asked.is_early, asked.orders)
    bins = {}
    for picker, block in layout.blocks.items():
        bins[picker] = sum(row_pass.leaves_bin for row_pass in layout.passes(block))
    if orders_of(bins) > MOST_ENUMERATED:
        return
    found_by = f"all orders of {sum(bins.values())} bins"
    for order in _orders(bins):
        yield from _schedule(layout, found_by, True, InOrder(order).orders)


def orders_of(bins: Mapping[str, int]) -> int:
    """Return in how many orders bins can be fetched. `bins`: picker -> how many."""
    count = factorial(sum(bins.values()))
    for number in bins.values():
        count //= factorial(number)
    return count


def _orders(bins: Mapping[str, int]) -> Iterator[list[str]]:
    """Yield the pickers in all orders in which their bins can be fetched."""
    if not any(bins.values()):
        yield []
    for picker, number in bins.items():
        if number > 0:
            for rest in _orders({**bins, picker: number - 1}):
                yield [picker, *rest]


def _schedule(
    layout: Layout, found_by: str, is_early: bool, decide: Decide
) -> Iterator[KnownSchedule]:
    """Yield the schedule of a policy; none if its harvest is never finished."""
    harvest = play(layout, is_early, decide)
    if harvest.seconds is not None:
        orders = recorded(harvest.decisions)
        yield KnownSchedule(round(harvest.seconds, 1), found_by, is_early, orders)


class InOrder:
    """A policy that serves pickers in a given order. A carrier leaves so that it arrives when the
    bin is full.
    """

    def __init__(self, pickers: Sequence[str]) -> None:
        """`pickers`: the picker of each bin, in the order in which bins are fetched."""
        self._pickers = [*pickers]

    def orders(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return the orders at a tick: those of the next bins, as far as it is time for them."""
        orders = []
        waiting = {report.picker: report for report in bins}
        for carrier in free_carriers(carriers):
            if not self._pickers:
                break
            report = waiting.get(self._pickers[0])
            if report is None or report.seconds_to_full - report.seconds_to_reach > MARGIN:
                break
            orders.append(Assignment(report.name, carrier.name))
            del self._pickers[0]
        return orders


def main(folder: Path) -> None:
    """Write the files of the public instances that are not in the folder yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for split, secret in PUBLIC_SECRETS.items():
        for name, values in scenarios_of(split, secret).items():
            file = folder / f"{name}.json"
            if file.exists():
                continue
            instance = instance_of(name, split, values, bounds_of(check(values, name)))
            file.write_bytes(as_file(with_schedules(instance)))
            print(name, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
