"""Makes the files of the public instances: `python -m orchard.study.benchmark.make_set FOLDER`.

It proves the bounds, which takes long, and looks for the best schedules.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import permutations
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

# Of an orchard with so few bins all orders are tried.
MOST_ENUMERATED = 4


def with_schedules(instance: Instance) -> Instance:
    """Return an instance with the best schedule of each seed that was found."""
    draws = []
    for draw in instance.draws:
        layout = lay_out(instance.of_seed(draw.seed))
        found = list(_tried(layout))
        best = min(found, key=lambda schedule: schedule.seconds)
        draws.append(replace(draw, best=best))
    return replace(instance, draws=draws)


def _tried(layout: Layout) -> Iterator[KnownSchedule]:
    """Yield the schedules of all policies, and in a small orchard those of all orders."""
    seen = nothing_drawn(layout.scenario)
    for policy in DISPATCH_POLICIES:
        if policy != NEAREST:
            asked = AskedPolicy(layout_seen(with_changes(seen, dispatch=policy)))
            yield from _schedule(layout, policy, asked.is_early, asked.orders)
    if layout.bins > MOST_ENUMERATED:
        return
    pickers = sorted(layout.blocks)
    for order in permutations(pickers):
        for slack in (MARGIN, 1e9):
            found_by = f"all orders of {len(pickers)} pickers"
            yield from _schedule(layout, found_by, True, InOrder(order, slack).orders)


def _schedule(
    layout: Layout, found_by: str, is_early: bool, decide: Decide
) -> Iterator[KnownSchedule]:
    """Yield the schedule of a policy, if its harvest is finished."""
    harvest = play(layout, is_early, decide)
    if harvest.seconds is not None:
        orders = recorded(harvest.decisions)
        yield KnownSchedule(round(harvest.seconds, 1), found_by, is_early, orders)


class InOrder:
    """Serves pickers in an order, each once."""

    def __init__(self, pickers: Sequence[str], slack: float) -> None:
        """`slack`: s before a bin is full at which a carrier leaves, beside its way."""
        self._pickers = [*pickers]
        self._slack = slack

    def orders(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return the next orders."""
        orders = []
        waiting = {report.picker: report for report in bins}
        for carrier in free_carriers(carriers):
            report = waiting.get(self._pickers[0]) if self._pickers else None
            if report is None or report.seconds_to_full - report.seconds_to_reach > self._slack:
                break
            orders.append(Assignment(report.name, carrier.name))
            del self._pickers[0]
        return orders


def main(folder: Path) -> None:
    """Write the files that are not there."""
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
