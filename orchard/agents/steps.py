"""The steps of which plans are made. A step is data with one method, `act`, which is called until the step is done.

`act` sets the velocity of this tick, asks, or waits. A step itself remembers nothing. Its target is absolute, so a robot still ends at the
right place after it was held up, or after its agent was started again.
"""

from collections.abc import Sequence
from functools import cache, reduce
from operator import or_
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import msgspec
from msgspec.structs import replace

from orchard.agents.robot import (
    ASK,
    EXACT,
    LITTLE,
    PATIENCE,
    SHIFT,
    SLACK,
    Gate,
    PlanExecutor,
    RobotMemory,
    Step,
)
from orchard.agents.sense import Box
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
from orchard.field.kinds import EIGHTH
from orchard.field.layout import UNLOADING_SECONDS
from orchard.field.passes import FULL_WITHIN
from orchard.field.picking import failure
from orchard.field.scenario import TIME_STEP

CRUISE = 1.0  # m/s
SELDOM = 50  # ticks between two questions if the answer changes nothing
CLEAR_OF_TURNS = 3.0  # m past a gate at which a robot that stands is clear of one that turns behind it, whose front corner no laser sees
LONGEST_WAIT = 300.0  # s in one step of a repair; a run is jammed after 600 s without progress
THERE = 0.01  # m: where a robot that searches for the coupling point counts as there
PULL = 1.0  # m which it drives ahead to come to one side
COUPLE = 2  # ticks to couple a bin: the robot must have stood for one tick
BIN_FOLLOWS = 2  # ticks after its robot at which a bin stands
UNCOUPLE = BIN_FOLLOWS + COUPLE
TRIES = 5  # ticks for which it tries to couple in one place
GRID = 0.14  # m from one place to the next: none of the area between is farther from a place than a bin can be coupled
SEARCH = [
    (GRID * left, GRID * ahead) for left in (0, 1, -1, 2, -2) for ahead in (0, 1, -1, 2)
]  # from the first, m
PASSED = 0.5  # m past a gate from which a robot that is not sure of its place takes it to be behind
LOOK_AHEAD = 3.0  # s before a robot is at a gate, at which it asks for its places: earlier would keep others off


class Say(Step, frozen=True):
    """Set what the robot does from now on: `doing` for people, `state` for programs."""

    doing: str
    state: State
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        robot.memory.doing, robot.memory.state = self.doing, self.state
        return True


class DriveTo(Step, frozen=True):
    """Drive straight on until x (or y) is exactly the target; slower in the last step."""

    x: float | None = None
    y: float | None = None
    speed: float = CRUISE
    needs: list[Gate] = []
    frees: list[Gate] = []
    blind_to: list[Box] = []
    queueing: bool = False  #: to stand behind other robots is normal here, and is not reported
    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        course, axis = robot.course, "y" if self.x is None else "x"
        here, before, target = (getattr(it, axis) for it in (robot.pose, course, self))
        ahead = 1.0 if course.heading in ("EAST", "NORTH") else -1.0
        robot.free(
            [
                place
                for gate in self.frees
                if ahead * (here - gate.at) > -EXACT
                for place in gate.places
            ]
        )
        limit = self._limit(
            robot, here, min(here, before, key=lambda at: ahead * at), ahead, target
        )
        setattr(course, axis, limit)
        left = ahead * (limit - here)
        if robot.comes_back(self.blind_to, self.speed):
            return False
        if left <= EXACT:
            robot.hold()
            return bool(ahead * (target - here) <= EXACT)
        robot.move(Twist(x=min(self.speed, left / TIME_STEP)), self.blind_to, self.queueing)
        robot.hold(self._ticks(robot, here, ahead, left))
        return False

    def motion(self, start: Pose) -> tuple[Pose, float]:
        end = start._replace(
            x=start.x if self.x is None else self.x, y=start.y if self.y is None else self.y
        )
        return end, (abs(end.x - start.x) + abs(end.y - start.y)) / self.speed

    @property
    def asks_before(self) -> float:
        """How far before a gate the robot asks for its places, m."""
        return LOOK_AHEAD * self.speed

    def _ticks(self, robot: PlanExecutor, here: float, ahead: float, left: float) -> int:
        if self.speed <= 0.0:
            return 1
        reserved, asks_before = set(robot.memory.reserved), self.asks_before
        frees = [
            ahead * (gate.at - here) for gate in self.frees if not reserved.isdisjoint(gate.places)
        ]
        needs = [
            ahead * (gate.at - here) - asks_before
            for gate in self.needs
            if not reserved.issuperset(gate.places)
        ]
        rooms = [left - self.speed * TIME_STEP, *frees, *(room for room in needs if room >= 0.0)]
        return int(max(0.0, min(rooms) - SLACK) / (self.speed * TIME_STEP)) + 1

    def _limit(
        self, robot: PlanExecutor, here: float, past: float, ahead: float, target: float
    ) -> float:
        """The target, or the first gate before it with places that are not reserved. `past`: to where it has passed gates."""
        for gate in self.needs:
            if ahead * (gate.at - past) >= -(
                PASSED if robot.position_bound else EXACT
            ) and not robot.has(gate.places):
                if ahead * (gate.at - here) < self.asks_before and (
                    not gate.bin or robot.is_left(gate.bin)
                ):
                    robot.want(gate.places)
                return gate.at if ahead * (target - gate.at) > 0 else target
        return target


