"""What a learned body observes and what it does, as arrays in Gymnasium's spaces.

All is in SI units. There is an array for each quantity:

`scan`, (180,)
    The ranges from right to left, m; 10 where there is no return.
`pose`, (4,)
    x and y in the frame `map`, m; cosine and sine of the yaw.
`velocity`, (2,)
    Of the last step: forward, m/s; counter-clockwise, rad/s.
`bar`, (1,)
    1 if a bin is coupled, else 0.
`fill`, (1,)
    Metres of row in the coupled bin.
`goal`, (3,)
    What the present step of its plan still asks for: m ahead, m to the left, rad
    counter-clockwise.
`mail`, (4,)
    What the body knows from messages of other agents. First: 1 if it has a job (a carrier), or if a
    carrier comes (a picker). Second: the lane of the job, from 1. Third: the end of that lane, -1
    west, 1 east. Fourth: 1 if it waits for another agent. Each is 0 otherwise.

A deed is what a body does to a bin in a tick: couple or uncouple it.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from orchard.contract.agent import Action, Observation
from orchard.contract.messages import Couple, Deed, Uncouple
from orchard.field.geometry import HEADINGS, Twist, angle_between
from orchard.field.kinds import KINDS, LASER_RANGE, kind_of
from orchard.field.machines import Machine
from orchard.field.queue import LONGEST_ROW
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo, Face, Plan
from orchard.sim.deeds import COUPLING_REACH
from orchard.sim.world import NONE, World

# m, the limit of distances in the observation spaces: no orchard is so large. A hundred surveyed
# rows may lie 60 m apart, which is 6000 m, and roads lead around them.
FAR = 8000.0
# Rows of a scenario, at most.
MOST_LANES = 100.0
# The deeds that an action names.
NOTHING, COUPLE, UNCOUPLE = range(3)

Arrays = dict[str, np.ndarray]
# The x and y of a goal, m, in the frame `map`, and the rad that remain to turn.
Goal = tuple[float, float, float]


def _box(*bounds: tuple[float, float]) -> spaces.Box:
    """Return the space of arrays with numbers within these bounds: lowest, highest."""
    low, high = np.array(bounds, dtype=np.float32).T
    return spaces.Box(low, high, dtype=np.float32)


def observation_space(name: str, machine: Machine) -> spaces.Dict:
    """Return the space of what a body observes: see the head of this module.

    `name`: of the body. The space depends on the limits of its machine only. All else of the
    orchard may change from episode to episode, for a curriculum.
    """
    kind = KINDS[kind_of(name)]
    whether = (0.0, 1.0)
    coordinate = (-FAR, FAR)
    ratio = (-1.0, 1.0)
    # The body may measure up to twice its speed: odometry has errors.
    most_speed = 2.0 * machine.speed
    most_turn = 2.0 * machine.turn
    # In the order of their names, as Gymnasium sorts them anyway.
    return spaces.Dict(
        bar=_box(whether),
        fill=_box((0.0, LONGEST_ROW)),
        goal=_box(coordinate, coordinate, (-math.pi, math.pi)),
        mail=_box(whether, (0.0, MOST_LANES), ratio, whether),
        pose=_box(coordinate, coordinate, ratio, ratio),
        scan=_box(*[(0.0, LASER_RANGE)] * kind.laser.beams),
        velocity=_box((-most_speed, most_speed), (-most_turn, most_turn)),
    )


def action_space(machine: Machine, deeds: bool) -> spaces.Space[Any]:
    """Return the space of actions: a velocity, m/s forward and rad/s counter-clockwise.

    `deeds`: an action also names a deed: 0 none, 1 couple, 2 uncouple.
    """
    velocity = _box((-machine.speed, machine.speed), (-machine.turn, machine.turn))
    if deeds:
        return spaces.Dict({"velocity": velocity, "deed": spaces.Discrete(3)})
    return velocity


def goal_of(seen: Observation, memory: Any) -> Goal:
    """Return what the present step of a plan still asks for.

    A drive's goal is its end, or the first place on the way that traffic has not granted. A step
    that is neither drive nor turn has the body's own position as its goal, and so has an agent
    without a plan. `memory`: of the body's agent.
    """
    step = None
    if isinstance(memory, Plan) and memory.plan:
        step = memory.plan[0]
    if isinstance(step, Face):
        return seen.x, seen.y, angle_between(seen.pose.yaw, HEADINGS[step.heading])
    if not isinstance(step, DriveTo):
        return seen.x, seen.y, 0.0
    if step.x is not None:
        return _way_end(seen.x, step.x, step.needs, memory.reserved), seen.y, 0.0
    # A drive along the other axis has y in place of x.
    assert step.y is not None
    return seen.x, _way_end(seen.y, step.y, step.needs, memory.reserved), 0.0


def _way_end(here: float, end: float, gates: Sequence[Gate], reserved: Sequence[str]) -> float:
    """Return the coordinate up to which a drive may go, m: of its end, or of the first closed gate
    before it.

    `here`, `end`: coordinates on the axis of the drive, m. `reserved`: the places that traffic has
    granted; a gate stands where a place begins.
    """
    for gate in gates:
        # Between here and the end, in whichever direction the drive goes.
        is_ahead = min(here, end) <= gate.at <= max(here, end)
        is_closed = any(place not in reserved for place in gate.places)
        if is_ahead and is_closed:
            end = gate.at
    return end


def mail_of(action: Action) -> tuple[float, float, float, float]:
    """Return the array `mail`: see the head of this module. `action`: the agent's newest one."""
    waits = float(bool(action.waits_for))
    job = getattr(action.memory, "job", None)
    if job is None:
        carrier_comes = bool(getattr(action.memory, "carrier", ""))
        return float(carrier_comes), 0.0, 0.0, waits
    end = -1.0
    if job.side == "east":
        end = 1.0
    return 1.0, float(job.lane), end, waits


