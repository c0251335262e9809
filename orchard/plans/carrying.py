"""Steps of carriers at the bay, at the load-out, in the queue and at a charger.

`orchard/plans/steps.py` says what a step is.
"""

from math import ceil
from typing import ClassVar

from orchard.contract.messages import BinState, StateRequest
from orchard.field.geometry import Pose
from orchard.field.machines import Machine
from orchard.field.scenario import TIME_STEP
from orchard.field.ticks import BIN_FOLLOWS
from orchard.plans.driving import DriveTo
from orchard.plans.robot import (
    ASK,
    PATIENCE,
    PlanExecutor,
    Step,
)


class Unload(Step, frozen=True):
    """For carriers: stand in the bay until the bin is no longer full.

    The carrier asks the bin every PATIENCE ticks.
    """

    def act(self, robot: PlanExecutor) -> bool:
        """Ask the bin. Return whether it is empty."""
        answer = None
        if robot.seen.hitch is not None:
            answer = robot.ask(robot.seen.hitch.name, StateRequest())
        robot.hold()
        return isinstance(answer, BinState) and not answer.full

    def ticks_until_empty(self, machine: Machine) -> int:
        """Return the ticks from the carrier's stop until the bin is empty.

        The bin stands BIN_FOLLOWS ticks later, and that tick is the first of its unloading.
        """
        return BIN_FOLLOWS + machine.unloading_ticks - 1

    def ticks(self, machine: Machine) -> int:
        """Return the ticks until the carrier has heard that the bin is empty.

        It asks at its stop, and then every PATIENCE ticks. The first question after the bin is
        empty is answered ASK ticks later.
        """
        return ceil(self.ticks_until_empty(machine) / PATIENCE) * PATIENCE + ASK


class Haul(Step, frozen=True):
    """For carriers that have unloaded: be away at the load-out.

    The load-out lies outside of the orchard. So the carrier stays in its line of the queue
    meanwhile, and moves up there like carriers that wait. `Home` after this step makes it free.
    """

    #: x of the line's head, m.
    head: float
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Move up. Return whether the carrier is back from the load-out."""
        back = robot.memory.since + robot.machine.haul_ticks
        if robot.seen.tick >= back:
            return True
        self._moving_up.act(robot)
        robot.look_at(back)
        return False

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the same pose, and the time for which the carrier is away, s.

        The time of moving up is taken off, because the drive after this step counts it.
        """
        _, moving_up = self._moving_up.motion(start, machine)
        return start, max(0.0, machine.haul_ticks * TIME_STEP - moving_up)

    @property
    def _moving_up(self) -> DriveTo:
        """The drive to the line's head, as far as carriers ahead leave room."""
        return DriveTo(x=self.head, queueing=True)


class Charge(Step, frozen=True):
    """For carriers that are in a charging line: begin to charge, or to wait for a charger.

    They charge where they stand, once a charger is free. Physics gives them one
    (orchard/sim/batteries.py).
    """

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Note in the memory that the carrier charges, and be done."""
        robot.memory.doing = "charging"
        robot.memory.state = "resting"
        robot.memory.charged = False
        return True


class Charged(Step, frozen=True):
    """For carriers: stand until the battery has been full since `Charge`.

    The carrier's agent notes that in the memory (orchard/behaviour/carrier.py).
    """

    def act(self, robot: PlanExecutor) -> bool:
        """Stand. Return whether the battery has been full."""
        robot.hold()
        return bool(robot.memory.charged)


class Home(Step, frozen=True):
    """For carriers: the job is done, and the carrier can be called again.

    The step needs no course: a carrier that is back from the load-out may still move up its line.
    """

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Forget the job, and be done."""
        robot.memory.job = None
        return True
