"""Parts of a picker's plan that come again: they are translated once, and then copied.

In a long run a picker picks its rows again and again, and its plan has the same steps each time. A
part begins where the picker begins to pick on a pass, and ends where it begins on the next one.
Copies differ in the numbers of their passes only.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model.writer import Writer
from orchard.field.geometry import Pose
from orchard.field.passes import UNKNOWN, Pass
from orchard.plans import steps as st
from orchard.plans.robot import Step

# Kinds of ops whose `arg` is the number of a pass, or NONE.
OF_A_PASS = (c.BEGIN_ROW, c.END_ROW, c.LEAVE_BIN, c.DRIVE)


class PartBeginning(NamedTuple):
    """Where a part begins: all on which its ops depend beside its steps.

    Neither pass has the number of its bin, because no op depends on that.
    """

    pose: Pose
    state: str
    current: Pass
    after: Pass | None


@dataclass(frozen=True)
class PlanPart:
    """A part that is translated."""

    # As the plan had them. The last one begins the next part, because a drive looks ahead to that.
    steps: list[Step]
    # How many of them are done at its end.
    steps_done: int
    # The number of its pass, or NONE; and how many passes are done at its end.
    number: int
    passes_done: int
    # Its first op, and the op behind its last one; the ops, and which have the number of a pass.
    first: int
    last: int
    ops: np.ndarray
    of_pass: np.ndarray
    # Of each of its steps the op at which it begins.
    begins: list[int]
    # Where and how the picker is at its end.
    pose: Pose
    state: str

    @property
    def is_of_pass(self) -> bool:
        """Whether it may come again: what belongs to no pass does not."""
        return self.number != c.NONE

    def with_number(self, number: int) -> np.ndarray:
        """Return its ops for a pass of another number."""
        rows = self.ops.copy()
        rows["arg"][self.of_pass] += number - self.number
        return rows


def beginning_of(writer: Writer) -> PartBeginning | None:
    """Return where the part begins that is translated next; None if it belongs to no pass."""
    if not writer.passes:
        return None
    nearest = [drive._replace(bin_number=UNKNOWN) for _, drive in writer.passes[:2]]
    after = nearest[1] if len(nearest) > 1 else None
    return PartBeginning(writer.pose, writer.state, nearest[0], after)


def end_of_part(writer: Writer) -> int:
    """Return the number of the step at which the part ends that begins at the writer's step."""
    number = writer.number + 1
    while number < len(writer.steps) and not _begins_picking(writer.steps[number]):
        number += 1
    return number


def of_pass(ops: np.ndarray) -> np.ndarray:
    """Return the indices of the ops whose `arg` is the number of a pass."""
    return np.flatnonzero(np.isin(ops["kind"], OF_A_PASS) & (ops["arg"] != c.NONE))


def _begins_picking(step: Step) -> bool:
    """Whether a picker begins to pick with a step."""
    return isinstance(step, st.Say) and step.state == "picking"
