"""The program of the event model: its ops, beside the steps of plans from which they are made.

An op is a step as a row of numbers, which the machine does. Here ops last as long as their steps.
"""

from typing import Any

import pytest
from quiet import NOBODY, quiet_layouts

from orchard.discrete.harvest import picked_again
from orchard.event_model import picker_plans, start
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.picker_plans import SIDES, end_number
from orchard.event_model.program import Program
from orchard.event_model.program_columns import OP
from orchard.event_model.repeated_parts import PlanPart
from orchard.field.layout import Layout, lay_out
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.plans.jobs import timed_steps
from orchard.plans.route import OneWay
from orchard.plans.routes import route_of
from orchard.plans.steps import Fill

LAYOUTS = list(quiet_layouts(seed=1, count=20))


@pytest.mark.parametrize("layout", LAYOUTS, ids=range(len(LAYOUTS)))
def test_the_ops_of_a_harvest_last_as_long_as_its_steps(layout: Layout) -> None:
    program = Program(layout)
    starts = {start.name: start.pose for start in layout.starts}
    for picker, block in layout.blocks.items():
        plan = list(
            timed_steps(route_of(layout).harvest(block), starts[picker], layout.machines["picker"])
        )
        ticks = program.ticks(program.harvests[picker], program.pass_speeds.in_layout(layout))
        assert ticks == pytest.approx(plan[-1].ends / TIME_STEP)


@pytest.mark.parametrize("layout", LAYOUTS, ids=range(len(LAYOUTS)))
def test_the_ops_of_a_job_last_as_long_as_its_steps(layout: Layout) -> None:
    program = Program(layout)
    route = route_of(layout)
    speeds = program.pass_speeds.in_layout(layout)
    for queue_line in range(len(program.queue_lines)):
        place = queue_line * layout.queue.places
        for lane in layout.lanes:
            for side in SIDES:
                job = route.fetch(place + 1, lane.number, route.sides[side], "picker_01", "bin_01")
                plan = list(timed_steps(job, layout.queue.place(place), layout.machines["carrier"]))
                first = program.translate_job(queue_line, end_number(lane.number, side))
                assert program.ticks(first, speeds) == pytest.approx(plan[-1].ends / TIME_STEP)


def test_a_program_has_each_bin_that_a_harvest_fills() -> None:
    assert [Program(layout).bins for layout in LAYOUTS] == [layout.bins for layout in LAYOUTS]


def test_a_step_that_the_model_does_not_know_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    # The event model knows no `Fill` as a step of a picker's plan.
    def harvest(self: OneWay, block: Block) -> list[Fill]:
        return [Fill(1.0, 1.0)]

    picker_plans._kept.cache_clear()
    monkeypatch.setattr(OneWay, "harvest", harvest)
    with pytest.raises(NotImplementedError, match="does not know the step Fill"):
        Program(lay_out(Scenario(rows=3, pickers=2, carriers=1)))


@pytest.mark.parametrize("layout", LAYOUTS, ids=range(len(LAYOUTS)))
def test_a_part_that_comes_again_is_copied_rightly(
    layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plan in which rows are picked again and again has the ops of its steps one by one."""
    again = picked_again(layout, 7)
    copied = Program(again)
    picker_plans._kept.cache_clear()
    monkeypatch.setattr(PlanPart, "is_of_pass", False)
    assert ops_of(copied) == ops_of(Program(again))


@pytest.mark.parametrize("layout", LAYOUTS, ids=range(len(LAYOUTS)))
def test_fleets_share_the_plans_of_their_pickers(layout: Layout) -> None:
    """A program that goes on from the plans of another fleet is the same as one from scratch."""
    values = layout.scenario.model_dump()
    other = lay_out(Scenario(**values | {"carriers": layout.scenario.carrier_count % 3 + 1}))
    picker_plans._kept.cache_clear()
    alone = Program(layout)
    picker_plans._kept.cache_clear()
    Program(other).translate_all()
    shared = Program(layout)
    assert picker_plans._kept.cache_info().hits == 1
    for program in (alone, shared):
        program.translate_all()
    assert ops_of(shared) == ops_of(alone)
    assert shared.places.array.tolist() == alone.places.array.tolist()
    assert shared.places.bits == alone.places.bits
    assert shared.lines.array.tolist() == alone.lines.array.tolist()
    assert shared.jobs.tolist() == alone.jobs.tolist()


def ops_of(program: Program) -> list[Any]:
    """Return all ops with their gates, the steps of which they are made, and where steps begin."""
    ops = []
    for op in program.ops.plain:
        needs = program.needs.plain[op["first_need"] : op["last_need"]]
        frees = program.frees.plain[op["first_free"] : op["last_free"]]
        columns = [op[name].item() for name in OP.names if not name.startswith(("first_", "last_"))]
        ops.append((columns, needs.tolist(), frees.tolist()))
    return [ops, program.steps, program.begins]


@pytest.mark.parametrize("seed", [2, 4])
def test_a_harvest_is_the_same_after_one_with_another_seed(seed: int) -> None:
    """Seeds share a program, which is kept, though each picks rows at other speeds."""
    values = NOBODY | {
        "rows": 8,
        "pickers": 4,
        "carriers": 3,
        "picking_speed": 0.5,
        "dispatch": "predictive",
        "route": "one-way",
        "rows_to_pickers": "balanced",
        "picking": {"spread": {"distribution": "gamma", "cv": 0.3}},
    }

    def deliveries(of_seed: int) -> list[float]:
        return EventHarvest(lay_out(Scenario(**values, seed=of_seed))).run().deliveries

    start._prepared.cache_clear()
    alone = deliveries(seed)
    start._prepared.cache_clear()
    deliveries(1)
    assert deliveries(seed) == alone
