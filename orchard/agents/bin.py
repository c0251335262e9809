"""The bin: holds fruit, follows its robot, and calls a carrier when it stands full in the mouth of a lane.

If the scenario's dispatch policy is `early`, the bin calls before that, while its picker still fills it.
"""

import msgspec

from orchard.agents.dispatch import BinReport, CarrierReport, is_early
from orchard.agents.forecast import LEAST_SPEED, Forecast
from orchard.agents.policies import dispatch_of
from orchard.contract import messages
from orchard.contract.agent import Action, Heard, Hitch, Hold, Mail, Observation
from orchard.field import repeatable
from orchard.field.geometry import STILL, Pose, Twist, angle_between, from_frame, to_frame
from orchard.field.kinds import DISPATCH, KINDS, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

CALL_AGAIN = 20  # ticks from a call that found no carrier to the next call
ASK_AGAIN = 50  # ticks between two questions to a carrier whether it still comes
KEEPS = 1e-6  # m/s and rad/s by which a bin's velocity may differ from its robot's without a correction: 1e-7 m in a tick
ALIGNED = 1e-9  # rad/s: a bin that would have to turn faster drifts off the way of its robot while it holds
GIVE_UP = 6  # questions in a row without an answer, after which a carrier is given up


class BinMemory(msgspec.Struct):
    """A bin's call for a carrier."""

    carrier: str = ""  # the carrier that it sent for
    coming: bool = False  # whether that carrier has agreed
    asked: int = -1000  # tick of its last question
    silent: int = 0  # questions since the last answer
    shunned: list[
        str
    ] = []  # carriers that did not answer when they were sent for, during this call
    picker: str = ""  # the picker that left it
    since: int = -1  # tick at which the call began; -1: no call is open
    done: int = 0  # calls that ended in an exchange
    picking_speed: float = 0.0  # m/s, in the present row
    speed: float = 0.0  # m/s at which the picker drove when the bin last looked
    fill: float = 0.0  # m in it when it last looked
    left_at: messages.LeftAt | None = None  # where its picker will leave it next