class Face(Step, frozen=True):
    """Turn on the spot, pi/8 rad/s, until the robot faces EAST, NORTH, WEST or SOUTH exactly: 4 s for a quarter turn.

    `swings`: the share of a quarter turn after which a bin on the bar is no longer in the way of a robot behind it.
    """

    heading: str
    blind_to: list[Box] = []
    keeps_course: ClassVar[bool] = True
    swings: ClassVar[float] = 0.4

    def act(self, robot: PlanExecutor) -> bool:
        robot.course.heading = self.heading
        if robot.is_moved:
            return not robot.comes_back(self.blind_to)
        return _turns_to(robot, HEADINGS[self.heading], self.blind_to)

    def motion(self, start: Pose) -> tuple[Pose, float]:
        yaw = HEADINGS[self.heading]
        return start._replace(yaw=yaw), abs(angle_between(start.yaw, yaw)) / EIGHTH


def _turns_to(robot: PlanExecutor, yaw: float, blind_to: list[Box]) -> bool:
    left = angle_between(robot.pose.yaw, yaw)
    if abs(left) > EXACT:
        robot.turn_by(left, blind_to)
    return abs(left) <= EXACT


class Realign(Step, frozen=True):
    """Turn on the spot to the nearest of the four headings, until exact."""

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        return Face(nearest_heading(robot.pose.yaw)).act(robot)

    def motion(self, start: Pose) -> tuple[Pose, float]:
        return Face(nearest_heading(start.yaw)).motion(start)


class Ahead(Step, frozen=True):
    """Drive `metres` forward from the present place, facing one of the four headings."""

    metres: float

    def act(self, robot: PlanExecutor) -> bool:
        heading = nearest_heading(robot.pose.yaw)
        sign = 1.0 if heading in ("EAST", "NORTH") else -1.0
        along_x = heading in ("EAST", "WEST")
        robot.next(
            [
                DriveTo(x=robot.pose.x + sign * self.metres)
                if along_x
                else DriveTo(y=robot.pose.y + sign * self.metres)
            ]
        )
        return True


class MoveTo(Step, frozen=True):
    """Drive to a point: first along the axis that the robot faces, then along the other one."""

    x: float
    y: float

    def act(self, robot: PlanExecutor) -> bool:
        east_west = _towards("EAST", "WEST", self.x - robot.pose.x), DriveTo(x=self.x)
        north_south = _towards("NORTH", "SOUTH", self.y - robot.pose.y), DriveTo(y=self.y)
        legs = (
            [east_west, north_south]
            if nearest_heading(robot.pose.yaw) in ("EAST", "WEST")
            else [north_south, east_west]
        )
        robot.next([step for face, drive in legs for step in ((Face(face), drive) if face else ())])
        return True


def _towards(positive: str, negative: str, distance: float) -> str:
    return "" if abs(distance) <= EXACT else positive if distance > 0 else negative


