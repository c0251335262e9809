"""The traffic plan at any spacing: what two robots sweep where rows end is apart, or both need one
place, and so are never there together.

The spacing is the distance from row to row, m, from centre line to centre line. A crew is how many
rows and bins the pickers have. tests/support/sweeps.py finds the sweeps.
"""

from itertools import product

import numpy as np
import pytest
from made_surveys import Row, orchard_of
from stage import empty_orchard
from sweeps import bounds, collisions, in_words, sweeps_at_rows
from walks import walks_of

from orchard.field.layout import X_WEST, lay_out
from orchard.field.queue import ONE_WAY, TWO_WAY
from orchard.field.rows import RULES
from orchard.field.scenario import Scenario
from orchard.field.survey import CLOSEST, FURTHEST, NARROWEST_ROW, TRUNK, WIDEST_ROW
from orchard.field.walls import FENCE_THICKNESS

FROM_THE_EAST = "examples.seams.from_the_east.from_the_east"
# Neighbours that leave their rows at one end, or at both, and bins that fill inside a row.
CREWS = {
    "a row each": {"rows": 4, "pickers": 4},
    "two rows each": {"rows": 6, "pickers": 3},
    "several bins a row": {"rows": 4, "pickers": 2, "bins_per_row": 1.7},
}
NARROWEST = NARROWEST_ROW + TRUNK
EVERY_5_CM = [
    round(spacing, 2)
    for spacing in np.arange(min(NARROWEST, CLOSEST), WIDEST_ROW + TRUNK + 0.001, 0.05)
]
# Every 15 cm of the close spacings: from each of these to the next another pair of sweeps comes
# apart.
CLOSE = [spacing for spacing in EVERY_5_CM if spacing <= 5.5 and round(spacing * 20) % 3 == 1]
SOME = [EVERY_5_CM[0], *CLOSE, 5.5, 7.0, 9.35, EVERY_5_CM[-1]]
# m that a turn keeps off fences; a robot's laser stops it at less.
CLEAR_OF_FENCE = 0.2


def spaced(spacing: float, route: str, crew: str, rule: str) -> Scenario:
    """Return rows that lie so far apart, drawn if that is allowed, else surveyed."""
    sizes = dict(CREWS[crew])
    changes = {"carriers": 9, "route": route, "rows_to_pickers": rule}
    if spacing >= NARROWEST:
        width = round(spacing - TRUNK, 2)
        return empty_orchard(row_width=width, row_length=40.0, **sizes, **changes)
    rows = [Row(round(spacing * i, 2), 0.0, 40.0) for i in range(sizes.pop("rows"))]
    return orchard_of(rows, **sizes, **changes)


def assert_apart(scenario: Scenario) -> None:
    """Assert that no two robots that may meet sweep the same place."""
    pairs = collisions(lay_out(scenario))
    assert not pairs, in_words(pairs)


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
@pytest.mark.parametrize("spacing", SOME)
def test_sweeps_at_some_spacings_are_apart(spacing: float, route: str) -> None:
    for crew in CREWS:
        assert_apart(spaced(spacing, route, crew, rule="balanced-ends"))


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
@pytest.mark.parametrize("spacing", SOME)
def test_no_turn_comes_near_a_fence(spacing: float, route: str) -> None:
    """Bins fill inside a row, so a picker comes back to the row at either end."""
    for crew, rule in product(CREWS, (*RULES, FROM_THE_EAST)):
        layout = lay_out(spaced(spacing, route, crew, rule))
        half = FENCE_THICKNESS / 2
        for sweep in sweeps_at_rows(layout):
            if sweep.what != "turn":
                continue
            west, east, south, north = bounds(sweep.boxes)
            assert west - (X_WEST + half) > CLEAR_OF_FENCE, sweep
            assert layout.east - half - east > CLEAR_OF_FENCE, sweep
            assert south - (layout.bottom + half) > CLEAR_OF_FENCE, sweep
            assert layout.top - half - north > CLEAR_OF_FENCE, sweep


@pytest.mark.soak
@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
@pytest.mark.parametrize("spacing", EVERY_5_CM)
def test_soak_sweeps_at_every_spacing_are_apart(spacing: float, route: str) -> None:
    for crew in CREWS:
        for rule in (*RULES, FROM_THE_EAST):
            assert_apart(spaced(spacing, route, crew, rule))


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
@pytest.mark.parametrize("spacing", [NARROWEST, 3.8, 4.2, 5.0, 5.5])
def test_each_place_is_given_back(spacing: float, route: str) -> None:
    for crew in CREWS:
        layout = lay_out(spaced(spacing, route, crew, rule="balanced-ends"))
        for walk in walks_of(layout):
            assert not walk.places, walk.robot


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
def test_sweeps_at_unequal_rows_are_apart(route: str) -> None:
    # x of both ends of each row, and the spacing to the next row, m.
    ends = ((0.0, 64.0), (1.3, 63.1), (2.6, 62.6), (0.9, 63.9), (3.0, 60.0), (0.0, 64.0))
    gaps = (CLOSEST, FURTHEST, CLOSEST, CLOSEST, 8.4)
    rows = []
    for i, (start, end) in enumerate(ends):
        rows.append(Row(round(sum(gaps[:i]), 2), start, round(end - start, 2)))
    for pickers in (3, 6):
        for rule in ("balanced-ends", FROM_THE_EAST):
            crew = {"pickers": pickers, "carriers": 9, "rows_to_pickers": rule}
            assert_apart(orchard_of(rows, route=route, **crew))


def test_two_loops_that_share_no_place_collide(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search finds what it looks for.

    Here a carrier stops 3.2 m past its lane instead of 1.9 m, and so its loop reaches the next one.
    """
    monkeypatch.setattr("orchard.plans.route.OneWay.STOP", 3.2)
    layout = lay_out(spaced(5.5, TWO_WAY, "a row each", rule="balanced-ends"))
    assert collisions(layout)


def test_a_hold_behind_the_entry_is_needed_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A carrier enters the full-bin road north of the point at which it would wait for the lane.

    The point is 5.9 m before the lane here, not 3.85 m. So the carrier must have the lane's place
    before it enters.
    """
    monkeypatch.setattr("orchard.plans.two_way.TwoWay.F_HOLD", 5.9)
    assert_apart(spaced(5.5, TWO_WAY, "a row each", rule="balanced-ends"))
