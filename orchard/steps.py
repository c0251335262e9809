"""The verbs: what a plan is made of. A step is data with one method, `act`, which is called every tick until it is done.

A step that acts sets the velocity of this tick, asks, or waits; it never remembers anything itself. Targets are
absolute, so a robot that was held up, or whose agent was started afresh, still ends where it should.
"""

from typing import cast

import msgspec

from orchard.bystanders import Sighting
from orchard.config import TIME_STEP
from orchard.doer import PATIENCE, RECOVERY, Doer
from orchard.geometry import HEADINGS, Twist, angle_between, nearest_heading
from orchard.kinds import EIGHTH
from orchard.messages import BinState, Carrier, Confirm, EmptyBin, Here, No, State, Yes
from orchard.sense import Box

EXACT = 1e-9  # m or rad: nearer than this is there
CRUISE = 1.0  # m/s
SELDOM = 50  # ticks between two questions whose answer changes nothing
LOOK_AHEAD = 3.0  # m before a gate at which its places are asked for


class Gate(msgspec.Struct, frozen=True):
    """A point of a drive, by the robot's centre: there it holds these places, or from there on it needs them no more."""

    places: list[str]
    at: float


class _Step(msgspec.Struct, frozen=True, tag_field="step", tag=True):
    pass


class Say(_Step, frozen=True):
    """Tell what the robot is doing from now on."""

    doing: str

    def act(self, me: Doer) -> bool:
        me.memory.doing = self.doing
        return True


class DriveTo(_Step, frozen=True):
    """Drive straight on, along the axis that it faces, until x (or y) is exactly this; slower in the last step."""

    x: float | None = None
    y: float | None = None
    speed: float = CRUISE
    needs: list[Gate] = []
    frees: list[Gate] = []
    blind_to: list[Box] = []
    queueing: bool = False  # to stand behind others here is no trouble, and not told as such

    def act(self, me: Doer) -> bool:
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

    def _limit(self, me: Doer, here: float, ahead: float, target: float) -> float:
        """The target, or the first gate ahead whose places the robot does not hold."""
        for gate in self.needs:
            if ahead * (gate.at - here) >= -EXACT and not me.holds(gate.places):
                if ahead * (gate.at - here) < LOOK_AHEAD:
                    me.want(gate.places)
                return gate.at if ahead * (target - gate.at) > 0 else target
        return target


class Face(_Step, frozen=True):
    """Turn on the spot, pi/8 rad/s, until it faces EAST, NORTH, WEST or SOUTH exactly: 4 s for a quarter turn."""

    heading: str
    blind_to: list[Box] = []

    def act(self, me: Doer) -> bool:
        left = angle_between(me.pose.yaw, HEADINGS[self.heading])
        if abs(left) <= EXACT:
            return True
        me.turn(max(-EIGHTH, min(EIGHTH, left / TIME_STEP)), left, self.blind_to)
        return False


class Realign(_Step, frozen=True):
    """Rotate by the small angle that is left to the nearest of the four headings, until exact."""

    def act(self, me: Doer) -> bool:
        return Face(nearest_heading(me.pose.yaw)).act(me)


class Ahead(_Step, frozen=True):
    """Drive so many metres forward from where it stands now, facing one of the four headings."""

    metres: float

    def act(self, me: Doer) -> bool:
        heading = nearest_heading(me.pose.yaw)
        sign = 1.0 if heading in ("EAST", "NORTH") else -1.0
        along_x = heading in ("EAST", "WEST")
        me.next([DriveTo(x=me.pose.x + sign * self.metres) if along_x else DriveTo(y=me.pose.y + sign * self.metres)])
        return True


class MoveTo(_Step, frozen=True):
    """Go to a point: first along the axis that it faces, turning about if the point lies behind, then along the other."""

    x: float
    y: float

    def act(self, me: Doer) -> bool:
        east_west = _towards("EAST", "WEST", self.x - me.pose.x), DriveTo(x=self.x)
        north_south = _towards("NORTH", "SOUTH", self.y - me.pose.y), DriveTo(y=self.y)
        legs = [east_west, north_south] if nearest_heading(me.pose.yaw) in ("EAST", "WEST") else [north_south, east_west]
        me.next([step for face, drive in legs for step in ((Face(face), drive) if face else ())])
        return True


def _towards(positive: str, negative: str, distance: float) -> str:
    """The heading in which a distance along an axis is driven; '' where there is nothing to drive."""
    return "" if abs(distance) <= EXACT else positive if distance > 0 else negative


