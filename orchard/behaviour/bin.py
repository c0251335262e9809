"""The bin: holds fruit, follows its robot, and calls a carrier when it stands full.

It stands in the mouth of a lane then. If the scenario's dispatch policy is `early`, it calls before
that, while its picker still fills it.

A bin cannot drive. While it is coupled, the "bar" joins it to a robot (a picker or a carrier), and
this agent computes the velocity with which it follows. The simulator lets the bin move sideways and
turn for that.

Theory of operation. A call is the search of a bin for a carrier that takes it away. A bin has at
most one call open. Which agents it asks depends on the policy: with `nearest` there is no
dispatcher, and it asks all carriers; else it asks the dispatcher. These are the states of a call,
with what leads to the next one:

    state of a call | what happens                                  | next state
    ----------------+-----------------------------------------------+-----------------
    none            | it stands full, or will soon, if `early`      | calling
    calling         | a carrier is chosen, or the dispatcher names  | sent for
                    | one; else the bin asks again after CALL_AGAIN |
    sent for        | the carrier agrees                            | coming
    sent for        | the carrier refuses                           | calling
    sent for        | the carrier leaves GIVE_UP questions without  | calling
                    | an answer; until the next call it is chosen   |
                    | only if no other one offers                   |
    coming          | the carrier is asked each ASK_AGAIN ticks,    | coming
                    | and agrees                                    |
    coming          | the carrier refuses, or leaves GIVE_UP        | calling
                    | questions without an answer                   |
    any             | a carrier has coupled the bin                 | none

"""

from typing import NamedTuple

import msgspec

from orchard.contract import messages
from orchard.contract.agent import Action, Heard, Hitch, Hold, Mail, Observation, State
from orchard.dispatch.policies import dispatch_of
from orchard.dispatch.policy import BinReport, CarrierReport, Dispatch, is_early
from orchard.field import repeatable
from orchard.field.geometry import STILL, Pose, Twist, angle_between, from_frame, to_frame
from orchard.field.kinds import DISPATCH, KINDS, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.forecast import LEAST_SPEED, Forecast

# Ticks from a call that found no carrier to the next call.
CALL_AGAIN = 20
# Ticks between two questions to a carrier whether it still comes.
ASK_AGAIN = 50
# m/s and rad/s by which a bin's velocity may differ from its robot's without a correction. It is
# then off its place by 1e-7 m after a tick, far less than the bar allows.
KEEPS = 1e-6
# rad/s. A bin that would have to turn faster than this to face as its robot does must not hold its
# velocity: it would drift off the way of its robot meanwhile.
ALIGNED = 1e-9
# Questions in a row without an answer, after which a carrier is given up.
GIVE_UP = 6


class BinMemory(msgspec.Struct):
    """A bin's call for a carrier."""

    # The carrier that it sent for.
    carrier: str = ""
    # Whether that carrier has agreed.
    coming: bool = False
    # Tick of its last question; at first so long ago that it may ask at once.
    asked: int = -1000
    # Questions since the last answer.
    silent: int = 0
    # Carriers that did not answer when they were sent for, during this call.
    shunned: list[str] = []
    # The picker that fills it, or that has left it.
    picker: str = ""
    # Tick at which the call began; -1: no call is open.
    since: int = -1
    # Calls that ended in an exchange.
    done: int = 0
    # m/s at which its picker picks in the present row; 0: not known yet.
    picking_speed: float = 0.0
    # m/s at which the picker drove when the bin last looked.
    speed: float = 0.0
    # m in it when it last looked.
    fill: float = 0.0
    # Where its picker will leave it next, by the picker's word; None: it has not said it.
    left_at: messages.LeftAt | None = None

    @property
    def ask_again(self) -> int:
        """Ticks from the last question to the next one."""
        if self.coming:
            return ASK_AGAIN
        return CALL_AGAIN


class Standing(NamedTuple):
    """Where a bin stands full, or will."""

    lane: int
    # End of the lane: 'east' or 'west'.
    side: str
    # s until it stands there full; 0 once it does.
    seconds_to_full: float = 0.0


