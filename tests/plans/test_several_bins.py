"""Several bins a row: a bin that fills inside a row is left at its end, and one that is part full
there goes on with the next row.

A pass is one drive of a picker through a row (orchard/field/passes.py). In each pass it picks what
still goes into its bin.
"""

from functools import cache
from itertools import pairwise
from math import ceil
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from local_runs import start_afresh
from made_surveys import UNEQUAL, orchard_of
from stage import Stage, empty_orchard

from orchard.contract.messages import pack
from orchard.field.passes import FULL_WITHIN, ORDERS, outward, passes_of
from orchard.field.rows import Block
from orchard.field.scenario import DISPATCH_POLICIES, ROW_ORDERS, ROW_RULES, Scenario
from orchard.local import Local
from orchard.plans.routes import route_of
from orchard.sim.lookahead import CheckedHolds, Lookahead
from orchard.sim.snapshot import Snapshot
from orchard.tables.exchanges import exchanges

# -- the passes of a picker


@given(
    st.lists(st.tuples(st.floats(-35.5, -20.0), st.floats(-10.0, 100.0)), min_size=1, max_size=6),
    st.floats(5.0, 200.0),
    st.sampled_from(["west", "east"]),
    st.sampled_from(ROW_ORDERS),
)
def test_each_metre_is_picked_once_and_bins_are_full(rows, metres_per_bin, start, order):
    """`rows`: x of the west and of the east end of each row, m.

    `start`: the end at which the picker begins. `order`: the rule that says which part of a row a
    pass picks first.
    """
    block = Block(tuple(range(1, len(rows) + 1)), start)
    passes = passes_of(rows, block, metres_per_bin, ORDERS[order])

    # A picker that starts in the west ends its first pass in the east, and so on.
    ends = ["east", "west"] if start == "west" else ["west", "east"]
    for count, pass_ in enumerate(passes):
        assert pass_.end == ends[count % 2]

    # The parts of a row follow each other without a gap. A part is (its west end, its east end).
    for number, (west, east) in enumerate(rows, start=1):
        parts = sorted(sorted((part.begin, part.stop)) for part in passes if part.row == number)
        assert parts[0][0] == west
        assert parts[-1][1] == east
        for (_, end), (begin, _) in pairwise(parts):
            assert end == pytest.approx(begin)

    # All bins but the last one are full. Each may lack FULL_WITHIN, a micrometre: 1e-4 m is the sum
    # for a hundred bins.
    fills = [pass_.fill for pass_ in passes if pass_.leaves_bin]
    assert passes[-1].leaves_bin
    for pass_ in passes:
        assert pass_.is_full == (pass_.fill >= metres_per_bin - FULL_WITHIN)
    assert fills[:-1] == pytest.approx([metres_per_bin] * (len(fills) - 1))
    assert sum(fills) == pytest.approx(sum(east - west for west, east in rows), abs=1e-4)


# -- harvests


@st.composite
def orchards(draw: st.DrawFn) -> dict[str, Any]:
    """Draw the values of a scenario in which a row may fill several bins."""
    rows = draw(st.integers(3, 12))
    length = draw(st.sampled_from([30.0, 40.0, 70.0, 100.0]))
    return {
        "rows": rows,
        "pickers": draw(st.integers(2, min(rows, 8))),
        "carriers": draw(st.integers(1, 6)),
        "row_length": length,
        "metres_per_bin": draw(
            st.one_of(st.integers(1, 5).map(lambda bins: length / bins), st.floats(5.0, 200.0))
        ),
        "route": draw(st.sampled_from(["one-way", "two-way"])),
        "dispatch": draw(st.sampled_from(DISPATCH_POLICIES)),
        "rows_to_pickers": draw(st.sampled_from(ROW_RULES)),
        "order_in_row": draw(st.sampled_from(ROW_ORDERS)),
        "picking_speed": draw(st.sampled_from([1.0, 0.5, 0.2, 0.05])),
        "seed": draw(st.integers(1, 1000)),
    }