class Wait(_Step, frozen=True):
    """Stand for so many seconds."""

    seconds: float

    def act(self, me: Doer) -> bool:
        return bool((me.seen.tick - me.memory.since) * TIME_STEP >= self.seconds - EXACT)


class Need(_Step, frozen=True):
    """Stand until traffic has given the robot all these places, shared at most with a partner."""

    places: list[str]

    def act(self, me: Doer) -> bool:
        if me.holds(self.places):
            return True
        me.want(self.places)
        return False


class Free(_Step, frozen=True):
    """Give places back."""

    places: list[str]

    def act(self, me: Doer) -> bool:
        me.free(self.places)
        return True


class Alone(_Step, frozen=True):
    """Stand until nobody shares a place that the robot holds."""

    place: str

    def act(self, me: Doer) -> bool:
        return me.is_alone_in(self.place)


class Deliver(_Step, frozen=True):
    """A carrier's: leave the empty bin on the picker's coupling point, tell the picker, and wait until it has taken it."""

    picker: str

    def act(self, me: Doer) -> bool:
        if me.seen.hitch is not None:
            me.memory.delivered = me.seen.hitch.name
            me.uncouple()
            return False
        return isinstance(me.ask(self.picker, Here(me.memory.delivered)), Yes)


class TakeBin(_Step, frozen=True):
    """Couple the bin that stands behind the robot."""

    bin: str

    def act(self, me: Doer) -> bool:
        if me.seen.hitch is not None and me.seen.hitch.name == self.bin:
            return True
        me.couple(self.bin)
        return False


class LeaveBin(_Step, frozen=True):
    """Uncouple the bin and remember it as the full one."""

    def act(self, me: Doer) -> bool:
        if me.seen.hitch is None:
            return True
        me.memory.full_bin, me.memory.offered, me.memory.carrier = me.seen.hitch.name, "", ""
        me.uncouple()
        return False


class FetchEmpty(_Step, frozen=True):
    """A picker's: call for an empty bin, couple it when a carrier has brought it, and take over the place it stands in."""

    place: str

    def act(self, me: Doer) -> bool:
        if not me.memory.offered:
            answer = me.ask(me.memory.full_bin, EmptyBin(), every=SELDOM)
            me.memory.carrier = answer.carrier if isinstance(answer, Carrier) else me.memory.carrier
            return False
        if me.seen.hitch is None:
            me.couple(me.memory.offered)
            return False
        if not me.holds([self.place]):
            me.want([self.place], beside=me.memory.carrier)
            return False
        me.memory.taken = me.memory.offered
        return True


class Unload(_Step, frozen=True):
    """A carrier's: stand in the bay until the bin says that it is empty."""

    def act(self, me: Doer) -> bool:
        answer = me.ask(me.seen.hitch.name, State()) if me.seen.hitch else None
        return isinstance(answer, BinState) and not answer.full


class Confirmed(_Step, frozen=True):
    """A carrier's, before it leaves: go only if the bin still wants it, else do something else."""

    bin: str
    otherwise: list["Step"]

    def act(self, me: Doer) -> bool:
        answer = me.ask(self.bin, Confirm())
        if isinstance(answer, No):
            me.memory.plan[1:] = self.otherwise
        return answer is not None


class Home(_Step, frozen=True):
    """A carrier's: the job is done, it waits to be called again."""

    def act(self, me: Doer) -> bool:
        me.memory.job = None
        return True


class Again(_Step, frozen=True):
    """Do these steps over and over."""

    steps: list["Step"]

    def act(self, me: Doer) -> bool:
        me.next([*self.steps, self])
        return True


Step = (
    Say | DriveTo | Face | Realign | Ahead | MoveTo | Wait | Need | Free
    | Alone | Deliver | TakeBin | LeaveBin | FetchEmpty | Unload | Confirmed | Home | Again
)


class Plan(msgspec.Struct):
    """The memory of a robot that follows a plan."""

    plan: list[Step] = []
    done: int = 0  # steps, since the beginning
    since: int = 0  # tick at which the present step began
    doing: str = ""
    held: list[str] = []  # places that traffic gave it
    agreed: list[str] = []  # of those, and of places given back, what traffic last said it holds
    alone: list[str] = []  # of those, what it shared with nobody when traffic last spoke
    claimed: int = -PATIENCE  # tick of its last word to traffic
    moving: bool = False  # whether it wanted to move in the last tick
    bumped: int = -RECOVERY  # tick at which it last found that it could not
    sighted: dict[str, Sighting] = {}  # where people and animals said that they were
    asked: dict[str, int] = {}  # question -> tick in which the present step last asked it