class Bin:
    """Drives a bin behind its robot, and calls for it."""

    Memory = BinMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout = layout
        self.carriers = layout.names_of("carrier")
        # None: the dispatcher decides.
        self.policy: Dispatch | None = None
        # None: it calls when it is full.
        self.forecast: Forecast | None = None
        policy = dispatch_of(layout)
        if DISPATCH not in layout.scenario.bodiless_agents:
            self.policy = policy
        elif is_early(policy):
            self.forecast = Forecast(layout)

    def tick(self, seen: Observation, mail: Mail, memory: BinMemory | None) -> Action:
        """Follow the robot, if it is coupled; call, if it is to be fetched; answer."""
        memory = memory or self.Memory()
        answers = [(heard, self.answer(seen, memory, heard)) for heard in mail.requests]
        action = Action(memory=memory, answers=answers, hold=Hold(messages.LAST_TICK))
        if seen.hitch is not None:
            self.follow(seen, seen.hitch, memory, action)
            if self.forecast is not None and kind_of(seen.hitch.name) == "picker":
                self.foresee(seen, seen.hitch, mail, memory, action)
        elif seen.full:
            self.call(seen, mail, memory, action, self.where(seen.x, seen.y))
            _show_call(memory, action)
        else:
            action.doing = "standing empty"
            action.state = "resting"
        action.steps_done = memory.done
        return action

    def answer(self, seen: Observation, memory: BinMemory, heard: Heard) -> messages.Answer:
        """Answer a request: of its state, its carrier, where it will be left, what it waits for."""
        match heard.body:
            case messages.StateRequest():
                robot = ""
                if seen.hitch is not None:
                    robot = seen.hitch.name
                return messages.BinState(full=seen.full, fill=seen.fill, coupled_to=robot)
            case messages.EmptyBin() if memory.coming:
                return messages.CarrierComing(memory.carrier)
            case messages.EmptyBin():
                return messages.CarrierComing("")
            case messages.LeftAt() as left_at:
                memory.left_at = left_at
                return messages.Yes()
            case messages.Confirm() if memory.carrier == heard.sender:
                return messages.Yes()
            case messages.Confirm():
                return messages.No("another carrier comes")
        return messages.No("a bin knows nothing of that")

    def follow(self, seen: Observation, hitch: Hitch, memory: BinMemory, action: Action) -> None:
        """Move to where the bin belongs after this tick, if its robot keeps its velocity.

        That is the place behind the robot. `hitch`: the robot. A call ends here: its carrier has
        coupled the bin.
        """
        yaw = seen.pose.yaw
        exact = twist_to(seen.pose, place_behind(hitch, yaw))
        # The same but for rounding, while the robot drives straight on: it can be held.
        straight = straight_twist(hitch, yaw)
        action.twist = exact
        if is_near(exact, straight, KEEPS):
            action.twist = straight
        is_turning = bool(hitch.twist.yaw) or abs(exact.yaw) > ALIGNED
        # While it holds, the two drift apart further: so a hold begins only at half the distance.
        if is_turning or not is_near(exact, straight, KEEPS / 2):
            action.hold = None
        _show_ride(seen, hitch.name, action)
        if kind_of(hitch.name) == "picker":
            memory.picker = hitch.name
            # A bin with a forecast may call while its picker still fills it.
            if self.forecast is None:
                memory.since = -1
            return
        memory.since = -1
        memory.left_at = None
        if memory.carrier:
            memory.carrier = ""
            memory.coming = False
            memory.shunned = []
            memory.done += 1

    def foresee(
        self, seen: Observation, picker: Hitch, mail: Mail, memory: BinMemory, action: Action
    ) -> None:
        """Call while the picker still fills the bin. Only a bin with a forecast can.

        It begins to call when a carrier for the farthest lane would have to leave (`horizon` of
        orchard/plans/forecast.py).
        """
        forecast = self.forecast
        assert forecast is not None
        is_steady = abs(picker.twist.x - memory.speed) < KEEPS
        memory.speed = picker.twist.x
        if not is_steady:
            # The last step before a picker stands is shorter, and tells nothing. The next tick
            # does.
            action.hold = None
        self._measure_picking_speed(seen, memory, is_steady)
        memory.fill = seen.fill
        ripening = forecast.of(seen, picker, memory.picking_speed, memory.left_at)
        if ripening is None:
            return
        if ripening.seconds < forecast.horizon or memory.carrier:
            standing = Standing(ripening.lane, ripening.side, ripening.seconds)
            self.call(seen, mail, memory, action, standing)
        elif action.hold is not None:
            # It need not look before it may have to call.
            action.hold = Hold(seen.tick + forecast.ticks(ripening))

    def _measure_picking_speed(self, seen: Observation, memory: BinMemory, is_steady: bool) -> None:
        """Note how fast the picker picks in this row.

        `is_steady`: whether it drives as fast as in the tick before. The last bits of its speed
        differ from tick to tick. The first speed that was measured in the row stays, so the result
        does not depend on when the bin is asked.
        """
        picks = memory.speed >= LEAST_SPEED and seen.fill > memory.fill
        is_new = abs(memory.speed - memory.picking_speed) >= KEEPS
        if not seen.fill:
            memory.picking_speed = self.layout.scenario.mean_picking_speed
        elif is_steady and picks and is_new:
            memory.picking_speed = memory.speed
        elif not memory.picking_speed:
            # The bin begins without a memory, on a picker that has begun.
            memory.picking_speed = self.layout.scenario.mean_picking_speed

    def call(
        self,
        seen: Observation,
        mail: Mail,
        memory: BinMemory,
        action: Action,
        standing: Standing,
    ) -> None:
        """Call until a carrier is chosen, send for it, and ask it again and again whether it
        still comes.
        """
        if memory.since < 0:
            memory.since = seen.tick
        self.hear(mail, memory, seen.tick)
        chosen = ""
        if not memory.carrier:
            chosen = self.chosen(seen, mail, memory, standing)
        if chosen:
            memory.carrier = chosen
            memory.silent = 0
        if chosen or seen.tick - memory.asked >= memory.ask_again:
            memory.asked = seen.tick
            self.ask(memory, action, standing)
        if action.hold is not None:
            action.hold = Hold(memory.asked + memory.ask_again)

    def ask(self, memory: BinMemory, action: Action, standing: Standing) -> None:
        """Ask the carrier that was chosen whether it comes.

        Without one, ask the dispatcher or, if there is none, all carriers.
        """
        lane, side, seconds_to_full = standing
        if memory.carrier:
            action.requests.append((memory.carrier, messages.Come(lane, side, memory.picker)))
            memory.silent += 1
        elif self.policy is None:
            fetch = messages.Fetch(lane, side, memory.picker, memory.since, seconds_to_full)
            action.requests.append((DISPATCH, fetch))
        else:
            call = messages.Call(lane, side, memory.since)
            action.requests += [(carrier, call) for carrier in self.carriers]

    def chosen(self, seen: Observation, mail: Mail, memory: BinMemory, standing: Standing) -> str:
        """Return the carrier that shall come; '' if there is none.

        The dispatcher names it, or the policy chooses among those that offer to come. A carrier
        that was silent during this call is chosen only if no other carrier offers.
        """
        if self.policy is None:
            return _named_by_dispatcher(mail)
        offers = _offers_in(mail)
        if not offers:
            return ""
        # If all that offer were silent before, any of them may come.
        willing = [offer for offer in offers if offer.name not in memory.shunned] or offers
        report = BinReport(
            name=seen.name,
            lane=standing.lane,
            side=standing.side,
            picker=memory.picker,
            since=memory.since,
            # It is the only bin here, so its distance decides nothing.
            metres=0.0,
        )
        # The policies that work without a dispatcher remember nothing.
        assignments = self.policy.assign(seen.tick, [report], willing, self.policy.Memory())
        if assignments:
            return assignments[0].carrier
        return ""

    def hear(self, mail: Mail, memory: BinMemory, tick: int) -> None:
        """Read the answer of the carrier that was sent for.

        A carrier that refuses, or stays silent, is given up.
        """
        for reply in mail.replies:
            if not isinstance(reply.request, messages.Come) or reply.sender != memory.carrier:
                continue
            is_silent = reply.body is None
            if isinstance(reply.body, messages.Yes):
                memory.coming = True
                memory.silent = 0
            elif not is_silent or memory.silent >= GIVE_UP:
                if is_silent and memory.carrier not in memory.shunned:
                    memory.shunned += [memory.carrier]
                memory.carrier = ""
                memory.coming = False
                # It asks again in this tick.
                memory.asked = tick - CALL_AGAIN

    def where(self, x: float, y: float) -> Standing:
        """Return the lane, and the end of it, in the mouth of which the bin stands."""
        lane = min(self.layout.lanes, key=lambda lane: abs(lane.y - y))
        if x > self.layout.middle:
            return Standing(lane.number, "east")
        return Standing(lane.number, "west")


