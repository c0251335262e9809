"""Deeds, which bodies request besides moving: couple, uncouple, flatten a weed, pick from an x on.

An agent puts them into its action. `orchard.sim.physics` calls `do_deeds`, which does or refuses
them.
"""

import numpy as np

from orchard.contract.events import Event
from orchard.contract.messages import Couple, Deed, Flatten, PickFrom, Uncouple
from orchard.field import repeatable
from orchard.field.geometry import Pose, angle_between, to_frame
from orchard.field.problems import printable
from orchard.sim.kernels.boxes import gap, place
from orchard.sim.world import NONE, World

# The rules of deeds, as docs/reference.md has them. The coupling point of a robot lies `tows` m
# behind its centre: there the bar ends.
COUPLING_REACH = 0.1  # m, between the bin's centre and the coupling point
COUPLING_ANGLE = 5.0 * repeatable.PI / 180.0  # rad, between the sides of robot and bin
WEED_REACH = 1.0  # m, edge to edge


class DeedRefused(Exception):
    """A deed that does not happen; the text is the reason."""


def do_deeds(world: World, wanted: np.ndarray, deeds: list[tuple[int, Deed]]) -> list[Event]:
    """Do the deeds of bodies that are not stopped. Return an event for each, also a refused one.

    deeds: (body index, deed), in body order. wanted (n, 3): the wanted twists for this step. A
    stopped picker may still say from where it picks later: that moves nothing, and its agent says
    so only once.
    """
    events = []
    for i, deed in deeds:
        if not world.stopped[i] or isinstance(deed, PickFrom):
            events.append(_do_one(world, wanted, i, deed))
    return events


def _do_one(world: World, wanted: np.ndarray, i: int, deed: Deed) -> Event:
    """Do a deed of body i, or refuse it. Return the event. Raises TypeError for what is no deed."""
    name = world.layout.names[i]
    try:
        match deed:
            case Couple():
                return Event(world.tick, "coupled", name, _couple(world, wanted, i, deed.bin))
            case Uncouple():
                return Event(world.tick, "uncoupled", name, _uncouple(world, wanted, i))
            case Flatten():
                return Event(world.tick, "weed flattened", name, _flatten(world, i))
            case PickFrom():
                _refuse_if(world.layout.starts[i].kind != "picker", "it picks nothing")
                world.pick_from[i] = deed.x
                return Event(world.tick, "picks from", name, "", f"x = {deed.x:.2f} m")
    except DeedRefused as reason:
        bin_ = ""
        if isinstance(deed, Couple):
            bin_ = printable(deed.bin)
        detail = f"{type(deed).__name__.lower()}: {reason}"
        return Event(world.tick, "deed refused", name, bin_, detail)
    raise TypeError(f"not a deed: {deed!r}")


def _couple(world: World, wanted: np.ndarray, robot: int, bin_name: str) -> str:
    """Couple a bin to a robot, and return the bin's name. Raises DeedRefused."""
    bin_ = world.index.get(bin_name, NONE)
    _refuse_if(world.fixed.tows[robot] == 0.0, "it tows nothing")
    _refuse_if(bin_ == NONE or world.layout.starts[bin_].kind != "bin", "no such bin")
    _refuse_if(world.coupled[robot] != NONE, "it has a bin")
    _refuse_if(world.coupled[bin_] != NONE, "the bin is coupled")
    _refuse_if(bool(world.stopped[bin_]), "the bin is stopped")
    _refuse_unless_both_stand(world, wanted, robot, bin_)
    _refuse_unless_in_place(world, robot, bin_)
    world.coupled[robot] = bin_
    world.coupled[bin_] = robot
    return bin_name


def _refuse_unless_in_place(world: World, robot: int, bin_: int) -> None:
    """Raise DeedRefused unless a bin stands at a robot's coupling point, square to the robot."""
    pose = Pose(*world.pose[robot].tolist())
    bin_pose = Pose(*world.pose[bin_].tolist())
    # The bin's centre, first from the robot's centre, and then from the coupling point.
    ahead, left = to_frame(pose, bin_pose.x, bin_pose.y)
    off_ahead = ahead + float(world.fixed.tows[robot])
    is_away = off_ahead * off_ahead + left * left > COUPLING_REACH * COUPLING_REACH
    _refuse_if(is_away, "the bin is not at the coupling point")
    # A bin is square, so its yaw counts modulo a quarter turn.
    askew = angle_between(pose.yaw, bin_pose.yaw)
    askew -= repeatable.QUARTER * round(askew / repeatable.QUARTER)
    _refuse_if(abs(askew) > COUPLING_ANGLE, "the bin is not square to it")


def _uncouple(world: World, wanted: np.ndarray, robot: int) -> str:
    """Uncouple a robot's bin, and return the bin's name. Raises DeedRefused."""
    bin_ = int(world.coupled[robot])
    _refuse_if(world.fixed.tows[robot] == 0.0, "it tows nothing")
    _refuse_if(bin_ == NONE, "it has no bin")
    _refuse_unless_both_stand(world, wanted, robot, bin_)
    world.coupled[robot] = world.coupled[bin_] = NONE
    return world.layout.names[bin_]


def _flatten(world: World, weed: int) -> str:
    """Flatten a weed, and return the name of a body that moves beside it. Raises DeedRefused."""
    _refuse_if(world.layout.starts[weed].kind != "weed", "it is no weed")
    _refuse_if(not world.alive[weed], "it is flat")
    boxes = world.fixed.shapes.copy()
    place(world.pose, boxes)
    # It is computed also for bodies that do not move, so that `Engine.rehearse`, in which nothing
    # moves, compiles `gap`.
    gaps = np.array([gap(boxes[weed], box) for box in boxes])
    is_moving = world.twist.any(axis=1)
    moving_near = np.flatnonzero(is_moving & (gaps <= WEED_REACH)).tolist()
    _refuse_if(not moving_near, "nothing moves within 1 m")
    world.alive[weed] = False
    return world.layout.names[moving_near[0]]


def _refuse_unless_both_stand(world: World, wanted: np.ndarray, robot: int, bin_: int) -> None:
    """Raise DeedRefused if a robot or its bin moves, or wants to."""
    for i in (robot, bin_):
        _refuse_if(world.twist[i].any() or wanted[i].any(), f"{world.layout.names[i]} moves")


def _refuse_if(wrong: bool, reason: str) -> None:
    """Raise DeedRefused with a reason."""
    if wrong:
        raise DeedRefused(reason)
