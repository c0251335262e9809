"""A robot that follows a plan, during one tick: what its steps can sense and command.

`PlanExecutor` reads what traffic granted, runs steps until one needs time, and finally stops for
obstacles, whatever the step commanded. Where the robot is off its course, it comes back first:
orchard/plans/course.py. What it remembers stands in orchard/plans/robot_memory.py.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import ClassVar, NamedTuple

import msgspec

from orchard.contract.agent import (
    AHEAD,
    IN_TURN,
    Action,
    Hold,
    Mail,
    Observation,
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
from orchard.field.geometry import STILL, Pose, Twist
from orchard.field.kinds import KINDS, TRAFFIC, kind_of
from orchard.field.machines import Machine
from orchard.plans import sense
from orchard.plans.course import CourseFollower
from orchard.plans.robot_memory import PATIENCE, RECOVERY, RobotMemory

__all__ = [
    "ASK",
    "GIVEN_BACK",
    "LOOK_AGAIN",
    "PATIENCE",
    "Gate",
    "Handles",
    "PlanExecutor",
    "Step",
]

# Ticks from a question to its answer: it is heard a tick later, and its answer again a tick later.
ASK = 2
# Ticks, at least, between a claim and the next one that gives places back.
GIVEN_BACK = 2
# Ticks between two questions to a bin whether its picker has left it. That is often enough: the
# picker needs 65 ticks after that to clear the way.
LOOK_AGAIN = 20
# Names of people and animals in what a robot waits for, at most: enough for those who read it.
MOST_NAMES = 3


class Gate(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point of a drive at which the robot needs places, or needs them no longer.

    A drive `needs` gates of the first kind, and `frees` the places of those of the second kind.
    """

    places: list[str]
    #: Position of the robot's centre along the axis of the drive, m.
    at: float
    #: A full bin that its picker must have left in the lane before the robot asks for the places;
    #: '' for none.
    bin: str = ""


class Handles(NamedTuple):
    """Ticks to couple or uncouple a bin."""

    # Of a robot that has just stopped for it.
    ticks: int
    # Of a robot that has stood for a tick or more.
    at_rest: int


class Step(msgspec.Struct, frozen=True, tag_field="step", tag=True):
    """One step of a plan, as data. The class name identifies it in a memory's bytes.

    `act` is called at every tick. A step that calls `robot.hold` is called less often. A user's own
    step is so only if its class says `holds = True`.
    """

    # Whether the step sets the course itself, or needs none. After any other step that moves the
    # robot a new course begins where the robot is.
    keeps_course: ClassVar[bool] = False

    def act(self, robot: "PlanExecutor") -> bool:
        """Command `robot` for this tick. Return whether the step is done.

        It is called at every tick until then, or when its hold ends.
        """
        raise NotImplementedError

    def ticks(self, machine: Machine) -> int:
        """Return for how many ticks the step lasts beside the robot's motion, without traffic.

        In that time bins are handled, and answers are awaited.
        """
        return 0

    def handles(self, machine: Machine) -> Handles:
        """Return how many of `ticks` the machine needs to couple or uncouple a bin."""
        return Handles(0, 0)

    def motion(self, start: Pose, machine: Machine) -> tuple[Pose, float]:
        """Return the pose at the end of the step, and for how long a machine drives, turns or waits
        in the step without traffic, s.

        `start`: the pose at its beginning.
        """
        return start, 0.0


@cache
def _may_hold(step: type[Step]) -> bool:
    """Whether a step's hold counts: the step is built in, or its class says so."""
    return step.__module__.startswith("orchard.") or says_holds(step)


