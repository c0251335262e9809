"""The verbs: what a plan is made of. A step is data with one method, `act`, which is called every tick until it is done.

A step that acts sets the velocity of this tick, asks, or waits; it never remembers anything itself. Targets are
absolute, so a robot that was held up, or whose agent was started afresh, still ends where it should.
"""

from typing import TYPE_CHECKING, cast

import msgspec

from orchard.agents.robot import PlanExecutor, RobotMemory, Step
from orchard.agents.sense import Box
from orchard.contract.messages import BinState, CarrierComing, Confirm, EmptyBin, Here, No, StateRequest, Yes
from orchard.field.geometry import HEADINGS, Twist, angle_between, nearest_heading
from orchard.field.kinds import EIGHTH
from orchard.field.scenario import TIME_STEP

EXACT = 1e-9  # m or rad: nearer than this is there
CRUISE = 1.0  # m/s
SELDOM = 50  # ticks between two questions whose answer changes nothing
LOOK_AHEAD = 3.0  # m before a gate at which its places are asked for


class Gate(msgspec.Struct, frozen=True):
    """A point of a drive, by the robot's centre: there it holds these places, or from there on it needs them no more."""

    places: list[str]
    at: float


class Say(Step, frozen=True):
    """Tell what the robot is doing from now on."""

    doing: str

    def act(self, me: PlanExecutor) -> bool:
        me.memory.doing = self.doing
        return True


class DriveTo(Step, frozen=True):
    """Drive straight on, along the axis that it faces, until x (or y) is exactly this; slower in the last step."""

    x: float | None = None
    y: float | None = None
    speed: float = CRUISE
    needs: list[Gate] = []
    frees: list[Gate] = []
    blind_to: list[Box] = []
    queueing: bool = False  # to stand behind others here is no trouble, and not told as such

    def act(self, me: PlanExecutor) -> bool:
        here, target = (me.pose.x, self.x) if self.x is not None else (me.pose.y, cast(float, self.y))
        ahead = 1.0 if nearest_heading(me.pose.yaw) in ("EAST", "NORTH") else -1.0
        for gate in self.frees:
            if ahead * (here - gate.at) > -EXACT:
                me.free(gate.places)
        left = ahead * (self._limit(me, here, ahead, target) - here)
        if left <= EXACT:
            return ahead * (target - here) <= EXACT
        me.move(Twist(x=min(self.speed, left / TIME_STEP)), self.blind_to, self.queueing)
        return False

    def _limit(self, me: PlanExecutor, here: float, ahead: float, target: float) -> float:
        """The target, or the first gate ahead whose places the robot does not hold."""
        for gate in self.needs:
            if ahead * (gate.at - here) >= -EXACT and not me.holds(gate.places):
                if ahead * (gate.at - here) < LOOK_AHEAD:
                    me.want(gate.places)
                return gate.at if ahead * (target - gate.at) > 0 else target
        return target


class Face(Step, frozen=True):
    """Turn on the spot, pi/8 rad/s, until it faces EAST, NORTH, WEST or SOUTH exactly: 4 s for a quarter turn."""

    heading: str
    blind_to: list[Box] = []

    def act(self, me: PlanExecutor) -> bool:
        left = angle_between(me.pose.yaw, HEADINGS[self.heading])
        if abs(left) <= EXACT:
            return True
        me.turn(max(-EIGHTH, min(EIGHTH, left / TIME_STEP)), left, self.blind_to)
        return False


class Realign(Step, frozen=True):
    """Rotate by the small angle that is left to the nearest of the four headings, until exact."""

    def act(self, me: PlanExecutor) -> bool:
        return Face(nearest_heading(me.pose.yaw)).act(me)


class Ahead(Step, frozen=True):
    """Drive so many metres forward from where it stands now, facing one of the four headings."""

    metres: float

    def act(self, me: PlanExecutor) -> bool:
        heading = nearest_heading(me.pose.yaw)
        sign = 1.0 if heading in ("EAST", "NORTH") else -1.0
        along_x = heading in ("EAST", "WEST")
        me.next([DriveTo(x=me.pose.x + sign * self.metres) if along_x else DriveTo(y=me.pose.y + sign * self.metres)])
        return True


class MoveTo(Step, frozen=True):
    """Go to a point: first along the axis that it faces, turning about if the point lies behind, then along the other."""

    x: float
    y: float

    def act(self, me: PlanExecutor) -> bool:
        east_west = _towards("EAST", "WEST", self.x - me.pose.x), DriveTo(x=self.x)
        north_south = _towards("NORTH", "SOUTH", self.y - me.pose.y), DriveTo(y=self.y)
        legs = [east_west, north_south] if nearest_heading(me.pose.yaw) in ("EAST", "WEST") else [north_south, east_west]
        me.next([step for face, drive in legs for step in ((Face(face), drive) if face else ())])
        return True