def _named_by_dispatcher(mail: Mail) -> str:
    """Return the carrier that the dispatcher sends; '' if it names none."""
    for reply in mail.replies:
        if isinstance(reply.body, messages.CarrierComing):
            return reply.body.carrier
    return ""


def _offers_in(mail: Mail) -> list[CarrierReport]:
    """Return the carriers that offer to come."""
    offers = []
    for reply in mail.replies:
        if isinstance(reply.body, messages.Offer):
            metres = reply.body.distance
            offers.append(CarrierReport(name=reply.sender, job="", is_next=True, metres=metres))
    return offers


def _show_ride(seen: Observation, robot: str, action: Action) -> None:
    """Set what a bin on the bar of a robot is shown to do."""
    if seen.full:
        action.doing = f"full, on {robot}"
        action.state = "hauling"
        state_at_picker: State = "waiting"
    else:
        action.doing = f"empty, on {robot}"
        action.state = "driving"
        state_at_picker = "picking"
    if kind_of(robot) == "picker":
        action.state = state_at_picker


def _show_call(memory: BinMemory, action: Action) -> None:
    """Set what a bin that stands full is shown to do."""
    action.waits_for = memory.carrier or "a carrier"
    if memory.coming:
        action.doing = f"full, {memory.carrier} comes"
        action.state = "waiting"
    else:
        action.doing = "full, calling"
        action.state = "calling"