class PlanExecutor(CourseFollower):
    """One robot at one tick, for the steps of its plan."""

    def __init__(
        self,
        seen: Observation,
        mail: Mail,
        memory: RobotMemory,
        machine: Machine,
        bystanders: tuple[sense.Bystander, ...] = (),
    ) -> None:
        super().__init__(seen, memory, machine)
        self.mail = mail
        # The people and animals of the orchard.
        self._bystanders = bystanders
        #: The places that the robot wants from traffic in this tick.
        self.wanting: list[str] = []
        # The robot with which it may share them; '' for none.
        self._beside = ""

    def next(self, steps: Sequence[Step]) -> None:
        """Insert steps right after the present one."""
        self.memory.plan[1:1] = steps

    def couple(self, bin_name: str, earliest: int = 0) -> bool:
        """Ask physics to couple a bin, once the robot stands, and not before the tick `earliest`.

        Return whether that tick is over. The bin is on the bar only in a later observation.
        """
        self.action.waits_for = bin_name
        if self.seen.tick < earliest:
            self.hold(earliest - self.seen.tick)
            return False
        if self.seen.twist == STILL:
            self.action.deeds.append(Couple(bin_name))
        return True

    def uncouple(self, since: int | None = None) -> None:
        """Ask physics to uncouple the bin, once robot and bin stand.

        `since`: the tick at which the robot began to handle it: it takes its time for that. None:
        it uncouples at once.
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
        """Ask an agent, again and again until the step is done.

        Return the answer in the tick in which it is heard, else None. `every`: the ticks between
        two questions.
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
        """Return what an agent answers to a request of this type in this tick; None if nothing.

        A reply has no body if the agent did not answer in time.
        """
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

        While it is not known to stand so, ask the bin again and again.
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
        """Run the plan's steps until one of them needs time. Call `finish` after it."""
        self._hear()
        while self.memory.plan and self._act(self.memory.plan[0]):
            del self.memory.plan[0]
            # The next step begins in this tick. Nothing of the last one must hold it.
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
        # The step has moved the robot away from its course: a new one begins where it will be.
        if not step.keeps_course and self.action.twist != STILL:
            self.memory.course = None
        if not _may_hold(type(step)):
            self._until = self.seen.tick + 1
        return done

    def finish(self) -> Action:
        """Return the action of this tick: what the steps command, unless it would hit something.

        Call it after `follow`. The hold is that of the commanded velocity. A robot that stands for
        an obstacle keeps it: the engine asks the robot again when the obstacle is gone.
        """
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
            self._stop_for(", ".join(near[:MOST_NAMES]))
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
        """Return how long the robot keeps this velocity; None: it is asked again in the next tick.

        A robot that asks physics for a deed, or corrects its position, is asked at every tick.
        Where it drives or turns, its hold ends when something comes into the watched zone, or
        leaves it. A robot that is blind to a box in its way must look at every tick; so must a
        robot that turns with a bin, because a hold does not watch the bin's laser.
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
        """Stand for RECOVERY ticks after a collision.

        There was an obstacle that no laser saw, and physics refused the motion.
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
        """Keep the places that were wanted and are granted now.

        `answer`: traffic's, to `claim`.
        """
        memory = self.memory
        reserved = list(memory.reserved)
        # Other places that traffic still holds for the robot were given back since the claim.
        for place in answer.held:
            if place in claim.want and place not in memory.reserved:
                reserved.append(place)
        memory.reserved = reserved
        memory.agreed = answer.held
        memory.alone = answer.alone
        memory.blockers = answer.blockers

    def _near_the_turn(self) -> list[str]:
        """Return the people and animals that are, or may be, in what the turn sweeps.

        These, and those that soon may be there, are asked for their positions. A timer is set for
        the tick at which the next bystander must be asked: until then the turn may hold.
        """
        radius = sense.sweep_radius(KINDS[kind_of(self.seen.name)], self.seen.hitch is not None)
        circle = sense.Circle(self.pose.x, self.pose.y, radius)
        hazards = sense.turn_hazards(self._bystanders, self.memory.sighted, self.seen.tick, circle)
        self.action.requests += [(name, Where()) for name in hazards.to_ask]
        self._timers.append(self.seen.tick + max(1, hazards.ticks))
        return hazards.near

    def _claim(self) -> None:
        """Send traffic the places that are kept and wanted, if it is time for that.

        It is when a place was given back, and again and again while places are wanted.
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
