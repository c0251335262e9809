"""What jams an orchard, for docs/traffic.md: routes, a policy and a person, each without one rule
of the built-in ones.

The road D is that of deliveries, and F that of full bins. A carrier drives past a lane only with
the lane's place on its road.
"""

from typing import ClassVar

from msgspec.structs import replace

from orchard import Assignment, DriveTo, Face, PlanExecutor, Say
from orchard.plans.robot import Gate
from orchard.plans.route import OneWay
from orchard.plans.sense import bystanders_of
from orchard.plans.steps import Plan, Wait
from orchard.plans.two_way import TwoWay


class OneRoad(TwoWay):
    """Full bins drive north on the road on which deliveries drive south."""

    F_ROAD = TwoWay.D_ROAD


class BothRoads(TwoWay):
    """A delivery takes the place on the road of full bins at its lane first, and waits with it for
    the place on its own road.
    """

    def approach(self, lane, side, carrier=1):
        delivery = side.place("D", lane)
        full = side.place("F", lane)
        steps = super().approach(lane, side, carrier)
        return [_with_both(step, delivery, full) for step in steps]


def _with_both(step, delivery, full):
    """Return a step that takes the place `full` where it needs the place `delivery`."""
    if not isinstance(step, DriveTo):
        return step
    needs = []
    for gate in step.needs:
        if delivery in gate.places:
            needs.append(Gate([full], gate.at))
        needs.append(gate)
    return replace(step, needs=needs)


class NoHold(OneWay):
    """A carrier that comes early does not hold before the lane: it takes the lane's place although
    the picker is still in its row.
    """

    def fetch(self, carrier, lane, side, picker, full_bin):
        steps = super().fetch(carrier, lane, side, picker, full_bin)
        return [_without_bins(step) for step in steps]


def _without_bins(step):
    """Return a step that takes places without asking a bin whether the picker has left its row."""
    if not isinstance(step, DriveTo):
        return step
    return replace(step, needs=[replace(gate, bin="") for gate in step.needs])


class AtOnce:
    """An early policy that sends a carrier as soon as a bin reports, which is much too early."""

    Memory: ClassVar = dict
    early = True

    def __init__(self, layout): ...

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        # As many as there are of both.
        pairs = zip(bins, free, strict=False)
        return [Assignment(report.name, carrier) for report, carrier in pairs]


class Resting:
    """A person that walks into the second row from the east, rests there for two minutes, and walks
    back.
    """

    Memory = Plan
    SECONDS = 120.0

    def __init__(self, layout, name):
        self.machine = layout.machines["worker"]
        self.bystanders = bystanders_of(layout)
        # By the east fence, beyond all roads, to the second row, and in to its middle.
        into = [
            Face("EAST"),
            DriveTo(x=47.0),
            Face("SOUTH"),
            DriveTo(y=layout.lane(2).y),
            Face("WEST"),
            DriveTo(x=0.0),
        ]
        rest = [Say("resting", "resting"), Wait(self.SECONDS), Say("walking back", "driving")]
        self.plan = [
            Say("walking to the second row", "driving"),
            *into,
            *rest,
            Face("EAST"),
            DriveTo(x=47.0),
        ]

    def tick(self, observation, mail, memory):
        person = PlanExecutor(
            observation,
            mail,
            memory or Plan(plan=[*self.plan]),
            self.machine,
            self.bystanders,
        )
        person.follow()
        return person.finish()


class Staying(Resting):
    """A person that stays in the second row for ever."""

    SECONDS = 1e6  # longer than any run
