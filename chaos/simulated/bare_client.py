"""A client that owns one agent as docs/protocol.md describes it, without the code of a host: it
follows `clock`, and its agent stands, as in any run; in realtime it walks.
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

BARE_CLIENT = "bare_client"  # the process
NAMES = {"lockstep": "idler", "realtime": "worker_01"}  # mode -> the agent
SPEEDS = {"lockstep": 0.0, "realtime": 0.5}  # m/s
AGAIN_SECONDS = 0.1  # between two tries to join


class BareClient:
    """The session of the client, in one run."""

    def __init__(self, bus: Bus, mode: str) -> None:
        self._bus = bus
        self._ending = Ending(bus.clock)
        self._name = NAMES[mode]
        self._speed = SPEEDS[mode]
        self._answered = -1  # the last tick
        self._answered_at = 0.0  # s, on the clock of the bus
        self._joins = 0  # how often it must join
        self._has_joined = -1  # the number of its last join

    def run(self) -> NoReturn:
        """Answer each tick until the run is over. Raises HostEnded."""
        for what in ("clock", "lost", "end"):
            self._bus.subscribe(KEYS.of(what))
        self._bus.watch(KEYS.of("physics", RUN))
        self._bus.declare_alive(KEYS.of("alive", self._name, self._bus.id))
        while True:
            self._check_gone()
            if self._has_joined != self._joins:
                self._join()
            elif (item := self._bus.inbox.take(1.0)) is not None:
                self._handle(item)

    def _join(self) -> None:
        number = self._joins
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
            self._has_joined = number
            self._answered = joined.tick - 1

    def _handle(self, item: Item) -> None:
        if isinstance(item, Signal):
            self._leave("asked to stop")
        elif isinstance(item, Alive):
            self._ending.track(item.key, item.up)
            self._joins += item.up
        elif isinstance(item, Sample):
            with suppress(Refused):
                self._hear(KEYS.parts(item.key)[-1], item.payload)
        if (end := self._ending.end) is not None:
            self._leave(end.why)

    def _hear(self, what: str, payload: bytes) -> None:
        if what == "clock" and self._has_joined == self._joins:
            self._answer(read_message(payload, wire.Clock, RUN).tick)
        elif what == "lost":
            self._joins += read_message(payload, wire.Lost, RUN).owner == self._bus.id
        elif what == "end":
            self._ending.hear(read_message(payload, wire.End, RUN))

    def _answer(self, tick: int) -> None:
        """Answer a tick, also one that comes again: its answer may be lost."""
        now = self._bus.clock()
        # A tick that comes again later was sent without its answer: the answer was lost, or
        # changed.
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
        if self._bus.clock() - self._ending.gone_at >= GONE_SECONDS:
            raise HostEnded(1, f"physics is gone; waited for {GONE_SECONDS:g} s")

    def _leave(self, why: str) -> NoReturn:
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
