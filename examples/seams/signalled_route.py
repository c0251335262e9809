"""A route with a step of its own: a carrier stops for a second before it turns to the bay.

route: examples.seams.signalled_route.SignalledRoute
"""

from orchard import OneWay, Say, Step, Wait


class Signal(Step, frozen=True):
    seconds: float

    def act(self, robot):
        robot.next([Say("about to enter the bay", "waiting"), Wait(self.seconds)])
        return True


class SignalledRoute(OneWay):
    Steps = (Signal,)
    PARKED = 44.0  # m: x at which a picker stays after its last row

    def go_to_bay(self, lane, side):
        # The last step is the drive to the bay.
        *steps, last = super().go_to_bay(lane, side)
        return [*steps, Signal(1.0), last]
