"""Names the agent that thinks for too long, and where in its code: the others of its process wait for it, and in lockstep all do."""

import logging
import sys
import threading
import time
import traceback

from orchard.contract import guard
from orchard.net.host import Host

log = logging.getLogger("orchard")

LONG_SECONDS = 3.0


def monitor(host: Host, seconds: float = LONG_SECONDS) -> None:
    """From now on tell, once for each, which agent of the host has thought for so long; its agents think in this thread."""
    threading.Thread(target=_watch, args=(host, threading.get_ident(), seconds), daemon=True).start()


def _watch(host: Host, thread: int, seconds: float) -> None:
    before, told = ("", -1), set()
    while True:
        time.sleep(seconds)
        now = name, tick = host.thinking, host.sight.tick
        if name and now == before and name not in told:
            told.add(name)
            log.error("%s still thinks about tick %d%s; %s", name, tick, _place(thread), _who_waits(host))
        before = now


def _who_waits(host: Host) -> str:
    others = ", ".join(name for name in host.performers if name != host.thinking)
    return f"until it has done so these of its process stand: {others}" if others else "its robot stands until it has done so"


def _place(thread: int) -> str:
    """Where the agent is, below its guard."""
    frames = traceback.extract_stack(sys._current_frames()[thread])
    inside = [i for i, frame in enumerate(frames) if frame.filename == guard.__file__]
    here = frames[inside[-1] + 1 :] if inside else []
    return f", in {here[0].filename}, line {here[0].lineno}" if here else ""
