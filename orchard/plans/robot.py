"""A robot that follows a plan, during one tick: what its steps can sense and command.

`PlanExecutor` reads what traffic granted, runs steps until one needs time, and finally stops for
obstacles, whatever the step commanded.

Theory of operation. A step commands a velocity; the executor decides whether the robot may have it.
A robot that is off its course, because something pushed or turned it, comes back before its step
goes on. `RobotMemory.way` is the state of that:

    way | means                        | becomes
    ----+------------------------------+----------------------------------------------------------
      0 | it is on its course          | 1 or -1 once it is off by more than LITTLE
      1 | it comes back driving ahead  | -1 if it is held up or collides; 0 once it is within NEAR
     -1 | it comes back driving back   | 1 if it is held up or collides; 0 once it is within NEAR
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, ClassVar, NamedTuple, cast

import msgspec

from orchard.contract.agent import (
    AHEAD,
    IN_TURN,
    MOST_HOLD,
    Action,
    Hold,
    Mail,
    Observation,
    State,
    says_holds,
)
from orchard.contract.messages import (
    Answer,
    BinState,
    Claim,
    Couple,
    Places,
    Position,
    Request,
    StateRequest,
    Uncouple,
    Where,
)
from orchard.field.geometry import (
    HEADINGS,
    STILL,
    Pose,
    Twist,
    angle_between,
    nearest_heading,
    to_frame,
)
from orchard.field.kinds import EIGHTH, KINDS, TRAFFIC, kind_of
from orchard.field.machines import Machine
from orchard.field.scenario import TIME_STEP
from orchard.plans import sense
from orchard.plans.estimate import Estimate, as_seen_from, place_of

# Ticks after which a question is asked again if it was not answered as hoped.
PATIENCE = 5
# Ticks from a question to its answer.
ASK = 2
# Ticks after a claim at which a robot may tell that it has given places back.
GIVEN_BACK = 2
# Ticks between two questions to a bin whether it is left. Its picker needs 65 more to clear the
# way.
LOOK_AGAIN = 20
# Standard deviations of its position within which a robot takes itself to be.
SURE = 3.0
# Ticks for which a robot stands after a collision.
RECOVERY = 10
# Ticks after which a robot that is held up on one way back to its course takes the other one.
HELD_UP = 20
# m or rad: nearer than this counts as there.
EXACT = 1e-9
# m or rad, far more than rounding: a motion acts again rather a tick too early than too late.
SLACK = 1e-6
# m off its course from which a robot comes back to it; rad by which it may be off its slant.
LITTLE = 0.02
# m off its course at which it is back.
NEAR = 0.005
# m off its course from which it may come back more steeply.
FAR = 0.3
# rad, at most, to its course on any other way back.
SLANT = 0.25
# rad, at most, to its course on a way back from far.
STEEP_SLANT = EIGHTH * 4
# m/s of a robot that shifts its place.
SHIFT = 0.2


class Course(msgspec.Struct):
    """Where the plan has the robot stand, or to where it drives, and on which path.

    What was moved or turned comes back to it.
    """

    x: float  # m
    y: float  # m
    heading: str


class CourseError(NamedTuple):
    """How far a robot is off its course, as in path following."""

    # m past the goal; negative before it.
    along: float
    # m to the left of the path: the cross-track error.
    across: float
    # rad to the left of the path's heading.
    heading: float


class RobotMemory(msgspec.Struct):
    """The memory of any robot that follows a plan. `steps.Plan` adds the plan itself."""

    # Steps since the beginning.
    done: int = 0
    # Tick at which the present step began.
    since: int = 0
    doing: str = ""
    state: State = "resting"
    # Places that traffic granted and the robot still keeps.
    reserved: list[str] = []
    # Places that are reserved for the robot by traffic's last answer.
    agreed: list[str] = []
    # Of those, places that it shares with no other robot.
    alone: list[str] = []
    # Robots for which the places that it wants are reserved, by traffic's last answer.
    blockers: list[str] = []
    # Tick of the last claim to traffic; at first so long ago that it may claim at once.
    claimed: int = -PATIENCE
    # Whether it wanted to move in the last tick.
    moving: bool = False
    # Whether it wanted to drive, and not only to turn.
    driving: bool = False
    # Tick at which it last found that it had collided; at first so long ago that it has no effect.
    bumped: int = -2 * RECOVERY
    # Person or animal -> its reported position.
    sighted: dict[str, sense.Sighting] = {}
    # Question -> tick at which the present step last asked it.
    asked: dict[str, int] = {}
    # The bin that it has found left in its lane.
    left: str = ""
    # Its estimate of its own pose; None if its receiver is exact.
    place: Estimate | None = None
    # None: as the robot stands now.
    course: Course | None = None
    # The way in which it comes back to its course: 1 forward, -1 back; 0: it does not.
    way: float = 0.0
    # Tick at which it last moved on that way, or began it.
    moved: int = 0
    # Failures so far.
    failures: int = 0
    # s for which it worked since the last one.
    worked: float = 0.0


class Gate(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point of a drive, by the robot's centre: where it needs places, or needs them no longer."""

    places: list[str]
    at: float
    #: A full bin that its picker must have left in the lane before the robot asks for the places;
    #: '' for none.
    bin: str = ""


