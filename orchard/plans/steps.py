"""The steps of which plans are made.

Theory of operation. A step is data with one method, `act`, which is called at each tick until it
returns True: the step is done then, and the next one of the plan follows in the same tick. `act`
sets the velocity of this tick, asks, or waits. It may also put further steps into the plan, after
itself. A step itself remembers nothing, and its target is absolute, so a robot still ends at the
right place after it was held up, or after its agent was started again.

The class `Step` stands in robot.py. The steps that drive stand in driving.py, those that handle
bins in handling.py, and those of carriers alone in carrying.py. This module has all others, and
lists all: it says which steps the plan in a memory may hold.

For plans and bounds a step tells how long it lasts without traffic: `motion` for its drive or turn,
and where that leads; `ticks` for all else, and `handles` for the part of `ticks` in which a bin is
coupled or uncoupled.
"""

from collections.abc import Sequence
from functools import cache, reduce
from math import copysign, inf
from operator import or_
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast, get_args

import msgspec
from msgspec.structs import replace

from orchard.contract.agent import MOST_HOLD, State
from orchard.contract.messages import Confirm, No
from orchard.field.geometry import Pose
from orchard.field.machines import Machine
from orchard.field.picking import failure
from orchard.field.scenario import TIME_STEP
from orchard.plans import failures
from orchard.plans.carrying import (
    Charge,
    Charged,
    Haul,
    Home,
    Unload,
)
from orchard.plans.course import EXACT
from orchard.plans.driving import (
    Ahead,
    Aim,
    DriveTo,
    DriveToBay,
    Face,
    MoveTo,
    Realign,
    Shift,
)
from orchard.plans.handling import (
    Announce,
    BeginPickingAt,
    Coupling,
    Deliver,
    FetchEmpty,
    Fill,
    LeaveBin,
    TakeBin,
)
from orchard.plans.robot import (
    ASK,
    PlanExecutor,
    Step,
)
from orchard.plans.robot_memory import RobotMemory

__all__ = [
    "Again",
    "Ahead",
    "Aim",
    "Alone",
    "Announce",
    "AnyStep",
    "BeginPickingAt",
    "Charge",
    "Charged",
    "Confirmed",
    "Coupling",
    "Deliver",
    "DriveTo",
    "DriveToBay",
    "Face",
    "FetchEmpty",
    "Fill",
    "Free",
    "Haul",
    "Home",
    "LeaveBin",
    "MayCharge",
    "MayFail",
    "MoveTo",
    "Need",
    "Plan",
    "Realign",
    "Repair",
    "Say",
    "Shift",
    "TakeBin",
    "Unload",
    "Wait",
    "of_known_steps",
    "with_steps",
]


class Say(Step, frozen=True):
    """Set what the robot is shown to do from now on: `doing` for people, `state` for programs."""

    doing: str
    state: State
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Set both in the memory, and be done."""
        robot.memory.doing = self.doing
        robot.memory.state = self.state
        return True


class Wait(Step, frozen=True):
    """Stand for `seconds`."""

    seconds: float

    def act(self, robot: PlanExecutor) -> bool:
        """Stand. Return whether the time is over."""
        waited = (robot.seen.tick - robot.memory.since) * TIME_STEP
        robot.hold(max(1, int(min(MOST_HOLD, (self.seconds - waited) / TIME_STEP))))
        return bool(waited >= self.seconds - EXACT)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the same pose, and the time, s."""
        return start, self.seconds


class Need(Step, frozen=True):
    """Stand until traffic has granted all these places."""

    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        """Claim the places. Return whether they are reserved."""
        if robot.has(self.places):
            return True
        robot.want(self.places)
        robot.hold()
        return False

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return ASK


class Free(Step, frozen=True):
    """Give places back."""

    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        """Give them back, and be done."""
        robot.free(self.places)
        return True


class Alone(Step, frozen=True):
    """Stand until no other robot shares a place that is reserved for the robot.

    In a handover picker and carrier share the place at the lane.
    """

    place: str

    def act(self, robot: PlanExecutor) -> bool:
        """Stand. Return whether the robot is alone there."""
        robot.hold()
        return robot.is_alone_in(self.place)


