"""What a user's code prints while a run goes on: some lines of it, harmless in a terminal, with the
place in the user's file.
"""

import ctypes
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from threading import Event, Thread

from orchard.contract.guard import place_in_agent
from orchard.field.problems import LONGEST, printable

MOST_LINES = 20  # that are shown of all that is printed
GLANCE = 0.1  # s between two looks at what C code has written
MOST_BYTES = 1 << 16  # of it that are read at a look


class Printed(io.TextIOBase):
    """A stream in place of stdout and stderr. `show` gets its first MOST_LINES lines, each as one
    that the program says.
    """

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show, self._left, self._begun = show, MOST_LINES, ""

    def write(self, text: str, /) -> int:
        *lines, begun = (self._begun + text).split("\n") if self._left else [""]
        self._begun = begun[:LONGEST]
        for line in lines[: self._left]:
            self._left -= 1
            self._show(f"printed{place_in_agent(sys._getframe(1))}: {printable(line)}")
            if not self._left:
                self._show("what own classes print from here on is left out; write it to a file")
        return len(text)


@contextmanager
def printed(show: Callable[[str], None]) -> Iterator[None]:
    """In this context, `show` gets what is printed, in place of stdout and stderr."""
    stream = Printed(show)
    with redirect_stdout(stream), redirect_stderr(stream):
        yield


@contextmanager
def diverted(show: Callable[[str], None]) -> Iterator[list[io.TextIOWrapper]]:
    """In this context, `show` gets some of what C code writes to the files 1 and 2. Yield stdout
    and stderr for the program's own words.
    """
    is_over, stream = (
        Event(),
        Printed(lambda words: show(words.replace("printed: printed", "printed", 1))),
    )  # by a worker that says so
    with ExitStack() as stack:
        own = [os.fdopen(os.dup(number), "w") for number in (1, 2)]
        stack.callback(_close, own)
        written = stack.enter_context(
            open(os.memfd_create("printed"), "wb")
        )  # no pipe: a writer must not wait until it is read
        for number in (1, 2):
            os.dup2(written.fileno(), number)
        reader = Thread(target=_follow, args=(written.fileno(), stream, is_over), daemon=True)
        reader.start()
        try:
            yield own
        finally:
            ctypes.CDLL(None).fflush(None)  # or what C code has in its buffers comes later
            for number, file in zip((1, 2), own, strict=True):
                os.dup2(file.fileno(), number)
            is_over.set()
            reader.join()


def _close(files: list[io.TextIOWrapper]) -> None:
    for file in files:
        with suppress(OSError):  # the disk is full: what is left is lost
            file.close()


def _follow(written: int, stream: Printed, is_over: Event) -> None:
    at, is_last = 0, False
    while not is_last:
        is_last = is_over.wait(GLANCE)
        if part := os.pread(written, MOST_BYTES, at):
            stream.write(part.decode(errors="replace"))
            at = os.fstat(written).st_size
            os.ftruncate(written, 0)  # the writer goes on at the same place
