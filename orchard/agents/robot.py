"""A robot that follows a plan, during one tick: what its steps can sense and command.

`PlanExecutor` reads what traffic granted, runs steps until one needs time, and finally stops for obstacles, whatever the step commanded.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, ClassVar, cast

import msgspec

from orchard.agents import sense
from orchard.agents.place import Estimate, as_seen_from, place_of
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
from orchard.field.scenario import TIME_STEP

PATIENCE = 5  # ticks after which a question is asked again if it was not answered as hoped
ASK = 2  # ticks from a question to its answer
GIVEN_BACK = 2  # ticks after a claim at which a robot may tell that it has given places back
LOOK_AGAIN = 20  # ticks between two questions to a bin whether it is left: its picker needs 65 more to clear the way
SURE = 3.0  # standard deviations of its position within which a robot takes itself to be
RECOVERY = 10  # ticks for which a robot stands after a collision
HELD_UP = 20  # ticks after which a robot that is held up on one way back to its course takes the other one
EXACT = 1e-9  # m or rad: nearer than this counts as there
SLACK = 1e-6  # m or rad, far more than rounding: a motion acts again rather a tick too early than too late
LITTLE = 0.02  # m off its course from which a robot comes back to it; rad by which it may be off its slant
NEAR = 0.005  # m off its course at which it is back
FAR = 0.3  # m off its course from which it may come back more steeply
SLANT = 0.25  # rad, at most, to its course on any other way back
SHIFT = 0.2  # m/s of a robot that shifts its place


class Course(msgspec.Struct):
    """Where the plan has the robot stand, or to where it drives, and on which line. What was moved or turned comes back to it."""

    x: float  # m
    y: float  # m
    heading: str


class RobotMemory(msgspec.Struct):
    """The memory of any robot that follows a plan. `steps.Plan` adds the plan itself."""

    done: int = 0  # steps since the beginning
    since: int = 0  # tick at which the present step began
    doing: str = ""
    state: State = "resting"
    reserved: list[str] = []  # places that traffic granted and the robot still keeps
    agreed: list[str] = []  # places that are reserved for the robot by traffic's last answer
    alone: list[str] = []  # of those, places that it shared with no other robot
    blockers: list[
        str
    ] = []  # robots for which the places that it wants are reserved, by traffic's last answer
    claimed: int = -PATIENCE  # tick of the last claim to traffic
    moving: bool = False  # whether it wanted to move in the last tick
    driving: bool = False  # whether it wanted to drive, and not only to turn
    bumped: int = -2 * RECOVERY  # tick at which it last found that it had collided
    sighted: dict[str, sense.Sighting] = {}  # person or animal -> its reported position
    asked: dict[str, int] = {}  # question -> tick at which the present step last asked it
    left: str = ""  # the bin that it has found left in its lane
    place: Estimate | None = None  # its estimate of its own pose; None if its receiver is exact
    course: Course | None = None  # None: as the robot stands now
    way: float = 0.0  # in which it comes back to its course: 1 forward, -1 back; 0: it does not
    moved: int = 0  # tick at which it last moved on that way, or began it
    failures: int = 0  # so far
    worked: float = 0.0  # s for which it worked since the last one


class Gate(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point of a drive, by the robot's centre: it needs these places from there on, or it needs them no longer."""

    places: list[str]
    at: float
    bin: str = ""  #: a full bin that its picker must have left in the lane before the robot asks for the places; '' for none


