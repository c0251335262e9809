"""A plan while it is translated: what is known at a step, and what steps say of themselves."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from orchard.field.geometry import Pose
from orchard.field.machines import Machine
from orchard.field.passes import Pass
from orchard.plans import steps as st
from orchard.plans.robot import Step

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
    # What the robot does, as it said.
    state: str = "resting"
    # The passes through rows that are still to be done, with their numbers, of a picker.
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


def failing(writer: Writer) -> dict[str, float]:
    """Return the columns of a drive that tell how its robot may fail on it."""
    step = writer.may_fail
    writer.may_fail = None
    if step is None:
        return {}
    return {"mean_between": step.mean_between, "mean_repair": step.mean_repair}
