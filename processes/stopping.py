"""Stop robots of a run that goes on, and let them go on again: what `run.py stop` and `run.py reset` do."""

import time
from pathlib import Path

from orchard.bus import Bus, Final, Replied, client
from orchard.endpoints import BusError
from orchard.identity import Identity
from orchard.keys import Keys
from orchard.messages import pack
from orchard.wire.course import Newcomer, Stop, Stopped
from orchard.wire.vocabulary import read
from processes.running import Going, all_going

LOOK_SECONDS = 5.0  # for how long somebody must listen at the endpoint
ANSWER_SECONDS = 10.0  # and physics answer
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


def switch(going: Going, names: list[str], stop: bool, identity: Identity | None = None) -> Stopped:
    """Stop (or reset) these robots and kinds of a run, or all. Raises BusError where nobody takes it, with the reason."""
    keys = Keys()
    with client(going.endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        run = going.run or read(_answer(bus, keys.of("scenario"), b""), Newcomer).run
        return read(_answer(bus, keys.of("stop"), pack(Stop(run, stop, names))), Stopped)


def _answer(bus: Bus, key: str, payload: bytes) -> bytes:
    """The reply to a get, asked again while nobody is there to answer, but not for long."""
    deadline = time.monotonic() + ANSWER_SECONDS
    while (left := deadline - time.monotonic()) > 0.0:
        bus.ask(key, payload, key, left)
        reply = bus.inbox.take(left)
        if isinstance(reply, Replied):
            if reply.error:
                raise BusError(reply.error)
            return reply.payload
        if isinstance(reply, Final):
            time.sleep(AGAIN_SECONDS)
    raise BusError(f"{bus.endpoint}: physics did not answer within {ANSWER_SECONDS:g} s")
