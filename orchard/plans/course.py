"""A robot on its course, during one tick: the motion that it commands, and its way back.

Theory of operation. A step commands a velocity. But a robot that is off its course, because
something pushed or turned it, comes back before its step goes on. `RobotMemory.way` is the state of
that:

    way | means                        | becomes
    ----+------------------------------+----------------------------------------------------------
      0 | it is on its course          | 1 or -1 once it is off by more than LITTLE
      1 | it comes back driving ahead  | -1 if it is held up or collides; 0 once it is within NEAR
     -1 | it comes back driving back   | 1 if it is held up or collides; 0 once it is within NEAR

The course is where the plan has the robot stand, or to where it drives: a goal, and the heading of
the straight path that leads there. `PlanExecutor` of orchard/plans/robot.py is derived from
`CourseFollower`, and adds plans, questions and places.
"""

import math
from typing import Any, NamedTuple, cast

from orchard.contract.agent import MOST_HOLD, Action, Observation
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
from orchard.field.repeatable import QUARTER
from orchard.field.scenario import TIME_STEP
from orchard.plans import sense
from orchard.plans.estimate import as_seen_from, place_of
from orchard.plans.robot_memory import RECOVERY, Course, RobotMemory

# A robot takes its true position to be within so many standard deviations of the measured one.
SURE = 3.0
# Ticks after which a robot that is held up on one way back to its course takes the other one.
HELD_UP = 20
# m or rad: nearer than this counts as there.
EXACT = 1e-9
# m or rad, far more than rounding. The ticks until a step must act again are counted with it, so
# that the step acts rather a tick too early than too late.
SLACK = 1e-6
# m off its course from which on a robot comes back. On a slant, an angle of that many rad to the
# wanted heading is near enough to drive.
LITTLE = 0.02
# m off its course at which a robot that comes back is on it again.
NEAR = 0.005
# m off its course from which on a robot may come back more steeply.
FAR = 0.3
# A slant is the angle between the robot's heading and its course on the way back, rad: at most so
# much if it is near, and if it is far.
SLANT = 0.25
STEEP_SLANT = QUARTER
# Speed of a robot that shifts its place, m/s.
SHIFT = 0.2


class CourseError(NamedTuple):
    """How far a robot is off its course, as in path following."""

    # m past the goal; negative before it.
    along: float
    # m to the left of the path: the cross-track error.
    across: float
    # rad to the left of the path's heading.
    heading: float


