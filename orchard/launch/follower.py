"""Follows a run in many processes up to its end: shows its figures, and restarts what has died.

Theory of operation. The follower opens a session with physics. It hears its figures, its end, and
the liveliness tokens of physics and the logger. It looks at the processes, too. A process is given
up if it died again and again (`Supervisor`). A signal is Ctrl-C or SIGTERM.

    state    | what happens                                      | next state
    ---------+---------------------------------------------------+------------------------------
    reaching | physics listens                                   | loading
    reaching | a signal                                          | reaching; physics is asked to
             |                                                   | end as soon as it listens
    reaching | a second signal, or physics is given up           | over, without a summary
    loading  | figures have come                                 | running
    loading  | agents are given up                               | over, without a summary
    loading  | a signal                                          | stopping, for LOAD_SECONDS
    running  | a signal                                          | stopping, for STOP_SECONDS
    stopping | a signal; or physics has ended, without an end    | stopping, for STOP_SECONDS
    stopping | the time is over                                  | over, without a summary
    any      | an end, and the token of physics is gone          | over, with the summary
    any      | physics has ended, or died again and again        | over, without a summary

Processes that die are restarted, but not in the state "stopping". The end that counts is in the
file of physics, because any client may send one over the bus: see `LaunchedRun`.
"""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import msgspec

from orchard.launch.hosts import POLL_BUS_SECONDS, STOP_SECONDS
from orchard.launch.supervisor import BAD_ORDER, Supervisor, Watchdog
from orchard.net.bus import Alive, Bus, Inbox, Sample, Signal
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refusals, Refused, read_message, refused_for
from orchard.report.progress import Progress
from orchard.report.summary import Outcome, headline_of
from orchard.terminal.typed import typed
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import RESET, End, Figures

# s that the processes may take to end before the first tick, in place of STOP_SECONDS: physics may
# still load its modules.
LOAD_SECONDS = 20.0
# s that physics may take to listen after its start, on a busy machine.
BEGIN_SECONDS = 60.0
# Exit code of physics -> what has happened, if its last message is not there.
HOW_PHYSICS_ENDED: dict[int | None, str] = {
    BAD_ORDER: "physics could not start; its line above says why",
    0: (
        "the run is over, and its result is lost: physics has ended, "
        "and its last message has not arrived"
    ),
}

# Tries to open a session with physics. Raises BusError if none can be opened for now.
TryToConnect = Callable[[Inbox], AbstractContextManager[Bus]]
Result = tuple[dict[str, Any] | None, str]  # the summary, if any, and why the run ended


