"""The loop of a run: publish a tick, wait until the barrier has all answers of the agents, step.

The process of physics (processes/physics.py) plays it.
"""

import logging
import math
from collections.abc import Callable, Sequence

import msgspec

from orchard.net.bus import Bus, Signal
from orchard.net.ending import write_end
from orchard.server.barriers import AGAIN_SECONDS
from orchard.server.control import Pacer
from orchard.server.inbound import Inbound
from orchard.server.options import RunOptions, last_tick
from orchard.server.run import PhysicsRun, RunEnded, RunReset
from orchard.sim.engine import Engine
from orchard.sim.snapshot import Snapshot
from orchard.wire.keys import Keys
from orchard.wire.messages import RESET, End

log = logging.getLogger("orchard")

# s between two log lines that name the missing agents.
WARN_SECONDS = 3.0
# s for which the first tick waits for a logger. On a busy machine it takes long to load.
LOGGER_SECONDS = 60.0
# s that the other processes may take to leave after the end.
LEAVE_SECONDS = 2.0
# s after which the end is published again for those that have not left.
END_SECONDS = 0.2


class RunLoop:
    """The loop of one run, from the first join to the last message."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        engine: Engine,
        options: RunOptions,
        before: Snapshot | None = None,
    ) -> None:
        """`before`: the snapshot from which the engine was resumed."""
        self.bus = bus
        self._engine = engine
        self.options = options
        self.run = PhysicsRun(bus, keys, engine, options, before)
        self.arrivals = Inbound(bus, keys, self.run)
        self._drivers = self.run.drivers
        # The agents that had a session in the snapshot. None: all agents are waited for, because
        # the run is new, or its snapshot is from before the first tick, when not all had come.
        self._owned_before: list[str] | None = None
        if before and engine.tick > 0:
            self._owned_before = before.owned
        self._clock = self.run.control.clock
        self._pacer = Pacer(options.pace, self._clock)
        # The options with which the run begins again after its end; None: it does not.
        self.again: RunOptions | None = None

    def play(self, get_ready: Callable[[], None]) -> End:
        """Run all ticks, and publish the end. Return its message.

        `get_ready`: called before the first tick; it compiles the kernels while agents join.
        """
        try:
            why = self._play_ticks(get_ready)
        except RunReset as reset:
            why = RESET
            self.again = self._options_after(reset)
        except RunEnded as ended:
            why = str(ended)
        return self._finish(why)

    def _play_ticks(self, get_ready: Callable[[], None]) -> str:
        """Run all ticks, and return why the run is over. Raises RunEnded."""
        ticks = last_tick(self.options.duration)
        # What waits is handled first: a signal to stop must not wait for what takes long.
        for _ in range(len(self.bus.inbox)):
            self.arrivals.take(0.0)
        get_ready()
        self.gather()
        self.run.begin()
        why = self.run.account.why_over(ticks)
        while not why:
            self._tick()
            why = self.run.account.why_over(ticks)
        return why

    def _options_after(self, reset: RunReset) -> RunOptions:
        """Return the options with which the run begins again, at the same endpoint."""
        listen: str | None = self.bus.endpoint
        if self.options.connect:
            listen = self.options.listen
        return msgspec.structs.replace(
            self.options,
            listen=listen,
            scenario=reset.scenario,
            run=self.run.id,
            resume=False,
            paused=self._clock.is_paused,
        )

    def _finish(self, why: str) -> End:
        """Keep what counts of the run, publish its end, and wait until sessions have left."""
        self.run.control.set("quitting")
        self.run.report()
        # From such an end a user may go on. A reset has kept what it needs.
        if why in ("stopped", "duration"):
            self.run.keep()
        self.run.account.close()
        end = self.run.end(why)
        if self.options.result is not None and why != RESET:
            write_end(end, self.options.result)
        self.run.publisher.send_bundle(end.tick)
        self.run.publisher.publish("end", end)
        self.arrivals.leave()
        if why == RESET:
            # The next run begins at the same router, so all sessions of this one must leave first.
            self._await_leaving(end, self.options.patience)
        else:
            self._await_leaving(end, LEAVE_SECONDS)
        return end

    def gather(self) -> None:
        """Wait for all expected agents, and for the logger if the run is recorded.

        So the recording begins with the run. A new run waits for its agents without a limit. A run
        that is resumed waits for the agents that had an owner, until none of them has come for
        `patience` seconds: many that start at once start slowly.
        """
        if self._owned_before is None:
            wanted: Sequence[str] = self._drivers.roster.names
            patience = math.inf
        else:
            wanted = self._owned_before
            patience = self.options.patience
        names = [name for name in wanted if name not in self.options.absent]
        missing = self._gather_agents(names, patience)
        if missing:
            effect = "no longer waited for; the hash changes"
            log.warning("no host has come back with %s: %s", ", ".join(missing), effect)
            self._drivers.miss(missing)
        if self.options.recorded:
            self._gather_logger()

    def _gather_agents(self, names: Sequence[str], patience: float) -> list[str]:
        """Wait for agents, for `patience` seconds after the last one came. Return those missing."""
        end = self.bus.clock() + patience
        fewest = len(names)
        while True:
            missing = [name for name in names if not self._drivers.drives(name)]
            remaining = end - self.bus.clock()
            if not missing or remaining <= 0.0:
                return missing
            if len(missing) < fewest:
                end = self.bus.clock() + patience
                fewest = len(missing)
            elif not self.arrivals.take(min(remaining, WARN_SECONDS)):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))

    def _gather_logger(self) -> None:
        """Wait until the logger is there, but not for ever.

        A run without a recording is better than none.
        """
        deadline = self.bus.clock() + LOGGER_SECONDS
        while not self._drivers.roster.has_logger:
            remaining = deadline - self.bus.clock()
            if remaining <= 0.0:
                log.warning("no logger has come: the run begins without a recording")
                return
            if not self.arrivals.take(min(remaining, WARN_SECONDS)):
                log.warning("waiting for the logger")

    def _tick(self) -> None:
        """Publish a tick, report the step before it while the agents think, and step."""
        self._drivers.begin(self._engine.observe(), self._pacer.begin())
        self._engine.account()
        self.run.report()
        self.run.keep_if_due()
        self._await_step()
        self.run.step()

    def _await_step(self) -> None:
        """Wait until the step may be done.

        Then all answers are in or their time is over, the next tick is due, and the run plays.
        """
        self._await_answers()
        # Whatever arrives may pause the run, or bring a session whose agents must be asked. So the
        # answers are waited for again after each item.
        while self._clock.is_paused or self.arrivals.take(self._pacer.wait()) or self._pacer.wait():
            self._await_answers()

    def _await_answers(self) -> None:
        """Wait until all answers are in, or their time is over.

        Send the tick again to silent sessions.
        """
        self._stand_by()
        drivers = self._drivers
        answers = drivers.answers
        again_at = self._clock() + AGAIN_SECONDS
        warn_at = math.inf
        if answers.deadline < math.inf:
            warn_at = self._clock() + WARN_SECONDS
        while answers.missing:
            until = min(answers.deadline, again_at)
            # Answers come quietly, one from each session: it need not wake up before the last one.
            enough = 1
            if not len(self.bus.inbox):
                enough = len(drivers.silent())
            self.arrivals.take(max(0.0, until - self._clock()), enough)
            now = self._clock()
            if now >= warn_at:
                warn_at = math.inf
                self._warn_of_missing(max(0.0, answers.deadline - now))
            if now >= answers.deadline:
                drivers.give_up()
            elif now >= again_at:
                again_at = now + AGAIN_SECONDS
                drivers.show(drivers.silent())
                self.run.publisher.send_bundle(self._engine.tick)
            self._stand_by()

    def _warn_of_missing(self, seconds: float) -> None:
        """Log which agents have not answered, and for how long they are waited for."""
        log.warning(
            "no answer to tick %d yet from %s: waiting for up to %.0f s more",
            self._engine.tick,
            ", ".join(sorted(self._drivers.answers.missing)),
            seconds,
        )

    def _stand_by(self) -> None:
        """Take what arrives while the run is paused. It returns at once if the run plays.

        The clock stands meanwhile, so no agent is late. The tick is sent again to sessions that
        have not answered it.
        """
        control = self.run.control
        while self._clock.is_paused:
            control.publish()
            self.run.publisher.send_bundle(self._engine.tick)
            # The steps of a query are over when all have answered the tick after the last one, or
            # after a moment in which nothing came.
            if not self._drivers.answers.missing:
                control.finish_steps()
            if not self.arrivals.take(AGAIN_SECONDS):
                control.finish_steps()
                self._drivers.show(self._drivers.silent())

    def _await_leaving(self, end: End, seconds: float) -> None:
        """Publish the end again and again until all sessions have left.

        It waits at most `seconds` until all tokens are gone, and at most LEAVE_SECONDS until all
        have said that they leave. A signal ends the waiting.
        """
        roster = self._drivers.roster
        now = self.bus.clock()
        deadline = now + seconds
        leave_until = now + LEAVE_SECONDS
        again_at = now + END_SECONDS
        while now < deadline:
            may_still_leave = now < leave_until and not roster.all_have_left()
            if not roster.tokens and not may_still_leave:
                return
            if now >= again_at:
                again_at = now + END_SECONDS
                self.run.publisher.publish("end", end)
            item = self.arrivals.take_after_end(min(deadline, again_at) - now)
            if isinstance(item, Signal):
                # The signal ends the next run too, if this one was reset.
                self.bus.inbox.put(item)
                return
            now = self.bus.clock()
