"""The bin: follows the robot that it is coupled to, and when it stands full in a lane's mouth, calls a carrier."""

import msgspec

from orchard.contract.agent import Action, Heard, Hitch, Mail, Observation
from orchard.contract.messages import Answer, BinState, Call, CarrierComing, Come, Confirm, EmptyBin, No, Offer, StateRequest, Yes
from orchard.field import repeatable
from orchard.field.geometry import STILL, Pose, Twist, angle_between, from_frame, to_frame
from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

CALL_AGAIN = 20  # ticks from a call that found nobody to the next one
ASK_AGAIN = 50  # ticks between two questions to a carrier whether it still comes
GIVE_UP = 6  # questions in a row without an answer


class BinMemory(msgspec.Struct):
    """Its call for a carrier, while it stands full."""

    carrier: str = ""  # whom it sent for
    coming: bool = False  # whether that one has agreed
    asked: int = -1000  # tick of its last question
    silent: int = 0  # questions since the last answer
    shunned: list[str] = []  # carriers that did not answer when they were sent for, during this call
    picker: str = ""  # who left it
    done: int = 0  # calls that ended in an exchange


class Bin:
    """Carries the fruit of one row."""

    Memory = BinMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout = layout
        self.carriers = [start.name for start in layout.starts if start.kind == "carrier"]

    def tick(self, seen: Observation, mail: Mail, memory: BinMemory | None) -> Action:
        memory = memory or BinMemory()
        action = Action(memory=memory, answers=[(heard, self.answer(seen, memory, heard)) for heard in mail.requests])
        if seen.hitch is not None:
            self.follow(seen, seen.hitch, memory, action)
        elif seen.full:
            self.call(seen, mail, memory, action)
        else:
            action.doing = "standing empty"
        action.steps_done = memory.done
        return action

    def answer(self, seen: Observation, memory: BinMemory, heard: Heard) -> Answer:
        if isinstance(heard.body, StateRequest):
            return BinState(full=seen.full, fill=seen.fill, coupled_to=seen.hitch.name if seen.hitch else "")
        if isinstance(heard.body, EmptyBin):
            return CarrierComing(memory.carrier if memory.coming else "")
        if isinstance(heard.body, Confirm):
            return Yes() if memory.carrier == heard.sender else No("another carrier comes")
        return No("a bin knows nothing of that")

    # -- following

    def follow(self, seen: Observation, hitch: Hitch, memory: BinMemory, action: Action) -> None:
        """Move to where its place behind the robot will be after this tick, if the robot keeps its velocity."""
        action.twist = twist_to(seen.pose, place_behind(hitch, seen.pose.yaw))
        action.doing = f"{'full' if seen.full else 'empty'}, on {hitch.name}"
        if kind_of(hitch.name) == "picker":
            memory.picker = hitch.name
        elif memory.carrier:
            memory.carrier, memory.coming, memory.shunned, memory.done = "", False, [], memory.done + 1

    # -- calling

    def call(self, seen: Observation, mail: Mail, memory: BinMemory, action: Action) -> None:
        """Ask all carriers, send for the nearest by road that is free, and make sure that it comes."""
        action.doing = f"full, {memory.carrier} comes" if memory.coming else "full, calling"
        action.waits_for = memory.carrier or "a carrier"
        lane, side = self.where(seen.x, seen.y)
        self.hear(mail, memory, seen.tick)
        offers = sorted((r.sender in memory.shunned, r.body.distance, r.sender) for r in mail.replies if isinstance(r.body, Offer))
        if not memory.carrier and offers:
            memory.carrier, memory.silent = offers[0][2], 0
            self.send_for(seen.tick, memory, action, lane, side)
        elif memory.carrier and seen.tick - memory.asked >= (ASK_AGAIN if memory.coming else CALL_AGAIN):
            self.send_for(seen.tick, memory, action, lane, side)
        elif not memory.carrier and seen.tick - memory.asked >= CALL_AGAIN:
            action.requests += [(carrier, Call(lane, side)) for carrier in self.carriers]
            memory.asked = seen.tick

    def send_for(self, tick: int, memory: BinMemory, action: Action, lane: int, side: str) -> None:
        action.requests.append((memory.carrier, Come(lane, side, memory.picker)))
        memory.asked, memory.silent = tick, memory.silent + 1

    def hear(self, mail: Mail, memory: BinMemory, tick: int) -> None:
        """What the carrier that was sent for says; one that refuses, or stays silent, is given up."""
        for reply in mail.replies:
            if not isinstance(reply.request, Come) or reply.sender != memory.carrier:
                continue
            if isinstance(reply.body, Yes):
                memory.coming, memory.silent = True, 0
            elif reply.body is not None or memory.silent >= GIVE_UP:
                memory.shunned += [memory.carrier] if reply.body is None and memory.carrier not in memory.shunned else []
                memory.carrier, memory.coming, memory.asked = "", False, tick - CALL_AGAIN

    def where(self, x: float, y: float) -> tuple[int, str]:
        """The lane in whose mouth it stands, and at which end."""
        lane = min(self.layout.lanes, key=lambda lane: abs(lane.y - y))
        return lane.number, "east" if x > -1.5 else "west"


def place_behind(hitch: Hitch, yaw: float) -> Pose:
    """Where the bin belongs after the next tick: behind its robot, at the quarter turn that is nearest to its own yaw."""
    robot = moved(hitch.pose, hitch.twist)
    x, y = from_frame(robot, -KINDS[kind_of(hitch.name)].tows, 0.0)
    off = angle_between(robot.yaw, yaw)
    quarter = repeatable.QUARTER * int(off / repeatable.QUARTER + (0.5 if off >= 0 else -0.5))
    return Pose(x, y, repeatable.wrap(robot.yaw + quarter))


def moved(pose: Pose, twist: Twist) -> Pose:
    """A pose after one tick of a forward and turning velocity."""
    turn = twist.yaw * TIME_STEP
    ahead, left = arc(twist.x * TIME_STEP, 0.0, turn)
    x, y = from_frame(pose, ahead, left)
    return Pose(x, y, repeatable.wrap(pose.yaw + turn))


def arc(ahead: float, left: float, turn: float) -> tuple[float, float]:
    """Where a path with these lengths in a frame that turns meanwhile ends, in the frame at its beginning."""
    a, b = chord(turn)
    return a * ahead - b * left, b * ahead + a * left


def chord(turn: float) -> tuple[float, float]:
    """sin(turn) / turn and (1 - cos(turn)) / turn."""
    if abs(turn) < 1e-6:
        return 1.0, 0.5 * turn
    s, c = repeatable.sin_cos(turn)
    return s / turn, (1.0 - c) / turn


def twist_to(start: Pose, end: Pose) -> Twist:
    """The velocity that leads from one pose to another in one tick: the inverse of `arc`."""
    turn = angle_between(start.yaw, end.yaw)
    ahead, left = to_frame(start, end.x, end.y)
    if (turn, ahead, left) == (0.0, 0.0, 0.0):
        return STILL
    a, b = chord(turn)
    scale = TIME_STEP * (a * a + b * b)
    return Twist((a * ahead + b * left) / scale, (a * left - b * ahead) / scale, turn / TIME_STEP)
