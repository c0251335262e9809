"""Steps that drive and turn. `orchard/plans/steps.py` says what a step is.

A drive leads along x or y, and passes gates (`Gate` of orchard/plans/robot.py): before some the
robot stops until the places there are reserved for it, at others it gives places back.
"""

from typing import ClassVar

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
from orchard.field.scenario import TIME_STEP
from orchard.plans.course import EXACT, SHIFT, SLACK
from orchard.plans.robot import Gate, PlanExecutor, Step
from orchard.plans.sense import Box

# A robot that searches for the coupling point is at a place if it is nearer than this, m.
THERE = 0.01
# A robot that is not sure of its position takes a gate to be behind it if it is so far past it, m.
PASSED = 0.5
# A robot asks for a gate's places so long before it is there, s. Earlier would keep others off.
LOOK_AHEAD = 3.0
# And so far before the gate at most, m: less than from a robot to the next one in a line, so that
# no robot asks before the one in front of it.
MOST_AHEAD = 3.0


def asked_ahead(speed: float) -> float:
    """Return how far before a gate a robot asks for its places, m. `speed`: m/s."""
    return min(MOST_AHEAD, LOOK_AHEAD * speed)


class DriveTo(Step, frozen=True):
    """Drive straight on until x (or y) is exactly the target; slower in the last tick.

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
    #: Whether it is normal to stand behind other robots here, so that it is not reported.
    queueing: bool = False
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Drive on up to the target or a closed gate. Return whether the robot is at the target."""
        course = robot.course
        speed = self.speed_of(robot.machine)
        axis = self.axis
        # Positions along the axis, m. The course led up to `course_end` in the last tick.
        here = getattr(robot.pose, axis)
        course_end = getattr(course, axis)
        target = getattr(self, axis)
        ahead = _sign_of(course.heading)
        for gate in self.frees:
            if ahead * (here - gate.at) > -EXACT:
                robot.free(gate.places)
        # A robot that was pushed beyond the end of its course has not passed the gates there.
        passed = min(here, course_end, key=lambda position: ahead * position)
        limit = self._limit(robot, here, passed, ahead, target)
        # The course leads up to the target, or to a gate that is closed.
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
        # m up to each point at which the step must act: where it drives slower, gives places back,
        # or asks for places.
        rooms = [remaining - speed * TIME_STEP]
        for gate in self.frees:
            if not reserved.isdisjoint(gate.places):
                rooms.append(ahead * (gate.at - here))
        asks_before = self.asks_before(robot.machine)
        for gate in self.needs:
            room = ahead * (gate.at - here) - asks_before
            if room >= 0.0 and not reserved.issuperset(gate.places):
                rooms.append(room)
        # Rounded up: the step acts again when the robot has come to the first of these points.
        return int(max(0.0, min(rooms) - SLACK) / (speed * TIME_STEP)) + 1

    def _limit(
        self, robot: PlanExecutor, here: float, passed: float, ahead: float, target: float
    ) -> float:
        """Return up to where the robot may drive along the axis, m.

        That is the target, or the first gate before it with places that are not reserved. The robot
        asks for these places if it is near the gate. `here`: where it is, `passed`: up to where it
        has passed gates, m. `ahead`: the sign of its direction.
        """
        tolerance = EXACT
        # A measured position may jump back behind a gate that the robot has passed.
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

    #: x from which on a carrier that is held up unloads, m.
    unloads_from: float

    def ends_at(self, robot: PlanExecutor, here: float) -> bool:
        """Whether the robot is held up in the bay."""
        return here >= self.unloads_from and robot.is_held_up(self.blind_to)


class Face(Step, frozen=True):
    """Turn on the spot until the robot faces EAST, NORTH, WEST or SOUTH exactly.

    It turns as fast as its machine can. `swings`: the share of a quarter turn after
    which a bin on the bar is no longer in the way of a robot behind it.
    """

    #: A key of HEADINGS.
    heading: str
    blind_to: list[Box] = []
    keeps_course: ClassVar[bool] = True
    swings: ClassVar[float] = 0.4

    def act(self, robot: PlanExecutor) -> bool:
        """Turn on. Return whether the robot faces the heading."""
        robot.course.heading = self.heading
        # A robot that was moved first comes back to where it shall turn; on that way it also turns.
        if robot.is_moved:
            return not robot.comes_back(self.blind_to)
        return _turns_to(robot, HEADINGS[self.heading], self.blind_to)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the pose after the turn, and its time, s."""
        yaw = HEADINGS[self.heading]
        return start._replace(yaw=yaw), abs(angle_between(start.yaw, yaw)) / machine.turn


def _turns_to(robot: PlanExecutor, yaw: float, blind_to: list[Box]) -> bool:
    """Turn towards a yaw, rad. Return whether the robot faces it already."""
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
        """Put a drive with an absolute target into the plan, and be done."""
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
        """Put the turns and drives to that point into the plan, and be done."""
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
    """Return the turn and the drive over a distance along an axis; none if the distance is 0.

    `positive`, `negative`: the headings in both directions. `distance`: m, with its sign.
    """
    if abs(distance) <= EXACT:
        return []
    if distance > 0:
        return [Face(positive), drive]
    return [Face(negative), drive]


class Aim(Step, frozen=True):
    """Turn on the spot to a yaw, rad."""

    yaw: float

    def act(self, robot: PlanExecutor) -> bool:
        """Turn on. Return whether the robot has the yaw."""
        return _turns_to(robot, self.yaw, [])


class Shift(Step, frozen=True):
    """Drive slowly, ahead or back, until the robot is beside the point (x, y), m.

    It does not turn. An obstacle ends the step too.
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
