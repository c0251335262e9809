"""What a robot does at a moment, and what its memory tells of its plan."""

from dataclasses import dataclass, field
from typing import Any

from orchard.event_model import codes as c
from orchard.field.geometry import Pose
from orchard.plans import steps as st
from orchard.plans.robot import Step


class NotInPlanError(NotImplementedError):
    """A robot does something that its plan does not have, such as coming back to its course."""


@dataclass
class Doing:
    """What a robot does at a moment. The modules of this package fill it in, one after the other.

    An op is the number of a row of `Program.ops`.
    """

    name: str
    # Its number in the event model.
    number: int
    # What its agent remembers.
    memory: Any
    pose: Pose
    # The number of the bin on its bar; NONE: none.
    bin: int
    # The op at which its plan begins, the one in which it is, and the kind of that.
    first: int
    op: int
    kind: int
    # The step that is first in its memory; None: its plan is done.
    step: Step | None
    state: int = c.STANDING
    # The tick at which it goes on; None: something else wakes it.
    alarm: int | None = None
    # Of a turn: the ticks for which it has turned.
    turned: int = 0
    # Of a drive: where it is along its line, m.
    here: float = 0.0
    # Of a carrier: the op at which its job begins, or its waiting in the queue if it has no job.
    # That is `first`, unless it left its job to charge: then `first` begins the plan of that.
    job_first: int = c.NONE
    # Of a carrier that left its job to charge: the op of the job at which it did; NONE: it did not.
    decided: int = c.NONE
    # Further columns of `columns.ROBOT`, by name, with the values that they get.
    more: dict[str, Any] = field(default_factory=dict)


def step_of(memory: Any) -> Step | None:
    """Return the step that is first in a robot's memory; None: its plan is done."""
    return memory.plan[0] if memory.plan else None


def has_step(memory: Any, step: type[Step]) -> bool:
    """Whether a plan has a step of a class, outside those that it may do in place of others."""
    return any(isinstance(planned, step) for planned in memory.plan)


def inserted_steps(memory: Any) -> int:
    """Return how many steps a failure has put before a plan: those before its MayFail."""
    is_failing = memory.state == "failed"
    # A failure puts a `Say` that it has failed first, or second after the drive up to there.
    for step in memory.plan[:2]:
        is_failing = is_failing or (isinstance(step, st.Say) and step.state == "failed")
    if not is_failing:
        return 0
    kinds = [type(step) for step in memory.plan]
    if st.MayFail not in kinds:
        raise NotInPlanError("a robot fails that has no failures in its plan")
    return kinds.index(st.MayFail)
