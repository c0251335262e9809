"""`run.py stop` and `run.py reset`: find the run on this machine, and stop or reset its robots.

Each run leaves a note of its endpoint in runs/ while it goes on. The process that wrote a note holds a lock on it. The lock ends with
the process, so a note without a lock is stale.
"""

import fcntl
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

import msgspec

from orchard.contract.messages import pack
from orchard.net.bus import TIMED_OUT, Bus, Final, Replied, client
from orchard.net.endpoints import BusError
from orchard.security.identity import Identity
from orchard.wire.keys import Keys
from orchard.wire.messages import RunInfo, Stop, Stopped
from orchard.wire.types import read


class RunNote(msgspec.Struct):
    """A run that goes on here."""

    run: str  # its id
    endpoint: str


@contextmanager
def noted(folder: Path, going: RunNote) -> Iterator[None]:
    """Within this, others on this machine can find the run. Raises OSError where no note can be written."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{going.run}.going"
    beside = path.with_suffix(".new")
    with beside.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.write(msgspec.json.encode(going).decode())
        file.flush()
        os.replace(beside, path)  # nobody sees it before it is locked and whole
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def running_here(folder: Path) -> list[RunNote]:
    """The runs that go on, by id; stale notes are removed."""
    return [going for path in sorted(folder.glob("*.going")) if (going := _read(path)) is not None]


def _read(path: Path) -> RunNote | None:
    """None where the note is stale, gone, or no note."""
    with suppress(OSError, msgspec.DecodeError), path.open() as file:
        if _is_locked(file):
            return msgspec.json.decode(file.read(), type=RunNote)
        path.unlink(missing_ok=True)
    return None


def _is_locked(file: TextIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


# -- the stop itself

LOOK_SECONDS = 5.0  # for how long somebody must listen at the endpoint
ANSWER_SECONDS = 20.0  # and physics answer: one that died is started again
QUIET_SECONDS = 3.0  # after which a person is told that it has not yet; more than it waits for a slow disk
AGAIN_SECONDS = 0.1  # between two tries, while it does not


def find_run(folder: Path, connect: str | None) -> RunNote:
    """The run that is meant: the one at an endpoint, or the only one that goes on here. Raises BusError where there is none, or several."""
    if connect is not None:
        return RunNote("", connect)
    runs = running_here(folder)
    if not runs:
        raise BusError(
            "no run goes on here that run.py started; for one elsewhere: --connect ENDPOINT "
            "(one in local mode has no network, and cannot be reached: Ctrl-C ends it)"
        )
    if len(runs) > 1:
        which = "\n".join(f"  --connect {going.endpoint}  (run {going.run})" for going in runs)
        raise BusError(f"{len(runs)} runs go on here; which one is meant?\n{which}")
    return runs[0]


def switch(going: RunNote, names: list[str], stop: bool, identity: Identity | None, say: Callable[[str], None]) -> Stopped:
    """Stop (or reset) these robots and kinds of a run, or all; `say` tells of a long wait.

    Raises BusError where nobody takes it, with the reason.
    """
    keys = Keys()
    with client(going.endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        run = going.run or read(_answer(bus, keys.of("scenario"), b"", say), RunInfo).run
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
