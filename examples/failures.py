"""What jams an orchard, for docs/traffic.md: routes, a policy and a person, each without one rule
of the built-in ones.
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
        return [
            _with_both(step, side.place("D", lane), side.place("F", lane))
            for step in super().approach(lane, side, carrier)
        ]


def _with_both(step, delivery, full):
    if not isinstance(step, DriveTo):
        return step
    needs = [
        gate
        for each in step.needs
        for gate in ([Gate([full], each.at), each] if delivery in each.places else [each])
    ]
    return replace(step, needs=needs)


class NoHold(OneWay):
    """A carrier that comes early does not hold before the lane: it takes the lane's place although
    the picker is still in its row.
    """

    def fetch(self, carrier, lane, side, picker, full_bin):
        return [
            _without_bins(step) for step in super().fetch(carrier, lane, side, picker, full_bin)
        ]


def _without_bins(step):
    return (
        replace(step, needs=[replace(gate, bin="") for gate in step.needs])
        if isinstance(step, DriveTo)
        else step
    )


class AtOnce:
    """An early policy that sends a carrier as soon as a bin reports, which is much too early."""

    Memory: ClassVar = dict
    early = True

    def __init__(self, layout): ...

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [
            Assignment(report.name, carrier) for report, carrier in zip(bins, free, strict=False)
        ]


class Resting:
    """A person that walks into the second row from the east, rests there for two minutes, and walks
    back.
    """

    Memory = Plan
    SECONDS = 120.0

    def __init__(self, layout, name):
        self.machine = layout.machines["worker"]
        self.bystanders = bystanders_of(layout)
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

    SECONDS = 1e6
