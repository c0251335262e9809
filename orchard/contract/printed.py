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
        self._show = show
        self._lines_left = MOST_LINES
        # The begin of a line that has not ended yet.
        self._begun = ""

    def write(self, text: str, /) -> int:
        """Show each line that ends in a text, with the place in the user's file that prints it.

        Return the number of characters, as each stream does.
        """
        if self._lines_left == 0:
            return len(text)
        *lines, begun = (self._begun + text).split("\n")
        self._begun = begun[:LONGEST]
        place = place_in_agent(sys._getframe(1))
        for line in lines[: self._lines_left]:
            self._lines_left -= 1
            self._show(f"printed{place}: {printable(line)}")
        if self._lines_left == 0:
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
    is_over = Event()

    def show_once(words: str) -> None:
        # A worker of the run may have said already that a line was printed.
        show(words.replace("printed: printed", "printed", 1))

    stream = Printed(show_once)
    with ExitStack() as stack:
        own = [os.fdopen(os.dup(number), "w") for number in (1, 2)]
        stack.callback(_close, own)
        # It is no pipe, because a writer must not wait until it is read.
        written = stack.enter_context(open(os.memfd_create("printed"), "wb"))
        for number in (1, 2):
            os.dup2(written.fileno(), number)
        reader = Thread(target=_follow, args=(written.fileno(), stream, is_over), daemon=True)
        reader.start()
        try:
            yield own
        finally:
            # Else what C code has in its buffers comes later.
            ctypes.CDLL(None).fflush(None)
            for number, file in zip((1, 2), own, strict=True):
                os.dup2(file.fileno(), number)
            is_over.set()
            reader.join()


def _close(files: list[io.TextIOWrapper]) -> None:
    """Close files. If the disk is full, what they still hold is lost."""
    for file in files:
        with suppress(OSError):
            file.close()


def _follow(written: int, stream: Printed, is_over: Event) -> None:
    """Pass on what is written into a file, until it is over. `written`: its descriptor."""
    read_to = 0
    is_last = False
    while not is_last:
        is_last = is_over.wait(GLANCE)
        part = os.pread(written, MOST_BYTES, read_to)
        if part:
            stream.write(part.decode(errors="replace"))
            read_to = os.fstat(written).st_size
            # The writer goes on at the same place.
            os.ftruncate(written, 0)
