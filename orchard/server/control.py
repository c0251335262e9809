"""Pause, step and play a run: what the queries on `set_simulation_state` and `step_simulation` do. Names: ROS's simulation_interfaces."""

from collections.abc import Callable
from typing import Literal

from orchard.contract.messages import pack
from orchard.net.bus import Query
from orchard.net.refusals import Refused
from orchard.server.run_clock import RunClock
from orchard.wire.messages import SimulationState, StateOfSimulation


class SimulationControl:
    """Whether a run plays. Every change of the state is published."""

    def __init__(self, clock: RunClock, publish: Callable[[SimulationState], None], run: str, tick: Callable[[], int]) -> None:
        """`clock`: that of the run, which a pause stops. `tick`: returns the tick of the run."""
        self.clock = clock
        self._publish, self._run, self._tick = publish, run, tick
        self._state: StateOfSimulation = "stopped"  # as it was published last
        self._begun = self._ended = False
        self._stepping: Query | None = None  # a query whose steps are not all done

    @property
    def state(self) -> SimulationState:
        """The state now, as a message."""
        running: StateOfSimulation = "paused" if self.clock.is_paused else "playing" if self._begun else "stopped"
        return SimulationState(self._run, self._tick(), "quitting" if self._ended else running)

    def begin(self) -> None:
        """Record that the first tick is about to be published."""
        self._begun = True
        self.tell()

    def end(self) -> None:
        """Record that the run is over. Steps that are left are not done."""
        self._ended = True
        self.tell()
        self.finish_steps()

    def set(self, wanted: Literal["playing", "paused"]) -> None:
        """Let the run play, or pause it. That also ends the steps of a query."""
        if wanted == "paused":
            self.clock.pause()
        else:
            self.clock.play()
        self.finish_steps()
        self.tell()

    def step(self, query: Query, steps: int) -> None:
        """Do some steps. `finish_steps` replies to the query. Raises Refused unless the run is paused."""
        if not self.clock.is_paused:
            raise Refused("not paused", "only a paused run does single steps; pause it first")
        self.finish_steps()
        self._stepping = query
        self.clock.play(steps)
        self.tell()

    def keeps(self, query: Query) -> bool:
        """Whether `finish_steps` will reply to this query."""
        return query is self._stepping

    def finish_steps(self) -> None:
        """Reply to the query for steps, if there is one: they are over."""
        query, self._stepping = self._stepping, None
        if query is not None:
            query.reply(pack(self.state))
            query.drop()

    def tell(self) -> None:
        """Publish the state if it has changed."""
        now = self.state
        if now.state != self._state:
            self._state = now.state
            self._publish(now)
