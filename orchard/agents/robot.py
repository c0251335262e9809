"""A robot that follows a plan, during one tick: what its steps may feel and command.

The memory of such a robot is its plan and the place in it. What this class adds is how a tick runs: hear what traffic
granted, do steps until one wants time, and last of all stop for what is in the way, whatever the step said.
"""

import math
from collections.abc import Sequence
from typing import Any

import msgspec

from orchard.agents.bystanders import Bystander, Sighting, doubts, sweep_radius
from orchard.agents.sense import Box, something_ahead, turn_is_free
from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.messages import TRAFFIC, Answer, Claim, Couple, Places, Position, Request, Uncouple, Where
from orchard.field.geometry import STILL, Pose, Twist
from orchard.field.kinds import KINDS, kind_of

PATIENCE = 5  # ticks after which a question that was not answered as hoped is asked again
RECOVERY = 10  # ticks for which a robot stands after a step that was refused


class RobotMemory(msgspec.Struct):
    """What every robot that follows a plan remembers. `steps.Plan` adds the plan itself."""

    done: int = 0  # steps, since the beginning
    since: int = 0  # tick at which the present step began
    doing: str = ""
    held: list[str] = []  # places that traffic granted
    agreed: list[str] = []  # places that traffic last said the robot holds
    alone: list[str] = []  # of those, places that the robot shared with none when traffic last answered
    claimed: int = -PATIENCE  # tick of the last claim to traffic
    moving: bool = False  # whether it wanted to move in the last tick
    bumped: int = -RECOVERY  # tick at which it last found that it could not
    sighted: dict[str, Sighting] = {}  # where people and animals said that they were
    asked: dict[str, int] = {}  # question -> tick at which the present step last asked it


class Step(msgspec.Struct, frozen=True, tag_field="step", tag=True):
    """One step of a plan, as data. The class name is its name in a memory's bytes."""

    def act(self, robot: "PlanExecutor") -> bool:
        """Command `robot` for this tick; True when the step is done. It is called every tick until then."""
        raise NotImplementedError