class MayFail(Step, frozen=True):
    """Decide, before a robot drives, whether it fails or goes away on the way.

    It must stand right before a `DriveTo` in the plan. If the robot fails or goes away, the drive
    is cut in two, with the repair or the absence in between. orchard/plans/failures.py has the
    rules.
    """

    #: Of the scenario, by which failures are drawn.
    seed: int
    #: Mean time of work between failures, s; 0: the robot never fails.
    mean_between: float
    #: Mean time of a repair, s.
    mean_repair: float
    #: When the robot is away: begin and end of each absence, s since the harvest began.
    absences: tuple[tuple[float, float], ...] = ()
    # The course is that of the drive that follows.
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Put a failure or an absence into the drive that follows, if one is due, and be done."""
        memory = robot.memory
        drive = cast(DriveTo, memory.plan[1])
        axis = drive.axis
        here = getattr(robot.pose, axis)
        distance = getattr(drive, axis) - here
        # s of work: for the drive, up to an absence, and up to a failure.
        needed = abs(distance) / drive.speed_of(robot.machine)
        until_absence, absence = self._until_away(robot, drive, here, needed)
        until_failure, repair = self._until_failure(robot)
        if min(until_absence, until_failure) >= needed:
            memory.worked += needed
            return True
        if until_absence <= until_failure:
            memory.worked += until_absence
            stop = failures.stop_of(here, distance, until_absence, needed)
            self._stand(robot, stop, "away", absence)
            return True
        memory.failures += 1
        memory.worked = 0.0
        stop = failures.stop_of(here, distance, until_failure, needed)
        self._stand(robot, stop, "failed, is repaired", repair)
        return True

    def _until_away(
        self, robot: PlanExecutor, drive: "DriveTo", here: float, needed: float
    ) -> tuple[float, float]:
        """Return the time of work up to the next absence, and for how long that then lasts, s.

        The first is infinite if no absence begins on this drive. `here`: position along the axis of
        the drive, m; `needed`: work for the drive, s.
        """
        distance = getattr(drive, drive.axis) - here
        if not distance:
            return inf, 0.0
        speed = abs(distance) / needed
        direction = copysign(1.0, distance)
        # s of work between which the robot has no place on a road.
        first = 0.0
        for gate in drive.frees:
            first = max(first, failures.off_the_road(direction * (gate.at - here), speed))
        last = failures.last_leave(needed)
        for gate in drive.needs:
            last = min(last, direction * (gate.at - here) / speed)
        now = robot.seen.tick * TIME_STEP
        for begin, end in self.absences:
            work = failures.work_until_away(begin, end, now, first, last)
            if work < needed:
                return work, end - now - work
        return inf, 0.0

    def _until_failure(self, robot: PlanExecutor) -> tuple[float, float]:
        """Return the time of work up to the next failure, and for how long its repair lasts, s.

        The first is infinite if the robot never fails.
        """
        if not self.mean_between:
            return inf, 0.0
        memory = robot.memory
        until, repair = failure(
            self.seed, robot.seen.name, memory.failures, self.mean_between, self.mean_repair
        )
        return failures.work_left(until, memory.worked), repair

    def _stand(self, robot: PlanExecutor, stop: float, doing: str, seconds: float) -> None:
        """Put a stay on the drive that follows into the plan.

        `stop`: its position along the axis of the drive, m. `doing`: what the robot is shown to do
        meanwhile. `seconds`: of the stay.

        The plan is then: the drive up to the stop, the stay, this step again, which may cut the
        rest of the drive too, and the drive to its end.
        """
        memory = robot.memory
        drive = cast(DriveTo, memory.plan[1])
        axis = drive.axis
        distance = getattr(drive, axis) - getattr(robot.pose, axis)
        needs = [gate for gate in drive.needs if failures.is_asked_for(gate.at, stop, distance)]
        frees = [gate for gate in drive.frees if failures.is_freed(gate.at, stop)]
        robot.next(
            [
                replace(drive, **{axis: stop}, needs=needs, frees=frees),
                Say(doing, "failed"),
                Repair(seconds),
                Say(memory.doing, memory.state),
                self,
            ]
        )


class Repair(Step, frozen=True):
    """Stand for `seconds`, in parts: a run in which no robot finishes a step for long is jammed.

    So a long repair is several steps `Wait`, each of LONGEST_WAIT at most.
    """

    seconds: float

    def act(self, robot: PlanExecutor) -> bool:
        """Put the first part, and what remains, into the plan."""
        first = failures.first_part(self.seconds)
        remaining = self.seconds - first
        steps: list[Step] = [Wait(first)]
        if remaining > 0.0:
            steps.append(Repair(remaining))
        robot.next(steps)
        return True


class Confirmed(Step, frozen=True):
    """For carriers, before they leave the queue: go on only if the bin still wants the carrier.

    Else do the steps `otherwise` in place of the rest of the plan.
    """

    #: The full bin of the job.
    bin: str
    otherwise: list["AnyStep"]
    # The carrier asks wherever in the queue it is, so it need not come back to its course first.
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Ask the bin. Return whether it has answered."""
        answer = robot.ask(self.bin, Confirm())
        robot.hold()
        if isinstance(answer, No):
            robot.memory.plan[1:] = self.otherwise
        return answer is not None

    def ticks(self, machine: Machine) -> int:
        """Return what it takes beside its motion, in ticks."""
        return ASK


