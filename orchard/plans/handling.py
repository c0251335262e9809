"""Steps that handle bins: robots couple them, leave them, and hand them over."""

from itertools import product

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
from orchard.plans.driving import Ahead, Aim, Shift
from orchard.plans.robot import (
    ASK,
    LITTLE,
    PATIENCE,
    Handles,
    PlanExecutor,
    Step,
)

# Ticks between two questions if the answer changes nothing.
SELDOM = 50
# m which a robot that searches for the coupling point drives ahead to come to one side.
PULL = 1.0
# Ticks for which a robot tries to couple in one place.
TRIES = 5
# m from one place to the next. None of the area between is farther from a place than a bin can be
# coupled.
GRID = 0.14
# The places of the search for the coupling point: m to the left and ahead of the first one.
SEARCH = [(GRID * left, GRID * ahead) for left, ahead in product((0, 1, -1, 2, -2), (0, 1, -1, 2))]
# What a picker begins when it has its empty bin, among what a step has asked.
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
        """Return what it takes beside its motion, in ticks: to uncouple, and to ask until the
        picker has the bin.
        """
        # From the first question, by which the picker hears of the bin, up to the one that it hears
        # when it has coupled it: a whole number of intervals.
        questions = -(-(machine.coupling_ticks_at_rest + ASK) // PATIENCE)
        return machine.uncoupling_ticks + questions * PATIENCE + ASK

    def handles(self, machine: Machine) -> Handles:
        """Return the ticks to uncouple the bin."""
        return Handles(machine.uncoupling_ticks, machine.uncoupling_ticks_at_rest)


class Coupling(Step, frozen=True, kw_only=True):
    """A step that couples a bin.

    A robot that is not sure of its place searches for the coupling point.
    """

    #: Number of the place of the search in which it tries.
    tried: int = 0
    #: x and y of the first of them, m.
    at: tuple[float, float] | None = None

    def couple(self, robot: PlanExecutor, bin_name: str) -> bool:
        """Couple a bin.

        Return whether this step was put off, because the robot tries another place first.
        """
        began = robot.memory.asked.setdefault(f"couple {bin_name}", robot.seen.tick)
        rest = robot.machine.rest_before_coupling
        if self.tried:
            # In the further places of its search it tries at once.
            rest = 0
        may_couple = robot.couple(bin_name, began + rest)
        if not may_couple or not robot.seen.accuracy:
            return False
        if robot.seen.tick - began - rest < TRIES:
            return False
        # The error changes slowly, so a place that was tried may do later.
        tried = (self.tried + 1) % len(SEARCH)
        x, y = self.at or (robot.pose.x, robot.pose.y)
        yaw = HEADINGS[nearest_heading(robot.pose.yaw)]
        s, c = repeatable.sin_cos(yaw)
        left, ahead = SEARCH[tried]
        last_left, _ = SEARCH[self.tried]
        steps: list[Step] = []
        if left != last_left:
            # It drives ahead to come to the other side, and backs up there.
            aside = Shift(x + c * PULL - s * left, y + s * PULL + c * left)
            slant = repeatable.atan2(aside.y - robot.pose.y, aside.x - robot.pose.x)
            steps += [Aim(slant), aside, Aim(yaw)]
        steps.append(Shift(x + c * ahead - s * left, y + s * ahead + c * left))
        steps.append(replace(self, tried=tried, at=(x, y)))
        robot.next(steps)
        robot.action.deeds = []
        return True

    def handles(self, machine: Machine) -> Handles:
        """Return the ticks to couple the bin."""
        return Handles(machine.coupling_ticks, machine.coupling_ticks_at_rest)


class TakeBin(Coupling, frozen=True):
    """Couple the bin that stands behind the robot."""

    bin: str

    def act(self, robot: PlanExecutor) -> bool:
        """Couple the bin. Return whether it is coupled, or the step is put off."""
        if robot.seen.hitch is not None and robot.seen.hitch.name == self.bin:
            return True
        return self.couple(robot, self.bin)

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return machine.coupling_ticks


class Announce(Step, frozen=True):
    """For pickers: announce to the bin where it will be left next, and how full."""

    row: int
    #: Of the row: 'east' or 'west'.
    end: str
    #: m
    fill: float

    def act(self, robot: PlanExecutor) -> bool:
        """Tell the bin. Return whether it has answered, or will not."""
        bin_ = robot.seen.hitch
        # It has asked, and asked again twice.
        is_too_late = robot.seen.tick - robot.memory.since > 2 * PATIENCE
        # A bin that does not know calls when it is left.
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
        """Ask physics for it, and be done."""
        robot.action.deeds.append(messages.PickFrom(self.x))
        return True


class Fill(Step, frozen=True):
    """For pickers that are not sure of their place: at a row's end, drive on until the bin is full.

    They do so little by little, and ask the bin each time.
    """

    #: m that they drive on at most.
    most: float
    #: m that the bin shall hold.
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
    """For pickers: take an empty bin that a carrier brings, with the place where it stands."""

    place: str

    def act(self, robot: PlanExecutor) -> bool:
        """Wait for the bin, couple it, and take over its place. Return whether all is done."""
        memory = robot.memory
        if not memory.offered:
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
        memory.taken = memory.offered
        memory.carrier = ""
        return self._has_handled(robot)

    @staticmethod
    def _has_handled(robot: PlanExecutor) -> bool:
        """Stand with the empty bin as long as an exchange takes. Return whether that is over."""
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
