"""Velocities of clients, which are programs outside the run, such as a bridge or a joystick.

A client drives a robot that no session owns by its velocities. To a robot whose agent still drives
it a client sends advice: a velocity that takes the place of the agent's for a while.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from msgspec.structs import replace

from orchard.contract.agent import MOST_DEEDS, Action
from orchard.contract.messages import Deed
from orchard.field.geometry import Twist
from orchard.net.refusals import Refused, refuse_other_tick
from orchard.wire.codec import twist_of
from orchard.wire.messages import Advice, Velocity

WATCHDOG = 0.5  # s of wall time that one velocity drives a robot at least, in realtime
# Steps that one velocity, or one advice, drives a robot.
WATCHDOG_TICKS = 5


class RecentTicks:
    """The ticks of which velocities may still drive.

    They are less than WATCHDOG_TICKS ticks ago, or less than `seconds` of wall time ago.
    """

    def __init__(self, clock: Callable[[], float], seconds: float = WATCHDOG) -> None:
        """`clock`: s of wall time, without pauses."""
        self.clock = clock
        self.newest = 0
        self._seconds = seconds
        # (tick, time of its publication, s), of each of these ticks.
        self._begun: deque[tuple[int, float]] = deque([(0, clock())])

    def begin(self, tick: int) -> None:
        """Record that a tick is published, and forget those that are over."""
        self.newest = tick
        self._begun.append((tick, self.clock()))
        while self.is_over(*self._begun[0], tick):
            self._begun.popleft()

    @property
    def oldest(self) -> int:
        """The oldest of these ticks."""
        return self._begun[0][0]

    def is_over(self, tick: int, at: float, now: int) -> bool:
        """Whether a velocity does not drive any more at the tick `now`.

        `tick`: of the velocity. `at`: when it came, s, on the clock.
        """
        return now - tick >= WATCHDOG_TICKS and self.clock() - at >= self._seconds


class _Sent(NamedTuple):
    """A velocity that a client sent for a tick; `at`: when it came, s, on the clock."""

    tick: int
    twist: Twist
    at: float


class UnownedCommands:
    """The velocities of robots that no session owns.

    The newest one drives a robot, for half a second.
    """

    def __init__(self, clock: Callable[[], float], seconds: float = WATCHDOG) -> None:
        """`seconds`: of wall time that a velocity drives at least; 0 in lockstep."""
        self._recent = RecentTicks(clock, seconds)
        # Robot -> its newest velocity.
        self._sent: dict[str, _Sent] = {}
        # Robot -> its deeds that no step has used.
        self._deeds: dict[str, list[Deed]] = {}

    def begin(self, tick: int) -> None:
        """Record that a tick is published."""
        self._recent.begin(tick)

    def take(self, name: str, velocity: Velocity) -> None:
        """Take a velocity for a robot.

        Raises Refused if it names an owner, for a client has none, or if its tick is too old, older
        than that of the last one, or in the future.
        """
        if velocity.owner:
            raise Refused("not owned", "no session owns this agent; join first")
        oldest = self._recent.oldest
        if name in self._sent:
            oldest = max(oldest, self._sent[name].tick)
        refuse_other_tick(velocity.tick, oldest, self._recent.newest)
        self._sent[name] = _Sent(velocity.tick, twist_of(velocity), self._recent.clock())
        self._deeds[name] = all_deeds(self._deeds.get(name, []), velocity.deeds)

    def drives(self, name: str) -> bool:
        """Whether a velocity drives a robot, as of the last step."""
        return name in self._sent

    def actions(self, tick: int) -> dict[str, Action]:
        """Return the actions to apply at a tick, by name; each deed is in them once."""
        deeds = self._deeds
        self._deeds = {}
        actions = {}
        for name, sent in list(self._sent.items()):
            if self._recent.is_over(sent.tick, sent.at, tick):
                del self._sent[name]
            else:
                actions[name] = Action(sent.twist, deeds.get(name, []))
        return actions


class Advised:
    """The newest advice for each robot.

    It drives for WATCHDOG_TICKS ticks of simulated time, so a paused or slow run changes nothing.
    """

    def __init__(self) -> None:
        self._newest: dict[str, Advice] = {}

    def take(self, name: str, advice: Advice, tick: int) -> None:
        """Take advice for a robot.

        Raises Refused if it is too old, older than the last one, or of the future.
        """
        if name in self._newest:
            last = self._newest[name].tick
        else:
            last = 0
        refuse_other_tick(advice.tick, max(last, tick - WATCHDOG_TICKS + 1), tick)
        self._newest[name] = advice

    def actions(
        self, tick: int, own: Mapping[str, Action], newest: Mapping[str, Action]
    ) -> dict[str, Action]:
        """Return the action of each advised robot, with the velocity of its advice.

        All else in it is from the robot's agent: from its answer to this tick, which is in `own`,
        or from its last answer, which is in `newest`. Both are name -> action.
        """
        actions = {}
        for name, advice in list(self._newest.items()):
            if tick - advice.tick >= WATCHDOG_TICKS:
                del self._newest[name]
                continue
            action = own.get(name)
            if action is None:
                # The deeds of the last answer are done, and its letters are sent, already.
                before = newest.get(name) or Action()
                action = replace(before, deeds=[], requests=[], answers=[])
            actions[name] = replace(action, twist=twist_of(advice), hold=None)
        return actions


def all_deeds(before: list[Deed], now: list[Deed]) -> list[Deed]:
    """Return deeds that no step has used, and then newer ones, each deed once.

    They are at most MOST_DEEDS, as in one action.
    """
    not_repeated = [deed for deed in before if deed not in now]
    return [*not_repeated, *now][:MOST_DEEDS]
