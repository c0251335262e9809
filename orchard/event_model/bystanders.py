"""What people and animals, spread evenly, cost a robot on its way: random stops, measured as
docs/bounds.md says.
"""

from math import inf, pi

from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import X_WEST, Layout
from orchard.field.repeatable import draw, exponential
from orchard.field.scenario import TIME_STEP
from orchard.plans.robot import ASK
from orchard.plans.sense import MARGIN, bystanders_of, sweep_radius

MEETS_WITHIN = (
    5.6  # m: a robot stops once for each of them that is in a strip of this width along its way
)
MEETING = 1.05  # s, mean time for which it then stands
PASSING = 3.0  # s, mean time for which one of them stays within what a turn sweeps


class Bystanders:
    """The people and animals of one orchard."""

    def __init__(self, layout: Layout) -> None:
        bystanders = bystanders_of(layout)
        area = (layout.east - X_WEST) * (layout.top - layout.bottom)
        self.seed = layout.scenario.seed
        # Per m2.
        self.density = len(bystanders) / area
        # m, mean.
        self.radius = 0.0
        if bystanders:
            self.radius = sum(body.radius for body in bystanders) / len(bystanders)

    def metres_to(self, robot: str, number: int) -> float:
        """Return the metres that a robot drives from one meeting to the next, for its meeting with
        this number.
        """
        if not self.density:
            return inf
        return exponential(
            draw(self.seed, f"way of {robot}", number)[0], 1.0 / (self.density * MEETS_WITHIN)
        )

    def meeting_ticks(self, robot: str, number: int) -> int:
        """Return the ticks for which a robot stands at a meeting."""
        return 1 + int(
            exponential(draw(self.seed, f"meeting of {robot}", number)[0], MEETING) / TIME_STEP
        )

    def turning_ticks(self, robot: str, number: int, is_towing: bool) -> int:
        """Return the ticks for which a robot stands before a turn: until all have told where they
        are, and while one is near.
        """
        if not self.density:
            return 0
        within = sweep_radius(KINDS[kind_of(robot)], is_towing) + self.radius + MARGIN
        is_near, stays = draw(self.seed, f"turn of {robot}", number, 2)
        return ASK + (
            int(exponential(stays, PASSING) / TIME_STEP)
            if is_near < self.density * pi * within * within
            else 0
        )
