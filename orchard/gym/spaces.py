"""What a learned body observes and what it does, as arrays in Gymnasium's spaces. SI units; an array for each quantity.

| key | shape | what |
| --- | --- | --- |
| scan | (180,) | ranges from right to left, m; 10 where there is no return |
| pose | (4,) | x, y (m, in the frame `map`), cosine and sine of the yaw |
| velocity | (2,) | of the last step: forward, m/s; counter-clockwise, rad/s |
| bar | (1,) | 1 if a bin is coupled, else 0 |
| fill | (1,) | metres of row in the coupled bin |
| goal | (3,) | what the present step of its plan still asks for: m ahead, m to the left, rad counter-clockwise |
| mail | (4,) | what its mail has come to: 1 if it has a job (a carrier) or a carrier comes (a picker); the job's lane, from 1; the end of that lane, -1 west, 1 east; 1 if it waits for another agent. 0 where there is none |
"""  # noqa: E501 - a table

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from orchard.contract.agent import Action, Observation
from orchard.contract.messages import Couple, Deed, Uncouple
from orchard.field.geometry import HEADINGS, Twist, angle_between
from orchard.field.kinds import KINDS, LASER_RANGE, kind_of
from orchard.field.queue import LONGEST_ROW
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo, Face, Plan
from orchard.sim.deeds import COUPLING_REACH
from orchard.sim.world import NONE, World

FAR = 2000.0  # m: no orchard is so large
MOST_LANES = 100.0  # rows of a scenario
NOTHING, COUPLE, UNCOUPLE = range(3)  # the deeds that an action names

Arrays = dict[str, np.ndarray]
Goal = tuple[float, float, float]  # x, y (m, in the frame `map`), rad that are left to turn


_SIZES = {
    "pose": 4,
    "velocity": 2,
    "bar": 1,
    "fill": 1,
    "goal": 3,
    "mail": 4,
}  # of all but the scan
_ENDS = np.cumsum(list(_SIZES.values())).tolist()
_PARTS = {
    key: slice(end - size, end) for (key, size), end in zip(_SIZES.items(), _ENDS, strict=True)
}


def _box(*bounds: tuple[float, float]) -> spaces.Box:
    low, high = np.array(bounds, dtype=np.float32).T
    return spaces.Box(low, high, dtype=np.float32)


def observation_space(name: str) -> spaces.Dict:
    """Return the space of what a body observes: see the table above.

    It does not depend on the orchard: a curriculum may change it.
    """
    kind, one = KINDS[kind_of(name)], (0.0, 1.0)
    return spaces.Dict(  # in the order in which Gymnasium sorts them
        bar=_box(one),
        fill=_box((0.0, LONGEST_ROW)),
        goal=_box((-FAR, FAR), (-FAR, FAR), (-math.pi, math.pi)),
        mail=_box(one, (0.0, MOST_LANES), (-1.0, 1.0), one),
        pose=_box((-FAR, FAR), (-FAR, FAR), (-1.0, 1.0), (-1.0, 1.0)),
        scan=_box(*[(0.0, LASER_RANGE)] * kind.laser.beams),
        velocity=_box(
            *[(-2.0 * most, 2.0 * most) for most in (kind.speed, kind.turn)]
        ),  # odometry may measure more than there is
    )


def action_space(name: str, deeds: bool) -> spaces.Space[Any]:
    """Return the space of what a body does: m/s forward, rad/s.

    With `deeds` beside it `deed`: 0, 1 couple, 2 uncouple.
    """
    velocity = _box(
        *[(-most, most) for most in (KINDS[kind_of(name)].speed, KINDS[kind_of(name)].turn)]
    )
    return spaces.Dict({"velocity": velocity, "deed": spaces.Discrete(3)}) if deeds else velocity


def goal_of(seen: Observation, memory: Any) -> Goal:
    """Return what the present step of a plan still asks for.

    A drive's goal is its end, or the first place on the way that traffic has not granted. A step
    that is neither drive nor turn asks for nothing, and so does an agent without a plan.
    """
    step = memory.plan[0] if isinstance(memory, Plan) and memory.plan else None
    if isinstance(step, Face):
        return seen.x, seen.y, angle_between(seen.pose.yaw, HEADINGS[step.heading])
    if not isinstance(step, DriveTo):
        return seen.x, seen.y, 0.0
    if step.x is not None:
        return _way_end(seen.x, step.x, step.needs, memory.reserved), seen.y, 0.0
    return seen.x, _way_end(seen.y, step.y or 0.0, step.needs, memory.reserved), 0.0


