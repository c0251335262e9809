"""Tells of a user's code that takes long, while the program waits for it.

A class of the user's may never end: when its module is imported, when it is made, or when it is
asked. `orchard.net.process` tells this of the agents of a run of many processes.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread, get_ident
from traceback import walk_stack
from types import FrameType

from orchard.contract.guard import CALLERS, place_in_own_code

# s from one look to the next. A call that goes on at two looks is told.
LONG_SECONDS = 10.0


@contextmanager
def long_calls_told(show: Callable[[str], None], seconds: float = LONG_SECONDS) -> Iterator[None]:
    """In this context, `show` gets a sentence for each call of the user's code in this thread that
    lasts for `seconds` or longer.
    """
    is_over = Event()
    tell_long_calls(show, seconds, is_over)
    try:
        yield
    finally:
        is_over.set()


def tell_long_calls(
    show: Callable[[str], None], seconds: float = LONG_SECONDS, is_over: Event | None = None
) -> None:
    """From now on, tell of long calls in this thread, until `is_over` is set.

    `show`, `seconds`: as of `long_calls_told`.
    """
    until = is_over or Event()
    Thread(target=_watch, args=(get_ident(), show, seconds, until), daemon=True).start()


def _watch(thread: int, show: Callable[[str], None], seconds: float, is_over: Event) -> None:
    """Tell of each call, once, that goes on at two looks. `thread`: the id of the thread."""
    seen: FrameType | None = None
    told: FrameType | None = None
    while not is_over.wait(seconds):
        frame = sys._current_frames().get(thread)
        call = _call_in(frame)
        place = place_in_own_code(frame)
        if call is not None and call is seen and call is not told and place:
            told = call
            show(f"your own code has run for {seconds:g} s, and still runs{place}")
        seen = call


def _call_in(frame: FrameType | None) -> FrameType | None:
    """Return the outermost frame that calls the user's code; None if there is none.

    While it is kept, no other call can be the same object.
    """
    call = None
    for caller, _ in walk_stack(frame):
        if caller.f_code.co_filename in CALLERS:
            call = caller
    return call
