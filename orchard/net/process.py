"""What all processes of a run share: start and end, and a report of an agent that is too slow."""

import gc
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

from orchard.contract.guard import place_in_agent
from orchard.net import lifeline
from orchard.net.bus import Inbox, Signal
from orchard.net.host import Host, HostEnded
from orchard.net.options import Options, read_options

log = logging.getLogger("orchard")

# s after which an agent is too slow.
LONG_SECONDS = 3.0


def run_process(
    name: str,
    kind: type[Options],
    argv: Sequence[str] | None,
    body: Callable[[Inbox, Options], int],
    *mistakes: type[Exception],
) -> int:
    """Run the body of a process, and return its exit code.

    It is 2 for `mistakes`, which a user can correct and which are logged. Requests to end arrive in
    its inbox: SIGINT and SIGTERM or, for a process of run.py, that run.py lets go of its line.
    """
    options = read_options(kind, f"orchard.processes.{name}", argv)
    # Objects of imported modules live as long as the process, so the garbage collector need not
    # look at them.
    gc.freeze()
    logging.basicConfig(level=logging.WARNING, format=f"{name}: %(message)s")
    inbox = Inbox()
    announce = lifeline.hold_on(partial(inbox.put, Signal(signal.SIGTERM)))
    if announce is None:
        inbox.take_signals()
    try:
        code = body(inbox, options)
    except HostEnded as end:
        code = end.code
        if code:
            log.error("%s", end)
    except mistakes as error:
        code = 2
        log.error("%s", error)
    if announce is not None:
        announce(code)
    return code


def monitor(host: Host, seconds: float = LONG_SECONDS) -> None:
    """Log each agent that spends `seconds` on one tick, once.

    The agents tick in the calling thread.
    """
    threading.Thread(
        target=_watch, args=(host, threading.get_ident(), seconds), daemon=True
    ).start()


def _watch(host: Host, thread: int, seconds: float) -> None:
    """Log each agent, once, that thinks about the same tick at two looks, `seconds` apart.

    `thread`: the id of the thread in which the agents tick.
    """
    # The agent and its tick at the last look.
    last_seen = ("", -1)
    logged = set[str]()
    while True:
        time.sleep(seconds)
        name = host.thinking
        tick = host.latest.tick
        if name and (name, tick) == last_seen and name not in logged:
            logged.add(name)
            place = place_in_agent(sys._current_frames()[thread])
            log.error("%s still thinks about tick %d%s; %s", name, tick, place, _effect(host))
        last_seen = (name, tick)


def _effect(host: Host) -> str:
    """Return what follows from an agent that thinks too long, in words."""
    others = [name for name in host.runners if name != host.thinking]
    if others:
        return f"until it answers, these agents of its process stand: {', '.join(others)}"
    return "its robot stands until it answers"
