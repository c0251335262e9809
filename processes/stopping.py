"""Stop robots of a run that goes on, and let them go on again: what `run.py stop` and `run.py reset` do."""

import math
import time
from collections.abc import Callable
from pathlib import Path

from orchard.bus import TIMED_OUT, Bus, Final, Replied, client
from orchard.endpoints import BusError
from orchard.identity import Identity
from orchard.keys import Keys
from orchard.messages import pack
from orchard.wire.course import Newcomer, Stop, Stopped
from orchard.wire.vocabulary import read
from processes.running import Going, all_going

LOOK_SECONDS = 5.0  # for how long somebody must listen at the endpoint
ANSWER_SECONDS = 20.0  # and physics answer: one that died is started again
QUIET_SECONDS = 3.0  # after which a person is told that it has not yet; more than it waits for a slow disk
AGAIN_SECONDS = 0.1  # between two tries, while it does not


def the_run(folder: Path, connect: str | None) -> Going:
    """The run that is meant: the one at an endpoint, or the only one that goes on here. Raises BusError where there is none, or several."""
    if connect is not None:
        return Going("", connect)
    runs = all_going(folder)
    if not runs:
        raise BusError(
            "no run goes on here that run.py started; for one elsewhere: --connect ENDPOINT "
            "(one in local mode has no network, and cannot be reached: Ctrl-C ends it)"
        )
    if len(runs) > 1:
        which = "\n".join(f"  --connect {going.endpoint}  (run {going.run})" for going in runs)
        raise BusError(f"{len(runs)} runs go on here; which one is meant?\n{which}")
    return runs[0]


def switch(going: Going, names: list[str], stop: bool, identity: Identity | None, say: Callable[[str], None]) -> Stopped:
    """Stop (or reset) these robots and kinds of a run, or all; `say` tells of a long wait.

    Raises BusError where nobody takes it, with the reason.
    """
    keys = Keys()
    with client(going.endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        run = going.run or read(_answer(bus, keys.of("scenario"), b"", say), Newcomer).run
        return read(_answer(bus, keys.of("stop"), pack(Stop(run, stop, names)), say), Stopped)


def _answer(bus: Bus, key: str, payload: bytes, say: Callable[[str], None]) -> bytes:
    """The reply to a get, asked again while nobody is there to answer, but not for long."""
    now = time.monotonic()
    quiet, deadline = now + QUIET_SECONDS, now + ANSWER_SECONDS
    ticket = object()  # what belongs to an earlier question is still on its way
    bus.ask(key, payload, ticket, ANSWER_SECONDS)
    while (now := time.monotonic()) < deadline:
        item = bus.inbox.take(min(quiet, deadline) - now)
        if isinstance(item, Replied) and item.ticket is ticket and item.error != TIMED_OUT:
            if item.error:
                raise BusError(item.error)
            return item.payload
        if isinstance(item, Final) and item.ticket is ticket:
            time.sleep(AGAIN_SECONDS)
            bus.ask(key, payload, ticket, ANSWER_SECONDS)
        if time.monotonic() >= quiet:
            say(f"{bus.endpoint}: physics does not answer yet; it has {ANSWER_SECONDS:g} s")
            quiet = math.inf
    raise BusError(f"{bus.endpoint}: physics did not answer within {ANSWER_SECONDS:g} s; it may have heard of this, or not: ask again")
