"""The steps of which plans are made.

Theory of operation. A step is data with one method, `act`, which is called at each tick until it
returns True: the step is done then, and the next one of the plan follows in the same tick. `act`
sets the velocity of this tick, asks, or waits. It may also put further steps before or after
itself. A step itself remembers nothing, and its target is absolute, so a robot still ends at the
right place after it was held up, or after its agent was started again.

`motion` tells where a step leads without traffic, and how long that takes, for plans and bounds;
`ticks` and `handles` how long other steps take at most, and the part of that for handling a bin.
"""

from collections.abc import Sequence
from functools import cache, reduce
from itertools import product
from operator import or_
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import msgspec
from msgspec.structs import replace

from orchard.contract import messages
from orchard.contract.agent import MOST_HOLD, State
from orchard.contract.messages import (
    BinState,
    CarrierComing,
    Confirm,
    EmptyBin,
    Here,
    LeftAt,
    No,
    StateRequest,
    Yes,
)
from orchard.field import repeatable
from orchard.field.geometry import (
    HEADINGS,
    STILL,
    Pose,
    Twist,
    angle_between,
    nearest_heading,
    to_frame,
)
from orchard.field.machines import Machine
from orchard.field.passes import FULL_WITHIN
from orchard.field.picking import failure
from orchard.field.scenario import TIME_STEP
from orchard.field.ticks import BIN_FOLLOWS
from orchard.plans import failures
from orchard.plans.robot import (
    ASK,
    EXACT,
    LITTLE,
    PATIENCE,
    SHIFT,
    SLACK,
    Gate,
    Handles,
    PlanExecutor,
    RobotMemory,
    Step,
)
from orchard.plans.sense import Box

# Ticks between two questions if the answer changes nothing.
SELDOM = 50
# m from a place at which a robot that searches for the coupling point counts as there.
THERE = 0.01
# m which it drives ahead to come to one side.
PULL = 1.0
# Ticks for which a robot tries to couple in one place.
TRIES = 5
# m from one place to the next. None of the area between is farther from a place than a bin can be
# coupled.
GRID = 0.14
# The places of the search for the coupling point: m to the left and ahead of the first one.
SEARCH = [(GRID * left, GRID * ahead) for left, ahead in product((0, 1, -1, 2, -2), (0, 1, -1, 2))]
# m past a gate from which a robot that is not sure of its place takes it to be behind.
PASSED = 0.5
# What a picker begins when it has its empty bin, among what a step has asked.
EXCHANGE = "exchange"
# s before a robot is at a gate, at which it asks for its places. Earlier would keep others off.
LOOK_AHEAD = 3.0
# m before it, at most: less than from a robot to the next one in a line, so that none asks before
# the one in front of it.
MOST_AHEAD = 3.0


def asked_ahead(speed: float) -> float:
    """Return how far before a gate a robot asks for its places, m. `speed`: m/s."""
    return min(MOST_AHEAD, LOOK_AHEAD * speed)