class Bin:
    Memory = BinMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout = layout
        self.carriers = [start.name for start in layout.starts if start.kind == "carrier"]
        policy = dispatch_of(layout)
        self.policy = (
            None if DISPATCH in layout.scenario.bodiless_agents else policy
        )  # None: the dispatcher decides
        self.forecast = (
            Forecast(layout) if self.policy is None and is_early(policy) else None
        )  # None: it calls when it is full

    def tick(self, seen: Observation, mail: Mail, memory: BinMemory | None) -> Action:
        memory = memory or self.Memory()
        action = Action(
            memory=memory,
            answers=[(heard, self.answer(seen, memory, heard)) for heard in mail.requests],
        )
        action.hold = Hold(messages.LAST_TICK)
        if seen.hitch is not None:
            self.follow(seen, seen.hitch, memory, action)
            if self.forecast is not None and kind_of(seen.hitch.name) == "picker":
                self.foresee(self.forecast, seen, seen.hitch, mail, memory, action)
        elif seen.full:
            self.call(seen, mail, memory, action, *self.where(seen.x, seen.y))
            action.doing = f"full, {memory.carrier} comes" if memory.coming else "full, calling"
            action.state = "waiting" if memory.coming else "calling"
            action.waits_for = memory.carrier or "a carrier"
        else:
            action.doing, action.state = "standing empty", "resting"
        action.steps_done = memory.done
        return action

    def answer(self, seen: Observation, memory: BinMemory, heard: Heard) -> messages.Answer:
        if isinstance(heard.body, messages.StateRequest):
            return messages.BinState(
                full=seen.full, fill=seen.fill, coupled_to=seen.hitch.name if seen.hitch else ""
            )
        if isinstance(heard.body, messages.EmptyBin):
            return messages.CarrierComing(memory.carrier if memory.coming else "")
        if isinstance(heard.body, messages.LeftAt):
            memory.left_at = heard.body
            return messages.Yes()
        if isinstance(heard.body, messages.Confirm):
            return (
                messages.Yes()
                if memory.carrier == heard.sender
                else messages.No("another carrier comes")
            )
        return messages.No("a bin knows nothing of that")

    def follow(self, seen: Observation, hitch: Hitch, memory: BinMemory, action: Action) -> None:
        """Move to the place behind the robot where the bin belongs after this tick, if the robot keeps its velocity."""
        exact, straight = (
            twist_to(seen.pose, place_behind(hitch, seen.pose.yaw)),
            along(hitch, seen.pose.yaw),
        )
        action.twist = straight if is_near(exact, straight, KEEPS) else exact
        if hitch.twist.yaw or abs(exact.yaw) > ALIGNED or not is_near(exact, straight, KEEPS / 2):
            action.hold = None
        action.doing = f"{'full' if seen.full else 'empty'}, on {hitch.name}"
        if kind_of(hitch.name) == "picker":
            memory.since = memory.since if self.forecast else -1
            memory.picker, action.state = hitch.name, "waiting" if seen.full else "picking"
            return
        action.state = "hauling" if seen.full else "driving"
        memory.since, memory.left_at = -1, None
        if memory.carrier:
            memory.carrier, memory.coming, memory.shunned, memory.done = (
                "",
                False,
                [],
                memory.done + 1,
            )

    def foresee(
        self,
        forecast: Forecast,
        seen: Observation,
        picker: Hitch,
        mail: Mail,
        memory: BinMemory,
        action: Action,
    ) -> None:
        """Call while the picker still fills the bin, from the time at which a carrier for the farthest lane would have to leave."""
        is_steady, memory.speed = abs(picker.twist.x - memory.speed) < KEEPS, picker.twist.x
        if not is_steady:
            action.hold = None  # the last step before a picker stands is shorter, and tells nothing: the next tick tells
        if not seen.fill:
            memory.picking_speed = self.layout.scenario.mean_picking_speed
        elif (
            is_steady
            and memory.speed >= LEAST_SPEED
            and seen.fill > memory.fill
            and abs(memory.speed - memory.picking_speed) >= KEEPS
        ):
            memory.picking_speed = memory.speed  # its last bits differ from tick to tick: those of the first one stay, whenever it is asked
        elif not memory.picking_speed:  # it begins without a memory, on a picker that has begun
            memory.picking_speed = self.layout.scenario.mean_picking_speed
        memory.fill = seen.fill
        ripening = forecast.of(seen, picker, memory.picking_speed, memory.left_at)
        is_time = ripening is not None and ripening.seconds < forecast.horizon
        if ripening is not None and (is_time or memory.carrier):
            self.call(seen, mail, memory, action, ripening.lane, ripening.side, ripening.seconds)
        elif ripening is not None:
            action.hold = action.hold and Hold(seen.tick + forecast.ticks(ripening))

    def call(
        self,
        seen: Observation,
        mail: Mail,
        memory: BinMemory,
        action: Action,
        lane: int,
        side: str,
        seconds_to_full: float = 0.0,
    ) -> None:
        """Call until a carrier is chosen, send for it, and ask it again and again whether it comes."""
        memory.since = seen.tick if memory.since < 0 else memory.since
        self.hear(mail, memory, seen.tick)
        chosen = "" if memory.carrier else self.chosen(seen, mail, memory, lane, side)
        if chosen:
            memory.carrier, memory.silent = chosen, 0
        if chosen or seen.tick - memory.asked >= (ASK_AGAIN if memory.coming else CALL_AGAIN):
            memory.asked = seen.tick
            self.ask(lane, side, seconds_to_full, memory, action)
        action.hold = action.hold and Hold(
            memory.asked + (ASK_AGAIN if memory.coming else CALL_AGAIN)
        )

    def ask(
        self, lane: int, side: str, seconds_to_full: float, memory: BinMemory, action: Action
    ) -> None:
        """Ask the carrier that was chosen whether it comes; without one the dispatcher, or all carriers."""
        if memory.carrier:
            action.requests.append((memory.carrier, messages.Come(lane, side, memory.picker)))
            memory.silent += 1
        elif self.policy is None:
            action.requests.append(
                (DISPATCH, messages.Fetch(lane, side, memory.picker, memory.since, seconds_to_full))
            )
        else:
            action.requests += [
                (carrier, messages.Call(lane, side, memory.since)) for carrier in self.carriers
            ]

    def chosen(self, seen: Observation, mail: Mail, memory: BinMemory, lane: int, side: str) -> str:
        """Return the carrier that the dispatcher names, or that the policy chooses among those that offer to come; '' if there is none.

        A carrier that was silent during this call is chosen only if no other carrier offers.
        """
        if self.policy is None:
            named = [
                reply.body.carrier
                for reply in mail.replies
                if isinstance(reply.body, messages.CarrierComing)
            ]
            return named[0] if named else ""
        offers = [
            CarrierReport(r.sender, "", True, r.body.distance)
            for r in mail.replies
            if isinstance(r.body, messages.Offer)
        ]
        willing = [offer for offer in offers if offer.name not in memory.shunned] or offers
        report = BinReport(seen.name, lane, side, memory.picker, memory.since, 0.0)
        assignments = (
            self.policy.assign(seen.tick, [report], willing, self.policy.Memory())
            if willing
            else []
        )
        return assignments[0].carrier if assignments else ""

    def hear(self, mail: Mail, memory: BinMemory, tick: int) -> None:
        """Read the answer of the carrier that was sent for. A carrier that refuses, or stays silent, is given up."""
        for reply in mail.replies:
            if not isinstance(reply.request, messages.Come) or reply.sender != memory.carrier:
                continue
            if isinstance(reply.body, messages.Yes):
                memory.coming, memory.silent = True, 0
            elif reply.body is not None or memory.silent >= GIVE_UP:
                memory.shunned += (
                    [memory.carrier]
                    if reply.body is None and memory.carrier not in memory.shunned
                    else []
                )
                memory.carrier, memory.coming, memory.asked = "", False, tick - CALL_AGAIN

    def where(self, x: float, y: float) -> tuple[int, str]:
        """Return the lane, and the end of it, in the mouth of which the bin stands."""
        lane = min(self.layout.lanes, key=lambda lane: abs(lane.y - y))
        return lane.number, "east" if x > self.layout.middle else "west"


