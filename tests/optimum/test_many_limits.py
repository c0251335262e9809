"""No harvest is shorter than what is proven of it, and no long run faster than its limit: random
orchards of all kinds, in the event model.
"""

from collections.abc import Iterator
from math import isnan, nan
from random import Random
from statistics import fmean
from typing import Any

import pytest

pytest.importorskip("ortools", reason="the extra `optimum` is not installed")
from drawn_machines import drawn_values
from quiet import NOBODY, laid_out

from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.field.layout import Layout, lay_out
from orchard.field.queue import QUEUES
from orchard.field.scenario import DISPATCH_POLICIES, ROW_RULES
from orchard.optimum.schedule import optimum
from orchard.report.bounds import Bounds, proven_seconds, undisturbed
from orchard.report.long_run import long_run

# The work of the solver for each proof with roads that robots share, in its own unit: about s.
WORK = 0.02
# Orchards of the soak.
MANY = 300
# A rate that a long run has brought down to what the truck allows may be above it by this share.
ROUNDING = 1e-12


def all_kinds(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many orchards. Each has a few of what an orchard may have beside rows and roads."""
    chances = Random(f"limits {seed}")

    def drawn() -> dict[str, Any]:
        """Draw the values of a scenario. Each kind of more has a chance of 40 %."""
        values = _sizes(chances)
        for more in (_batteries, _load_out, _people):
            if chances.random() < 0.4:
                values |= more(chances)
        machines = drawn_values(chances) if chances.random() < 0.4 else {}
        for group, parts in machines.items():
            values[group] = values.get(group, {}) | parts
        return values

    return laid_out(drawn, count)


def _sizes(chances: Random) -> dict[str, Any]:
    rows = chances.randint(2, 12)
    values = NOBODY | {
        "rows": rows,
        "row_length": float(chances.randint(20, 120)),
        "row_width": chances.choice([3.65, 4.57, 6.0]),
        "pickers": chances.randint(1, min(rows, 8)),
        "carriers": chances.randint(1, 10),
        "picking_speed": chances.choice([1.0, 0.5, 0.2, 0.05]),
        "route": chances.choice([*QUEUES]),
        "rows_to_pickers": chances.choice(ROW_RULES),
        "order_in_row": chances.choice(["onward", "outward"]),
        "dispatch": chances.choice(DISPATCH_POLICIES),
        "seed": chances.randint(1, 1000),
    }
    if chances.random() < 0.4:
        values["metres_per_bin"] = float(chances.choice([11, 17.5, 30, 55, 100]))
    return values


def _batteries(chances: Random) -> dict[str, Any]:
    battery = {
        "hours": chances.choice([0.2, 0.5, 2.0]),
        "hours_to_charge": chances.choice([0.02, 0.1, 0.5]),
        "reserve": chances.choice([0.2, 0.5, 0.8]),
    }
    return {"chargers": chances.randint(1, 4), "carrying": {"battery": battery}}


def _load_out(chances: Random) -> dict[str, Any]:
    bins = chances.randint(1, 4)
    load_out: dict[str, Any] = {"seconds_away": float(chances.randint(0, 400))}
    kind = chances.choice(["carriers", "trailers", "truck"])
    if kind == "trailers":
        load_out["trailers"] = {"count": chances.randint(1, 3), "bins": bins}
    elif kind == "truck":
        load_out = {"truck": {"every": float(chances.randint(60, 600)), "bins": bins}}
    if kind != "carriers" and chances.random() < 0.5:
        load_out["empty_bins"] = bins + chances.randint(0, 4)
    return {"load_out": load_out}


def _people(chances: Random) -> dict[str, Any]:
    return {
        "people": {"workers": chances.randint(0, 6), "visitors": chances.randint(0, 2)},
        "animals": {"dogs": chances.randint(0, 2), "cats": chances.randint(0, 2)},
    }


def assert_no_limit_is_passed(layout: Layout) -> tuple[float, float]:
    """Compare a harvest and a long run with their limits.

    Return the proven seconds as a share of the harvest's, and the rate as a share of its limit; nan
    where robots wait for each other.
    """
    shares = [nan, nan]
    harvest = DiscreteHarvest(layout).run()
    if harvest.is_over:
        free = proven_seconds(layout)
        assert free is not None
        proven = optimum(lay_out(undisturbed(layout.scenario)), WORK).proven_seconds
        assert free <= harvest.seconds
        assert proven <= harvest.seconds
        shares[0] = max(free, proven) / harvest.seconds
    try:
        rate = long_run(layout).bins_per_hour
    except Jam:
        return shares[0], shares[1]
    share = rate / Bounds(layout).bins_per_hour
    assert share <= 1.0 + ROUNDING
    return shares[0], share


def test_no_harvest_of_any_kind_passes_its_limits() -> None:
    for layout in all_kinds(1, 4):
        assert_no_limit_is_passed(layout)


def with_absences(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many orchards of which most pickers are away once, twice or thrice, for seconds or
    for hours, from the beginning or from any time on.
    """
    chances = Random(f"absences {seed}")

    def drawn() -> dict[str, Any]:
        values = _sizes(chances)
        values["picking_speed"] = chances.choice([0.2, 0.05, 0.02])
        absences = {}
        for number in range(1, values["pickers"] + 1):
            hours = []
            at = 0.0
            for _ in range(chances.choice([0, 1, 1, 2, 3])):
                begin = at + chances.choice([0.0, 0.3, 1.0]) * chances.random()
                at = begin + chances.choice([0.03, 0.3, 3.0]) * (0.1 + chances.random())
                hours.append([round(begin, 3), round(at, 3)])
                at += 0.02
            if hours:
                absences[f"picker_{number:02d}"] = hours
        failure = chances.choice([{}, {"mean_between": 300.0, "mean_repair": 60.0}])
        return values | {"picker_absences": absences, "picking": {"failure": failure}}

    return laid_out(drawn, count)


def absence_shares(layouts: Iterator[Layout]) -> tuple[list[float], list[float]]:
    """Check that no harvest is shorter than what is proven.

    Return the proven seconds as a share of the harvest's, and the same if nobody is away.
    """
    shares = []
    if_present = []
    for layout in layouts:
        harvest = DiscreteHarvest(layout).run()
        if harvest.is_over:
            proven = optimum(lay_out(undisturbed(layout.scenario)), WORK).proven_seconds
            assert proven <= harvest.seconds, layout.scenario
            shares.append(proven / harvest.seconds)
            present = undisturbed(layout.scenario, picker_absences={})
            if_present.append(optimum(lay_out(present), WORK).proven_seconds / harvest.seconds)
    return shares, if_present


def test_no_harvest_with_absences_is_shorter_than_proven() -> None:
    """And the proof knows of the absences: it comes nearer to these harvests."""
    shares, if_present = absence_shares(with_absences(1, 12))
    assert fmean(shares) > fmean(if_present) + 0.1


@pytest.mark.soak
def test_soak_no_harvest_of_300_with_absences_beats_proofs() -> None:
    shares, if_present = absence_shares(with_absences(2, MANY))
    print(f"proven: {fmean(shares):.3f} of the harvest on average, {min(shares):.3f} at least")
    print(f"without absences: {fmean(if_present):.3f} on average, {min(if_present):.3f} at least")


@pytest.mark.soak
def test_soak_no_harvest_of_300_passes_its_limits() -> None:
    harvests = []
    rates = []
    for layout in all_kinds(2, MANY):
        harvest, rate = assert_no_limit_is_passed(layout)
        harvests.append(harvest)
        rates.append(rate)
    for name, shares in (("proven / harvest", harvests), ("long run / limit", rates)):
        known = sorted(share for share in shares if not isnan(share))
        middle = known[len(known) // 2]
        print(f"{name}: {len(known)} of {MANY}, middle {middle:.3f}, most {known[-1]:.3f}")
