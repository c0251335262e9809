"""Steps of carriers at the bay, at the load-out, in the queue and at a charger."""

from typing import ClassVar

from orchard.contract.messages import (
    BinState,
    StateRequest,
)
from orchard.field.geometry import (
    Pose,
)
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

    It is asked every PATIENCE ticks.
    """

    def act(self, robot: PlanExecutor) -> bool:
        """Ask the bin. Return whether it is empty."""
        answer = None
        if robot.seen.hitch is not None:
            answer = robot.ask(robot.seen.hitch.name, StateRequest())
        robot.hold()
        return isinstance(answer, BinState) and not answer.full

    def ticks_until_empty(self, machine: Machine) -> int:
        """Return the ticks until the bin is empty."""
        return BIN_FOLLOWS + machine.unloading_ticks - 1

    def ticks(self, machine: Machine) -> int:
        """Return the ticks until the carrier has heard that.

        The bin is asked first after so many ticks that are a multiple of PATIENCE.
        """
        return -(-self.ticks_until_empty(machine) // PATIENCE) * PATIENCE + ASK


class Haul(Step, frozen=True):
    """For carriers that have unloaded: be away at the load-out, as seen from the queue.

    The carrier stands for itself in its line, and moves up there like those that wait. `Home`
    after this step makes it free.
    """

    #: x of the line's head.
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
        """Return the same pose, and the time for which it is away, s, less that of moving up, which
        the drive after this step takes.
        """
        _, moving_up = self._moving_up.motion(start, machine)
        return start, max(0.0, machine.haul_ticks * TIME_STEP - moving_up)

    @property
    def _moving_up(self) -> DriveTo:
        return DriveTo(x=self.head, queueing=True)


class Charge(Step, frozen=True):
    """For carriers that are in a charging line: charge from here on.

    They charge where they stand, once a charger is free.
    """

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Say so, and be done."""
        robot.memory.doing = "charging"
        robot.memory.state = "resting"
        robot.memory.charged = False
        return True


class Charged(Step, frozen=True):
    """For carriers: stand until the battery has been full."""

    def act(self, robot: PlanExecutor) -> bool:
        """Stand. Return whether the battery has been full."""
        robot.hold()
        return bool(robot.memory.charged)


class Home(Step, frozen=True):
    """For carriers: the job is done, and the carrier can be called again.

    A carrier that is back from the load-out may be on its way up its line.
    """

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Forget the job, and be done."""
        robot.memory.job = None
        return True
