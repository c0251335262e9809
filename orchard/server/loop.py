"""The clock of a run: shows each tick, waits for every agent's answer, steps.

There is no agent in it: a robot that nobody drives stands still. In realtime it waits no longer than the clock allows:
`lockstep.Answers` and `realtime.Live` decide when a tick's answers are in.
"""

import logging
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from orchard.net.bus import Bus
from orchard.net.lockstep import AGAIN_SECONDS
from orchard.net.pacer import Pacer
from orchard.server.harvest import Harvest, RunEnded, RunOptions
from orchard.server.inbound import Inbound
from orchard.server.step_reporter import FinishedStep
from orchard.sim.snapshot import Snapshot
from orchard.wire.keys import LOGGER, Keys
from orchard.wire.messages import End

if TYPE_CHECKING:
    from orchard.sim.engine import Engine

log = logging.getLogger("orchard")

NAG_SECONDS = 3.0  # between two lines that name who is missing
LOGGER_SECONDS = 10.0  # for how long the first tick waits for a logger
FAREWELL_SECONDS = 2.0  # for how long the others may take to leave


class Physics:
    """One run, from the first agent to the last message."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: RunOptions, before: Snapshot | None = None) -> None:
        """`before`: the snapshot that the engine was made of."""
        self.bus, self._engine, self._options = bus, engine, options
        self.harvest = Harvest(bus, keys, engine, options, before)
        self.arrivals = Inbound(bus, keys, self.harvest)
        self._drivers, self._reporter = self.harvest.drivers, self.harvest.reporter
        self._held_before = before.held if before else None
        self._pacer = Pacer(options.speed)

    def listen(self) -> None:
        self.arrivals.listen()

    def run(self, get_ready: Callable[[], None]) -> End:
        """All ticks; the end that was told to everybody.

        `get_ready`: what physics does before the first tick, once those who wait have been told of the run and get ready as well.
        """
        try:
            for _ in range(len(self.bus.inbox)):
                self.arrivals.take(0.0)
            get_ready()
            self.gather()
            self._reporter.begin()
            while not (why := self._why_over()):
                self._tick()
        except RunEnded as ended:
            why = str(ended)
        self._reporter.tell()
        if why in ("stopped", "duration"):
            self.harvest.keep()
        self.harvest.snapshot_writer.finish()
        end = self.harvest.end(why)
        self.harvest.publisher.say("end", end)
        self._farewell()
        return end

    def gather(self) -> None:
        """Wait for all agents that are expected, and for the logger, so that the recording begins with the run.

        Those that were held in a run that goes on have some time to come back; and again, whenever one of them has: many are slow to start.
        """
        names = self._drivers.roster.names if self._held_before is None else tuple(self._held_before)
        patience = math.inf if self._held_before is None else self._options.patience
        end, fewest = time.monotonic() + patience, len(names)
        while (missing := [name for name in names if self._is_expected(name)]) and (left := end - time.monotonic()) > 0.0:
            if len(missing) < fewest:
                end, fewest = time.monotonic() + patience, len(missing)
            elif not self.arrivals.take(min(left, NAG_SECONDS)):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))
        deadline = time.monotonic() + LOGGER_SECONDS
        while self._options.recorded and not self._drivers.roster.is_there(LOGGER) and (left := deadline - time.monotonic()) > 0.0:
            self.arrivals.take(left)

    def _is_expected(self, name: str) -> bool:
        return name not in self._options.absent and not self._drivers.drives(name)

    def _why_over(self) -> str:
        """Why the run is over; '' if it is not."""
        if self._engine.over:
            return "harvested"
        if self._engine.tick >= self._options.ticks:
            return "duration"
        return "\n".join(["jammed", *jam]) if (jam := self._reporter.account.jam) else ""

    def _tick(self) -> None:
        """Show the tick; while the agents think, account for the last one and tell of it; take their answers; step."""
        tick, seen = self._engine.tick, self._engine.observe()
        self._drivers.begin(seen, self._pause())
        self._engine.account()
        self._reporter.tell()
        if self.harvest.snapshot_writer.is_due():
            self.harvest.keep()
        self._await_answers()
        actions = self._drivers.actions(tick)
        self._reporter.stepped(FinishedStep(tick, self._engine.step(actions, self._drivers.answers.digests()), actions))

    def _pause(self) -> float:
        """Until the tick's time has come; so many seconds after it."""
        while self.arrivals.take(self._pacer.wait()) or self._pacer.wait():
            pass
        return self._pacer.begin()

    def _await_answers(self) -> None:
        """Until all are in, or their time is over. Whoever is silent is shown the tick again: it may have been lost."""
        drivers, answers, again = self._drivers, self._drivers.answers, time.monotonic() + AGAIN_SECONDS
        while answers.missing:
            until, enough = min(answers.deadline, again), 1 if len(self.bus.inbox) else len(drivers.silent())
            self.arrivals.take(max(0.0, until - time.monotonic()), enough)
            now = time.monotonic()
            if now >= answers.deadline:
                drivers.release(answers.give_up())
            elif now >= again:
                again = now + AGAIN_SECONDS
                drivers.show(drivers.silent())

    def _farewell(self) -> None:
        """Stay until all others have gone, so that the last message reaches them, but not for long."""
        deadline = time.monotonic() + FAREWELL_SECONDS
        while self._drivers.roster.anybody() and (left := deadline - time.monotonic()) > 0.0:
            if not self.arrivals.take_leave(left):
                return
