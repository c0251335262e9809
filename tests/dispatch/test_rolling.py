"""The dispatch policy `rolling`: what it gains, what it foresees, and that it leaves no picker out.

At each decision it lets a coarse model, the roll-out, carry on the harvest for each bin that could
get the carrier, and takes the bin with which the harvest ends first. A course is the way of a
picker from one bin to the next.
"""

from collections import Counter
from typing import Any

import pytest
from stage import empty_orchard

from orchard import Assignment, BinReport, CarrierReport, lay_out
from orchard.contract.messages import pack, unpack
from orchard.discrete.harvest import DiscreteHarvest
from orchard.dispatch.rolling import AHEAD, NextBin, Rolling
from orchard.dispatch.rollout import AWAY, RollOut
from orchard.field.scenario import TIME_STEP

# Orchards in which carriers are short, so that it matters where they go.
LOADED: list[dict[str, Any]] = [
    {"rows": 10, "pickers": 5, "carriers": 5},
    {"rows": 16, "pickers": 16, "carriers": 12},
    {"rows": 20, "pickers": 10, "carriers": 7, "picking_speed": 0.3},
]
HEAD = CarrierReport("carrier_01", "", True, 0.0)


def orchard(**values: Any) -> Any:
    """Return a small orchard with the policy `rolling`."""
    return lay_out(
        empty_orchard(
            **{"dispatch": "rolling", "route": "two-way", "rows_to_pickers": "balanced-ends"}
            | values
        )
    )


@pytest.mark.parametrize("values", LOADED)
def test_it_makes_harvests_shorter_in_which_carriers_are_short(values):
    """By 5 % at least, beside `predictive`."""
    rolling = DiscreteHarvest(orchard(**values)).run().seconds
    predictive = DiscreteHarvest(orchard(**values, dispatch="predictive")).run().seconds
    assert rolling < 0.95 * predictive


@pytest.mark.parametrize("values", LOADED)
def test_it_foresees_when_all_bins_are_home(values, monkeypatch):
    """The value of a bin is the tick at which all bins are home if it is served next. The least of
    the first values is the end as it is foreseen at the first decision.
    """
    ends = list[float]()
    value = Rolling.value

    def noted(policy, report, line, plan):
        ends.append(value(policy, report, line, plan))
        return ends[-1]

    monkeypatch.setattr(Rolling, "value", noted)
    seconds = DiscreteHarvest(orchard(**values)).run().seconds
    assert min(ends[:5]) / 10 == pytest.approx(seconds, rel=0.15)


def test_the_first_of_several_lines_leaves_first():
    policy = Rolling(orchard(rows=20, pickers=10, carriers=10))
    lines = sorted(set(policy.lines.values()))
    plan = RollOut(policy.courses, policy.lines.values(), 0, dict.fromkeys(policy.courses, 1))
    for picker in policy.courses:
        plan.come_out(picker, 0, stop=0)
    plan.go_on(lines)
    plan.run(1)
    # In the first tick one carrier leaves from each of the four lines.
    assert [robot.line for robot in plan.robots if robot.line != AWAY] == lines
    assert lines == [0, 1, 2, 3]


def test_it_decides_as_predictive_where_it_cannot_look_ahead():
    """It cannot with many pickers, in the long run, and on roads that it does not know."""
    many = orchard(rows=30, pickers=21, carriers=4)
    most = orchard(rows=30, pickers=20, carriers=4)
    unknown = orchard(
        rows=4, pickers=2, carriers=2, route="examples.seams.signalled_route.SignalledRoute"
    )
    again = DiscreteHarvest(orchard(rows=4, pickers=2, carriers=2), rows_each=6).layout
    assert [bool(Rolling(layout).courses) for layout in (many, unknown, again, most)] == [
        False,
        False,
        False,
        True,
    ]


def test_no_picker_is_left_out_while_others_go_on():
    """There is one carrier for three pickers of twelve rows each. No picker may get more than
    `AHEAD` bins more than another one.
    """
    layout = orchard(rows=36, pickers=3, carriers=1, row_length=30.0)
    exchanges = list[tuple[int, str]]()
    for picker, of_picker in DiscreteHarvest(layout).run().exchanges.items():
        exchanges += [(exchange.tick, picker) for exchange in of_picker]
    # Picker -> bins so far; and by how many the first picker is ahead of the last one.
    served = Counter[str]()
    ahead = list[int]()
    for _, picker in sorted(exchanges):
        served[picker] += 1
        ahead.append(max(served.values()) - min(served[name] for name in layout.blocks))
    assert set(served.values()) == {12}
    assert max(ahead) <= AHEAD


def test_a_bin_whose_carrier_does_not_come_gets_another():
    """The bin is still there 30 s after carrier_01 was sent. Both trips are for the first bin of
    the picker, number 0; its next bin is number 1.
    """
    policy = Rolling(orchard(rows=4, pickers=2, carriers=2))
    memory = policy.Memory()
    report = BinReport("bin_01", 1, "east", "picker_01", since=900, metres=30.0)
    assert policy.assign(900, [report], [HEAD], memory) == [Assignment("bin_01", "carrier_01")]
    memory = unpack(pack(memory), policy.Memory)
    assert policy.assign(1200, [report], [CarrierReport("carrier_02", "", True, 0.0)], memory) == [
        Assignment("bin_01", "carrier_02")
    ]
    assert memory.trips["carrier_01"].bin.number == memory.trips["carrier_02"].bin.number
    assert memory.trips["carrier_02"].bin.number == 0
    assert memory.after["picker_01"].number == 1


def test_the_bin_after_a_trip_is_expected_once_it_is_picked():
    """A carrier is sent for the first bin. The next bin is full after its row has been picked."""
    layout = orchard(rows=4, pickers=2, carriers=2, picking_speed=0.1)
    policy = Rolling(layout)
    memory = policy.Memory()
    report = BinReport("bin_01", 1, "east", "picker_01", since=900, metres=30.0)
    policy.assign(900, [report], [HEAD], memory)
    first, second = layout.blocks["picker_01"].rows[:2]
    assert first == 1
    lane = layout.lane(second)
    picking_ticks = lane.length / lane.picking_speed / TIME_STEP
    assert memory.after["picker_01"].stop > 900 + picking_ticks


def test_after_its_last_bin_a_picker_has_none_to_expect():
    """`after`: the bin that the policy expects next of a picker: its number, from 0, and a tick."""
    policy = Rolling(orchard(rows=4, pickers=2, carriers=2))
    courses = policy.courses["picker_01"]
    last = courses[-1].job
    memory = policy.Memory(after={"picker_01": NextBin(len(courses) - 1, 0)})
    report = BinReport("bin_01", last.lane, last.side, "picker_01", since=900, metres=30.0)
    policy.assign(900, [report], [HEAD], memory)
    assert memory.after["picker_01"].number == len(courses)