class Say(Step, frozen=True):
    """Set what the robot does from now on: `doing` for people, `state` for programs."""

    doing: str
    state: State
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Set it, and be done."""
        robot.memory.doing = self.doing
        robot.memory.state = self.state
        return True


class DriveTo(Step, frozen=True):
    """Drive straight on until x (or y) is exactly the target; slower in the last step.

    The robot stops before the first of the gates `needs` whose places are not reserved for it. It
    gives the places of the gates `frees` back once it has passed them.
    """

    #: m; None: the robot drives along y.
    x: float | None = None
    #: m; None: the robot drives along x.
    y: float | None = None
    #: m/s; None: that of the machine.
    speed: float | None = None
    needs: list[Gate] = []
    frees: list[Gate] = []
    #: What is no obstacle on the way.
    blind_to: list[Box] = []
    #: To stand behind other robots is normal here, and is not reported.
    queueing: bool = False
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Drive on up to the target or a closed gate. Return whether the robot is at the target."""
        course = robot.course
        speed = self.speed_of(robot.machine)
        axis = self.axis
        # Positions along the axis, m.
        here = getattr(robot.pose, axis)
        before = getattr(course, axis)
        target = getattr(self, axis)
        ahead = _sign_of(course.heading)
        for gate in self.frees:
            if ahead * (here - gate.at) > -EXACT:
                robot.free(gate.places)
        # A robot that was pushed ahead has not passed the gates there.
        passed = min(here, before, key=lambda at: ahead * at)
        limit = self._limit(robot, here, passed, ahead, target)
        setattr(course, axis, limit)
        remaining = ahead * (limit - here)
        if robot.comes_back(self.blind_to, speed):
            return False
        if self.ends_at(robot, here):
            setattr(course, axis, here)
            robot.hold()
            return True
        if remaining <= EXACT:
            robot.hold()
            return bool(ahead * (target - here) <= EXACT)
        robot.move(Twist(x=min(speed, remaining / TIME_STEP)), self.blind_to, self.queueing)
        robot.hold(self._ticks(robot, here, ahead, remaining))
        return False

    def ends_at(self, robot: PlanExecutor, here: float) -> bool:
        """Whether the robot need not drive on to the target. `here`: its place on the axis, m."""
        return False

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the pose at the target, and the time of the drive, s."""
        end = start
        if self.x is not None:
            end = end._replace(x=self.x)
        if self.y is not None:
            end = end._replace(y=self.y)
        metres = abs(end.x - start.x) + abs(end.y - start.y)
        return end, metres / self.speed_of(machine)

    @property
    def axis(self) -> str:
        """The axis along which the robot drives, `x` or `y`."""
        if self.x is None:
            return "y"
        return "x"

    def speed_of(self, machine: Machine) -> float:
        """Return how fast a machine drives, m/s."""
        if self.speed is None:
            return machine.speed
        return self.speed

    def asks_before(self, machine: Machine) -> float:
        """Return how far before a gate a machine asks for its places, m."""
        return asked_ahead(self.speed_of(machine))

    def _ticks(self, robot: PlanExecutor, here: float, ahead: float, remaining: float) -> int:
        """Return for how many ticks the robot keeps its velocity, if nothing comes in its way.

        `here`: where it is along the axis, m. `ahead`: the sign of its direction. `remaining`: the
        way up to the target or a closed gate, m.
        """
        speed = self.speed_of(robot.machine)
        if speed <= 0.0:
            return 1
        reserved = set(robot.memory.reserved)
        # m up to where it drives slower, gives places back, or asks for places.
        rooms = [remaining - speed * TIME_STEP]
        for gate in self.frees:
            if not reserved.isdisjoint(gate.places):
                rooms.append(ahead * (gate.at - here))
        asks_before = self.asks_before(robot.machine)
        for gate in self.needs:
            room = ahead * (gate.at - here) - asks_before
            if room >= 0.0 and not reserved.issuperset(gate.places):
                rooms.append(room)
        return int(max(0.0, min(rooms) - SLACK) / (speed * TIME_STEP)) + 1

    def _limit(
        self, robot: PlanExecutor, here: float, passed: float, ahead: float, target: float
    ) -> float:
        """Return up to where the robot may drive along the axis, m.

        That is the target, or the first gate before it with places that are not reserved. It asks
        for these places if it is near. `passed`: up to where it has passed gates, m. `ahead`: the
        sign of its direction.
        """
        tolerance = EXACT
        if robot.position_bound:
            tolerance = PASSED
        for gate in self.needs:
            is_behind = ahead * (gate.at - passed) < -tolerance
            if is_behind or robot.has(gate.places):
                continue
            is_near = ahead * (gate.at - here) < self.asks_before(robot.machine)
            if is_near and (not gate.bin or robot.is_left(gate.bin)):
                robot.want(gate.places)
            if ahead * (target - gate.at) > 0:
                return gate.at
            return target
        return target


class DriveToBay(DriveTo, frozen=True, kw_only=True):
    """Drive east to the first place of the bay, or as far as is free in it.

    A carrier that is held up further back in the bay has come to a place too, and unloads there.
    """

    #: x from which on it does, m.
    unloads_from: float

    def ends_at(self, robot: PlanExecutor, here: float) -> bool:
        """Whether the robot is held up in the bay."""
        return here >= self.unloads_from and robot.is_held_up(self.blind_to)


class Face(Step, frozen=True):
    """Turn on the spot until the robot faces EAST, NORTH, WEST or SOUTH exactly.

    It turns as fast as its machine can. `swings`: the share of a quarter turn after
    which a bin on the bar is no longer in the way of a robot behind it.
    """

    heading: str
    blind_to: list[Box] = []
    keeps_course: ClassVar[bool] = True
    swings: ClassVar[float] = 0.4

    def act(self, robot: PlanExecutor) -> bool:
        """Turn on. Return whether the robot faces the heading."""
        robot.course.heading = self.heading
        if robot.is_moved:
            return not robot.comes_back(self.blind_to)
        return _turns_to(robot, HEADINGS[self.heading], self.blind_to)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the pose after the turn, and its time, s."""
        yaw = HEADINGS[self.heading]
        return start._replace(yaw=yaw), abs(angle_between(start.yaw, yaw)) / machine.turn