class CourseFollower:
    """One robot at one tick: what it sees, how it shall move, and how it comes back to course."""

    def __init__(self, seen: Observation, memory: RobotMemory, machine: Machine) -> None:
        # `Any`, because each kind of robot adds fields, which only its own steps use.
        self.memory: Any = memory
        self.seen = self._located(seen)
        #: What the robot can, as the scenario says: `Layout.machines` has it by its kind.
        self.machine = machine
        self.pose: Pose = self.seen.pose
        #: What the robot does in this tick. Steps change it.
        self.action = Action(memory=memory)
        # Boxes of which returns are no obstacle to the commanded motion.
        self._blind_to: list[sense.Box] = []
        # What remains of a turn, rad; 0: it does not turn.
        self._turn = 0.0
        # Whether an obstacle ahead is normal, as in a queue, and is not reported.
        self._queueing = False
        # The tick at which the present step must act again.
        self._until = seen.tick + 1
        # Ticks at which something must be asked again.
        self._timers: list[int] = []

    def _located(self, seen: Observation) -> Observation:
        """Return the observation with the robot's estimate in place of a measured position.

        The estimate is carried on in the memory. An exact position needs none.
        """
        if not seen.accuracy:
            return seen
        self.memory.place = place_of(seen, self.memory.place)
        return as_seen_from(self.memory.place, seen)

    @property
    def position_bound(self) -> float:
        """How far the robot may be from where it takes itself to be, m; 0 if sensors are exact."""
        return SURE * self.seen.accuracy

    def move(self, twist: Twist, blind_to: list[sense.Box], queueing: bool = False) -> None:
        """Drive with this velocity in this tick, unless something is in the way.

        Laser returns from the boxes `blind_to` do not count. `queueing`: whether an obstacle ahead
        is normal, and is not reported.
        """
        self.action.twist = twist
        self._turn = 0.0
        self._blind_to = blind_to
        self._queueing = queueing

    def turn(self, rate: float, remaining: float, blind_to: list[sense.Box]) -> None:
        """Turn at this rate in this tick, unless something is in the rest of the turn.

        `rate`: rad/s, and `remaining`: the rest of the turn, rad; left is positive.
        """
        self.action.twist = Twist(yaw=rate)
        self._turn = remaining
        self._blind_to = blind_to

    def turn_by(self, remaining: float, blind_to: list[sense.Box]) -> None:
        """Turn by what remains of a turn, rad, as fast as the machine can; slower in the last
        tick.
        """
        most = self.machine.turn
        rate = max(-most, min(most, remaining / TIME_STEP))
        self.turn(rate, remaining, blind_to)
        # Ticks at the full rate, before the last tick, in which the robot turns by what remains.
        full_ticks = max(0.0, abs(remaining) / TIME_STEP - most - SLACK) / most
        # Rounded up: the step acts again for the last tick.
        self.hold(int(full_ticks) + 1)

    def hold(self, ticks: int = MOST_HOLD) -> None:
        """Say that the present step would command the same for so many ticks.

        The robot is asked earlier if it hears or meets something (orchard/sim/lookahead.py).
        """
        self._until = self.seen.tick + min(ticks, MOST_HOLD)

    def look_at(self, tick: int) -> None:
        """Say that the present step must act again at a tick, also within a hold."""
        self._timers.append(tick)

    def is_held_up(self, blind_to: list[sense.Box]) -> bool:
        """Whether anything but these boxes is in the way ahead."""
        return sense.something_ahead(self.seen, blind_to)

    @property
    def course(self) -> Course:
        """Where the plan has the robot stand or drive.

        Without a course a new one begins where the robot stands, along the nearest heading.
        """
        if self.memory.course is None:
            self.memory.course = Course(self.pose.x, self.pose.y, nearest_heading(self.pose.yaw))
        return cast(Course, self.memory.course)

    def course_error(self) -> CourseError:
        """Return how far the robot is off its course."""
        course = self.course
        x = self.pose.x - course.x
        y = self.pose.y - course.y
        heading = angle_between(HEADINGS[course.heading], self.pose.yaw)
        # `along` is in the direction of the course, `across` to the left of it.
        if course.heading == "EAST":
            return CourseError(along=x, across=y, heading=heading)
        if course.heading == "NORTH":
            return CourseError(along=y, across=-x, heading=heading)
        if course.heading == "WEST":
            return CourseError(along=-x, across=-y, heading=heading)
        return CourseError(along=-y, across=x, heading=heading)

    @property
    def is_moved(self) -> bool:
        """Whether the robot is off the goal of its course, or comes back to it."""
        error = self.course_error()
        distance = max(abs(error.along), abs(error.across))
        return bool(self.memory.way) or distance > self._tolerance(LITTLE)

    def comes_back(self, blind_to: list[sense.Box], speed: float = 0.0) -> bool:
        """Whether the robot is off its course; if it is, command its way back in this tick.

        `speed`: that of its drive to the goal of its course, m/s; 0: it shall stand at the goal.

        A robot off its path drives aslant, ahead or back. Where it cannot turn, it drives on as it
        faces. Where it is held up, it changes between ahead and back. If something keeps it past
        its goal, it counts as being there.
        """
        if self.memory.course is None:
            return False
        error = self.course_error()
        is_off_path = abs(error.across) > self._tolerance(NEAR)
        is_aslant = abs(error.heading) > SLACK
        if not (is_off_path or is_aslant or self._is_off_goal(error, speed)):
            self.memory.way = 0.0
            return False
        if not is_off_path and self._is_stuck_past_goal(error):
            return False
        # There is room if the way to the goal is long enough to come back to the path at SLANT.
        self._choose_way(has_room=speed > 0.0 and -error.along * SLANT > abs(error.across))
        slant = 0.0
        near_enough = SLACK
        if is_off_path:
            slant = self._slant(error, speed)
            near_enough = LITTLE
        # rad to the left of the course. To the right, if the robot is left of its path and drives
        # ahead; if it drives back, to the other side.
        wanted_heading = -math.copysign(slant, error.across * self.memory.way)
        turn = angle_between(error.heading, wanted_heading)
        is_aligned = abs(turn) <= near_enough
        if not is_aligned and self._may_turn(turn, blind_to):
            self.turn_by(turn, blind_to)
        elif is_aligned and not is_off_path:
            self._close_up(error.along, blind_to)
        elif is_aligned and speed and self.memory.way > 0.0:
            self.move(Twist(x=speed), blind_to)
        else:
            # It stands at its goal, drives back, or cannot turn.
            self.move(Twist(x=SHIFT * self.memory.way), blind_to)
        return True

    def _is_off_goal(self, error: CourseError, speed: float) -> bool:
        """Whether the robot is past its goal, or before it without a drive that leads there."""
        tolerance = self._tolerance(SLACK)
        is_past = error.along > tolerance
        is_short = not speed and -error.along > tolerance
        return is_past or is_short

    def _is_stuck_past_goal(self, error: CourseError) -> bool:
        """Whether the robot has long tried to come back to its goal, and something is behind it."""
        tries_to_come_back = error.along > 0.0 and bool(self.memory.way)
        is_held_up = self.seen.tick - self.memory.moved >= HELD_UP
        return tries_to_come_back and is_held_up and not sense.back_is_free(self.seen)

    def _slant(self, error: CourseError, speed: float) -> float:
        """Return the angle at which the robot drives back to its path, rad."""
        is_near = abs(error.across) <= FAR + self.position_bound
        if is_near:
            most = SLANT
        else:
            most = STEEP_SLANT
        # As many rad as the robot is m off its path, so it comes back ever more gently. But not
        # less than what leads it NEAR across in a tick, which cannot overshoot the path by more.
        gentle = NEAR / (max(speed, SHIFT) * TIME_STEP)
        return min(most, max(abs(error.across), gentle))

    def _may_turn(self, turn: float, blind_to: list[sense.Box]) -> bool:
        """Whether nothing is in a turn, rad, and the robot has not just collided.

        After a collision it stands for RECOVERY ticks, and then drives for as many before it turns.
        """
        was_refused = RECOVERY <= self.seen.tick - self.memory.bumped < 2 * RECOVERY
        return not was_refused and sense.turn_is_free(self.seen, turn, blind_to)

    def _close_up(self, along: float, blind_to: list[sense.Box]) -> None:
        """Drive along the path to its goal. `along`: how far the robot is past it, m."""
        speed = max(-SHIFT, min(SHIFT, -along / TIME_STEP))
        self.move(Twist(x=speed), blind_to)

    def _choose_way(self, has_room: bool) -> None:
        """Choose whether the robot comes back driving ahead or driving back.

        It drives ahead if it has room or its goal lies ahead, else back. If its drive is held up,
        it changes to the contrary. `has_room`: whether it can come back on its way to the goal.
        """
        memory = self.memory
        tick = self.seen.tick
        if self.seen.twist != STILL:
            memory.moved = tick
        is_pushed = bool(self.seen.twist.x) and not memory.driving
        if not memory.way or is_pushed:
            memory.way = -1.0
            if has_room or self._is_goal_ahead():
                memory.way = 1.0
            memory.moved = tick
        elif (self._has_collided and memory.driving) or tick - memory.moved >= HELD_UP:
            memory.way = -memory.way
            memory.moved = tick

    def _is_goal_ahead(self) -> bool:
        """Whether the goal of the course lies ahead of the robot, and nothing is in between."""
        ahead, _ = to_frame(self.pose, self.course.x, self.course.y)
        return ahead > 0.0 and not sense.something_ahead(self.seen, [])

    def _tolerance(self, exact: float) -> float:
        """Return how far off its course the robot may be, m.

        `exact`: how far it may be when it comes back. A robot that does not may be LITTLE off.
        """
        if self.memory.way:
            return self.position_bound + exact
        return self.position_bound + LITTLE

    @property
    def _has_collided(self) -> bool:
        """Whether physics refused the motion that the robot commanded in the last tick."""
        return bool(self.memory.moving and self.seen.twist == STILL)
