"""Ends what is left of runs after their run.py was killed.

Their processes end by themselves within seconds, because nothing holds their lines. What does not, as a frozen process, is ended by force.
"""

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from orchard.launch.run_notes import running_here
from orchard.net.lifeline import ALONE_SECONDS, STARTED_BY

POLL_SECONDS = 0.1  # between two looks whether a process has ended


def end_left_over(folder: Path, say: Callable[[str], None]) -> bool:
    """End the processes of all runs in this folder without a run.py, and remove their notes. Return whether there was any process."""
    gone: list[Path] = []
    running_here(folder, gone)
    found = [_end(note.stem, say) for note in gone]
    for note in gone:
        note.unlink(missing_ok=True)
    return any(found)


def _end(run: str, say: Callable[[str], None]) -> bool:
    """End the processes of a run. Return whether there was any."""
    if not (left := processes_of(run)):
        return False
    say(f"run {run}: its `orchard` is gone; ending the {len(left)} processes that it has left")
    deadline = time.monotonic() + ALONE_SECONDS
    while (left := processes_of(run)) and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS)
    for pid in left:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    while processes_of(run) and time.monotonic() < deadline + ALONE_SECONDS:  # their ports and locks are free only then
        time.sleep(POLL_SECONDS)
    return True


def processes_of(run: str) -> list[int]:
    """Return the ids of the processes that run.py has started for a run. Only Linux tells their environments: elsewhere there is none."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):  # it has just ended, or is another user's
            variables = path.read_bytes().split(b"\0")
            if any(variable.startswith(f"{STARTED_BY}=".encode()) and variable.endswith(f" {run}".encode()) for variable in variables):
                found.append(int(path.parent.name))
    return found
