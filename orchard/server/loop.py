"""The loop of a run: publish a tick, wait until the barrier has all answers of the agents, step."""

import logging
import math
from collections.abc import Callable

import msgspec

from orchard.net.bus import Bus, Signal
from orchard.net.ending import write_end
from orchard.server.barriers import AGAIN_SECONDS
from orchard.server.control import Pacer
from orchard.server.inbound import Inbound
from orchard.server.options import RunOptions, last_tick
from orchard.server.run import Run, RunEnded, RunReset
from orchard.sim.engine import Engine
from orchard.sim.snapshot import Snapshot
from orchard.wire.keys import Keys
from orchard.wire.messages import RESET, End

log = logging.getLogger("orchard")

WARN_SECONDS = 3.0  # between two log lines that name the missing agents
# s for which the first tick waits for a logger. On a busy machine it takes long to load.
LOGGER_SECONDS = 60.0
LEAVE_SECONDS = 2.0  # that the other processes may take to leave after the end
END_SECONDS = 0.2  # after which the end is told again to those that have not left


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
        self.bus, self._engine, self.options = bus, engine, options
        self.run = Run(bus, keys, engine, options, before)
        self.arrivals = Inbound(bus, keys, self.run)
        self._drivers = self.run.drivers
        self._owned_before = (
            before.owned if before and engine.tick > 0 else None
        )  # before the first tick not all had come
        self._clock = self.run.control.clock
        self._pacer = Pacer(options.pace, self._clock)
        self.again: RunOptions | None = (
            None  # the options with which the run begins again after its end; None: it does not
        )

    def play(self, get_ready: Callable[[], None]) -> End:
        """Run all ticks, and publish the end. Return it. `get_ready`: called before the first tick."""
        ticks = last_tick(self.options.duration)
        try:
            for _ in range(len(self.bus.inbox)):
                self.arrivals.take(0.0)
            get_ready()
            self.gather()
            self.run.begin()
            while not (why := self.run.account.why_over(ticks)):
                self._tick()
        except RunReset as ended:
            why, listen = (
                str(ended),
                self.options.listen if self.options.connect else self.bus.endpoint,
            )
            news = {
                "scenario": ended.scenario,
                "run": self.run.id,
                "resume": False,
                "paused": self._clock.is_paused,
            }
            self.again = msgspec.structs.replace(self.options, listen=listen, **news)
        except RunEnded as ended:
            why = str(ended)
        self.run.control.set("quitting")
        self.run.report()
        if why in ("stopped", "duration"):
            self.run.keep()
        self.run.account.close()
        end = self.run.end(why)
        if self.options.result is not None and why != RESET:
            write_end(end, self.options.result)
        self.run.publisher.send_bundle(end.tick)
        self.run.publisher.publish("end", end)
        self.arrivals.leave()
        self._await_leaving(end, LEAVE_SECONDS if why != RESET else self.options.patience)
        return end

    def gather(self) -> None:
        """Wait for all expected agents, and for the logger if the run is recorded, so that the recording begins with the run.

        A run that is resumed waits for those that had an owner, for `patience` seconds, renewed by each that returns: many start slowly.
        """
        names = self._drivers.roster.names if self._owned_before is None else self._owned_before
        names = [name for name in names if name not in self.options.absent]
        patience = math.inf if self._owned_before is None else self.options.patience
        end, fewest = self.bus.clock() + patience, len(names)
        while (missing := [name for name in names if not self._drivers.drives(name)]) and (
            left := end - self.bus.clock()
        ) > 0.0:
            if len(missing) < fewest:
                end, fewest = self.bus.clock() + patience, len(missing)
            elif not self.arrivals.take(min(left, WARN_SECONDS)):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))
        if missing:
            log.warning(
                "no host has come back with %s: no longer waited for; the hash changes",
                ", ".join(missing),
            )
            self._drivers.miss(missing)
        if self.options.recorded:
            self._gather_logger()

    def _gather_logger(self) -> None:
        """Wait until the logger is there, but not for ever: a run without a recording is better than none."""
        deadline = self.bus.clock() + LOGGER_SECONDS
        while not self._drivers.roster.has_logger:
            remaining = deadline - self.bus.clock()
            if remaining <= 0.0:
                log.warning("no logger has come: the run begins without a recording")
                return
            if not self.arrivals.take(min(remaining, WARN_SECONDS)):
                log.warning("waiting for the logger")

    def _tick(self) -> None:
        self._drivers.begin(self._engine.observe(), self._pacer.begin())
        self._engine.account()
        self.run.report()
        if self.run.account.snapshot_writer.is_due(self._engine.tick):
            self.run.keep()
        self._await_step()
        self.run.step()

    def _await_step(self) -> None:
        """Wait until all answers are in or their time is over, the next tick is due, and the run plays."""
        self._await_answers()
        while self._clock.is_paused or self.arrivals.take(self._pacer.wait()) or self._pacer.wait():
            self._await_answers()

    def _await_answers(self) -> None:
        """Wait until all answers are in, or their time is over. Send the tick again to silent sessions."""
        self._stand_by()
        drivers, answers, again = (
            self._drivers,
            self._drivers.answers,
            self._clock() + AGAIN_SECONDS,
        )
        warn_at = self._clock() + WARN_SECONDS if answers.deadline < math.inf else math.inf
        while answers.missing:
            until, enough = (
                min(answers.deadline, again),
                1 if len(self.bus.inbox) else len(drivers.silent()),
            )
            self.arrivals.take(max(0.0, until - self._clock()), enough)
            now = self._clock()
            if now >= warn_at:
                warn_at, words = (
                    math.inf,
                    "no answer to tick %d yet from %s: waiting for up to %.0f s more",
                )
                log.warning(
                    words,
                    self._engine.tick,
                    ", ".join(sorted(answers.missing)),
                    max(0.0, answers.deadline - now),
                )
            if now >= answers.deadline:
                drivers.give_up()
            elif now >= again:
                again = now + AGAIN_SECONDS
                drivers.show(drivers.silent())
                self.run.publisher.send_bundle(self._engine.tick)
            self._stand_by()

    def _stand_by(self) -> None:
        """While the run is paused, take what arrives: no agent is late, and the tick is published repeatedly."""
        control = self.run.control
        while self._clock.is_paused:
            control.publish()
            self.run.publisher.send_bundle(self._engine.tick)
            if not self._drivers.answers.missing:
                control.finish_steps()
            if not self.arrivals.take(AGAIN_SECONDS):
                control.finish_steps()
                self._drivers.show(self._drivers.silent())

    def _await_leaving(self, end: End, seconds: float) -> None:
        """Publish the end until all tokens are gone, at most so long, and all sessions leave, at most LEAVE_SECONDS."""
        now, roster = self.bus.clock(), self._drivers.roster
        deadline, told_by, again = now + seconds, now + LEAVE_SECONDS, now + END_SECONDS
        while now < deadline and (roster.tokens or (now < told_by and not roster.all_have_left())):
            if now >= again:
                again = now + END_SECONDS
                self.run.publisher.publish("end", end)
            if isinstance(item := self.arrivals.take_after_end(min(deadline, again) - now), Signal):
                self.bus.inbox.put(item)  # it ends the next run too, if this one was reset
                return
            now = self.bus.clock()