def along(hitch: Hitch, yaw: float) -> Twist:
    """Return the velocity of a bin that keeps its place behind a robot which does not turn, at the quarter turn nearest to its own yaw."""
    x, y = from_frame(
        Pose(0.0, 0.0, -quarter_turn(hitch.pose.yaw, yaw)), hitch.twist.x, hitch.twist.y
    )
    return Twist(x, y)


def is_near(one: Twist, other: Twist, much: float) -> bool:
    """Whether no component of two velocities differs by `much`, m/s or rad/s."""
    return (
        abs(one.x - other.x) < much
        and abs(one.y - other.y) < much
        and abs(one.yaw - other.yaw) < much
    )


def quarter_turn(robot: float, yaw: float) -> float:
    """Return how far a bin is turned from its robot: the quarter turn that is nearest to the difference of their yaws, rad."""
    off = angle_between(robot, yaw)
    return repeatable.QUARTER * int(off / repeatable.QUARTER + (0.5 if off >= 0 else -0.5))


def place_behind(hitch: Hitch, yaw: float) -> Pose:
    """Return the bin's pose after the next tick: behind its robot, at the quarter turn that is nearest to the bin's own yaw."""
    robot = moved(hitch.pose, hitch.twist)
    x, y = from_frame(robot, -KINDS[kind_of(hitch.name)].tows, 0.0)
    return Pose(x, y, repeatable.wrap(robot.yaw + quarter_turn(robot.yaw, yaw)))


def moved(pose: Pose, twist: Twist) -> Pose:
    """Return a pose after one tick of a forward and turning velocity: the end of an arc."""
    ahead, turn = twist.x * TIME_STEP, twist.yaw * TIME_STEP
    a, b = chord(turn)
    x, y = from_frame(pose, a * ahead, b * ahead)
    return Pose(x, y, repeatable.wrap(pose.yaw + turn))


def chord(turn: float) -> tuple[float, float]:
    """Return sin(turn) / turn and (1 - cos(turn)) / turn."""
    if abs(turn) < 1e-6:
        return 1.0, 0.5 * turn
    s, c = repeatable.sin_cos(turn)
    return s / turn, (1.0 - c) / turn


def twist_to(start: Pose, end: Pose) -> Twist:
    """Return the velocity that leads from one pose to another in one tick: on an arc."""
    turn = angle_between(start.yaw, end.yaw)
    ahead, left = to_frame(start, end.x, end.y)
    if (turn, ahead, left) == (0.0, 0.0, 0.0):
        return STILL
    a, b = chord(turn)
    scale = TIME_STEP * (a * a + b * b)
    return Twist((a * ahead + b * left) / scale, (a * left - b * ahead) / scale, turn / TIME_STEP)