class Wait(Step, frozen=True):
    """Stand for `seconds`."""

    seconds: float

    def act(self, robot: PlanExecutor) -> bool:
        waited = (robot.seen.tick - robot.memory.since) * TIME_STEP
        robot.hold(max(1, int(min(MOST_HOLD, (self.seconds - waited) / TIME_STEP))))
        return bool(waited >= self.seconds - EXACT)

    def motion(self, start: Pose) -> tuple[Pose, float]:
        return start, self.seconds


class Need(Step, frozen=True):
    """Stand until traffic has granted all these places. At most a partner shares them."""

    ticks = ASK
    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        if robot.has(self.places):
            return True
        robot.want(self.places)
        robot.hold()
        return False


class Free(Step, frozen=True):
    """Give places back."""

    places: list[str]

    def act(self, robot: PlanExecutor) -> bool:
        robot.free(self.places)
        return True


class Alone(Step, frozen=True):
    """Stand until no other robot shares a place that is reserved for the robot."""

    place: str

    def act(self, robot: PlanExecutor) -> bool:
        robot.hold()
        return robot.is_alone_in(self.place)


class Deliver(Step, frozen=True):
    """For carriers: leave the empty bin on the picker's coupling point, until the picker has taken it."""

    handles = UNCOUPLE
    ticks = handles + PATIENCE + ASK
    picker: str

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is not None:
            robot.memory.delivered = robot.seen.hitch.name
            robot.uncouple()
            return False
        robot.hold()
        return isinstance(robot.ask(self.picker, Here(robot.memory.delivered)), Yes)


class Coupling(Step, frozen=True, kw_only=True):
    """A step that couples a bin. A robot that is not sure of its place searches for the coupling point."""

    handles = COUPLE
    tried: int = 0  #: places of the search in which it has tried
    at: tuple[float, float] | None = None  #: x and y of the first of them, m

    def couple(self, robot: PlanExecutor, bin_name: str) -> bool:
        """Couple a bin. Return whether this step was put off, because the robot tries another place first."""
        robot.couple(bin_name)
        began = robot.memory.asked.setdefault(f"couple {bin_name}", robot.seen.tick)
        if not robot.seen.accuracy or robot.seen.tick - began < TRIES:
            return False
        tried = (self.tried + 1) % len(
            SEARCH
        )  # the error changes slowly: a place that was tried may do later
        x, y = self.at or (robot.pose.x, robot.pose.y)
        yaw, (before, _), (left, ahead) = (
            HEADINGS[nearest_heading(robot.pose.yaw)],
            SEARCH[self.tried],
            SEARCH[tried],
        )
        s, c = repeatable.sin_cos(yaw)
        here = Shift(x + c * ahead - s * left, y + s * ahead + c * left)
        aside = Shift(x + c * PULL - s * left, y + s * PULL + c * left)
        slant = repeatable.atan2(aside.y - robot.pose.y, aside.x - robot.pose.x)
        around = [Aim(slant), aside, Aim(yaw)] if left != before else []
        robot.next([*around, here, replace(self, tried=tried, at=(x, y))])
        robot.action.deeds = []
        return True


class Aim(Step, frozen=True):
    """Turn on the spot to a yaw, rad."""

    yaw: float

    def act(self, robot: PlanExecutor) -> bool:
        return _turns_to(robot, self.yaw, [])


class Shift(Step, frozen=True):
    """Drive slowly, ahead or back, to the point nearest to (x, y) on the robot's line, or up to an obstacle."""

    x: float
    y: float

    def act(self, robot: PlanExecutor) -> bool:
        left, _ = to_frame(robot.pose, self.x, self.y)
        if abs(left) <= THERE or (robot.memory.moving and robot.seen.twist == STILL):
            return True
        robot.move(Twist(x=max(-SHIFT, min(SHIFT, left / TIME_STEP))), [])
        return False


class TakeBin(Coupling, frozen=True):
    """Couple the bin that stands behind the robot."""

    ticks = COUPLE
    bin: str

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is not None and robot.seen.hitch.name == self.bin:
            return True
        return self.couple(robot, self.bin)


