"""The plan of one schedule: its run, and the faults that happen in it.

drawing.py draws a plan from a seed, schedule.py carries it out, and verdict.py judges what came of
it. Here a plan says, too, what may be expected of it: whether a host may be given up, for example.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

from chaos.simulated.clients import CHANGES_THE_HASH
from chaos.simulated.link import Delays
from chaos.simulated.scenes import SCENES
from chaos.simulated.tearing import NO_TEARS, Tears
from orchard.net import requests
from orchard.server.options import PATIENCE
from orchard.wire.keys import LOGGER

# s that a host takes after a fault to be back, over a fast network.
BACK_SECONDS = 3.0
# Slow messages that it may send and receive until then, one after the other.
SLOW_IN_TURN = 3
# s for which a cut link alone keeps no host from the message of the end.
SHORT_CUT = 0.7
# s that a client may claim agents while a host goes on to try.
SHORT_CLAIM = 2.0
# s that processes may take to end after physics, beside the questions of those that start.
END_SECONDS = 15.0
# Processes, as faults name them.
CLIENT = "client"
RUN_PY = "run.py"
ROUTER = "router"


class Fault(NamedTuple):
    """A fault: what happens to which process, and when."""

    what: str  # such as "kill"
    who: str  # the process, such as "physics"
    # Counted from the beginning of the schedule, or from its last reset; -1: before the first tick.
    tick: int
    delay: float = 0.0  # s after the tick
    seconds: float = 0.0  # how long it lasts; 0.0: it is a moment
    # n: it happens when the process is about to send its n-th message from then on; 0: at once. Of
    # a host only queries count: it has sent its velocities then, and not yet all of its mail.
    message: int = 0

    def __str__(self) -> str:
        words = f"tick {self.tick} + {self.delay:.4f} s"
        if self.message:
            words += f", at message {self.message}"
        words += f": {self.what} {self.who}"
        if self.seconds:
            words += f" for {self.seconds:.2f} s"
        return words


@dataclass(frozen=True)
class Plan:
    """What one schedule does. The same plan gives the same schedule."""

    seed: int
    scene: str  # a name in SCENES
    ticks: int  # how long it lasts, from `begin` on
    hosts: int  # how many processes host agents
    has_logger: bool
    has_router: bool  # a router of its own, to which physics connects too
    delays: Delays
    faults: tuple[Fault, ...]
    mode: str = "lockstep"
    patience: float = PATIENCE  # s that physics waits for a host
    is_elsewhere: bool = False  # the hosts are on another machine: run.py does not end them
    has_bare_client: bool = False  # a client of its own has one agent, which stands
    late: float = 0.0  # s by which tokens come later than messages, as over several routers
    begin: int = 0  # the tick of the keyframe from which it begins
    has_tables: bool = False
    tears: Tears = NO_TEARS  # how often payloads change on their way

    @property
    def scenario(self) -> dict[str, Any]:
        """The scenario of its scene."""
        return SCENES[self.scene]

    @property
    def end(self) -> int:
        """The tick at which it ends, unless the harvest is over, or is reset."""
        return self.begin + self.ticks

    @property
    def has_hash(self) -> bool:
        """Whether the run has the hash of local mode, if no agent was lost."""
        return self.mode == "lockstep" and not any(
            fault.what in CHANGES_THE_HASH for fault in self.faults
        )

    @property
    def _of_hosts(self) -> list[Fault]:
        """The faults that may keep a host away."""
        found = []
        for fault in self.faults:
            if fault.who not in (CLIENT, LOGGER) or fault.what == "claim":
                found.append(fault)
        return found

    @property
    def away(self) -> float:
        """For how long a host may be away at most, s of a run that plays."""
        seconds = sum(fault.seconds + BACK_SECONDS for fault in self._of_hosts)
        return seconds - self._paused_while_thinking

    @property
    def _paused_while_thinking(self) -> float:
        """For how long the run is paused while a host thinks, s; 0 if the plan is another one.

        Such a plan is that of a host in a debugger. The clock of the run stands in a pause.
        """
        if [fault.what for fault in self.faults] != ["think", "pause"]:
            return 0.0
        think, pause = self.faults
        begin_together = (think.tick, think.delay) == (pause.tick, pause.delay)
        if begin_together and pause.tick > 0:
            return pause.seconds
        return 0.0

    @property
    def may_lose(self) -> bool:
        """Whether a host may be away for longer than physics waits.

        After a single fault it may be back late, because its messages are slow. For several faults
        BACK_SECONDS of each leave time for that. A host that only thinks need not join again.
        """
        faults = self._of_hosts
        slow = 0.0
        if len(faults) == 1 and faults[0].what != "think" and self.delays.share:
            slow = SLOW_IN_TURN * self.delays.slow + self.late
        return self.away + slow >= self.patience

    @property
    def may_miss_the_end(self) -> bool:
        """Whether a host may not hear that the run is over.

        run.py ends its own hosts. Another host may miss it if more happens than a short cut of one
        link.
        """
        if not (self.is_elsewhere or self.has_bare_client):
            return False
        faults = [fault for fault in self.faults if fault.who not in (CLIENT, LOGGER)]
        if len(faults) > 1:
            return True
        return any(fault.what != "cut" or fault.seconds > SHORT_CUT for fault in faults)

    @property
    def may_take(self) -> bool:
        """Whether a client may keep agents that it has got for longer than a host tries to get
        them.

        While another client is mute, the question of the first one lasts, too.
        """
        for fault in self.faults:
            if fault.what == "claim" and (fault.seconds > SHORT_CLAIM or self.has("mute")):
                return True
        return False

    def has(self, *what: str) -> bool:
        """Whether it has one of these faults."""
        return any(fault.what in what for fault in self.faults)


def leave_limit(plan: Plan) -> float:
    """Return the seconds of virtual time within which all processes end after physics.

    A host that starts just then asks TRIES times for the run. A client that is mute, so does not
    answer, makes a question last.
    """
    mute = sum(fault.seconds for fault in plan.faults if fault.what == "mute")
    seconds_of_a_try = requests.AGAIN_SECONDS + plan.delays.there_and_back
    return END_SECONDS + mute + requests.TRIES * seconds_of_a_try