def observed(seen: Observation, fill: float, goal: Goal, action: Action) -> Arrays:
    """Return what a body observes: see the head of this module.

    `fill`: metres of row in its bin. `action`: the newest one of its own agent.
    """
    goal_x, goal_y, goal_turn = goal
    # The orientation is a quaternion about the vertical axis: z is the sine and w the cosine of
    # half the yaw.
    z, w = seen.orientation
    cosine = w * w - z * z
    sine = 2.0 * z * w
    dx = goal_x - seen.x
    dy = goal_y - seen.y
    ahead = cosine * dx + sine * dy
    to_the_left = cosine * dy - sine * dx
    has_bin = seen.hitch is not None
    return {
        "pose": np.array((seen.x, seen.y, cosine, sine), np.float32),
        "velocity": np.array((seen.twist.x, seen.twist.yaw), np.float32),
        "bar": np.array((has_bin,), np.float32),
        "fill": np.array((fill,), np.float32),
        "goal": np.array((ahead, to_the_left, goal_turn), np.float32),
        "mail": np.array(mail_of(action), np.float32),
        "scan": np.minimum(seen.scan, np.float32(LASER_RANGE)),
    }


class DecodedAction(NamedTuple):
    """What an action commands."""

    # Within the limits of the body.
    velocity: Twist
    deed: int = NOTHING


def decode(name: str, machine: Machine, action: Any, deeds: bool) -> DecodedAction:
    """Return what an action of a body commands. `deeds`: whether it also names a deed.

    A velocity beyond the limits of the machine is cut to them. Raises ValueError for an action of
    another form, or with numbers that are not finite.
    """
    try:
        forward, turn, deed = _numbers_of(action, deeds)
    except (TypeError, ValueError, LookupError):
        raise ValueError(
            f"{name}: action {action!r}; it must be {_form(deeds)} m/s forward and rad/s"
            " counter-clockwise"
        ) from None
    if not (math.isfinite(forward) and math.isfinite(turn)):
        raise ValueError(f"{name}: action {action!r}; its numbers must be finite")
    velocity = Twist(
        x=min(max(forward, -machine.speed), machine.speed),
        yaw=min(max(turn, -machine.turn), machine.turn),
    )
    return DecodedAction(velocity, deed)


def _numbers_of(action: Any, deeds: bool) -> tuple[float, float, int]:
    """Return speed, turn and deed of an action.

    Raises TypeError, ValueError or LookupError for one of another form.
    """
    if not deeds:
        forward, turn = _numbers(action, "iuf").tolist()
        return float(forward), float(turn), NOTHING
    forward, turn = _numbers(action["velocity"], "iuf").tolist()
    deed = _numbers(action["deed"], "iu").item()
    if deed not in (NOTHING, COUPLE, UNCOUPLE):
        raise ValueError(deed)
    return float(forward), float(turn), deed


def _form(deeds: bool) -> str:
    """Return how an action is written, in words. `deeds`: whether it also names a deed."""
    if deeds:
        return (
            "{'velocity': two numbers, 'deed': 0, 1 to couple, or 2 to uncouple}; the numbers are"
        )
    return "two numbers,"


def _numbers(values: Any, kinds: str) -> np.ndarray:
    """Return numbers as an array.

    `kinds`: numpy's letters for the types that are allowed: i signed, u unsigned, f float. Raises
    ValueError for others.
    """
    numbers = np.asarray(values)
    if numbers.dtype.kind not in kinds:
        raise ValueError(values)
    return numbers


def deeds_of(world: World, name: str, deed: int) -> list[Deed]:
    """Return the deeds for the number of a deed in an action.

    A deed that `deed_mask` does not allow is left out.
    """
    if deed == NOTHING or not deed_mask(world, name)[deed]:
        return []
    if deed == UNCOUPLE:
        return [Uncouple()]
    behind = _bin_behind(world, world.index[name])
    return [Couple(world.layout.names[behind])]


def deed_mask(world: World, name: str) -> np.ndarray:
    """Return which deeds a body can try, (3,) int8: nothing; couple, where a free bin stands on its
    coupling point; uncouple.
    """
    robot = world.index[name]
    has_bin = bool(world.coupled[robot] != NONE)
    can_couple = not has_bin and _bin_behind(world, robot) != NONE
    return np.array([True, can_couple, has_bin], dtype=np.int8)


def _bin_behind(world: World, robot: int) -> int:
    """Return the index of a free bin within reach of a robot's coupling point; NONE if none is.

    Whether the deed succeeds is decided by physics, which checks more than the distance.
    """
    x, y, yaw = world.pose[robot].tolist()
    behind = float(world.fixed.tows[robot])
    coupling_point = (x - behind * math.cos(yaw), y - behind * math.sin(yaw))
    for body, start in enumerate(world.layout.starts):
        if start.kind != "bin" or world.coupled[body] != NONE:
            continue
        if math.dist(coupling_point, world.pose[body, :2].tolist()) <= COUPLING_REACH:
            return body
    return NONE