class Announce(Step, frozen=True):
    """For pickers: announce to the bin at which end of which row it will be left next, and with how many metres in it."""

    ticks = ASK
    row: int
    end: str
    fill: float

    def act(self, robot: PlanExecutor) -> bool:
        bin_ = robot.seen.hitch
        if (
            bin_ is None or robot.seen.tick - robot.memory.since > 2 * PATIENCE
        ):  # a bin that was not told calls when it is left
            return True
        return robot.ask(bin_.name, LeftAt(self.row, self.end, self.fill)) is not None


class PickFrom(Step, frozen=True):
    """For pickers: pick nothing before this x in the next row."""

    x: float  #: m

    def act(self, robot: PlanExecutor) -> bool:
        robot.action.deeds.append(messages.PickFrom(self.x))
        return True


class Fill(Step, frozen=True):
    """For pickers that are not sure of their place: at a row's end, drive on little by little until the bin holds so much."""

    most: float  #: m
    fill: float  #: m

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None or self.most <= 0.0:
            return True
        answer = robot.ask(robot.seen.hitch.name, StateRequest())
        if isinstance(answer, BinState) and answer.fill < self.fill - FULL_WITHIN:
            robot.next([Ahead(LITTLE), Fill(self.most - LITTLE, self.fill)])
        return isinstance(answer, BinState)


class LeaveBin(Step, frozen=True):
    """For pickers: uncouple the bin, and remember it as the full bin."""

    handles = UNCOUPLE
    ticks = handles

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None:
            return True
        robot.memory.full_bin, robot.memory.offered, robot.memory.carrier = (
            robot.seen.hitch.name,
            "",
            "",
        )
        robot.uncouple()
        return False


class FetchEmpty(Coupling, frozen=True):
    """For pickers: wait until a carrier has brought an empty bin, couple the bin, and take over the place where it stands."""

    place: str

    def act(self, robot: PlanExecutor) -> bool:
        if not robot.memory.offered:
            answer = robot.ask(robot.memory.full_bin, EmptyBin(), every=SELDOM)
            robot.memory.carrier = (
                answer.carrier if isinstance(answer, CarrierComing) else robot.memory.carrier
            )
            robot.hold()
            return False
        if robot.seen.hitch is None:
            return self.couple(robot, robot.memory.offered)
        if not robot.has([self.place]):
            robot.want([self.place], beside=robot.memory.carrier)
            robot.hold()
            return False
        robot.memory.taken, robot.memory.carrier = robot.memory.offered, ""
        return True


class MayFail(Step, frozen=True):
    """Decide, before a robot drives, whether it fails on the way. Then add its repair."""

    seed: int
    mean_between: float  #: s of work
    mean_repair: float  #: s
    keeps_course: ClassVar[bool] = True  # of the drive that follows

    def act(self, robot: PlanExecutor) -> bool:
        memory, drive = robot.memory, cast(DriveTo, robot.memory.plan[1])
        until, repair = failure(
            self.seed, robot.seen.name, memory.failures, self.mean_between, self.mean_repair
        )
        axis = "y" if drive.x is None else "x"
        here = getattr(robot.pose, axis)
        way = getattr(drive, axis) - here
        needed, sound = (
            abs(way) / drive.speed,
            max(0.0, until - memory.worked),
        )  # s of work: for the rest of the drive; to the failure
        if sound >= needed:
            memory.worked += needed
            return True
        memory.failures, memory.worked = memory.failures + 1, 0.0
        at = here + way * sound / needed
        needs = [
            gate for gate in drive.needs if (at - gate.at) * way > 0.0
        ]  # it asks for no place that it does not come to
        frees = [
            gate for gate in drive.frees if abs(at - gate.at) > CLEAR_OF_TURNS
        ]  # and keeps what it stands near
        stand = (
            Say("failed, is repaired", "failed"),
            Repair(repair),
            Say(memory.doing, memory.state),
        )
        robot.next([replace(drive, **{axis: at}, needs=needs, frees=frees), *stand, self])
        return True


class Repair(Step, frozen=True):
    """Stand for `seconds`, in parts: a run in which no robot finishes a step for long is jammed."""

    seconds: float

    def act(self, robot: PlanExecutor) -> bool:
        left = self.seconds - LONGEST_WAIT
        robot.next([Wait(LONGEST_WAIT), Repair(left)] if left > 0.0 else [Wait(self.seconds)])
        return True