def in_turn(first: float, last: float, metres: float) -> float:
    """Return where a pass begins, as a user's own rule for the order in a row, x in m.

    It begins at one edge of what is unpicked or ends at the other one, as the whole metres that are
    left are odd or even. `metres`: what the pass picks.
    """
    if round(abs(last - first)) % 2 == 1:
        return first
    return outward(first, last, metres)


# No harvest here is longer: a bound, so that one that never ends fails.
MOST_TICKS = 2_000_000


def harvested(scenario: Scenario, holds: type[Lookahead] = Lookahead, kill_every: int = 0) -> Stage:
    """Harvest a scenario to its end.

    `holds`: the class that says which agents are asked; CheckedHolds asks all, and fails if one
    that holds its velocity would have given another. `kill_every`: ticks after which new agents
    take the place of all; 0: never.
    """
    stage = Stage(scenario, holds=holds)
    while kill_every and not stage.local.engine.over and stage.world.tick < MOST_TICKS:
        stage.run(kill_every / 10)
        start_afresh(stage.local)
    stage.run_to_the_end(200_000.0)
    return stage


def assert_all_is_picked_into_bins_and_delivered(stage: Stage) -> None:
    stage.assert_no_collisions()
    world = stage.world
    layout = stage.world.layout
    scenario = stage.world.layout.scenario
    # The metres of row that each picker has: the last bin of a picker may be part full.
    metres_of_pickers = []
    for block in layout.blocks.values():
        metres_of_pickers.append(sum(layout.lane(row).length for row in block.rows))
    # Less than a micrometre more than whole bins begins no further bin.
    bins = sum(ceil(metres / scenario.metres_per_bin - 1e-6) for metres in metres_of_pickers)
    assert world.row_picked.tolist() == pytest.approx([lane.length for lane in layout.lanes])
    assert layout.bins == bins
    assert world.delivered == bins
    assert world.delivered_metres == pytest.approx(sum(metres_of_pickers))

    fields = ("tick", "what", "who", "whom", "detail")
    events = [{name: getattr(event, name) for name in fields} for event in stage.events]
    done = exchanges(events)
    assert len(done) == bins
    # An event has its metres to a centimetre.
    metres = sum(exchange["metres"] for exchange in done)
    assert metres == pytest.approx(sum(metres_of_pickers), abs=0.01 * bins)
    for exchange in done:
        assert exchange["left"]
        assert exchange["brought"]
        assert exchange["fetched"]
        assert exchange["unloaded"]


# A picker breaks down once a minute on average, and is repaired in 20 s.
FAILURE = {"failure": {"mean_between": 60.0, "mean_repair": 20.0}}
# Positions are off by 2 cm of noise, and by a bias of 3 cm.
GNSS = {"gnss": {"white": 0.02, "bias": 0.03}}
# What differs from an orchard of 3 rows of 30 m and 4 carriers, by the keys of a scenario.
HARVESTS: dict[str, dict[str, Any]] = {
    "bins that go on with the next row": {"metres_per_bin": 12.0},
    "bins that are full where the row ends": {"metres_per_bin": 12.0, "order_in_row": "outward"},
    "an order of the user's own": {
        "metres_per_bin": 7.0,
        "order_in_row": "test_several_bins.in_turn",
    },
    "bins larger than rows": {
        "rows": 4,
        "carriers": 1,
        "metres_per_bin": 50.0,
        "dispatch": "nearest",
    },
    "two-way, and from both ends": {
        "pickers": 3,
        "carriers": 2,
        "metres_per_bin": 16.0,
        "picking_speed": 0.3,
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    },
    "pickers that fail": {
        "metres_per_bin": 11.0,
        "order_in_row": "outward",
        "picking_speed": 0.2,
        "picking": FAILURE,
        "dispatch": "assignment",
    },
    "sensors with errors": {"pickers": 3, "carriers": 3, "metres_per_bin": 20.0, "sensors": GNSS},
    "outward, and sensors with errors": {
        "carriers": 2,
        "metres_per_bin": 20.0,
        "order_in_row": "outward",
        "sensors": GNSS,
    },
    "surveyed rows": {"metres_per_bin": 14.0, "order_in_row": "outward"},
}