class PlanExecutor:
    """One robot at one tick."""

    def __init__(self, seen: Observation, mail: Mail, memory: RobotMemory, bystanders: tuple[Bystander, ...] = ()) -> None:
        self.seen, self.mail, self._bystanders = seen, mail, bystanders
        self.memory: Any = memory  # what each kind adds to a Plan is known to its own steps alone
        self.pose: Pose = seen.pose
        self.action = Action(memory=memory)
        self.wanting: list[str] = []
        self._beside = ""
        self._turn = 0.0
        self._blind_to: list[Box] = []
        self._queueing = False

    # -- what steps do

    def move(self, twist: Twist, blind_to: list[Box], queueing: bool = False) -> None:
        """Drive with this velocity in this tick, unless something but these boxes is in the way."""
        self.action.twist, self._blind_to, self._queueing = twist, blind_to, queueing

    def turn(self, rate: float, left: float, blind_to: list[Box]) -> None:
        """Turn at this rate (rad/s) in this tick, unless something is in the part of the turn that is left (rad)."""
        self.action.twist, self._turn, self._blind_to = Twist(yaw=rate), left, blind_to

    def next(self, steps: Sequence[Step]) -> None:
        """Put steps right behind the present one."""
        self.memory.plan[1:1] = steps

    def couple(self, bin_name: str) -> None:
        """Take a bin, once the robot stands."""
        self.action.waits_for = bin_name
        if self.seen.twist == STILL:
            self.action.deeds.append(Couple(bin_name))

    def uncouple(self) -> None:
        """Leave the bin, once both stand."""
        if self.seen.twist == STILL and self.seen.hitch is not None and self.seen.hitch.twist == STILL:
            self.action.deeds.append(Uncouple())

    def ask(self, to: str, request: Request, every: int = PATIENCE) -> Answer | None:
        """Ask again and again until the step is done; what the answer is, in the tick in which one is heard."""
        self.action.waits_for = to
        answers = [r.body for r in self.mail.replies if r.sender == to and type(r.request) is type(request) and r.body is not None]
        question = f"{type(request).__name__} {to}"
        if not answers and self.seen.tick - self.memory.asked.get(question, -every) >= every:
            self.action.requests.append((to, request))
            self.memory.asked[question] = self.seen.tick
        return answers[0] if answers else None

    # -- places

    def holds(self, places: list[str]) -> bool:
        return all(place in self.memory.held for place in places)

    def want(self, places: list[str], beside: str = "") -> None:
        """Ask traffic for places, all of them or none, if need be together with a partner who holds some."""
        self.wanting, self._beside = places, beside

    def free(self, places: list[str]) -> None:
        if any(place in self.memory.held for place in places):
            self.memory.held = [place for place in self.memory.held if place not in places]

    def is_alone_in(self, place: str) -> bool:
        """Whether nobody shares a place; asks traffic until it is so."""
        if place in self.memory.alone:
            return True
        self.wanting = [place]
        return False

    # -- how a tick runs

    def follow(self) -> None:
        """Do the plan's steps until one of them wants time."""
        self._hear_traffic()
        self._hear_bystanders()
        while self.memory.plan and self.memory.plan[0].act(self):
            del self.memory.plan[0]
            self.memory.done += 1
            self.memory.since = self.seen.tick
            self.memory.asked = {}
            self.action.waits_for = ""

    def finish(self) -> Action:
        """The action of this tick: the steps' wishes, less what would hit something."""
        self._claim()
        action = self.action
        self._mind_bump()
        if action.twist.x > 0 and something_ahead(self.seen, self._blind_to):
            action.twist, action.waits_for = STILL, "" if self._queueing else "an obstacle ahead"
        if action.twist.yaw and not turn_is_free(self.seen, self._turn, self._blind_to):
            action.twist, action.waits_for = STILL, "an obstacle in its turn"
        if self._turn and (near := self._near_the_turn()):
            action.twist, action.waits_for = STILL, ", ".join(near[:3])
        self.memory.moving = action.twist != STILL
        action.doing, action.steps_done = self.memory.doing, self.memory.done
        return action

    def _mind_bump(self) -> None:
        """Stand for a second after a step that physics refused: something was in the way that no laser saw."""
        memory, tick = self.memory, self.seen.tick
        if memory.moving and self.seen.twist == STILL:
            memory.bumped = tick
        if tick - memory.bumped < RECOVERY and self.action.twist != STILL:
            self.action.twist, self.action.waits_for = STILL, "what it bumped into"

    def _hear_traffic(self) -> None:
        for reply in self.mail.replies:
            if isinstance(reply.body, Places) and isinstance(reply.request, Claim):
                granted = [p for p in reply.body.held if p in reply.request.want and p not in self.memory.held]
                self.memory.held = self.memory.held + granted
                self.memory.agreed, self.memory.alone = reply.body.held, reply.body.alone
                if reply.body.blockers:
                    self.action.waits_for = ", ".join(reply.body.blockers)

    def _hear_bystanders(self) -> None:
        """Note where those are that were asked; one that does not answer is noted as such."""
        for reply in self.mail.replies:
            if isinstance(reply.request, Where):
                here = (reply.body.x, reply.body.y) if isinstance(reply.body, Position) else (math.inf, math.inf)
                self.memory.sighted[reply.sender] = Sighting(self.seen.tick - 1, *here)

    def _near_the_turn(self) -> list[str]:
        """Who is, or may be, within what the turn sweeps; those of whom that is not certain for long are asked."""
        radius = sweep_radius(KINDS[kind_of(self.seen.name)], self.seen.hitch is not None)
        near, to_ask = doubts(self._bystanders, self.memory.sighted, self.seen.tick, self.pose.x, self.pose.y, radius)
        self.action.requests += [(name, Where()) for name in to_ask]
        return near

    def _claim(self) -> None:
        """Tell traffic what is kept and wanted: at once when something was given back, and again while something is wanted."""
        memory, since = self.memory, self.seen.tick - self.memory.claimed
        given_back = sorted(memory.agreed) != sorted(memory.held)
        if (self.wanting and since >= PATIENCE) or (given_back and since >= 2):
            self.action.requests.append((TRAFFIC, Claim(keep=list(memory.held), want=list(self.wanting), beside=self._beside)))
            memory.claimed = self.seen.tick
