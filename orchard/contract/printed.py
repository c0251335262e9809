"""Shows some of what a user's code prints while a run goes on.

Each line is shown as one of the program, with the place in the user's file, and without the control
characters that a terminal obeys. `printed` does it for Python, `diverted` for C code too.
"""

import ctypes
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from threading import Event, Thread

from orchard.contract.guard import place_in_own_code
from orchard.field.problems import LONGEST, printable

# Lines of one stream that are shown; what comes after them is left out.
MOST_LINES = 20
GLANCE = 0.1  # s between two looks at what C code has written
MOST_BYTES = 1 << 16  # bytes that are read at one look


class Printed(io.TextIOBase):
    """A stream in place of stdout and stderr. `show` gets its first MOST_LINES lines."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._lines_left = MOST_LINES
        # The beginning of a line that has not ended yet.
        self._begun = ""

    def write(self, text: str, /) -> int:
        """Show each line that ends in a text, with the place in the user's file that prints it.

        Return the number of characters, as each stream does.
        """
        if self._lines_left == 0:
            return len(text)
        *lines, begun = (self._begun + text).split("\n")
        self._begun = begun[:LONGEST]
        # Frame 1 is the caller: the user's code, or what it prints with.
        place = place_in_own_code(sys._getframe(1))
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
    """In this context, `show` gets some of what C code writes to the files 1 and 2.

    These are stdout and stderr of the process. Yield two files that still lead to where stdout and
    stderr led, for the program's own words.
    """
    is_over = Event()

    def show_once(words: str) -> None:
        # A process that this one has started may have put "printed" before the line already.
        show(words.replace("printed: printed", "printed", 1))

    stream = Printed(show_once)
    with ExitStack() as stack:
        own = [os.fdopen(os.dup(number), "w") for number in (1, 2)]
        stack.callback(_close, own)
        # A file in memory and no pipe, because a writer waits when a pipe is full.
        written = stack.enter_context(open(os.memfd_create("printed"), "wb"))
        for number in (1, 2):
            os.dup2(written.fileno(), number)
        reader = Thread(target=_follow, args=(written.fileno(), stream, is_over), daemon=True)
        reader.start()
        try:
            yield own
        finally:
            # C code buffers what it writes. It goes into the file now, before the file is read for
            # the last time; later it would go to the terminal.
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
    """Pass on what is written into a file, until `is_over`. `written`: its descriptor.

    Of more than MOST_BYTES since the last look the rest is left out.
    """
    read_to = 0
    is_last = False
    while not is_last:
        # It is True once the event is set; then the file is read once more.
        is_last = is_over.wait(GLANCE)
        part = os.pread(written, MOST_BYTES, read_to)
        if part:
            stream.write(part.decode(errors="replace"))
            read_to = os.fstat(written).st_size
            # This frees the memory. The writer keeps its place in the file, and goes on there.
            os.ftruncate(written, 0)
