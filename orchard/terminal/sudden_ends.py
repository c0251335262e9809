"""Tells where a user's code ends this program at once, so that it can tell nothing itself.

Such code may call `os._exit`, or crash in C. Without a word a run would be over with nothing
written, and perhaps with the exit code 0 of a good run.
"""

import faulthandler
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, NoReturn

from orchard.field.plugins import is_own

# The exit code in place of 0, as after each failure: `orchard.terminal.exits` imports this module.
FAILED = 1


@contextmanager
def sudden_ends_told(show: Callable[[str], None], stream: IO[str]) -> Iterator[None]:
    """In this context, the user's code that ends this process is told with its place.

    `show` gets a sentence of an `os._exit`, after which the exit code is not 0. `stream` gets the
    calls of the thread that crashes: it must be a file.
    """
    leave = os._exit
    program = os.getpid()

    def told(status: int) -> NoReturn:
        """End this process as `os._exit` does."""
        caller = sys._getframe(1)
        file = caller.f_code.co_filename
        # A process that the user's code has forked may end as it likes.
        if is_own(file) and os.getpid() == program:
            place = f"in {file}, line {caller.f_lineno}"
            show(f"your own code ended the program by os._exit({status}), {place}")
            leave(status or FAILED)
        leave(status)

    is_set_already = faulthandler.is_enabled()
    if not is_set_already:
        faulthandler.enable(stream, all_threads=False)
    # There is no other way to notice it: Python gives no signal and calls nothing.
    os._exit = told
    try:
        yield
    finally:
        os._exit = leave
        if not is_set_already:
            faulthandler.disable()