# -- the geometry of a bin on the bar


def straight_twist(hitch: Hitch, yaw: float) -> Twist:
    """Return the velocity of a bin that keeps its place behind a robot which does not turn.

    The bin is at the quarter turn nearest to its own yaw, rad.
    """
    bin_frame = Pose(0.0, 0.0, -quarter_turn(hitch.pose.yaw, yaw))
    x, y = from_frame(bin_frame, hitch.twist.x, hitch.twist.y)
    return Twist(x, y)


def is_near(a: Twist, b: Twist, within: float) -> bool:
    """Whether no component of two velocities differs by `within`, m/s or rad/s."""
    return abs(a.x - b.x) < within and abs(a.y - b.y) < within and abs(a.yaw - b.yaw) < within


def quarter_turn(robot: float, yaw: float) -> float:
    """Return how far a bin is turned from its robot, rad.

    It is the quarter turn that is nearest to the difference of their yaws, rad.
    """
    off = angle_between(robot, yaw)
    # `int` cuts towards 0. With a half more, away from 0, it rounds to the nearest number.
    half = 0.5 if off >= 0 else -0.5
    return repeatable.QUARTER * int(off / repeatable.QUARTER + half)


def place_behind(hitch: Hitch, yaw: float) -> Pose:
    """Return the bin's pose after the next tick: behind its robot.

    It is at the quarter turn that is nearest to the bin's own yaw, rad.
    """
    robot = moved(hitch.pose, hitch.twist)
    x, y = from_frame(robot, -KINDS[kind_of(hitch.name)].tows, 0.0)
    return Pose(x, y, repeatable.wrap(robot.yaw + quarter_turn(robot.yaw, yaw)))


def moved(pose: Pose, twist: Twist) -> Pose:
    """Return a pose after one tick of a forward and turning velocity: the end of an arc."""
    ahead = twist.x * TIME_STEP
    turn = twist.yaw * TIME_STEP
    a, b = chord(turn)
    x, y = from_frame(pose, a * ahead, b * ahead)
    return Pose(x, y, repeatable.wrap(pose.yaw + turn))


def chord(turn: float) -> tuple[float, float]:
    """Return sin(turn) / turn and (1 - cos(turn)) / turn. `turn`: rad.

    After a drive of 1 m on an arc that turns so far, these are the metres ahead and to the left.
    """
    # Here the first terms of both series are exact to 2e-13.
    if abs(turn) < 1e-6:
        return 1.0, 0.5 * turn
    s, c = repeatable.sin_cos(turn)
    return s / turn, (1.0 - c) / turn


def twist_to(start: Pose, end: Pose) -> Twist:
    """Return the velocity that leads from one pose to another in one tick: on an arc.

    It is what `moved` does, the other way about: there a * v and b * v are the ways ahead and to
    the left, and here they are solved for v.
    """
    turn = angle_between(start.yaw, end.yaw)
    ahead, left = to_frame(start, end.x, end.y)
    if (turn, ahead, left) == (0.0, 0.0, 0.0):
        return STILL
    a, b = chord(turn)
    scale = TIME_STEP * (a * a + b * b)
    return Twist((a * ahead + b * left) / scale, (a * left - b * ahead) / scale, turn / TIME_STEP)
