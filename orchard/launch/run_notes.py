"""The notes of the runs on this machine, by which commands such as `orchard stop` find them.

A note is a file. The `orchard` that wrote it holds a lock on it until it ends, so a note without a
lock is stale: its `orchard` is gone. The processes of that run end by themselves within seconds,
because nothing holds the other end of their lines (orchard/net/lifeline.py). A process that does
not, such as a frozen one, is ended by force.
"""

import fcntl
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

import msgspec

from orchard.folders import regular
from orchard.launch.request import RunRequest
from orchard.net.endpoints import BusError
from orchard.net.lifeline import ALONE_SECONDS, STARTED_BY
from orchard.terminal.signals import CTRL_C
from orchard.terminal.typed import typed

LONGEST = 10_000  # characters of a note


class RunNote(msgspec.Struct):
    """An active run on this machine."""

    # Its id.
    run: str
    # The endpoint of its router.
    endpoint: str
    # Its scenario and the time of its start, for people.
    title: str = ""


@contextmanager
def noted(folder: Path, note: RunNote) -> Iterator[None]:
    """Keep a note in this context, by which others find the run.

    Raises OSError if it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{note.run}.going"
    beside = path.with_suffix(".new")
    with beside.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.write(msgspec.json.encode(note).decode())
        file.flush()
        # It gets its name now, so that no process sees it before it is locked and complete.
        os.replace(beside, path)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


@contextmanager
def announced(
    request: RunRequest, run: str, endpoint: str, say: Callable[[str], None]
) -> Iterator[None]:
    """In this context `orchard stop` finds the run.

    `say` gets the command that stops the run. If no note can be written, the command has the
    endpoint.
    """
    scenario = request.scenario
    title = (
        f"{scenario.rows} rows, {scenario.pickers} pickers, seed {scenario.seed}, "
        f"since {datetime.now():%H:%M:%S}"
    )
    command: list[object] = ["stop"]
    if request.options.secure is not None:
        command += ["--secure", request.options.secure]
    with ExitStack() as stack:
        try:
            if request.notes is not None:
                stack.enter_context(noted(request.notes, RunNote(run, endpoint, title)))
        except OSError as error:
            say(f"{request.notes}: no note of this run can be written there: {error.strerror}")
            command += ["--connect", endpoint]
        if request.options.progress == "text":
            say(f"{CTRL_C}; emergency stop of the robots: {typed(*command)}")
        yield


def running_here(folder: Path, gone: list[Path] | None = None) -> list[RunNote]:
    """Return the active runs, sorted by id.

    The paths of stale notes are added to `gone`. A file that holds no note, or that of another run
    than its name says, is passed over.
    """
    notes = []
    for path in sorted(folder.glob("*.going")):
        # It may have gone meanwhile, or be no note.
        with suppress(OSError, ValueError), regular(path).open() as file:
            note = msgspec.json.decode(file.read(LONGEST), type=RunNote)
            if note.run != path.stem:
                continue
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                # The run holds the lock.
                notes.append(note)
            else:
                if gone is not None:
                    gone.append(path)
    return notes


def find_runs(folder: Path, connect: str | None) -> list[RunNote]:
    """Return the run at `connect`, or all active runs here. Raises BusError if there is none."""
    runs = running_here(folder) if connect is None else [RunNote("", connect)]
    if not runs:
        raise BusError(
            "no run is active here; for a run elsewhere: --connect ENDPOINT "
            "(a run in local mode has no network, and cannot be reached: Ctrl-C ends it)"
        )
    return runs


def find_run(folder: Path, connect: str | None) -> list[RunNote]:
    """Return the run at `connect`, or the only active run here, in a list.

    Raises BusError if there is none, or if there are several.
    """
    runs = find_runs(folder, connect)
    if len(runs) > 1:
        choices = "\n".join(f"  --connect {note.endpoint}  ({note.title})" for note in runs)
        raise BusError(f"{len(runs)} runs are active here; choose one:\n{choices}")
    return runs


POLL_SECONDS = 0.1  # between two looks whether a process has ended


def end_orphaned_processes(folder: Path, say: Callable[[str], None]) -> bool:
    """End the processes of runs in this folder whose `orchard` is gone, and remove their notes.

    Return whether there were such processes.
    """
    gone: list[Path] = []
    running_here(folder, gone)
    had_processes = False
    for note in gone:
        if _end(note.stem, say):
            had_processes = True
    for note in gone:
        note.unlink(missing_ok=True)
    return had_processes


def _end(run: str, say: Callable[[str], None]) -> bool:
    """End the processes of a run. Return whether there were any."""
    pids = processes_of(run)
    if not pids:
        return False
    say(f"run {run}: its `orchard` is gone; ending the {len(pids)} processes that it has left")
    for pid in _await_ends(run, ALONE_SECONDS):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    # Their ports and locks are free only when they have ended.
    _await_ends(run, ALONE_SECONDS)
    return True


def _await_ends(run: str, seconds: float) -> list[int]:
    """Wait until the processes of a run have ended. Return the ids of those that have not."""
    deadline = time.monotonic() + seconds
    pids = processes_of(run)
    while pids and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS)
        pids = processes_of(run)
    return pids


def processes_of(run: str) -> list[int]:
    """Return the ids of the processes that were started for a run.

    They have its id in their environment (`lifeline.environment`), which only Linux shows.
    """
    pids = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        # The process may have ended just now, or be another user's.
        with suppress(OSError):
            if _names_run(path.read_bytes(), run):
                pids.append(int(path.parent.name))
    return pids


def _names_run(environment: bytes, run: str) -> bool:
    """Whether an environment, as Linux shows it, is that of a process of a run.

    One of its variables is "ORCHARD_STARTED_BY=PID RUN".
    """
    begin = f"{STARTED_BY}=".encode()
    end = f" {run}".encode()
    for variable in environment.split(b"\0"):
        if variable.startswith(begin) and variable.endswith(end):
            return True
    return False