class Unload(Step, frozen=True):
    """For carriers: stand in the bay until the bin, asked every PATIENCE ticks, is no longer full."""

    ticks = (
        -(-(BIN_FOLLOWS + round(UNLOADING_SECONDS / TIME_STEP) - 1) // PATIENCE) * PATIENCE + ASK
    )

    def act(self, robot: PlanExecutor) -> bool:
        answer = robot.ask(robot.seen.hitch.name, StateRequest()) if robot.seen.hitch else None
        robot.hold()
        return isinstance(answer, BinState) and not answer.full


class Confirmed(Step, frozen=True):
    """For carriers, before they leave: go on only if the bin still wants the carrier, else do the steps `otherwise`."""

    ticks = ASK
    bin: str
    otherwise: list["AnyStep"]
    keeps_course: ClassVar[bool] = True  # wherever in the queue it is asked

    def act(self, robot: PlanExecutor) -> bool:
        answer = robot.ask(self.bin, Confirm())
        robot.hold()
        if isinstance(answer, No):
            robot.memory.plan[1:] = self.otherwise
        return answer is not None


class MayCharge(Step, frozen=True):
    """For carriers, once they have unloaded: if the charge is at the reserve, do the steps `otherwise`."""

    reserve: float  #: of the charge, 0 to 1
    otherwise: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.charge <= self.reserve:
            robot.memory.plan[1:] = self.otherwise
        return True


class Charge(Step, frozen=True):
    """For carriers that are in a charging line: from here on they charge where they stand, once a charger is free."""

    keeps_course: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        robot.memory.doing, robot.memory.state, robot.memory.charged = "charging", "resting", False
        return True


class Charged(Step, frozen=True):
    """For carriers: stand until the battery has been full."""

    def act(self, robot: PlanExecutor) -> bool:
        robot.hold()
        return bool(robot.memory.charged)


class Home(Step, frozen=True):
    """For carriers: the job is done, and the carrier can be called again."""

    def act(self, robot: PlanExecutor) -> bool:
        robot.memory.job = None
        return True


class Again(Step, frozen=True):
    """Repeat these steps without end."""

    steps: list["AnyStep"]

    def act(self, robot: PlanExecutor) -> bool:
        robot.next([*self.steps, self])
        return True


if TYPE_CHECKING:
    AnyStep = Step
else:  # for msgspec, which decodes the steps of a memory: these, and those that `with_steps` adds
    AnyStep = (
        Say | DriveTo | Face | Realign | Ahead | MoveTo | Wait | Need | Free | Alone | Deliver | TakeBin | LeaveBin
        | FetchEmpty | Announce | PickFrom | Fill | Aim | Shift | MayFail | Repair | Unload | Confirmed
        | MayCharge | Charge | Charged | Home | Again
    )  # fmt: skip


class Plan(RobotMemory):
    """The memory of a robot that follows a plan. `plan`: the steps that are left, the present one first."""

    plan: list[AnyStep] = []


P = TypeVar("P", bound=Plan)


def of_known_steps(steps: list[Step], own: Sequence[type[Step]]) -> list[Step]:
    """Return these steps. Raises TypeError for one that a memory could not hold: its class is neither built-in nor in `own`, or it is
    a step of `own` within `Again` or `Confirmed`, which hold built-in steps only."""
    for step in steps:
        if type(step) not in own and type(step).__module__ != __name__:
            raise TypeError(
                f"{type(step).__name__} is not in `Steps`, or is within a step that holds built-in steps only"
            )
        of_known_steps([*getattr(step, "steps", ()), *getattr(step, "otherwise", ())], ())
    return steps


def with_steps(memory: type[P], steps: Sequence[type[Step]]) -> type[P]:
    """Return a memory type derived from `memory`. Its plan may also hold these steps: they are checked and encoded like built-in steps."""
    return cast(type[P], _with_steps(memory, tuple(steps))) if steps else memory


@cache
def _with_steps(memory: type[Plan], steps: tuple[type[Step], ...]) -> Any:
    kinds: Any = reduce(or_, steps, AnyStep)
    plan: Any = ("plan", list[kinds], msgspec.field(default_factory=list))
    return msgspec.defstruct(memory.__name__, [plan], bases=(memory,))
