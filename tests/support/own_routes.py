"""Routes of a user's own, of steps that any plan may have, in a file that each process of a test
finds.
"""

from orchard import OneWay, Say, Wait
from orchard.plans.steps import Ahead, DriveTo, MoveTo, Repair
from orchard.plans.two_way import TwoWay


class Wider(OneWay):
    """A route whose loop around the bottom is wider."""

    F_BOTTOM = 5.5
    D_BOTTOM = 7.6


class Pausing(OneWay):
    """A route on which a carrier stops for a second before it turns to the bay."""

    PARKED = 44.0

    def go_to_bay(self, lane, side):
        *way, last = super().go_to_bay(lane, side)
        return [*way, Say("about to enter the bay", "waiting"), Wait(1.0), last]


class Onward(TwoWay):
    """A route on which a picker drives on after its last row.

    It stands for repairs there, and comes a little back.
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
    """A route that takes the ways in the queue to be twice as long as they are."""

    def distance(self, x, y, lane, side):
        return super().distance(x, y, lane, side) + (self.queue.head - x)
