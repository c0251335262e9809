"""By how much absences of a picker delay a bin at least, for limits and proofs.

`orchard.plans.failures` says when a picker goes away on a drive. It comes back at a time of the
clock, so a delay depends on when the drive begins. A picker that begins later is not done earlier,
but for OVER: one that begins less than that before the end of an absence does not go away. So what
follows from the earliest begin, less OVER for each absence, holds for any other begin.
"""

from dataclasses import dataclass

from orchard.field.geometry import Pose
from orchard.field.picking import Absences
from orchard.plans.failures import OVER, last_leave, off_the_road, work_until_away
from orchard.plans.steps import DriveTo


@dataclass(frozen=True)
class AbsentDrive:
    """A drive on which a picker may go away. All times in s."""

    #: From the time at which the picker last went on, without absences, to the drive.
    begins: float
    #: Work for the whole drive.
    needed: float
    #: The work after which the picker may go away, and after which it stays.
    first: float
    last: float
    #: Begin and end of each absence, since the harvest began.
    absences: Absences

    def delay(self, begun: float) -> float:
        """Return by how much absences delay the drive at least, s. `begun`: when it begins at the
        earliest, s since the harvest began.
        """
        now = begun
        worked = 0.0
        for begin, end in self.absences:
            first = max(0.0, self.first - worked)
            work = work_until_away(begin, end, now, first, self.last - worked)
            if worked + work < self.needed:
                worked += work
                now = end - OVER
        return max(0.0, now - worked - begun)


def absent_drive(
    drive: DriveTo, pose: Pose, speed: float, begins: float, absences: Absences
) -> AbsentDrive:
    """Return a drive on which a picker may go away, on free roads.

    `pose`, `begins`: where and when it begins, m and s. `speed`: m/s. The rest as of `AbsentDrive`.
    """
    here = getattr(pose, drive.axis)
    distance = getattr(drive, drive.axis) - here
    direction = 1.0
    if distance < 0.0:
        direction = -1.0
    needed = abs(distance) / speed
    first = 0.0
    for gate in drive.frees:
        first = max(first, off_the_road(direction * (gate.at - here), speed))
    last = last_leave(needed)
    for gate in drive.needs:
        last = min(last, direction * (gate.at - here) / speed)
    return AbsentDrive(begins, needed, first, last, absences)