def _turns_to(robot: PlanExecutor, yaw: float, blind_to: list[Box]) -> bool:
    """Turn towards a yaw, rad. Return whether the robot has it."""
    remaining = angle_between(robot.pose.yaw, yaw)
    if abs(remaining) > EXACT:
        robot.turn_by(remaining, blind_to)
    return abs(remaining) <= EXACT


class Realign(Step, frozen=True):
    """Turn on the spot to the nearest of the four headings, until exact."""

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Turn on. Return whether the robot faces a heading."""
        return Face(nearest_heading(robot.pose.yaw)).act(robot)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the pose after the turn, and its time, s."""
        return Face(nearest_heading(start.yaw)).motion(start, machine)


class Ahead(Step, frozen=True):
    """Drive `metres` forward from the present place, facing one of the four headings."""

    metres: float

    def act(self, robot: PlanExecutor) -> bool:
        """Put the drive to that point into the plan."""
        heading = nearest_heading(robot.pose.yaw)
        distance = _sign_of(heading) * self.metres
        if heading in ("EAST", "WEST"):
            drive = DriveTo(x=robot.pose.x + distance)
        else:
            drive = DriveTo(y=robot.pose.y + distance)
        robot.next([drive])
        return True


class MoveTo(Step, frozen=True):
    """Drive to a point: first along the axis that the robot faces, then along the other one."""

    x: float
    y: float

    def act(self, robot: PlanExecutor) -> bool:
        """Put the turns and drives to that point into the plan."""
        along_x = _leg("EAST", "WEST", self.x - robot.pose.x, DriveTo(x=self.x))
        along_y = _leg("NORTH", "SOUTH", self.y - robot.pose.y, DriveTo(y=self.y))
        if nearest_heading(robot.pose.yaw) in ("EAST", "WEST"):
            robot.next([*along_x, *along_y])
        else:
            robot.next([*along_y, *along_x])
        return True


def _sign_of(heading: str) -> float:
    """Return the direction of a heading along its axis: 1 to the east and north, else -1."""
    if heading in ("EAST", "NORTH"):
        return 1.0
    return -1.0


def _leg(positive: str, negative: str, distance: float, drive: DriveTo) -> list[Step]:
    """Return the turn and the drive over a distance, m, with a sign; none if it is 0."""
    if abs(distance) <= EXACT:
        return []
    if distance > 0:
        return [Face(positive), drive]
    return [Face(negative), drive]


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
    """Stand until traffic has granted all these places. At most a partner shares them."""

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
    """Stand until no other robot shares a place that is reserved for the robot."""

    place: str

    def act(self, robot: PlanExecutor) -> bool:
        """Stand. Return whether the robot is alone there."""
        robot.hold()
        return robot.is_alone_in(self.place)


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


class Aim(Step, frozen=True):
    """Turn on the spot to a yaw, rad."""

    yaw: float

    def act(self, robot: PlanExecutor) -> bool:
        """Turn on. Return whether the robot has the yaw."""
        return _turns_to(robot, self.yaw, [])


class Shift(Step, frozen=True):
    """Drive slowly, ahead or back, to the point of the robot's line that is nearest to (x, y).

    An obstacle ends the step too.
    """

    x: float
    y: float

    def act(self, robot: PlanExecutor) -> bool:
        """Drive on. Return whether the robot is there, or cannot go on."""
        remaining, _ = to_frame(robot.pose, self.x, self.y)
        has_met_something = robot.memory.moving and robot.seen.twist == STILL
        if abs(remaining) <= THERE or has_met_something:
            return True
        robot.move(Twist(x=max(-SHIFT, min(SHIFT, remaining / TIME_STEP))), [])
        return False


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


