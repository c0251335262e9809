"""What all processes of a run share: start and end, and a report of an agent that is too slow."""

import gc
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence

from orchard.contract.guard import place_in_agent
from orchard.net import lifeline
from orchard.net.bus import Inbox, Signal
from orchard.net.host import Host, HostEnded
from orchard.net.options import Options, read_options

log = logging.getLogger("orchard")

LONG_SECONDS = 3.0  # after which an agent is too slow


def run_process(
    name: str, kind: type[Options], argv: Sequence[str] | None, body: Callable[[Inbox, Options], int], *mistakes: type[Exception]
) -> int:
    """Run the body of a process, and return its exit code: 2 for `mistakes`, which a user can correct and which are logged.

    Requests to end arrive in its inbox: SIGINT and SIGTERM or, for a process of run.py, that run.py lets go of its line.
    """
    options = read_options(kind, f"orchard.processes.{name}", argv)
    gc.freeze()  # what is imported stays
    logging.basicConfig(level=logging.WARNING, format=f"{name}: %(message)s")
    inbox = Inbox()
    if lifeline.is_held():
        announce = lifeline.hold_on(lambda: inbox.put(Signal(signal.SIGTERM)))
        code = _code_of(lambda: body(inbox, options), *mistakes)
        announce(code)
        return code
    inbox.take_signals()
    return _code_of(lambda: body(inbox, options), *mistakes)


def _code_of(body: Callable[[], int], *mistakes: type[Exception]) -> int:
    try:
        return body()
    except HostEnded as end:
        if end.code:
            log.error("%s", end)
        return end.code
    except mistakes as error:
        log.error("%s", error)
        return 2


def monitor(host: Host, seconds: float = LONG_SECONDS) -> None:
    """Log each agent of the host that spends at least `seconds` on one tick, once per agent. The agents tick in the calling thread."""
    threading.Thread(target=_watch, args=(host, threading.get_ident(), seconds), daemon=True).start()


def _watch(host: Host, thread: int, seconds: float) -> None:
    before, logged = ("", -1), set()
    while True:
        time.sleep(seconds)
        now = name, tick = host.thinking, host.latest.tick
        if name and now == before and name not in logged:
            logged.add(name)
            log.error("%s still thinks about tick %d%s; %s", name, tick, place_in_agent(sys._current_frames()[thread]), _effect(host))
        before = now


def _effect(host: Host) -> str:
    others = ", ".join(name for name in host.runners if name != host.thinking)
    return f"until it answers, these agents of its process stand: {others}" if others else "its robot stands until it answers"
