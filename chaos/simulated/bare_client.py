"""A client that owns one agent as docs/protocol.md describes it, without the code of a host.

It answers each tick that comes on the key `clock`. In lockstep its agent is one that always stands,
so the hash is that of a run without this client; in realtime it is a worker that walks.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import NoReturn

from chaos.simulated.clients import KEYS, RUN
from orchard.contract.messages import pack
from orchard.net.bus import Alive, Bus, Inbox, Item, Sample, Signal
from orchard.net.ending import Ending
from orchard.net.host import ANSWER_AGAIN_SECONDS, GONE_SECONDS, HostEnded
from orchard.net.refusals import Refused, read_message
from orchard.net.requests import ANSWER_SECONDS, ErrorReply, ask, fetch_run
from orchard.wire import messages as wire

# The name of its process.
BARE_CLIENT = "bare_client"
# Mode -> the agent that it owns, and its speed, m/s.
NAMES = {"lockstep": "idler", "realtime": "worker_01"}
SPEEDS = {"lockstep": 0.0, "realtime": 0.5}
# s between two tries to join.
AGAIN_SECONDS = 0.1


class BareClient:
    """The session of the client, in one run."""

    def __init__(self, bus: Bus, mode: str) -> None:
        self._bus = bus
        self._ending = Ending(bus.clock)
        self._name = NAMES[mode]
        self._speed = SPEEDS[mode]
        # The last tick that it has answered; -1: none.
        self._answered = -1
        # s, on the clock of the bus: when it has answered that.
        self._answered_at = 0.0
        # A number that grows whenever it must join anew, and its value at the last join that
        # physics has accepted. They differ while it has to join.
        self._wanted_join = 0
        self._accepted_join = -1

    def run(self) -> NoReturn:
        """Answer each tick until the run is over. Raises HostEnded."""
        for what in ("clock", "lost", "end"):
            self._bus.subscribe(KEYS.of(what))
        self._bus.watch(KEYS.of("physics", RUN))
        self._bus.declare_alive(KEYS.of("alive", self._name, self._bus.id))
        while True:
            self._check_gone()
            if self._accepted_join != self._wanted_join:
                self._join()
                continue
            item = self._bus.inbox.take(1.0)
            if item is not None:
                self._handle(item)

    def _join(self) -> None:
        """Ask physics for the agent, once."""
        number = self._wanted_join
        request = pack(wire.Join(RUN, self._bus.id, [self._name]))
        key = KEYS.of("join", session=self._bus.id)
        try:
            joined = ask(
                self._bus,
                key,
                request,
                lambda reply: read_message(reply, wire.Joined, RUN),
                seconds=ANSWER_SECONDS,
                handle=self._handle,
                meanwhile=self._check_gone,
            )
        except ErrorReply:
            # The request may have changed on its way.
            self._bus.sleep(AGAIN_SECONDS)
            return
        if joined.refused:
            self._bus.sleep(AGAIN_SECONDS)
        else:
            # It may have to join again already: physics may have gone meanwhile.
            self._accepted_join = number
            self._answered = joined.tick - 1

    def _handle(self, item: Item) -> None:
        """Take what arrives. Raises HostEnded at the end of the run."""
        if isinstance(item, Signal):
            self._leave("asked to stop")
        elif isinstance(item, Alive):
            self._ending.track(item.key, item.up)
            if item.up:
                # Physics has come, or come back.
                self._wanted_join += 1
        elif isinstance(item, Sample):
            with suppress(Refused):
                self._hear(KEYS.parts(item.key)[-1], item.payload)
        end = self._ending.end
        if end is not None:
            self._leave(end.why)

    def _hear(self, what: str, payload: bytes) -> None:
        """Take a message. `what`: the kind of its key. Raises Refused."""
        if what == "clock" and self._accepted_join == self._wanted_join:
            self._answer(read_message(payload, wire.Clock, RUN).tick)
        elif what == "lost":
            if read_message(payload, wire.Lost, RUN).owner == self._bus.id:
                self._wanted_join += 1
        elif what == "end":
            self._ending.hear(read_message(payload, wire.End, RUN))

    def _answer(self, tick: int) -> None:
        """Answer a tick, also one that comes again: its answer may be lost."""
        now = self._bus.clock()
        # Physics has sent the tick again so late because it has no answer: the answer was lost, or
        # has changed on its way.
        is_again = tick == self._answered and now >= self._answered_at + ANSWER_AGAIN_SECONDS
        # A tick that changed on its way may be far ahead: the true one comes after it.
        if tick != self._answered or is_again:
            self._answered = tick
            self._answered_at = now
            velocity = wire.Velocity(
                RUN, tick, wire.Linear(self._speed), wire.Angular(0.0), self._bus.id
            )
            self._bus.publish(KEYS.of("velocity", self._name), pack(velocity))

    def _check_gone(self) -> None:
        """Raise HostEnded if physics has been gone for too long."""
        if self._bus.clock() - self._ending.gone_at >= GONE_SECONDS:
            raise HostEnded(1, f"physics is gone; waited for {GONE_SECONDS:g} s")

    def _leave(self, why: str) -> NoReturn:
        """Tell physics that this session leaves. Raises HostEnded."""
        self._bus.publish(KEYS.of("left", session=self._bus.id), pack(wire.Departure(RUN)))
        raise HostEnded(0, why)


def own_agent(inbox: Inbox, opened: Callable[[], AbstractContextManager[Bus]]) -> NoReturn:
    """Own the agent until the run is over, again after each reset. Raises HostEnded."""
    while True:
        try:
            with opened() as bus:
                BareClient(bus, fetch_run(bus, KEYS).mode).run()
        except HostEnded as end:
            if str(end) != wire.RESET:
                raise
        inbox.forget()
