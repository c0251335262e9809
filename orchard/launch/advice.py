"""What a run says at its start: how a user ends it and stops its robots, and how other machines join it."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime

from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.run_notes import RunNote, noted
from orchard.launch.terminal import CTRL_C, typed
from orchard.net.endpoints import from_elsewhere, is_public


@contextmanager
def announced(request: RunRequest, run: str, endpoint: str, say: Callable[[str], None]) -> Iterator[None]:
    """In this context `run.py stop` finds the run. A line says how to stop it; if its note cannot be written, with the endpoint."""
    words = [] if request.options.secure is None else ["--secure", request.options.secure]
    with ExitStack() as stack:
        try:
            if request.notes is not None:
                stack.enter_context(noted(request.notes, RunNote(run, endpoint, f"{request.title}, since {datetime.now():%H:%M:%S}")))
        except OSError as error:
            say(f"{request.notes}: no note of this run can be written there: {error.strerror}")
            words += ["--connect", endpoint]
        if request.options.progress == "text":
            say(f"{CTRL_C}; emergency stop of the robots: {typed('stop', *words)}")
        yield


def how_to_join(options: HarvestOptions, endpoint: str) -> str:
    """Return the command for the agents that a run leaves to other processes, or its address for other machines; '' if it needs neither."""
    there = from_elsewhere(endpoint)
    if options.without:
        only = [word for left in options.without for word in ("--only", left)]
        role = ["--secure", "DIR/ROLE"] if options.secure else []
        return f"{', '.join(options.without)}: left to other processes: {typed('--connect', there, *role, *only)}"
    return f"Other machines reach this run at {there}" if is_public(endpoint) else ""
