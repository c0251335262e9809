"""Requests of a session to physics: a Zenoh get that is repeated until a valid reply arrives."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from orchard.contract.messages import pack
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import check
from orchard.net.bus import TIMED_OUT, Bus, Final, Item, Replied
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refusals, Refused
from orchard.wire.keys import Keys
from orchard.wire.messages import RefusedThere, RunInfo, read

M = TypeVar("M")

# s that physics may take to reply to a session that joins: it may be compiling.
ANSWER_SECONDS = 120.0
# s after which the question for the run is repeated: it may be lost during a reset.
FETCH_SECONDS = 3.0
# s between two checks whether physics is gone, while nothing arrives.
LOOK_SECONDS = 1.0
# s between two tries, while no reply comes.
AGAIN_SECONDS = 0.1
# So 30 s in all: physics starts slowly on a busy machine.
TRIES = 300
# Tries of a question to which the only replies are errors, or an answer that cannot be used. Bytes
# of the question or the answer may have changed on their way. The question for the run is asked
# again after errors as long as after silence: see `_ask_for_run`.
REFUSED_TRIES = 5


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
    *,
    seconds: float = ANSWER_SECONDS,
    handle: Callable[[Item], None] = lambda item: None,
    refusals: Refusals | None = None,
    meanwhile: Callable[[], None] = lambda: None,
    tries: int = TRIES,
) -> M:
    """Return the first valid reply to a get that only physics can answer.

    The get is repeated after `seconds` without a valid reply. Any client may reply, so an error
    counts only if no valid reply comes. Raises ErrorReply for an error, BusError if no reply comes.

    `understand`: payload of a reply -> message. It raises Refused or ValueError for an invalid
    reply; if it raises ScenarioError, that counts as an error reply, and is raised in place of
    ErrorReply. `handle`: takes all other items that arrive. `refusals`: counts invalid replies.
    `meanwhile`: called at least once a second.
    """
    for _ in range(tries):
        ticket = object()
        bus.ask(key, payload, ticket, seconds)
        first_error: ErrorReply | ScenarioError | None = None
        for reply in _replies_to(bus, ticket, handle, meanwhile):
            if reply.error == TIMED_OUT:
                continue
            try:
                return _understood(reply, key, understand)
            except (ErrorReply, ScenarioError) as error:
                first_error = first_error or error
            except (Refused, ValueError) as error:
                _note(refusals, key, error)
        if first_error is not None:
            raise first_error
        bus.sleep(AGAIN_SECONDS)
    raise BusError(f"{key}: no reply; is the physics process running, with the same prefix?")


def _understood(reply: Replied, key: str, understand: Callable[[bytes], M]) -> M:
    """Return the message of a reply. Raises ErrorReply for an error, and what `understand` does."""
    if reply.error:
        raise ErrorReply(f"{key}: {printable(reply.error)}")
    return understand(reply.payload)


def _note(refusals: Refusals | None, key: str, error: Refused | ValueError) -> None:
    """Count a reply that is not valid."""
    if refusals is None:
        return
    if isinstance(error, Refused):
        refusal = error
    else:
        refusal = Refused("malformed", str(error))
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
    return _ask_for_run(bus, keys, lambda reply: read(reply, RunInfo), handle, tries)


def fetch_layout(
    bus: Bus, keys: Keys, handle: Callable[[Item], None] = lambda item: None, tries: int = TRIES
) -> tuple[RunInfo, Layout]:
    """Return the run that physics simulates at this router, and the layout of its scenario.

    Raises BusError if there is no run, ScenarioError if its scenario is not valid.
    """
    return _ask_for_run(bus, keys, _with_layout, handle, tries)


def _ask_for_run(
    bus: Bus,
    keys: Keys,
    understand: Callable[[bytes], M],
    handle: Callable[[Item], None],
    tries: int,
) -> M:
    """Return what physics replies to the question for its run.

    Physics refuses no client its run. So an error reply is from another client, and no reason to
    give up: it is asked again, up to `tries` times. Bytes of a scenario that is not valid may have
    changed on their way: it is asked for REFUSED_TRIES times.
    """
    key = keys.of("scenario")
    error_replies = 0
    invalid = 0
    while True:
        try:
            return ask(
                bus,
                key,
                b"",
                understand,
                seconds=FETCH_SECONDS,
                handle=handle,
                tries=tries,
            )
        except ErrorReply:
            error_replies += 1
            if error_replies >= tries:
                raise
        except ScenarioError:
            invalid += 1
            if invalid >= REFUSED_TRIES:
                raise
        bus.sleep(AGAIN_SECONDS)


def _with_layout(reply: bytes) -> tuple[RunInfo, Layout]:
    """Return the run in a reply, and its layout. Raises ValueError or ScenarioError."""
    run = read(reply, RunInfo)
    layout = lay_out(check(run.scenario, "the scenario that physics sent"))
    unknown = sorted(set(run.agents).difference(layout.agents))
    if unknown:
        raise ValueError(f"the scenario has no agent {', '.join(unknown)}")
    return run, layout
