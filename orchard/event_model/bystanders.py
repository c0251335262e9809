"""What people and animals ("bystanders") cost a robot on its way, if they are spread evenly.

The event model has none of them: robots stop at random, as often and as long as was measured in the
simulator (docs/bounds.md). On its way a robot "meets" one of them, and stands until that has gone.
Before a turn it asks all where they are (a "look"), and stands while one of them is near.
"""

from dataclasses import dataclass
from math import inf, pi

from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import X_WEST, Layout
from orchard.field.repeatable import draw, exponential
from orchard.field.scenario import TIME_STEP
from orchard.plans.robot import ASK
from orchard.plans.sense import BYSTANDER_MARGIN, bystanders_of, sweep_radius

# m: a robot stops once for each of them that is in a strip of this width along its way.
MEETS_WITHIN = 5.6
MEETING = 1.05  # s, mean time for which it then stands
PASSING = 3.0  # s, mean time for which one of them stays within what a turn sweeps
# The name of a draw is one of these, and the robot's name.
WAY = "way of "
STANDING = "meeting of "
LOOKING = "turn of "


def ticks_of_meeting(chance: float) -> int:
    """Return the ticks of a meeting, at least one, for a random number, uniform in [0, 1)."""
    return 1 + int(exponential(chance, MEETING) / TIME_STEP)


def ticks_of_look(is_near: float, stays: float, nearness: float) -> int:
    """Return the ticks of a look before a turn, for two random numbers, uniform in [0, 1).

    `is_near`, `stays`: these numbers. `nearness`: the chance that a person or an animal is near. If
    none is, the look takes the ASK ticks until all have answered.
    """
    if is_near < nearness:
        return ASK + int(exponential(stays, PASSING) / TIME_STEP)
    return ASK


@dataclass(frozen=True)
class Bystanders:
    """The people and animals of one orchard."""

    seed: int
    #: Per m2.
    density: float
    #: m, mean of their bodies.
    radius: float

    @classmethod
    def of(cls, layout: Layout) -> "Bystanders":
        """Return those of a layout."""
        bystanders = bystanders_of(layout)
        area = (layout.east - X_WEST) * (layout.top - layout.bottom)
        radius = 0.0
        if bystanders:
            radius = sum(body.radius for body in bystanders) / len(bystanders)
        return cls(layout.scenario.seed, len(bystanders) / area, radius)

    @property
    def metres(self) -> float:
        """Mean metres from one meeting to the next, where there are people or animals."""
        return 1.0 / (self.density * MEETS_WITHIN)

    def nearness(self, robot: str, is_towing: bool) -> float:
        """Return the chance that a person or an animal is within what a turn sweeps."""
        swept = sweep_radius(KINDS[kind_of(robot)], is_towing)
        within = swept + self.radius + BYSTANDER_MARGIN
        return self.density * pi * within * within

    def metres_to(self, robot: str, number: int) -> float:
        """Return the metres that a robot drives from one meeting to the next, for its meeting with
        this number.
        """
        if not self.density:
            return inf
        return exponential(draw(self.seed, WAY + robot, number)[0], self.metres)

    def meeting_ticks(self, robot: str, number: int) -> int:
        """Return the ticks for which a robot stands at a meeting."""
        return ticks_of_meeting(draw(self.seed, STANDING + robot, number)[0])

    def turning_ticks(self, robot: str, first: int, last: int) -> list[tuple[int, int]]:
        """Return the ticks for which a robot stands before its turns from one number up to another
        one: without a bin, and with one.

        It stands until all have told where they are, and while one is near.
        """
        if not self.density:
            return [(0, 0)] * (last - first)
        alone = self.nearness(robot, is_towing=False)
        towing = self.nearness(robot, is_towing=True)
        looks = []
        for number in range(first, last):
            is_near, stays = draw(self.seed, LOOKING + robot, number, 2)
            without = ticks_of_look(is_near, stays, alone)
            looks.append((without, ticks_of_look(is_near, stays, towing)))
        return looks