class MayCharge(Step, frozen=True):
    """For carriers, once they have unloaded: do the steps `otherwise` if they must charge.

    These are done in place of the rest of the plan.
    """

    #: The charge at which and below which they must, 0 to 1.
    reserve: float
    otherwise: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        """Change the plan, if the charge is at the reserve, and be done."""
        if robot.seen.charge <= self.reserve:
            robot.memory.plan[1:] = self.otherwise
        return True


class Again(Step, frozen=True):
    """Repeat these steps without end."""

    steps: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        """Put the steps, and this one after them, into the plan."""
        robot.next([*self.steps, self])
        return True


# For mypy a plan holds steps of any class. For msgspec, which decodes memories, it holds only the
# steps of this union, and those that `with_steps` adds.
if TYPE_CHECKING:
    AnyStep = Step
else:
    AnyStep = (
        Say | DriveTo | DriveToBay | Face | Realign | Ahead | MoveTo | Wait | Need | Free | Alone
        | Deliver | TakeBin | LeaveBin | FetchEmpty | Announce | BeginPickingAt | Fill | Aim | Shift
        | MayFail | Repair | Unload | Haul | Confirmed | MayCharge | Charge | Charged | Home | Again
    )  # fmt: skip
_BUILT_IN = get_args(AnyStep)


class Plan(RobotMemory):
    """The memory of a robot that follows a plan.

    `plan`: the steps that remain, the present one first.
    """

    plan: list[AnyStep] = []


P = TypeVar("P", bound=Plan)


def of_known_steps(steps: list[Step], own: Sequence[type[Step]]) -> list[Step]:
    """Return these steps. Raises TypeError for a step that a memory could not hold.

    Its class must be built-in or in `own`, the classes of the user's own steps. Steps that hold
    other steps, as `Again` and `Confirmed`, hold built-in steps only.
    """
    for step in steps:
        if type(step) not in own and type(step) not in _BUILT_IN:
            fault = "is not in `Steps`, or is within a step that holds built-in steps only"
            raise TypeError(f"{type(step).__name__} {fault}")
        held_steps = [*getattr(step, "steps", ()), *getattr(step, "otherwise", ())]
        of_known_steps(held_steps, own=())
    return steps


def with_steps(memory: type[P], steps: Sequence[type[Step]]) -> type[P]:
    """Return a memory type derived from `memory`, whose plan may also hold these steps.

    They are checked and encoded like built-in steps.
    """
    if not steps:
        return memory
    return cast(type[P], _with_steps(memory, tuple(steps)))


@cache
def _with_steps(memory: type[Plan], steps: tuple[type[Step], ...]) -> Any:
    """Return what `with_steps` does, the same class for the same arguments (it is `cache`d)."""
    kinds: Any = reduce(or_, steps, AnyStep)
    plan: Any = ("plan", list[kinds], msgspec.field(default_factory=list))
    return msgspec.defstruct(memory.__name__, [plan], bases=(memory,))