def _way_end(here: float, end: float, gates: Sequence[Gate], reserved: Sequence[str]) -> float:
    for gate in gates:
        if (here <= gate.at <= end or end <= gate.at <= here) and any(
            place not in reserved for place in gate.places
        ):
            end = gate.at
    return end


def mail_of(action: Action) -> tuple[float, float, float, float]:
    """Return what an agent's mail has come to: see the table above."""
    memory, waits = action.memory, float(bool(action.waits_for))
    job = getattr(memory, "job", None)
    if job is None:
        return float(bool(getattr(memory, "carrier", ""))), 0.0, 0.0, waits
    return 1.0, float(job.lane), 1.0 if job.side == "east" else -1.0, waits


def observed(seen: Observation, fill: float, goal: Goal, action: Action) -> Arrays:
    """Return what a body observes: see the table above.

    `fill`: m in its bin; `action`: the newest one of its own agent.
    """
    (z, w), (forward, _, turn) = seen.orientation, seen.twist
    cosine, sine = w * w - z * z, 2.0 * z * w
    dx, dy, left = goal[0] - seen.x, goal[1] - seen.y, goal[2]
    towards = cosine * dx + sine * dy, cosine * dy - sine * dx, left
    told = (
        seen.x,
        seen.y,
        cosine,
        sine,
        forward,
        turn,
        float(seen.hitch is not None),
        fill,
        *towards,
        *mail_of(action),
    )
    numbers = np.array(told, np.float32)
    arrays = {key: numbers[part] for key, part in _PARTS.items()}
    arrays["scan"] = np.minimum(seen.scan, np.float32(LASER_RANGE))
    return arrays


class Command(NamedTuple):
    """What an action commands."""

    velocity: Twist  # within the limits of the body
    deed: int = NOTHING


def command_of(name: str, given: Any, deeds: bool) -> Command:
    """Return what an action commands.

    Raises ValueError for one that is not in the action space, limits aside.
    """
    kind = KINDS[kind_of(name)]
    try:
        velocity, deed = (given["velocity"], given["deed"]) if deeds else (given, NOTHING)
        forward, turn = map(float, _numbers(velocity, "iuf").tolist())
        number = (NOTHING, COUPLE, UNCOUPLE).index(_numbers(deed, "iu").item())
    except (TypeError, ValueError, LookupError):
        words = (
            "{'velocity': two numbers, 'deed': 0, 1 to couple, or 2 to uncouple}; the numbers are"
            if deeds
            else "two numbers,"
        )
        raise ValueError(
            f"{name}: action {given!r}; it must be {words} m/s forward and rad/s counter-clockwise"
        ) from None
    if not (math.isfinite(forward) and math.isfinite(turn)):
        raise ValueError(f"{name}: action {given!r}; its numbers must be finite")
    return Command(
        Twist(
            min(max(forward, -kind.speed), kind.speed), 0.0, min(max(turn, -kind.turn), kind.turn)
        ),
        number,
    )


def _numbers(given: Any, kinds: str) -> np.ndarray:
    """Return numbers as an array.

    `kinds`: numpy's letters for those that can be. Raises ValueError for others.
    """
    numbers = np.asarray(given)
    if numbers.dtype.kind not in kinds:
        raise ValueError(given)
    return numbers


def deeds_of(world: World, name: str, deed: int) -> list[Deed]:
    """Return the deeds for the number in an action.

    A deed that cannot be is left out: see `deed_mask`.
    """
    robot = world.index[name]
    if not deed_mask(world, name)[deed] or deed == NOTHING:
        return []
    return (
        [Uncouple()]
        if deed == UNCOUPLE
        else [Couple(world.layout.names[_bin_behind(world, robot)])]
    )


def deed_mask(world: World, name: str) -> np.ndarray:
    """Return which deeds a body can try, (3,) int8: nothing; couple, where a free bin stands on its
    coupling point; uncouple.
    """
    robot = world.index[name]
    has = bool(world.coupled[robot] != NONE)
    return np.array([True, not has and _bin_behind(world, robot) != NONE, has], dtype=np.int8)


def _bin_behind(world: World, robot: int) -> int:
    """The free bin within reach of a robot's coupling point; NONE without one.

    Physics decides on the rest.
    """
    x, y, yaw = world.pose[robot].tolist()
    behind = float(world.fixed.tows[robot])
    at = x - behind * math.cos(yaw), y - behind * math.sin(yaw)
    for i, start in enumerate(world.layout.starts):
        if (
            start.kind == "bin"
            and world.coupled[i] == NONE
            and math.dist(at, world.pose[i, :2].tolist()) <= COUPLING_REACH
        ):
            return i
    return NONE
