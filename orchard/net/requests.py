"""Requests to physics: a Zenoh get that is repeated until a valid reply arrives."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from orchard.contract.messages import pack
from orchard.field.problems import printable
from orchard.net.bus import TIMED_OUT, Bus, Final, Item, Replied
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refusals, Refused
from orchard.wire.keys import Keys
from orchard.wire.messages import RefusedThere, RunInfo, read

M = TypeVar("M")

# How long physics may take to reply to a session that joins: it may be compiling.
ANSWER_SECONDS = 120.0
# s after which the question for the run is repeated: it may be lost during a reset.
FETCH_SECONDS = 3.0
# Between two checks whether physics is gone, while nothing arrives.
LOOK_SECONDS = 1.0
# Between two tries, while no reply comes.
AGAIN_SECONDS = 0.1
TRIES = 300  # 30 s in all: physics starts slowly on a busy machine


class ErrorReply(BusError):
    """Raised when the only replies are errors."""


def publish_refusals(bus: Bus, keys: Keys, run: str, refusals: Refusals) -> None:
    """Publish the session's counts of refused messages if they have changed.

    Physics adds them up.
    """
    if refusals.is_news():
        bus.publish(
            keys.of("refused", session=bus.id), pack(RefusedThere(run, dict(refusals.counts)))
        )


def ask(
    bus: Bus,
    key: str,
    payload: bytes,
    understand: Callable[[bytes], M],
    seconds: float = ANSWER_SECONDS,
    handle: Callable[[Item], None] = lambda item: None,
    refusals: Refusals | None = None,
    meanwhile: Callable[[], None] = lambda: None,
    tries: int = TRIES,
) -> M:
    """Return the first valid reply to a get that only physics can answer.

    The get is repeated after `seconds` without a valid reply. Any client may reply, so an error
    counts only if no valid reply comes. Raises ErrorReply for an error, BusError if no reply comes.

    `understand`: payload of a reply -> message; raises Refused or ValueError. `handle`: takes all
    other items that arrive. `refusals`: counts invalid replies. `meanwhile`: called at least once a
    second.
    """
    for _ in range(tries):
        ticket = object()
        bus.ask(key, payload, ticket, seconds)
        errors: list[str] = []
        for reply in _replies_to(bus, ticket, handle, meanwhile):
            if reply.error:
                if reply.error != TIMED_OUT:
                    errors.append(printable(reply.error))
                continue
            try:
                return understand(reply.payload)
            except (Refused, ValueError) as error:
                _note(refusals, key, error)
        if errors:
            raise ErrorReply(f"{key}: {errors[0]}")
        bus.sleep(AGAIN_SECONDS)
    raise BusError(f"{key}: no reply; is the physics process running, with the same prefix?")


def _note(refusals: Refusals | None, key: str, error: Refused | ValueError) -> None:
    """Count a reply that is not valid."""
    if refusals is None:
        return
    refusal = error if isinstance(error, Refused) else Refused("malformed", str(error))
    refusals.note(key, refusal)


def _replies_to(
    bus: Bus, ticket: object, handle: Callable[[Item], None], meanwhile: Callable[[], None]
) -> Iterator[Replied]:
    """Yield the replies to a get until it is final. `ticket`: with which it was asked."""
    while True:
        meanwhile()
        item = bus.inbox.take(LOOK_SECONDS)
        if isinstance(item, Replied) and item.ticket is ticket:
            yield item
        elif isinstance(item, Final) and item.ticket is ticket:
            return
        elif item is not None:
            handle(item)


def fetch_run(
    bus: Bus, keys: Keys, handle: Callable[[Item], None] = lambda item: None, tries: int = TRIES
) -> RunInfo:
    """Return the run that physics simulates at this router. Raises BusError if there is none."""
    return ask(
        bus,
        keys.of("scenario"),
        b"",
        lambda reply: read(reply, RunInfo),
        seconds=FETCH_SECONDS,
        handle=handle,
        tries=tries,
    )
