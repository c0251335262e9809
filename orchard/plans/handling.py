"""Steps that handle bins: robots couple them, leave them, and hand them over.

`orchard/plans/steps.py` says what a step is. A handover: a carrier uncouples its empty bin on the
point behind a picker's bar where the picker can couple it, and waits until the picker has the bin
and the place on the road. A robot that is not sure of its position may stand beside the coupling
point, and then searches for it.
"""

from itertools import product
from math import ceil

from msgspec.structs import replace

from orchard.contract import messages
from orchard.contract.messages import (
    BinState,
    CarrierComing,
    EmptyBin,
    Here,
    LeftAt,
    StateRequest,
    Yes,
)
from orchard.field import repeatable
from orchard.field.geometry import (
    HEADINGS,
    nearest_heading,
)
from orchard.field.machines import Machine
from orchard.field.passes import FULL_WITHIN
from orchard.plans.course import LITTLE
from orchard.plans.driving import Ahead, Aim, Shift
from orchard.plans.robot import (
    ASK,
    PATIENCE,
    Handles,
    PlanExecutor,
    Step,
)

# Ticks between two questions of which the answer is only shown, and changes nothing.
SELDOM = 50
# m that a robot which searches for the coupling point drives ahead, to come to another side of it.
PULL = 1.0
# Ticks for which a robot tries to couple at one place of its search.
TRIES = 5
# m from one place of the search to the next. No point between places is farther from a place than a
# bin can be coupled.
GRID = 0.14
# The places of the search for the coupling point, in the order in which they are tried: m to the
# left of the first place, and ahead of it. For each distance to the left all those ahead are tried.
SEARCH = [(GRID * left, GRID * ahead) for left, ahead in product((0, 1, -1, 2, -2), (0, 1, -1, 2))]
# Key in `RobotMemory.asked` for the tick at which a picker began to handle its empty bin. It is no
# question, but is kept and forgotten like those of the step.
EXCHANGE = "exchange"