class _Following:
    """What is known of a run that is followed."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.ending = Ending(clock)
        self.refusals = Refusals()
        # Whether figures have come: then all agents were there.
        self.has_begun = False
        # s, on the clock: until when the processes may take to end; infinity: they are not asked.
        self.deadline = math.inf

    @property
    def is_stopping(self) -> bool:
        """Whether the processes are asked to end."""
        return self.deadline < math.inf

    @property
    def is_late(self) -> bool:
        """Whether the processes had their time to end."""
        return self._clock() >= self.deadline

    def end_within(self, seconds: float) -> None:
        """Give the processes at most so many seconds from now on to end."""
        self.deadline = min(self.deadline, self._clock() + seconds)


class RunFollower:
    """Follows a run that this program has started."""

    def __init__(
        self,
        *,
        endpoint: str,
        snapshots: Path,
        supervisor: Supervisor,
        watchdog: Watchdog,
        progress: Progress,
        connect: TryToConnect,
    ) -> None:
        """`endpoint`: of the run's router. `snapshots`: the folder from which a run can go on.

        `watchdog`: of the logger.
        """
        self._endpoint = endpoint
        self._snapshots = snapshots
        self._supervisor = supervisor
        self._watchdog = watchdog
        self._progress = progress
        self._connect = connect
        self._run_id = supervisor.run
        self._clock = supervisor.clock

    def follow(self, inbox: Inbox) -> Result:
        """Show the progress until the run is over. Return its summary, if any, and why it ended."""
        keys = Keys()
        try:
            with ExitStack() as stack:
                bus = self._reach(inbox, stack)
                if bus is None:
                    return None, "stopped"
                bus.subscribe(keys.of("figures"))
                bus.subscribe(keys.of("end"))
                bus.watch(keys.of("alive", LOGGER, self._run_id))
                bus.watch(keys.of("physics", self._run_id))
                return self._listen(bus, keys)
        except BusError as error:
            return None, str(error)

    def _reach(self, inbox: Inbox, stack: ExitStack) -> Bus | None:
        """Return a session with physics, once it listens; None if the user does not want it.

        Dead processes are restarted meanwhile. After a first Ctrl-C it goes on for at most
        LOAD_SECONDS: physics is asked to stop as soon as it listens, and gives the summary of a run
        without a tick. A second Ctrl-C ends that. `stack`: closes the session. Raises BusError if
        physics does not listen.
        """
        deadline = self._clock() + BEGIN_SECONDS
        # The first Ctrl-C.
        signal: Signal | None = None
        while True:
            try:
                bus = stack.enter_context(self._connect(inbox))
            except BusError as error:
                self._supervisor.watch()
                if signal is not None and self._clock() >= deadline:
                    return None
                self._check_may_listen(deadline, error)
            else:
                if signal is not None:
                    # `_listen` takes it, and asks physics to stop.
                    inbox.put(signal)
                return bus
            item = inbox.take(0.0)
            if not isinstance(item, Signal):
                continue
            if signal is not None:
                return None
            signal = item
            deadline = min(deadline, self._clock() + LOAD_SECONDS)

    def _check_may_listen(self, deadline: float, error: BusError) -> None:
        """Raise BusError if physics will not listen any more, or does not by a deadline.

        `error`: of the last attempt to connect.
        """
        # Lost agents do not matter here: they are no reason why physics would not listen.
        if self.why_over(has_begun=True):
            raise error
        if self._clock() >= deadline:
            raise BusError(
                f"{self._endpoint}: physics does not listen {BEGIN_SECONDS:g} s after its start; "
                "is the machine too busy?"
            ) from error

    def _listen(self, bus: Bus, keys: Keys) -> Result:
        """Hear the run until it is over. Return its summary, if any, and why it ended.

        After a signal the processes have some seconds to end, and are not restarted.
        """
        state = _Following(self._clock)
        of_logger = keys.of("alive", LOGGER, self._run_id)
        while not state.is_late:
            match bus.inbox.take(POLL_BUS_SECONDS):
                case Signal():
                    self._stop_soon(state)
                case Alive() as token if token.key == of_logger:
                    self._watchdog.hear(token.up)
                case Alive() as token:
                    state.ending.track(token.key, token.up)
                    self._watchdog.hear_of_physics(up=state.ending.gone_at == math.inf)
                case Sample() as sample:
                    self._hear_sample(state, sample)
                case _:
                    why = self.why_over(state.has_begun)
                    if why:
                        return None, why
            end = state.ending.end
            if end is not None and self._may_believe_end():
                return end.summary, end.why
            self._watchdog.look()
            self._look_after_processes(state)
        return None, "stopped"

    def _stop_soon(self, state: _Following) -> None:
        """Ask physics to end the run. It has longer while it may still load its modules."""
        self._supervisor.terminate(PHYSICS)
        is_loading = not state.has_begun and not state.is_stopping
        if is_loading:
            state.end_within(LOAD_SECONDS)
        else:
            state.end_within(STOP_SECONDS)

    def _hear_sample(self, state: _Following, sample: Sample) -> None:
        """Take figures or an end from the bus. What cannot be read is refused, and noted."""
        try:
            end = _hear(sample, self._run_id, self._progress)
        except Refused as refusal:
            state.refusals.note(sample.key, refusal)
            return
        if end is None:
            state.has_begun = True
        elif end.why != RESET:
            state.ending.hear(end)

    def _may_believe_end(self) -> bool:
        """Whether an end that the bus told can be that of physics, which may have died since."""
        return self._supervisor.exit_code(PHYSICS) is None or self._supervisor.is_over(PHYSICS)

    def _look_after_processes(self, state: _Following) -> None:
        """Restart what has died. What ends after a request to stop is not restarted."""
        if not state.is_stopping:
            self._supervisor.watch()
        elif self._supervisor.exit_code(PHYSICS) is not None:
            state.end_within(STOP_SECONDS)

    def why_over(self, has_begun: bool) -> str:
        """Return why the run cannot go on; "" if it can.

        `has_begun`: whether all agents were there once. After that a run goes on without some.
        """
        if self._supervisor.is_over(PHYSICS):
            code = self._supervisor.exit_code(PHYSICS)
            return HOW_PHYSICS_ENDED.get(code, f"physics ended with code {code}")
        if PHYSICS in self._supervisor.given_up:
            return f"physics died repeatedly; to go on: {typed('--resume', self._snapshots)}"
        if has_begun:
            return ""
        lost = self._supervisor.lost_agents
        if lost:
            return (
                f"the run cannot begin without {', '.join(lost)}: "
                "the processes that hosted them died repeatedly"
            )
        return ""


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
    """Return the end of a run, if the sample is one. Else it has figures: show them, return None.

    Raises Refused for what cannot be read.
    """
    with refused_for("malformed"):
        if sample.key.endswith("/end"):
            end = read_message(sample.payload, End, run_id)
            msgspec.convert(end.summary, Outcome)
            return end
        message = read_message(sample.payload, Figures, run_id)
        headline_of(message.figures)
    progress.show(message.figures, message.doing, message.waits_for)
    return None
