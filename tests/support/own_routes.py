"""Routes as a user writes them: classes that a scenario names as `own_routes.Wider`.

Their plans have only steps of `orchard.plans.steps`. They stand in a module of their own because
each process of a run imports them by this name. Distances are in metres: docs/traffic.md draws the
roads A to G of a side.
"""

from orchard import OneWay, Say, Wait
from orchard.plans.steps import Ahead, DriveTo, MoveTo, Repair
from orchard.plans.two_way import TwoWay


class Wider(OneWay):
    """A route whose loop around the bottom is wider."""

    # Each 2 m further south than in `OneWay`.
    F_BOTTOM = 5.5
    D_BOTTOM = 7.6


class Pausing(OneWay):
    """A route on which a carrier stops for a second before it turns to the bay."""

    # As in `OneWay`.
    PARKED = 44.0

    def go_to_bay(self, lane, side):
        *way, last = super().go_to_bay(lane, side)
        return [*way, Say("about to enter the bay", "waiting"), Wait(1.0), last]


class Onward(TwoWay):
    """A route on which a picker that has parked drives on for 1.5 m.

    It stands there for 400 s, as for repairs, and comes a little back. So a plan has more steps
    after the last row than a built-in one.
    """

    def harvest(self, block):
        *plan, last = super().harvest(block)
        end = self.east.x(self.PARKED)
        return [*plan, last, Ahead(1.5), Repair(400.0), MoveTo(end, self.layout.top + 1.0)]


class OnePlace(OneWay):
    """A route that knows one place at the bay."""

    def go_to_bay(self, lane, side):
        *way, _ = super().go_to_bay(lane, side)
        return [*way, DriveTo(x=self.layout.bay_stop)]


class Farther(OneWay):
    """A route that takes the ways in the queue to be twice as long as they are.

    `distance` is what policies ask for the way of a carrier at (x, y) to a lane.
    """

    def distance(self, x, y, lane, side):
        # `super` has counted the way from the carrier's place to the queue's head once.
        return super().distance(x, y, lane, side) + (self.queue.head - x)