def _towards(positive: str, negative: str, distance: float) -> str:
    """The heading in which a distance along an axis is driven; '' where there is nothing to drive."""
    return "" if abs(distance) <= EXACT else positive if distance > 0 else negative


class Wait(Step, frozen=True):
    """Stand for so many seconds."""

    seconds: float

    def act(self, me: PlanExecutor) -> bool:
        return bool((me.seen.tick - me.memory.since) * TIME_STEP >= self.seconds - EXACT)


class Need(Step, frozen=True):
    """Stand until traffic has given the robot all these places, shared at most with a partner."""

    places: list[str]

    def act(self, me: PlanExecutor) -> bool:
        if me.holds(self.places):
            return True
        me.want(self.places)
        return False


class Free(Step, frozen=True):
    """Give places back."""

    places: list[str]

    def act(self, me: PlanExecutor) -> bool:
        me.free(self.places)
        return True


class Alone(Step, frozen=True):
    """Stand until nobody shares a place that the robot holds."""

    place: str

    def act(self, me: PlanExecutor) -> bool:
        return me.is_alone_in(self.place)


class Deliver(Step, frozen=True):
    """A carrier's: leave the empty bin on the picker's coupling point, tell the picker, and wait until it has taken it."""

    picker: str

    def act(self, me: PlanExecutor) -> bool:
        if me.seen.hitch is not None:
            me.memory.delivered = me.seen.hitch.name
            me.uncouple()
            return False
        return isinstance(me.ask(self.picker, Here(me.memory.delivered)), Yes)


class TakeBin(Step, frozen=True):
    """Couple the bin that stands behind the robot."""

    bin: str

    def act(self, me: PlanExecutor) -> bool:
        if me.seen.hitch is not None and me.seen.hitch.name == self.bin:
            return True
        me.couple(self.bin)
        return False


class LeaveBin(Step, frozen=True):
    """Uncouple the bin and remember it as the full one."""

    def act(self, me: PlanExecutor) -> bool:
        if me.seen.hitch is None:
            return True
        me.memory.full_bin, me.memory.offered, me.memory.carrier = me.seen.hitch.name, "", ""
        me.uncouple()
        return False


class FetchEmpty(Step, frozen=True):
    """A picker's: call for an empty bin, couple it when a carrier has brought it, and take over the place it stands in."""

    place: str

    def act(self, me: PlanExecutor) -> bool:
        if not me.memory.offered:
            answer = me.ask(me.memory.full_bin, EmptyBin(), every=SELDOM)
            me.memory.carrier = answer.carrier if isinstance(answer, CarrierComing) else me.memory.carrier
            return False
        if me.seen.hitch is None:
            me.couple(me.memory.offered)
            return False
        if not me.holds([self.place]):
            me.want([self.place], beside=me.memory.carrier)
            return False
        me.memory.taken = me.memory.offered
        return True


class Unload(Step, frozen=True):
    """A carrier's: stand in the bay until the bin says that it is empty."""

    def act(self, me: PlanExecutor) -> bool:
        answer = me.ask(me.seen.hitch.name, StateRequest()) if me.seen.hitch else None
        return isinstance(answer, BinState) and not answer.full


class Confirmed(Step, frozen=True):
    """A carrier's, before it leaves: go only if the bin still wants it, else do something else."""

    bin: str
    otherwise: list["AnyStep"]

    def act(self, me: PlanExecutor) -> bool:
        answer = me.ask(self.bin, Confirm())
        if isinstance(answer, No):
            me.memory.plan[1:] = self.otherwise
        return answer is not None


class Home(Step, frozen=True):
    """A carrier's: the job is done, it waits to be called again."""

    def act(self, me: PlanExecutor) -> bool:
        me.memory.job = None
        return True


class Again(Step, frozen=True):
    """Do these steps over and over."""

    steps: list["AnyStep"]

    def act(self, me: PlanExecutor) -> bool:
        me.next([*self.steps, self])
        return True


if TYPE_CHECKING:
    AnyStep = Step
else:  # for msgspec, which decodes the steps of a memory: these, and those that `with_steps` adds
    AnyStep = (
        Say
        | DriveTo
        | Face
        | Realign
        | Ahead
        | MoveTo
        | Wait
        | Need
        | Free
        | Alone
        | Deliver
        | TakeBin
        | LeaveBin
        | FetchEmpty
        | Unload
        | Confirmed
        | Home
        | Again
    )


class Plan(RobotMemory):
    """The memory of a robot that follows a plan: the steps that are left, the present one first."""

    plan: list[AnyStep] = []
