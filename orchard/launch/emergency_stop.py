"""The emergency stop: find the runs on this machine, and stop or reset the robots of each; other queries to a run go the same way.

Each run keeps a note of its endpoint in runs/ while it is active. The process that wrote a note holds a lock on it. The lock ends with
the process, so a note without a lock is stale (`left_over.py`).
"""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import msgspec

from orchard.contract.messages import pack
from orchard.net.bus import Bus
from orchard.net.endpoints import BusError
from orchard.net.requests import PhysicsRequest, ask
from orchard.net.zenoh_bus import client
from orchard.security.identity import Identity
from orchard.wire.keys import Keys
from orchard.wire.messages import RunInfo, Stop, Stopped
from orchard.wire.types import RunMessage, read


class RunNote(msgspec.Struct):
    """An active run on this machine."""

    run: str  # its id
    endpoint: str
    title: str = ""  # its scenario and the time of its start, for people


@contextmanager
def noted(folder: Path, note: RunNote) -> Iterator[None]:
    """Keep a note in this context, with which other processes on this machine find the run. Raises OSError if it cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{note.run}.going"
    beside = path.with_suffix(".new")
    with beside.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.write(msgspec.json.encode(note).decode())
        file.flush()
        os.replace(beside, path)  # no process sees it before it is locked and complete
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def running_here(folder: Path, gone: list[Path] | None = None) -> list[RunNote]:
    """Return the active runs, sorted by id. Stale notes, of which the run.py is gone, are appended to `gone`."""
    notes = []
    for path in sorted(folder.glob("*.going")):
        with suppress(OSError, msgspec.DecodeError), path.open() as file:  # gone meanwhile, or malformed
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                if gone is not None:
                    gone.append(path)
            except BlockingIOError:  # the run holds the lock
                notes.append(msgspec.json.decode(file.read(), type=RunNote))
    return notes


# -- the request to physics

M = TypeVar("M")
LOOK_SECONDS = 5.0  # in which a router must answer at the endpoint
ANSWER_SECONDS = 20.0  # in which physics must answer; if it has died, run.py starts it again
QUIET_SECONDS = 3.0  # without an answer, after which the user gets a line; more than snapshots.KEPT_SECONDS


def find_runs(folder: Path, connect: str | None) -> list[RunNote]:
    """Return the run at `connect`, or all active runs on this machine. Raises BusError if there is none."""
    runs = running_here(folder) if connect is None else [RunNote("", connect)]
    if not runs:
        raise BusError(
            "no run is active here; for a run elsewhere: --connect ENDPOINT "
            "(a run in local mode has no network, and cannot be reached: Ctrl-C ends it)"
        )
    return runs


def find_run(folder: Path, connect: str | None) -> RunNote:
    """Return the run at `connect`, or the only active run on this machine. Raises BusError if there is none, or several."""
    run, *others = find_runs(folder, connect)
    if others:
        which = "\n".join(f"  --connect {note.endpoint}  ({note.title})" for note in (run, *others))
        raise BusError(f"{len(others) + 1} runs are active here; choose one:\n{which}")
    return run


def switch(note: RunNote, names: list[str], stop: bool, identity: Identity | None, say: Callable[[str], None]) -> Stopped:
    """Stop or reset robots of a run. Return the reply of physics.

    `names`: names or kinds; empty for all robots. `stop`: False resets them. `say`: prints a line if physics does not answer soon.
    Raises BusError, with the reason, if physics does not answer or refuses.
    """
    return control(note, "stop", lambda run: Stop(run, stop, names), Stopped, identity, say)


def control(
    note: RunNote,
    what: str,
    message: Callable[[str], RunMessage],
    reply: type[M],
    identity: Identity | None,
    say: Callable[[str], None],
    seconds: float | None = None,
) -> M:
    """Send a query to physics of a run, and return the reply. `what`: a key in `wire.keys.TABLE`; `message`: made of the run's id.

    Raises BusError if physics does not answer within `seconds`, ANSWER_SECONDS unless given, or refuses.
    """
    keys = Keys()
    if note.run and not note.endpoint.startswith("tls/"):  # a run found here that is open: a role is needed for the others only
        identity = None
    with client(note.endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        run = note.run or _ask(bus, keys.of("scenario"), b"", RunInfo, say, ANSWER_SECONDS).run
        return _ask(bus, keys.of(what), pack(message(run)), reply, say, seconds or ANSWER_SECONDS)


def _ask(bus: Bus, key: str, payload: bytes, type_: type[M], say: Callable[[str], None], seconds: float) -> M:
    """The reply of physics. Raises BusError after `seconds` without one."""
    begun, said = time.monotonic(), False

    def check_time() -> None:
        nonlocal said
        waited = time.monotonic() - begun
        if waited >= seconds:
            raise BusError(f"{bus.endpoint}: physics did not answer within {seconds:g} s; the command may have arrived: try again")
        if waited >= QUIET_SECONDS and not said:
            said = True
            say(f"{bus.endpoint}: physics does not answer yet; waiting for up to {seconds:g} s")

    return ask(bus, PhysicsRequest(key, payload, lambda reply: read(reply, type_), seconds), meanwhile=check_time)
