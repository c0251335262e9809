"""A plan while it is translated: what is known at a step, and what steps say of themselves.

`orchard.event_model.translator` uses it. "Columns" are those of `program_columns.OP`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, cast

from orchard.event_model import codes as c
from orchard.field.geometry import Pose, nearest_heading
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.passes import Pass
from orchard.plans import steps as st
from orchard.plans.forecast import ALONG
from orchard.plans.robot import Step
from orchard.plans.route import OneWay

# Steps that put others in their place.
INSERTING = (st.Ahead, st.MoveTo, st.Repair)


@dataclass
class Writer:
    """What the translation of a plan knows at a step: the steps, which one it is, and what was
    before.
    """

    steps: list[Step]
    pose: Pose
    machine: Machine
    number: int = 0
    # What the robot does, by its last `Say`.
    state: str = "resting"
    # Of a picker: its passes through rows that are still to be done, each with its number.
    passes: list[tuple[int, Pass]] = field(default_factory=list)
    # What may happen on the drive that follows.
    may_fail: st.MayFail | None = None
    # The steps that may take the place of the rest, each with the op that decides, and where it is.
    otherwise: list[tuple[int, Sequence[Step], Pose]] = field(default_factory=list)


class _StandsAt:
    """What a step may ask that puts others in its place: where its robot is."""

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self.steps: list[Step] = []

    def next(self, steps: Sequence[Step]) -> None:
        """Hear which steps take its place."""
        self.steps = list(steps)


def put_by(step: Step, pose: Pose) -> list[Step]:
    """Return the steps that a step of INSERTING puts in its place."""
    robot = _StandsAt(pose)
    step.act(cast(Any, robot))
    return robot.steps


def handling(step: Step, writer: Writer) -> dict[str, int]:
    """Return the columns that tell for how long a bin is coupled or uncoupled."""
    handles = step.handles(writer.machine)
    return {"handles": handles.ticks, "handles_at_rest": handles.at_rest}


def failing(writer: Writer) -> dict[str, Any]:
    """Return the columns of a drive that tell how its robot may fail on it, or leave."""
    step = writer.may_fail
    writer.may_fail = None
    if step is None:
        return {}
    return {
        "mean_between": step.mean_between,
        "mean_repair": step.mean_repair,
        "may_leave": bool(step.absences),
    }


# -- turns and drives

# Heading -> its unit vector.
DIRECTIONS = {
    "EAST": (1.0, 0.0),
    "NORTH": (0.0, 1.0),
    "WEST": (-1.0, 0.0),
    "SOUTH": (0.0, -1.0),
}


def quarter_turn(step: st.Face | st.Realign, writer: Writer) -> dict[str, float]:
    """Return the columns of a turn that tell from which heading it leads to which.

    None of a half turn, or where the robot does not look for others.
    """
    if isinstance(step, st.Realign) or step.blind_to:
        return {}
    before = nearest_heading(writer.pose.yaw)
    faced_x, faced_y = DIRECTIONS[before]
    faces_x, faces_y = DIRECTIONS[step.heading]
    if faced_x * faces_x + faced_y * faces_y:
        return {}
    return {"faced_x": faced_x, "faced_y": faced_y, "faces_x": faces_x, "faces_y": faces_y}


def sign_of(pose: Pose) -> int:
    """Return the sign of the direction in which a robot looks: along its axis, or against it."""
    if nearest_heading(pose.yaw) in ("EAST", "NORTH"):
        return 1
    return -1


def along(step: st.DriveTo, end: Pose) -> float:
    """Return the coordinate along its axis at which a drive ends, m."""
    if step.x is None:
        return end.y
    return end.x


def unloads_from(step: st.DriveTo, sign: int) -> float:
    """Return from where on a carrier that is held up unloads on a drive, along its line, m."""
    if isinstance(step, st.DriveToBay):
        return sign * step.unloads_from
    return inf


def pace(step: st.DriveTo, writer: Writer, layout: Layout) -> dict[str, Any]:
    """Return the columns of a drive that tell how fast it is: at a speed, or as on a pass."""
    number = _picking_pass(step, writer, layout)
    if number is None:
        return {"speed": step.speed_of(writer.machine), "arg": c.NONE}
    return {"speed": 0.0, "arg": number}


def _picking_pass(step: st.DriveTo, writer: Writer, layout: Layout) -> int | None:
    """Return the number of the pass on which a drive picks; None if it picks nothing."""
    if writer.state != "picking" or not writer.passes:
        return None
    number, current = writer.passes[0]
    if step.speed != layout.speed_on(current):
        return None
    return number


def metres_until_picking(step: st.DriveTo, writer: Writer) -> float | None:
    """Return how far a picker drives after a drive until it picks, m; None if it does more before.

    It drives to its fruit, perhaps with one more drive through a part of the row.
    """
    # The pattern that is looked for: perhaps Say "driving" and another drive, then Say "picking".
    following = writer.steps[writer.number + 1 : writer.number + 4]
    states = [after.state if isinstance(after, st.Say) else "" for after in following]
    if "picking" not in states or states[0] not in ("driving", "picking"):
        return None
    metres = 0.0
    here = step.x
    for after in following[: states.index("picking")]:
        if isinstance(after, st.DriveTo):
            assert here is not None
            assert after.x is not None
            metres += abs(after.x - here)
    return metres


def seen(writer: Writer, layout: Layout, route: OneWay) -> dict[str, Any]:
    """Return the columns of a drive that tell what a picker's bin sees of it."""
    if not writer.passes:
        return {}
    _, drive = writer.passes[0]
    is_in_row = abs(writer.pose.y - layout.lane(drive.row).y) < ALONG
    is_along = nearest_heading(writer.pose.yaw) == drive.end.upper()
    if not drive.leaves_bin or not is_in_row or not is_along:
        return {}
    sign = sign_of(writer.pose)
    row_end = route.end(drive.row, route.sides[drive.end])
    begin = drive.begin
    if writer.state == "picking" or sign * writer.pose.x > sign * begin:
        begin = writer.pose.x
    drives_first = sign * (begin - writer.pose.x) > ALONG
    drives_after = abs(row_end - drive.stop) > ALONG
    return {
        "is_seen": True,
        "tells_to": sign * row_end,
        "tells_on_drive": drives_first or drives_after,
    }
