"""Whether simulated time goes on, and how fast.

A run pauses, steps and plays as in ROS's simulation_interfaces.
"""

import math
from collections.abc import Callable
from typing import Literal

from orchard.contract.messages import pack
from orchard.field.scenario import TIME_STEP
from orchard.net.bus import Query
from orchard.net.refusals import Refused
from orchard.wire.messages import SimulationState, StateOfSimulation


class RunClock:
    """The clock of a run: it stands while the run is paused.

    Deadlines, pace and watchdogs of a run read it, so a pause makes no agent late and no velocity
    old. A pause takes effect between two steps. It has no lock: the thread that reads the clock is
    the one that pauses it.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        """`clock`: s, which goes on in pauses."""
        self._clock = clock
        # Steps that are still done before the run is paused; infinity: it plays on.
        self._left: float = math.inf
        # s, on `clock`: the beginning of the pause; None while the run plays.
        self._since: float | None = None
        # s, of all pauses that are over, together.
        self._paused = 0.0

    def __call__(self) -> float:
        """Return the time, s, without that of pauses."""
        if self._since is None:
            now = self._clock()
        else:
            now = self._since
        return now - self._paused

    @property
    def is_paused(self) -> bool:
        """Whether the clock stands."""
        return self._since is not None

    def pause(self) -> None:
        """Stop the clock, unless it stands."""
        if self._since is None:
            self._since = self._clock()

    def play(self, steps: float = math.inf) -> None:
        """Let the clock go on, until so many steps are done."""
        self._left = steps
        if self._since is not None:
            self._paused += self._clock() - self._since
            self._since = None

    def count_step(self) -> None:
        """Record that a step is done. After the last one of `play` the clock stands."""
        self._left -= 1
        if self._left <= 0:
            self.pause()


class Pacer:
    """Paces ticks in wall time: `speed` simulated seconds per second.

    With infinity it never waits.
    """

    CATCH_UP = 0.25  # s: the largest delay that later ticks make up for

    def __init__(self, speed: float, clock: Callable[[], float]) -> None:
        # s of wall time from a tick to the next one.
        self._step = TIME_STEP / speed
        self._clock = clock
        # s, on the clock: when the next tick may begin; -infinity before the first tick.
        self._due = -math.inf

    def wait(self) -> float:
        """Return the seconds until the next tick may begin."""
        return max(0.0, self._due - self._clock())

    def begin(self) -> float:
        """Begin a tick, and return the seconds that it begins late."""
        now = self._clock()
        due = self._due
        if due == -math.inf:
            # The first tick is in time.
            due = now
        self._due = max(due, now - self.CATCH_UP) + self._step
        return max(0.0, now - due)


class SimulationControl:
    """Whether a run plays. Every change of the state is published."""

    def __init__(
        self,
        clock: RunClock,
        send: Callable[[SimulationState], None],
        run: str,
        tick: Callable[[], int],
    ) -> None:
        """`clock`: that of the run, which a pause stops. `tick`: returns the tick of the run."""
        self.clock = clock
        self._send = send
        self._run = run
        self._tick = tick
        # The state that was published last.
        self._state: StateOfSimulation = "stopped"
        self._begun = False
        self._ended = False
        # The query for some steps, which gets its reply after the last one of them.
        self._stepping: Query | None = None

    @property
    def state(self) -> SimulationState:
        """The message of the present state."""
        return SimulationState(self._run, self._tick(), self._word())

    def _word(self) -> StateOfSimulation:
        """Return the word for the present state."""
        if self._ended:
            return "quitting"
        if self.clock.is_paused:
            return "paused"
        if self._begun:
            return "playing"
        return "stopped"

    def begin(self) -> None:
        """Record that the first tick is about to be published."""
        self._begun = True
        self.publish()

    def set(self, wanted: Literal["playing", "paused", "quitting"]) -> None:
        """Let the run play, pause it, or end it. That also ends the steps of a query."""
        if wanted == "quitting":
            self._ended = True
        elif wanted == "paused":
            self.clock.pause()
        else:
            self.clock.play()
        self.finish_steps()
        self.publish()

    def step(self, query: Query, steps: int) -> None:
        """Let a paused run do some steps. `finish_steps` replies to the query when they are done.

        Raises Refused if the run is not paused.
        """
        if not self.clock.is_paused:
            raise Refused("not paused", "only a paused run does single steps; pause it first")
        self.finish_steps()
        self._stepping = query
        self.clock.play(steps)
        self.publish()

    def keeps(self, query: Query) -> bool:
        """Whether a query gets its reply later, so that it must not be dropped yet."""
        return query is self._stepping

    def finish_steps(self) -> None:
        """Reply to the query for steps, if there is one: they are over."""
        query = self._stepping
        self._stepping = None
        if query is not None:
            query.reply(pack(self.state))
            query.drop()

    def publish(self) -> None:
        """Publish the state, if it is another than before."""
        now = self.state
        if now.state != self._state:
            self._state = now.state
            self._send(now)