def harvest_of(name: str) -> Scenario:
    """Return the scenario of one of HARVESTS."""
    values = {"carriers": 4, **HARVESTS[name]}
    if name == "surveyed rows":
        return orchard_of(UNEQUAL, **values)
    return empty_orchard(row_length=30.0, **values)


@cache
def snapshots_of(name: str) -> tuple[Stage, list[Snapshot]]:
    """Harvest to the end. Return the stage, and snapshots on the way and at the end.

    A snapshot is taken every 1,500 ticks, and first at tick 700, in the middle of the first pass.
    """
    stage = Stage(harvest_of(name), is_hashed=True)
    kept = []
    while not stage.local.engine.over and stage.world.tick < MOST_TICKS:
        stage.tick()
        if stage.world.tick % 1500 == 700:
            kept.append(stage.local.snapshot())
    assert stage.local.engine.violations() == []
    return stage, [*kept, stage.local.snapshot()]


@pytest.mark.parametrize("name", HARVESTS)
def test_all_is_picked_into_bins_and_delivered(name):
    assert_all_is_picked_into_bins_and_delivered(snapshots_of(name)[0])


def test_no_hold_is_wrong():
    """A hold is how long an agent's velocity stands without its being asked."""
    assert_all_is_picked_into_bins_and_delivered(
        harvested(harvest_of("two-way, and from both ends"), CheckedHolds)
    )


@pytest.mark.soak
@settings(max_examples=60, phases=[Phase.generate])
@given(orchards(), st.sampled_from([Lookahead, CheckedHolds]), st.sampled_from([0, 7, 100, 1011]))
def test_random_harvests_finish_without_a_collision(values, holds, kill_every):
    assert_all_is_picked_into_bins_and_delivered(
        harvested(empty_orchard(**values), holds, kill_every)
    )


@pytest.mark.parametrize(
    "name", ["bins that go on with the next row", "bins that are full where the row ends"]
)
def test_a_run_resumes_anywhere_to_the_same_hash(name):
    """From each snapshot the run goes on, with other agents.

    Each stretch ends with the state, memories and mail with which the next one begins.
    """
    _, snapshots = snapshots_of(name)
    for begin, end in pairwise(snapshots):
        resumed = Local.resume(begin)
        while resumed.engine.tick < end.world["tick"]:
            if resumed.engine.tick % 250 == 0:
                start_afresh(resumed)
            resumed.tick()
        reached = resumed.snapshot()
        assert reached.digest == end.digest
        assert reached.memories == end.memories
        assert reached.letters == end.letters
        assert resumed.engine.violations() == []


def test_a_picker_remembers_few_steps_however_many_bins_it_fills():
    """Its whole plan has thousands of steps: 40 bins a row. Its memory, in bytes, has only the next
    ones.
    """
    stage = Stage(empty_orchard(rows=20, row_length=200.0, metres_per_bin=5.0))
    stage.run(5.0)
    layout = stage.world.layout
    assert len(route_of(layout).harvest(layout.blocks["picker_01"])) > 5000
    assert len(pack(stage.local.memories["picker_01"])) < 8192


# s of a picker from a row's end out, around and back into the row: 6.5 s out, two turns of 4 s, two
# answers of 0.2 s, and 6.5 s back in the east, 8.5 s in the west. So 21.4 s or 23.4 s.
TURN_AROUND = 22.4


@pytest.mark.parametrize(
    ("metres_per_bin", "bins", "seconds"),
    [(None, 3, 0.0), (70.0, 3, 0.0), (17.5, 12, 3 / 4 * (70.0 + TURN_AROUND))],
    ids=["a bin a row", "bins of a row's length", "four bins a row"],
)
def test_the_summary_has_the_cost_of_drives_to_row_ends(metres_per_bin, bins, seconds):
    """With four bins a row there are three more drives through 70 m at 1 m/s, and three more turns.

    `seconds` are for each of the four bins. With them a third of a picker's time goes there.
    """
    stage = Stage(empty_orchard(pickers=3, metres_per_bin=metres_per_bin))
    figures = stage.account.figures()
    assert figures["bins"] == bins
    assert figures["row_end_seconds"] == pytest.approx(seconds, abs=0.1)
    assert (figures["row_end_share"] > 0.3) == (seconds > 0.0)