class Step(msgspec.Struct, frozen=True, tag_field="step", tag=True):
    """One step of a plan, as data. The class name identifies it in a memory's bytes.

    `act` is called at every tick. An own step that calls `robot.hold` is called less often if its class says `holds = True`.
    `ticks`: what the step takes without traffic, beside its motion: for bins that are handled, and for answers. `handles`: of these, the
    ticks to couple or uncouple a bin; a robot that has stood for a tick needs only one.
    """

    ticks: ClassVar[int] = 0
    handles: ClassVar[int] = 0
    keeps_course: ClassVar[bool] = (
        False  # it changes the course, or needs no place; after any other step that moves it is anew
    )

    def act(self, robot: "PlanExecutor") -> bool:
        """Command `robot` for this tick. Return whether the step is done; it is called at every tick until then, or when its hold ends."""
        raise NotImplementedError

    def motion(self, start: Pose) -> tuple[Pose, float]:
        """Return where the step ends, and how long it drives, turns or waits without traffic, s."""
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
        bystanders: tuple[sense.Bystander, ...] = (),
    ) -> None:
        self.memory: Any = (
            memory  # only the steps of each kind know the fields that it adds to Plan
        )
        self.seen, self.mail, self._bystanders = self._located(seen), mail, bystanders
        self.pose: Pose = self.seen.pose
        self.action = Action(memory=memory)
        self.wanting: list[str] = []
        self._blind_to: list[sense.Box] = []
        self._beside, self._turn, self._queueing = "", 0.0, False
        self._until = seen.tick + 1  # tick at which the present step must act again
        self._timers: list[int] = []  # ticks at which something must be asked again

    def _located(self, seen: Observation) -> Observation:
        if not seen.accuracy:
            return seen
        self.memory.place = place_of(seen, self.memory.place)
        return as_seen_from(self.memory.place, seen)

    @property
    def doubt(self) -> float:
        """How far from where it takes itself to be the robot may be, m; 0 if its receiver is exact."""
        return SURE * self.seen.accuracy

    def move(self, twist: Twist, blind_to: list[sense.Box], queueing: bool = False) -> None:
        """Drive with this velocity in this tick, unless something is in the way. Returns from the boxes `blind_to` do not count.

        `queueing`: an obstacle ahead is normal, and is not reported.
        """
        self.action.twist, self._turn, self._blind_to, self._queueing = (
            twist,
            0.0,
            blind_to,
            queueing,
        )

    def turn(self, rate: float, left: float, blind_to: list[sense.Box]) -> None:
        """Turn at this rate (rad/s) in this tick, unless something is in the part of the turn that is left (rad)."""
        self.action.twist, self._turn, self._blind_to = Twist(yaw=rate), left, blind_to

    def turn_by(self, left: float, blind_to: list[sense.Box]) -> None:
        """Turn by what is left of a turn, rad, at pi/8 rad/s; slower in the last tick."""
        self.turn(max(-EIGHTH, min(EIGHTH, left / TIME_STEP)), left, blind_to)
        self.hold(int(max(0.0, abs(left) / TIME_STEP - EIGHTH - SLACK) / EIGHTH) + 1)

    @property
    def course(self) -> Course:
        """Where the plan has the robot stand or drive."""
        if self.memory.course is None:
            self.memory.course = Course(self.pose.x, self.pose.y, nearest_heading(self.pose.yaw))
        return cast(Course, self.memory.course)

    def comes_back(self, blind_to: list[sense.Box], speed: float = 0.0) -> bool:
        """Whether the robot is off its course, and comes back: off its line it drives aslant, ahead or back.

        `speed`: at which it drives to the place of its course, m/s; 0: it stands there. Where it cannot turn, it drives on as it
        faces; where it is held up, it takes the other way. If something keeps it past its place, it goes on from there.
        """
        memory = self.memory
        if memory.course is None:
            return False
        ahead, left, off = self.off_course()
        is_off, is_away = (
            abs(left) > self._near(NEAR),
            ahead > self._near(SLACK) or (not speed and -ahead > self._near(SLACK)),
        )
        if not (is_off or is_away or abs(off) > SLACK):
            memory.way = 0.0
            return False
        if (
            ahead > 0.0
            and not is_off
            and memory.way
            and self.seen.tick - memory.moved >= HELD_UP
            and not sense.back_is_free(self.seen)
        ):
            return False
        self._choose_way(speed > 0.0 and -ahead * SLANT > abs(left))
        most = SLANT if abs(left) <= FAR + self.doubt else EIGHTH * 4
        steep = (
            min(most, max(abs(left), NEAR / (max(speed, SHIFT) * TIME_STEP))) if is_off else 0.0
        )  # a step passes no more than NEAR
        turn = angle_between(off, -math.copysign(steep, left * memory.way))
        is_turned = abs(turn) <= (LITTLE if steep else SLACK)
        was_refused = RECOVERY <= self.seen.tick - memory.bumped < 2 * RECOVERY
        if not is_turned and not was_refused and sense.turn_is_free(self.seen, turn, blind_to):
            self.turn_by(turn, blind_to)
        elif is_off or not is_turned:
            self.move(
                Twist(x=speed if speed and is_turned and memory.way > 0.0 else SHIFT * memory.way),
                blind_to,
            )
        else:
            self.move(Twist(x=max(-SHIFT, min(SHIFT, -ahead / TIME_STEP))), blind_to)
        return True

    def _choose_way(self, has_room: bool) -> None:
        """Choose the way back: ahead if it has room or its place lies ahead, else back; the other one if a drive is held up."""
        memory, tick = self.memory, self.seen.tick
        if self.seen.twist != STILL:
            memory.moved = tick
        if not memory.way or (
            self.seen.twist.x and not memory.driving
        ):  # the latter: something else has driven it
            ahead, _ = to_frame(self.pose, self.course.x, self.course.y)
            memory.way, memory.moved = (
                1.0
                if has_room or (ahead > 0.0 and not sense.something_ahead(self.seen, []))
                else -1.0,
                tick,
            )
        elif (self._has_collided and memory.driving) or tick - memory.moved >= HELD_UP:
            memory.way, memory.moved = -memory.way, tick

    def _near(self, exact: float) -> float:
        """How far off its course the robot may be, m: little; so far exactly once it comes back."""
        return self.doubt + (exact if self.memory.way else LITTLE)

    @property
    def is_moved(self) -> bool:
        """Whether the robot is off the place of its course, or comes back to it."""
        ahead, left, _ = self.off_course()
        return bool(self.memory.way) or max(abs(ahead), abs(left)) > self._near(LITTLE)

    def off_course(self) -> tuple[float, float, float]:
        """Return how far the robot is off its course: m ahead, m to the left, and rad to the left."""
        course = self.course
        x, y = self.pose.x - course.x, self.pose.y - course.y
        ahead, left = {"EAST": (x, y), "NORTH": (y, -x), "WEST": (-x, -y), "SOUTH": (-y, x)}[
            course.heading
        ]
        return ahead, left, angle_between(HEADINGS[course.heading], self.pose.yaw)

    @property
    def _has_collided(self) -> bool:
        """Whether physics refused its motion in the last step."""
        return bool(self.memory.moving and self.seen.twist == STILL)

    def hold(self, ticks: int = MOST_HOLD) -> None:
        """Say that the present step would command the same for so many ticks, unless it hears or meets something."""
        self._until = self.seen.tick + min(ticks, MOST_HOLD)

    def next(self, steps: Sequence[Step]) -> None:
        """Insert steps right after the present one."""
        self.memory.plan[1:1] = steps

    def couple(self, bin_name: str) -> None:
        """Couple a bin, once the robot stands."""
        self.action.waits_for = bin_name
        if self.seen.twist == STILL:
            self.action.deeds.append(Couple(bin_name))

    def uncouple(self) -> None:
        """Uncouple the bin, once both stand."""
        if (
            self.seen.twist == STILL
            and self.seen.hitch is not None
            and self.seen.hitch.twist == STILL
        ):
            self.action.deeds.append(Uncouple())

    def ask(self, to: str, request: Request, every: int = PATIENCE) -> Answer | None:
        """Ask every `every` ticks until the step is done. Return the answer in the tick in which it is heard, else None."""
        self.action.waits_for = to
        answers = [
            r.body
            for r in self.mail.replies
            if r.sender == to and type(r.request) is type(request) and r.body is not None
        ]
        question = f"{type(request).__name__} {to}"
        if not answers and self.seen.tick - self.memory.asked.get(question, -every) >= every:
            self.action.requests.append((to, request))
            self.memory.asked[question] = self.seen.tick
        self._timers.append(self.memory.asked.get(question, self.seen.tick) + every)
        return answers[0] if answers else None

    def has(self, places: list[str]) -> bool:
        """Whether all these places are reserved for the robot."""
        return all(place in self.memory.reserved for place in places)

    def want(self, places: list[str], beside: str = "") -> None:
        """Ask traffic for places, all of them or none. `beside`: a partner with which the robot may share them."""
        self.wanting, self._beside = places, beside
        self.action.waits_for = ", ".join(self.memory.blockers)

    def free(self, places: list[str]) -> None:
        """Give places back."""
        self.memory.reserved = [place for place in self.memory.reserved if place not in places]

    def is_left(self, bin_name: str) -> bool:
        """Whether a full bin stands by itself in its lane. While it does not, ask it again and again."""
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
            self._timers, self._until = [], self.seen.tick + 1
        if not self.memory.plan and not self.comes_back([]):
            self.hold()

    def _act(self, step: Step) -> bool:
        if not step.keeps_course and self.comes_back([]):
            return False
        done = step.act(self)
        if not step.keeps_course and self.action.twist != STILL:
            self.memory.course = None
        if not _may_hold(type(step)):
            self._until = self.seen.tick + 1
        return done

    def finish(self) -> Action:
        """Return the action of this tick: what the steps command, without motion that would hit something."""
        self._claim()
        action, memory = self.action, self.memory
        action.doing, action.state = memory.doing, memory.state
        near = self._near_the_turn() if self._turn else []
        self._recover()
        action.hold = self._hold_of(action.twist)
        if action.twist.x > 0 and sense.something_ahead(self.seen, self._blind_to):
            if self._queueing:
                action.twist, action.waits_for = STILL, ""
            else:
                self._hold_up(AHEAD)
        if action.twist.x < 0 and not sense.back_is_free(self.seen):
            self._hold_up("an obstacle behind")
        if action.twist.yaw and not sense.turn_is_free(self.seen, self._turn, self._blind_to):
            self._hold_up(IN_TURN)
        if near:
            self._hold_up(", ".join(near[:3]))
        memory.moving, memory.driving, action.steps_done = (
            action.twist != STILL,
            bool(action.twist.x),
            memory.done,
        )
        return action

    def _hold_of(self, twist: Twist) -> Hold | None:
        """Return how long the robot keeps this velocity. A robot that acts, or corrects its place, is asked at every tick.

        Where it drives or turns, its hold ends when something comes into the way, or leaves it. A robot that is blind to boxes in its way
        must look at every tick; so must one that turns with a bin, because a hold does not watch the bin's laser.
        """
        until = min(self._until, *self._timers) if self._timers else self._until
        if until <= self.seen.tick + 1 or self.action.deeds or self.seen.accuracy:
            return None
        if self._turn:
            zone = sense.turn_zone(kind_of(self.seen.name))
            return (
                Hold(until, watch=(zone,))
                if self.seen.hitch is None and not zone.is_occupied(self.seen)
                else None
            )
        if twist == STILL:
            return Hold(until)
        zone = sense.stop_zone(self.seen)
        if twist.yaw or (self._blind_to and zone.is_occupied(self.seen)):
            return None
        return Hold(until, watch=(zone,))

    def _hold_up(self, obstacle: str) -> None:
        """Stand in this tick because of an obstacle."""
        self.action.twist, self.action.waits_for, self.action.state = STILL, obstacle, "stopped"

    def _recover(self) -> None:
        """Stand for a second after a collision: there was an obstacle that no laser saw, and physics refused the step."""
        memory, tick = self.memory, self.seen.tick
        if self._has_collided:
            memory.bumped = tick
        if tick - memory.bumped < RECOVERY and self.action.twist != STILL:
            self._hold_up("what it collided with")
            self._timers.append(memory.bumped + RECOVERY)

    def _hear(self) -> None:
        for reply in self.mail.replies:
            if isinstance(reply.body, Places) and isinstance(reply.request, Claim):
                granted = [
                    p
                    for p in reply.body.held
                    if p in reply.request.want and p not in self.memory.reserved
                ]
                self.memory.reserved = self.memory.reserved + granted
                self.memory.agreed, self.memory.alone = reply.body.held, reply.body.alone
                self.memory.blockers = reply.body.blockers
            elif isinstance(reply.request, Where):
                here = (
                    (reply.body.x, reply.body.y)
                    if isinstance(reply.body, Position)
                    else (math.inf, math.inf)
                )
                self.memory.sighted[reply.sender] = sense.Sighting(self.seen.tick - 1, *here)

    def _near_the_turn(self) -> list[str]:
        """The people and animals that are, or may be, in what the turn sweeps. They, and those that soon may be, are asked.

        A timer is set for the tick at which the next one must be asked: until then a turn may hold.
        """
        radius = sense.sweep_radius(KINDS[kind_of(self.seen.name)], self.seen.hitch is not None)
        found = sense.doubts(
            self._bystanders, self.memory.sighted, self.seen.tick, self.pose.x, self.pose.y, radius
        )
        self.action.requests += [(name, Where()) for name in found.to_ask]
        self._timers.append(self.seen.tick + max(1, found.ticks))
        return found.near

    def _claim(self) -> None:
        """Send traffic the places that are kept and wanted: when one was given back, and again while one is wanted."""
        memory, since = self.memory, self.seen.tick - self.memory.claimed
        given_back = sorted(memory.agreed) != sorted(memory.reserved)
        if (self.wanting and since >= PATIENCE) or (given_back and since >= GIVEN_BACK):
            self.action.requests.append(
                (
                    TRAFFIC,
                    Claim(keep=list(memory.reserved), want=list(self.wanting), beside=self._beside),
                )
            )
            memory.claimed = self.seen.tick
        if self.wanting or given_back:
            self._timers.append(
                memory.claimed + (PATIENCE if self.wanting and not given_back else GIVEN_BACK)
            )