class Deliver(Step, frozen=True):
    """For carriers: leave the empty bin on the picker's coupling point.

    The carrier waits there until the picker has taken the bin.
    """

    picker: str

    def act(self, robot: PlanExecutor) -> bool:
        """Uncouple, then ask the picker. Return whether it has the bin."""
        if robot.seen.hitch is not None:
            robot.memory.delivered = robot.seen.hitch.name
            robot.uncouple(robot.memory.since)
            return False
        robot.hold()
        return isinstance(robot.ask(self.picker, Here(robot.memory.delivered)), Yes)

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks.

        The carrier uncouples, and asks until the picker has the bin.
        """
        # By the first question the picker hears of the bin. The last one it hears when it has
        # coupled the bin. Between them lies a whole number of intervals.
        intervals = ceil((machine.coupling_ticks_at_rest + ASK) / PATIENCE)
        return machine.uncoupling_ticks + intervals * PATIENCE + ASK

    def handles(self, machine: Machine) -> Handles:
        """Return the ticks to uncouple the bin."""
        return Handles(machine.uncoupling_ticks, machine.uncoupling_ticks_at_rest)


class Coupling(Step, frozen=True, kw_only=True):
    """A step that couples a bin.

    A robot that is not sure of its position searches for the coupling point: it tries one place of
    SEARCH after another.
    """

    #: Number of the place of SEARCH at which the robot tries now.
    tried: int = 0
    #: x and y of the first place, m; None: the robot stands there.
    at: tuple[float, float] | None = None

    def couple(self, robot: PlanExecutor, bin_name: str) -> bool:
        """Couple a bin, or go on to the next place of the search.

        Return whether this step is over without a bin: the robot then has the way to the next
        place, and a further step that tries there, in its plan.
        """
        began = robot.memory.asked.setdefault(f"couple {bin_name}", robot.seen.tick)
        rest = robot.machine.rest_before_coupling
        if self.tried:
            # The robot has taken its time for the deed at the first place.
            rest = 0
        may_couple = robot.couple(bin_name, began + rest)
        if not may_couple or not robot.seen.accuracy:
            return False
        if robot.seen.tick - began - rest < TRIES:
            return False
        # After the last place the first one comes again. The error changes slowly, so a place that
        # was tried may do later.
        tried = (self.tried + 1) % len(SEARCH)
        robot.next(self._steps_to_place(robot, tried))
        # The deed is not asked for where the robot leaves.
        robot.action.deeds = []
        return True

    def _steps_to_place(self, robot: PlanExecutor, tried: int) -> list[Step]:
        """Return the way to a place of SEARCH, and the step that tries to couple there."""
        x, y = self.at or (robot.pose.x, robot.pose.y)
        yaw = HEADINGS[nearest_heading(robot.pose.yaw)]
        sine, cosine = repeatable.sin_cos(yaw)
        left, ahead = SEARCH[tried]
        last_left, _ = SEARCH[self.tried]
        steps: list[Step] = []
        if left != last_left:
            # A robot cannot drive sideways. It drives ahead at a slant, and backs up there.
            aside = Shift(x + cosine * PULL - sine * left, y + sine * PULL + cosine * left)
            slant = repeatable.atan2(aside.y - robot.pose.y, aside.x - robot.pose.x)
            steps += [Aim(slant), aside, Aim(yaw)]
        steps.append(Shift(x + cosine * ahead - sine * left, y + sine * ahead + cosine * left))
        steps.append(replace(self, tried=tried, at=(x, y)))
        return steps

    def handles(self, machine: Machine) -> Handles:
        """Return the ticks to couple the bin."""
        return Handles(machine.coupling_ticks, machine.coupling_ticks_at_rest)


class TakeBin(Coupling, frozen=True):
    """Couple the bin that stands behind the robot."""

    bin: str

    def act(self, robot: PlanExecutor) -> bool:
        """Couple the bin. Return whether it is coupled, or a further step tries elsewhere."""
        if robot.seen.hitch is not None and robot.seen.hitch.name == self.bin:
            return True
        return self.couple(robot, self.bin)

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return machine.coupling_ticks


class Announce(Step, frozen=True):
    """For pickers: announce to the bin where it will be left next, and how full.

    From that the bin forecasts when it will be full (orchard/plans/forecast.py).
    """

    row: int
    #: Of the row: 'east' or 'west'.
    end: str
    #: Metres of row that will be in the bin.
    fill: float

    def act(self, robot: PlanExecutor) -> bool:
        """Tell the bin. Return whether it has answered, or will not answer."""
        bin_ = robot.seen.hitch
        # The picker has told it three times: at first, and twice again, PATIENCE ticks apart.
        is_too_late = robot.seen.tick - robot.memory.since > 2 * PATIENCE
        # The harvest goes on: a bin that was not told calls a carrier when it is left.
        if bin_ is None or is_too_late:
            return True
        return robot.ask(bin_.name, LeftAt(self.row, self.end, self.fill)) is not None

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return ASK


class BeginPickingAt(Step, frozen=True, tag="PickFrom"):
    """For pickers: pick nothing before this x in the next row."""

    x: float  #: m

    def act(self, robot: PlanExecutor) -> bool:
        """Ask physics to let the picker pick from there, and be done."""
        robot.action.deeds.append(messages.PickFrom(self.x))
        return True


class Fill(Step, frozen=True):
    """For pickers that are not sure of their position: at a row's end, drive on until the bin is
    full.

    They drive on by LITTLE, and ask the bin each time.
    """

    #: m that the picker still drives on at most.
    most: float
    #: Metres of row that the bin shall hold.
    fill: float

    def act(self, robot: PlanExecutor) -> bool:
        """Ask the bin, and drive on if it lacks something. Return whether it has answered."""
        if robot.seen.hitch is None or self.most <= 0.0:
            return True
        answer = robot.ask(robot.seen.hitch.name, StateRequest())
        if isinstance(answer, BinState) and answer.fill < self.fill - FULL_WITHIN:
            robot.next([Ahead(LITTLE), Fill(self.most - LITTLE, self.fill)])
        return isinstance(answer, BinState)


class LeaveBin(Step, frozen=True):
    """For pickers: uncouple the bin, and remember it as the full bin."""

    def act(self, robot: PlanExecutor) -> bool:
        """Uncouple. Return whether the bin is left."""
        if robot.seen.hitch is None:
            return True
        robot.memory.full_bin = robot.seen.hitch.name
        # No carrier has offered an empty bin in exchange for this bin yet.
        robot.memory.offered = ""
        robot.memory.carrier = ""
        robot.uncouple(robot.memory.since)
        return False

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return machine.uncoupling_ticks

    def handles(self, machine: Machine) -> Handles:
        """Return the ticks to uncouple the bin."""
        return Handles(machine.uncoupling_ticks, machine.uncoupling_ticks_at_rest)


class FetchEmpty(Coupling, frozen=True):
    """For pickers: take an empty bin that a carrier brings, with the place where it stands.

    The carrier tells the picker of the bin, which the picker's agent notes as `memory.offered`
    (orchard/behaviour/picker.py).
    """

    #: On the delivery road, at the lane.
    place: str

    def act(self, robot: PlanExecutor) -> bool:
        """Wait for the bin, couple it, and take over its place. Return whether all is done."""
        memory = robot.memory
        if not memory.offered:
            # Only to show which carrier comes.
            answer = robot.ask(memory.full_bin, EmptyBin(), every=SELDOM)
            if isinstance(answer, CarrierComing):
                memory.carrier = answer.carrier
            robot.hold()
            return False
        if robot.seen.hitch is None:
            return self.couple(robot, memory.offered)
        if not robot.has([self.place]):
            robot.want([self.place], beside=memory.carrier)
            robot.hold()
            return False
        # From now on the agent answers the carrier that the bin is taken.
        memory.taken = memory.offered
        memory.carrier = ""
        return self._has_handled(robot)

    @staticmethod
    def _has_handled(robot: PlanExecutor) -> bool:
        """Stand with the empty bin for the time of an exchange. Return whether that is over."""
        ticks = robot.machine.exchange_ticks
        if not ticks:
            return True
        began = robot.memory.asked.setdefault(EXCHANGE, robot.seen.tick)
        left = began + ticks - robot.seen.tick
        if left <= 0:
            return True
        robot.memory.doing = "handling its empty bin"
        robot.memory.state = "handling a bin"
        robot.hold(left)
        return False

    def exchange_ticks(self, machine: Machine) -> int:
        """Return the ticks for which the picker stands with its empty bin."""
        return machine.exchange_ticks