class Handles(NamedTuple):
    """Ticks to couple or uncouple a bin."""

    # Of a robot that stops for it.
    ticks: int
    # Of one that has stood for a tick or more.
    at_rest: int


class Step(msgspec.Struct, frozen=True, tag_field="step", tag=True):
    """One step of a plan, as data. The class name identifies it in a memory's bytes.

    `act` is called at every tick. An own step that calls `robot.hold` is called less often if its
    class says `holds = True`.
    """

    # Whether it changes the course itself, or needs none. After any other step that moves the robot
    # the course is a new one.
    keeps_course: ClassVar[bool] = False

    def act(self, robot: "PlanExecutor") -> bool:
        """Command `robot` for this tick. Return whether the step is done.

        It is called at every tick until then, or when its hold ends.
        """
        raise NotImplementedError

    def ticks(self, machine: Machine) -> int:
        """Return what the step takes a machine without traffic, beside its motion, in ticks.

        That is for bins that are handled, and for answers.
        """
        return 0

    def handles(self, machine: Machine) -> Handles:
        """Return those of these ticks in which the machine couples or uncouples a bin."""
        return Handles(0, 0)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return where the step ends, and how long a machine drives, turns or waits in it without
        traffic, s.
        """
        return start, 0.0


@cache
def _may_hold(step: type[Step]) -> bool:
    """Whether a step's hold counts: it is built in, or its class says so."""
    return step.__module__.startswith("orchard.") or says_holds(step)


