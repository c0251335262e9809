"""The agent's one door: what it sees, what it hears, what it does. No socket, no clock, no process behind it.

    action = agent.tick(observation, mail, memory)

`memory` is None at the very first tick, afterwards whatever the agent returned in its last action: plain data (msgspec
Structs, numbers, strings, lists, maps), because it travels with the velocity and is handed to whoever runs the agent next.
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from orchard.contract.messages import Answer, Deed, Request
from orchard.field.geometry import STILL, Pose, Twist, yaw_of


class Hitch(NamedTuple):
    """The other end of the bar: what a robot knows of its bin, and a bin of its robot."""

    name: str
    x: float
    y: float
    orientation: tuple[float, float]  # quaternion z, w
    twist: Twist
    scan: np.ndarray | None  # the bin's ranges, (60,) float32; None for a bin, which does not hear its robot's

    @property
    def pose(self) -> Pose:
        return Pose(self.x, self.y, yaw_of(*self.orientation))


@dataclass(slots=True)
class Observation:
    """What physics tells one body at one tick. An agent without a body has no place: x is NaN and scan None."""

    name: str
    tick: int
    x: float
    y: float
    orientation: tuple[float, float]  # quaternion z, w
    twist: Twist  # what it was driven with in the last step
    scan: np.ndarray  # ranges, m: (180,) or, of bins and weeds, (60,) float32; +inf where nothing returns (REP-117)
    hitch: Hitch | None = None
    fill: float = 0.0  # of a bin: metres of row that are in it, 0 to 70
    full: bool = False  # of a bin
    _pose: Pose | None = field(default=None, init=False, repr=False, compare=False)  # once somebody has asked for it

    @property
    def pose(self) -> Pose:
        if self._pose is None:
            self._pose = Pose(self.x, self.y, yaw_of(*self.orientation))
        return self._pose


def without_body(name: str, tick: int) -> Observation:
    """What an agent without a body is told: the tick."""
    return Observation(name, tick, math.nan, math.nan, (0.0, 1.0), STILL, None)  # type: ignore[arg-type]  # those with a body need not ask


class Heard(NamedTuple):
    """A request that arrived. Answer it in the tick in which it is heard, or never."""

    sender: str
    tick: int  # in which it was asked
    number: int  # of the sender's requests in that tick
    body: Request


class Reply(NamedTuple):
    """What became of a request of two ticks ago: the answer, or None where nobody answered."""

    sender: str  # who was asked
    number: int
    request: Request
    body: Answer | None


@dataclass(slots=True)
class Mail:
    """What an agent hears at one tick: requests sorted by kind, sender and number, replies by number."""

    requests: list[Heard] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)


@dataclass(slots=True)
class Action:
    """What an agent wants, and what it has to say."""

    twist: Twist = STILL
    deeds: list[Deed] = field(default_factory=list)
    requests: list[tuple[str, Request]] = field(default_factory=list)  # (to whom, what)
    answers: list[tuple[Heard, Answer]] = field(default_factory=list)
    memory: Any = None
    doing: str = ""  # a short present participle: "picking row 3"
    waits_for: str = ""  # whom or what, when it cannot go on
    steps_done: int = 0  # of its plan, since the beginning


class Agent(Protocol):
    """Anything with this one method drives a robot. `Memory` is the type of its memory, so that bytes become one again."""

    @property
    def Memory(self) -> type: ...

    def tick(self, observation: Observation, mail: Mail, memory: Any, /) -> Action: ...
