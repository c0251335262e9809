"""Requests to physics: one Zenoh get, repeated until a reply counts."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from orchard.contract.messages import pack
from orchard.net.bus import TIMED_OUT, Bus, Final, Item, Replied
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refusals, Refused, printable
from orchard.wire.keys import Keys
from orchard.wire.messages import RefusedThere, RunInfo
from orchard.wire.types import RunMessage, read

M = TypeVar("M", bound=RunMessage)

ANSWER_SECONDS = 120.0  # for how long physics may take to answer a newcomer: it may be compiling
LOOK_SECONDS = 1.0  # between two looks whether physics is gone, while nothing arrives
AGAIN_SECONDS = 0.1  # between two tries, while nobody is there to answer
TRIES = 300  # half a minute: physics starts slowly on a busy machine


def publish_refusals(bus: Bus, keys: Keys, run: str, refusals: Refusals) -> None:
    """Physics counts what all refuse."""
    if refusals.is_news():
        bus.publish(keys.of("refused", session=bus.id), pack(RefusedThere(run, dict(refusals.counts))))


def _go_on() -> None:
    """What is done while nobody answers, where there is nothing to do."""


@dataclass(frozen=True)
class PhysicsRequest(Generic[M]):
    """A get to which physics has the one reply that counts."""

    key: str
    payload: bytes
    understand: Callable[[bytes], M]  # raises Refused
    seconds: float = ANSWER_SECONDS  # after which it is asked again


def ask(
    bus: Bus, asking: PhysicsRequest[M], handle: Callable[[Item], None], refusals: Refusals, meanwhile: Callable[[], None] = _go_on
) -> M:
    """The first reply that makes sense; asked again while there is none, with something done meanwhile. Whatever else arrives is handled.

    Anybody may reply, so that an error counts only if nothing better comes: then it is raised, as BusError.
    """
    for _ in range(TRIES):
        ticket = object()
        bus.ask(asking.key, asking.payload, ticket, asking.seconds)
        errors: list[str] = []
        for reply in _replies_to(bus, ticket, handle, meanwhile):
            try:
                if not reply.error:
                    return asking.understand(reply.payload)
                if reply.error != TIMED_OUT:
                    errors.append(printable(reply.error))
            except Refused as refusal:
                refusals.note(asking.key, refusal)
        if errors:
            raise BusError(f"{asking.key}: {errors[0]}")
        time.sleep(AGAIN_SECONDS)
    raise BusError(f"{asking.key}: nobody answers; is the physics process running, with the same prefix?")


def _replies_to(bus: Bus, ticket: object, handle: Callable[[Item], None], meanwhile: Callable[[], None]) -> Iterator[Replied]:
    """One after the other, until no more will come."""
    while True:
        meanwhile()
        item = bus.inbox.take(LOOK_SECONDS)
        if isinstance(item, Replied) and item.ticket is ticket:
            yield item
        elif isinstance(item, Final) and item.ticket is ticket:
            return
        elif item is not None:
            handle(item)


def _ignore(item: Item) -> None:
    """What arrives before one knows the run is of no use."""


def fetch_run(bus: Bus, keys: Keys, handle: Callable[[Item], None] = _ignore) -> RunInfo:
    """What physics tells one who comes to the run. Raises BusError where nobody does."""
    return ask(bus, PhysicsRequest(keys.of("scenario"), b"", _newcomer_of), handle, Refusals())


def _newcomer_of(payload: bytes) -> RunInfo:
    try:
        return read(payload, RunInfo)
    except ValueError as error:
        raise Refused("malformed", str(error)) from error