class PlanExecutor:
    """One robot at one tick, for the steps of its plan."""

    def __init__(
        self,
        seen: Observation,
        mail: Mail,
        memory: RobotMemory,
        machine: Machine,
        bystanders: tuple[sense.Bystander, ...] = (),
    ) -> None:
        # Only the steps of each kind know the fields that it adds to Plan.
        self.memory: Any = memory
        self.seen = self._located(seen)
        self.mail = mail
        #: What it can, as the scenario says: `Layout.machines` has it by its kind.
        self.machine = machine
        self._bystanders = bystanders
        self.pose: Pose = self.seen.pose
        self.action = Action(memory=memory)
        self.wanting: list[str] = []
        self._blind_to: list[sense.Box] = []
        self._beside = ""
        # What remains of a turn, rad; 0: it does not turn.
        self._turn = 0.0
        self._queueing = False
        # The tick at which the present step must act again.
        self._until = seen.tick + 1
        # Ticks at which something must be asked again.
        self._timers: list[int] = []

    def _located(self, seen: Observation) -> Observation:
        """Return what is seen from where the robot takes itself to be."""
        if not seen.accuracy:
            return seen
        self.memory.place = place_of(seen, self.memory.place)
        return as_seen_from(self.memory.place, seen)

    @property
    def position_bound(self) -> float:
        """How far the robot may be from where it takes itself to be, m; 0 if it is sure."""
        return SURE * self.seen.accuracy

    def move(self, twist: Twist, blind_to: list[sense.Box], queueing: bool = False) -> None:
        """Drive with this velocity in this tick, unless something is in the way.

        Returns from the boxes `blind_to` do not count. `queueing`: an obstacle ahead is normal, and
        is not reported.
        """
        self.action.twist = twist
        self._turn = 0.0
        self._blind_to = blind_to
        self._queueing = queueing

    def turn(self, rate: float, remaining: float, blind_to: list[sense.Box]) -> None:
        """Turn at this rate (rad/s) in this tick, unless something is in the rest of the turn.

        `remaining`: that rest, rad, to the left.
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
        in_full_ticks = max(0.0, abs(remaining) / TIME_STEP - most - SLACK)
        # Rounded up: it acts again for the last tick of the turn.
        self.hold(int(in_full_ticks / most) + 1)

    def is_held_up(self, blind_to: list[sense.Box]) -> bool:
        """Whether anything but these boxes is in the way ahead."""
        return sense.something_ahead(self.seen, blind_to)

    @property
    def course(self) -> Course:
        """Where the plan has the robot stand or drive."""
        if self.memory.course is None:
            self.memory.course = Course(self.pose.x, self.pose.y, nearest_heading(self.pose.yaw))
        return cast(Course, self.memory.course)

    def comes_back(self, blind_to: list[sense.Box], speed: float = 0.0) -> bool:
        """Whether the robot is off its course, and comes back to it in this tick.

        Off its path it drives aslant, ahead or back. `speed`: that of its drive to the goal of its
        course, m/s; 0: it stands there. Where it cannot turn, it drives on as it faces. Where it is
        held up, it takes the other way. If something keeps it past its goal, it goes on from there.
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
        self._choose_way(has_room=speed > 0.0 and -error.along * SLANT > abs(error.across))
        slant = 0.0
        near_enough = SLACK
        if is_off_path:
            slant = self._slant(error, speed)
            near_enough = LITTLE
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
        # A step crosses the path by no more than NEAR.
        gentle = NEAR / (max(speed, SHIFT) * TIME_STEP)
        return min(most, max(abs(error.across), gentle))

    def _may_turn(self, turn: float, blind_to: list[sense.Box]) -> bool:
        """Whether nothing is in a turn, rad, and physics has not just refused one."""
        was_refused = RECOVERY <= self.seen.tick - self.memory.bumped < 2 * RECOVERY
        return not was_refused and sense.turn_is_free(self.seen, turn, blind_to)

    def _close_up(self, along: float, blind_to: list[sense.Box]) -> None:
        """Drive along the path to its goal. `along`: how far the robot is past it, m."""
        speed = max(-SHIFT, min(SHIFT, -along / TIME_STEP))
        self.move(Twist(x=speed), blind_to)

    def _choose_way(self, has_room: bool) -> None:
        """Choose the way back to the course.

        That is ahead if it has room or its goal lies ahead, else back; and the other one if a drive
        is held up.
        """
        memory = self.memory
        tick = self.seen.tick
        if self.seen.twist != STILL:
            memory.moved = tick
        something_else_drove = bool(self.seen.twist.x) and not memory.driving
        if not memory.way or something_else_drove:
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
        """Return how far off its course the robot may be, m: exactly so far once it comes back."""
        if self.memory.way:
            return self.position_bound + exact
        return self.position_bound + LITTLE

    @property
    def is_moved(self) -> bool:
        """Whether the robot is off the goal of its course, or comes back to it."""
        error = self.course_error()
        distance = max(abs(error.along), abs(error.across))
        return bool(self.memory.way) or distance > self._tolerance(LITTLE)

    def course_error(self) -> CourseError:
        """Return how far the robot is off its course."""
        course = self.course
        x = self.pose.x - course.x
        y = self.pose.y - course.y
        if course.heading == "EAST":
            along, across = x, y
        elif course.heading == "NORTH":
            along, across = y, -x
        elif course.heading == "WEST":
            along, across = -x, -y
        else:
            along, across = -y, x
        heading = angle_between(HEADINGS[course.heading], self.pose.yaw)
        return CourseError(along, across, heading)

    @property
    def _has_collided(self) -> bool:
        """Whether physics refused its motion in the last step."""
        return bool(self.memory.moving and self.seen.twist == STILL)

    def hold(self, ticks: int = MOST_HOLD) -> None:
        """Say that the present step would command the same for so many ticks.

        It is asked earlier if it hears or meets something.
        """
        self._until = self.seen.tick + min(ticks, MOST_HOLD)

    def look_at(self, tick: int) -> None:
        """Say that the present step must act again at a tick, whatever it holds."""
        self._timers.append(tick)

    def next(self, steps: Sequence[Step]) -> None:
        """Insert steps right after the present one."""
        self.memory.plan[1:1] = steps

    def couple(self, bin_name: str, earliest: int = 0) -> bool:
        """Couple a bin, once the robot stands, and at `earliest` at that tick.

        Return whether that is over.
        """
        self.action.waits_for = bin_name
        if self.seen.tick < earliest:
            self.hold(earliest - self.seen.tick)
            return False
        if self.seen.twist == STILL:
            self.action.deeds.append(Couple(bin_name))
        return True

    def uncouple(self, since: int | None = None) -> None:
        """Uncouple the bin, once both stand.

        `since`: the tick from which on the robot takes its time for that; None: it does it at once.
        """
        if since is not None:
            left = since + self.machine.rest_before_uncoupling - self.seen.tick
            if left > 0:
                self.hold(left)
                return
        hitch = self.seen.hitch
        if self.seen.twist == STILL and hitch is not None and hitch.twist == STILL:
            self.action.deeds.append(Uncouple())

    def ask(self, to: str, request: Request, every: int = PATIENCE) -> Answer | None:
        """Ask every `every` ticks until the step is done.

        Return the answer in the tick in which it is heard, else None.
        """
        self.action.waits_for = to
        answer = self._answer_of(to, type(request))
        question = f"{type(request).__name__} {to}"
        is_due = self.seen.tick - self.memory.asked.get(question, -every) >= every
        if answer is None and is_due:
            self.action.requests.append((to, request))
            self.memory.asked[question] = self.seen.tick
        self._timers.append(self.memory.asked.get(question, self.seen.tick) + every)
        return answer

    def _answer_of(self, sender: str, request: type[Request]) -> Answer | None:
        """Return what an agent answers to a request of this type in this tick; None if nothing."""
        for reply in self.mail.replies:
            is_meant = reply.sender == sender and type(reply.request) is request
            if is_meant and reply.body is not None:
                return reply.body
        return None

    def has(self, places: list[str]) -> bool:
        """Whether all these places are reserved for the robot."""
        return all(place in self.memory.reserved for place in places)

    def want(self, places: list[str], beside: str = "") -> None:
        """Ask traffic for places, all of them or none.

        `beside`: a partner with which the robot may share them.
        """
        self.wanting = places
        self._beside = beside
        self.action.waits_for = ", ".join(self.memory.blockers)

    def free(self, places: list[str]) -> None:
        """Give places back."""
        self.memory.reserved = [place for place in self.memory.reserved if place not in places]

    def is_left(self, bin_name: str) -> bool:
        """Whether a full bin stands by itself in its lane.

        While it does not, ask it again and again.
        """
        if self.memory.left != bin_name:
            answer = self.ask(bin_name, StateRequest(), every=LOOK_AGAIN)
            if isinstance(answer, BinState) and answer.full and not answer.coupled_to:
                self.memory.left = bin_name
        return bool(self.memory.left == bin_name)

    def is_alone_in(self, place: str) -> bool:
        """Whether no other robot shares a place. While one does, ask traffic again."""
        if place not in self.memory.alone:
            self.want([place])
        return place in self.memory.alone

    def follow(self) -> None:
        """Run the plan's steps until one of them needs time."""
        self._hear()
        while self.memory.plan and self._act(self.memory.plan[0]):
            del self.memory.plan[0]
            self.memory.done += 1
            self.memory.since = self.seen.tick
            self.memory.asked = {}
            self.action.waits_for = ""
            self._timers = []
            self._until = self.seen.tick + 1
        if not self.memory.plan and not self.comes_back([]):
            self.hold()

    def _act(self, step: Step) -> bool:
        """Let a step command the robot, unless it must come back to its course.

        Return whether the step is done.
        """
        if not step.keeps_course and self.comes_back([]):
            return False
        done = step.act(self)
        if not step.keeps_course and self.action.twist != STILL:
            self.memory.course = None
        if not _may_hold(type(step)):
            self._until = self.seen.tick + 1
        return done

    def finish(self) -> Action:
        """Return the action of this tick: what the steps command, if nothing is hit by it."""
        self._claim()
        action = self.action
        memory = self.memory
        action.doing = memory.doing
        action.state = memory.state
        near: list[str] = []
        if self._turn:
            near = self._near_the_turn()
        self._recover()
        action.hold = self._hold_of(action.twist)
        self._stop_for_obstacles()
        if near:
            # A few names are enough for people.
            self._stop_for(", ".join(near[:3]))
        memory.moving = action.twist != STILL
        memory.driving = bool(action.twist.x)
        action.steps_done = memory.done
        return action

    def _stop_for_obstacles(self) -> None:
        """Stand if the laser returns from something in the way of the commanded velocity."""
        action = self.action
        if action.twist.x > 0 and sense.something_ahead(self.seen, self._blind_to):
            if self._queueing:
                action.twist = STILL
                action.waits_for = ""
            else:
                self._stop_for(AHEAD)
        if action.twist.x < 0 and not sense.back_is_free(self.seen):
            self._stop_for("an obstacle behind")
        if action.twist.yaw and not sense.turn_is_free(self.seen, self._turn, self._blind_to):
            self._stop_for(IN_TURN)

    def _hold_of(self, twist: Twist) -> Hold | None:
        """Return how long the robot keeps this velocity.

        A robot that acts, or corrects its place, is asked at every tick. Where it drives or turns,
        its hold ends when something comes into the way, or leaves it. A robot that is blind to
        boxes in its way must look at every tick; so must one that turns with a bin, because a hold
        does not watch the bin's laser.
        """
        until = self._until
        if self._timers:
            until = min(until, *self._timers)
        if until <= self.seen.tick + 1 or self.action.deeds or self.seen.accuracy:
            return None
        if self._turn:
            zone = sense.turn_zone(kind_of(self.seen.name))
            if self.seen.hitch is not None or zone.is_occupied(self.seen):
                return None
            return Hold(until, watch=(zone,))
        if twist == STILL:
            return Hold(until)
        zone = sense.stop_zone(self.seen)
        if twist.yaw or (self._blind_to and zone.is_occupied(self.seen)):
            return None
        return Hold(until, watch=(zone,))

    def _stop_for(self, obstacle: str) -> None:
        """Stand in this tick because of an obstacle."""
        self.action.twist = STILL
        self.action.waits_for = obstacle
        self.action.state = "stopped"

    def _recover(self) -> None:
        """Stand for a second after a collision.

        There was an obstacle that no laser saw, and physics refused the step.
        """
        memory = self.memory
        tick = self.seen.tick
        if self._has_collided:
            memory.bumped = tick
        if tick - memory.bumped < RECOVERY and self.action.twist != STILL:
            self._stop_for("what it collided with")
            self._timers.append(memory.bumped + RECOVERY)

    def _hear(self) -> None:
        """Note the places that traffic granted, and where people and animals are."""
        for reply in self.mail.replies:
            if isinstance(reply.body, Places) and isinstance(reply.request, Claim):
                self._hear_places(reply.body, reply.request)
            elif isinstance(reply.request, Where):
                x = y = math.inf
                if isinstance(reply.body, Position):
                    x, y = reply.body.x, reply.body.y
                # It was there when it answered, a tick ago.
                self.memory.sighted[reply.sender] = sense.Sighting(self.seen.tick - 1, x, y)

    def _hear_places(self, answer: Places, claim: Claim) -> None:
        """Keep the places that were wanted and are granted now."""
        memory = self.memory
        reserved = list(memory.reserved)
        for place in answer.held:
            if place in claim.want and place not in memory.reserved:
                reserved.append(place)
        memory.reserved = reserved
        memory.agreed = answer.held
        memory.alone = answer.alone
        memory.blockers = answer.blockers

    def _near_the_turn(self) -> list[str]:
        """Return the people and animals that are, or may be, in what the turn sweeps.

        They, and those that soon may be, are asked. A timer is set for the tick at which the next
        one must be asked: until then a turn may hold.
        """
        radius = sense.sweep_radius(KINDS[kind_of(self.seen.name)], self.seen.hitch is not None)
        circle = sense.Circle(self.pose.x, self.pose.y, radius)
        hazards = sense.turn_hazards(self._bystanders, self.memory.sighted, self.seen.tick, circle)
        self.action.requests += [(name, Where()) for name in hazards.to_ask]
        self._timers.append(self.seen.tick + max(1, hazards.ticks))
        return hazards.near

    def _claim(self) -> None:
        """Send traffic the places that are kept and wanted.

        That is when one was given back, and again while one is wanted.
        """
        memory = self.memory
        since = self.seen.tick - memory.claimed
        has_given_back = sorted(memory.agreed) != sorted(memory.reserved)
        if (self.wanting and since >= PATIENCE) or (has_given_back and since >= GIVEN_BACK):
            claim = Claim(keep=list(memory.reserved), want=list(self.wanting), beside=self._beside)
            self.action.requests.append((TRAFFIC, claim))
            memory.claimed = self.seen.tick
        if has_given_back:
            self._timers.append(memory.claimed + GIVEN_BACK)
        elif self.wanting:
            self._timers.append(memory.claimed + PATIENCE)
