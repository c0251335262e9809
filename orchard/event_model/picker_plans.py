"""The plans of all pickers of an orchard, translated into ops.

They are most of a program, and have nothing of the carriers. So fleets that are compared with the
same pickers share them: each program goes on from a copy.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from orchard.event_model import program_columns
from orchard.event_model.pass_speeds import PassSpeeds
from orchard.event_model.tables import Table
from orchard.event_model.translator import PlanTranslator
from orchard.event_model.writer import Writer
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.layout_key import Geometry
from orchard.plans.route import OneWay
from orchard.plans.routes import ROUTES, route_of

SIDES = ("east", "west")


@dataclass(frozen=True)
class PickerPlans:
    """The plans of all pickers, and the translator that knows their ops, places and lines."""

    translator: PlanTranslator
    passes: Table
    pass_speeds: PassSpeeds
    #: Bins that all pickers fill.
    bins: int
    #: Picker -> the ops at which its plan begins and ends.
    first_ops: Mapping[str, int]
    last_ops: Mapping[str, int]


def picker_plans(layout: Layout, route: OneWay) -> PickerPlans:
    """Return the plans of an orchard's pickers, with a translator that may translate more.

    Raises NotImplementedError for a step that the event model does not know, and for a route with
    very many places.
    """
    if layout.scenario.route not in ROUTES:
        # A user's own code may read how many carriers there are.
        return _translated(layout, route)
    plans = _kept(Geometry.of_pickers(layout))
    return PickerPlans(
        translator=plans.translator.copy_for(layout, route),
        passes=plans.passes,
        pass_speeds=plans.pass_speeds,
        bins=plans.bins,
        first_ops=plans.first_ops,
        last_ops=plans.last_ops,
    )


def end_number(row: int, side: str) -> int:
    """Return the number of a lane's end."""
    return 2 * (row - 1) + SIDES.index(side)


@lru_cache(maxsize=KEPT_LAYOUTS)
def _kept(geometry: Geometry) -> PickerPlans:
    return _translated(geometry.layout, route_of(geometry.layout))


def _translated(layout: Layout, route: OneWay) -> PickerPlans:
    """Translate the plans of all pickers."""
    translator = PlanTranslator(layout, route)
    passes = Table(program_columns.PASS)
    pass_speeds = PassSpeeds()
    bins = 0
    first_ops = {}
    last_ops = {}
    starts = {start.name: start.pose for start in layout.starts}
    for picker, block in layout.blocks.items():
        numbered = []
        fills_on = False
        for drive in layout.passes(block):
            numbered.append((len(passes), drive))
            bins += drive.leaves_bin
            pass_speeds.add(picker, drive)
            passes.append(
                row=drive.row - 1,
                end=end_number(drive.row, drive.end),
                metres=drive.metres,
                is_full=drive.is_full,
                leaves_bin=drive.leaves_bin,
                fills_on=fills_on,
            )
            fills_on = not drive.leaves_bin
        plan = Writer(
            route.harvest(block), starts[picker], layout.machines["picker"], passes=numbered
        )
        first_ops[picker] = translator.translate(plan)
        last_ops[picker] = len(translator.ops) - 1
    return PickerPlans(translator, passes, pass_speeds, bins, first_ops, last_ops)
