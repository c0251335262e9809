"""What a robot that follows a plan remembers from tick to tick.

Agents remember nothing but this: it is sent to physics, so that another process can go on with the
robot (docs/design.md). `PlanExecutor` of orchard/plans/robot.py reads and changes it.
"""

import msgspec

from orchard.contract.agent import State
from orchard.plans import sense
from orchard.plans.estimate import Estimate

# Ticks after which a question is asked again if it was not answered as hoped.
PATIENCE = 5
# Ticks for which a robot stands after a collision.
RECOVERY = 10


class Course(msgspec.Struct):
    """Where the plan has the robot stand, or to where it drives, and on which path.

    A robot that something moved or turned comes back to it.
    """

    x: float  # m
    y: float  # m
    # Of the straight path that leads there: a key of HEADINGS.
    heading: str


class RobotMemory(msgspec.Struct):
    """The memory of any robot that follows a plan. `steps.Plan` adds the plan itself.

    A place is a stretch of a road that the agent `traffic` grants. A claim is the message in which
    a robot tells traffic the places that it keeps and those that it wants.
    """

    # Number of steps that are done since the beginning.
    done: int = 0
    # Tick at which the present step began.
    since: int = 0
    # What the robot does, in words for people, and as a state for programs.
    doing: str = ""
    state: State = "resting"
    # Places that traffic granted and the robot still keeps.
    reserved: list[str] = []
    # Places that are reserved for the robot by traffic's last answer. Some of them the robot may
    # have given back since.
    agreed: list[str] = []
    # Of `agreed`, the places that it shares with no other robot.
    alone: list[str] = []
    # Other robots that have places which this robot wants, by traffic's last answer.
    blockers: list[str] = []
    # Tick of the last claim to traffic; at first so long ago that it may claim at once.
    claimed: int = -PATIENCE
    # Whether it commanded a motion in the last tick.
    moving: bool = False
    # Whether that was a drive, and not only a turn.
    driving: bool = False
    # Tick at which it last found that it had collided; at first so long ago that it has no effect.
    bumped: int = -2 * RECOVERY
    # Person or animal -> its reported position.
    sighted: dict[str, sense.Sighting] = {}
    # Question of the present step -> tick at which the robot last asked it.
    asked: dict[str, int] = {}
    # The full bin of which the robot knows that its picker has left it in the lane; '' for none.
    left: str = ""
    # Its estimate of its own position; None if its receiver is exact.
    place: Estimate | None = None
    # None: a new course begins where the robot stands now.
    course: Course | None = None
    # How it comes back to its course: 1 driving ahead, -1 driving back; 0: it is on its course. See
    # orchard/plans/course.py.
    way: float = 0.0
    # Tick at which it last moved on its way back to the course, or began it.
    moved: int = 0
    # Number of its failures so far.
    failures: int = 0
    # Time for which it worked since the last failure, s.
    worked: float = 0.0