class MayFail(Step, frozen=True):
    """Decide, before a robot drives, whether it fails on the way. Then add its repair."""

    seed: int
    mean_between: float  #: s of work
    mean_repair: float  #: s
    # The course is that of the drive that follows.
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Put a failure into the drive that follows, if one is due, and be done."""
        memory = robot.memory
        drive = cast(DriveTo, memory.plan[1])
        until, repair = failure(
            self.seed, robot.seen.name, memory.failures, self.mean_between, self.mean_repair
        )
        axis = drive.axis
        here = getattr(robot.pose, axis)
        distance = getattr(drive, axis) - here
        # s of work: for the rest of the drive, and up to the failure.
        needed = abs(distance) / drive.speed_of(robot.machine)
        sound = failures.work_left(until, memory.worked)
        if sound >= needed:
            memory.worked += needed
            return True
        memory.failures += 1
        memory.worked = 0.0
        stop = failures.stop_of(here, distance, sound, needed)
        needs = [gate for gate in drive.needs if failures.is_asked_for(gate.at, stop, distance)]
        frees = [gate for gate in drive.frees if failures.is_freed(gate.at, stop)]
        robot.next(
            [
                replace(drive, **{axis: stop}, needs=needs, frees=frees),
                Say("failed, is repaired", "failed"),
                Repair(repair),
                Say(memory.doing, memory.state),
                self,
            ]
        )
        return True


class Repair(Step, frozen=True):
    """Stand for `seconds`, in parts: a run in which no robot finishes a step for long is jammed."""

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


class Confirmed(Step, frozen=True):
    """For carriers, before they leave: go on only if the bin still wants the carrier.

    Else do the steps `otherwise`.
    """

    bin: str
    otherwise: list["AnyStep"]
    # The carrier asks wherever in the queue it is.
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
    """For carriers, once they have unloaded: do the steps `otherwise` if they must charge."""

    #: The charge at which they must, 0 to 1.
    reserve: float
    otherwise: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        """Change the plan, if the charge is at the reserve, and be done."""
        if robot.seen.charge <= self.reserve:
            robot.memory.plan[1:] = self.otherwise
        return True


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


class Again(Step, frozen=True):
    """Repeat these steps without end."""

    steps: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        """Put the steps, and this one after them, into the plan."""
        robot.next([*self.steps, self])
        return True


if TYPE_CHECKING:
    AnyStep = Step
else:
    # msgspec decodes the steps of a memory: these, and those that `with_steps` adds.
    AnyStep = (
        Say | DriveTo | DriveToBay | Face | Realign | Ahead | MoveTo | Wait | Need | Free | Alone
        | Deliver | TakeBin | LeaveBin | FetchEmpty | Announce | BeginPickingAt | Fill | Aim | Shift
        | MayFail | Repair | Unload | Haul | Confirmed | MayCharge | Charge | Charged | Home | Again
    )  # fmt: skip


class Plan(RobotMemory):
    """The memory of a robot that follows a plan.

    `plan`: the steps that remain, the present one first.
    """

    plan: list[AnyStep] = []


P = TypeVar("P", bound=Plan)


def of_known_steps(steps: list[Step], own: Sequence[type[Step]]) -> list[Step]:
    """Return these steps. Raises TypeError for one that a memory could not hold.

    The class of such a step is neither built-in nor in `own`; or it is a step of `own` within
    `Again` or `Confirmed`, which hold built-in steps only.
    """
    for step in steps:
        if type(step) not in own and type(step).__module__ != __name__:
            fault = "is not in `Steps`, or is within a step that holds built-in steps only"
            raise TypeError(f"{type(step).__name__} {fault}")
        of_known_steps([*getattr(step, "steps", ()), *getattr(step, "otherwise", ())], ())
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
    """Return as `with_steps`: the same class for the same arguments."""
    kinds: Any = reduce(or_, steps, AnyStep)
    plan: Any = ("plan", list[kinds], msgspec.field(default_factory=list))
    return msgspec.defstruct(memory.__name__, [plan], bases=(memory,))
