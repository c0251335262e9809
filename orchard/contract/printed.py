"""What a user's code prints while a run goes on: some lines of it, harmless in a terminal, with the place in the user's file."""

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout

from orchard.contract.guard import place_in_agent
from orchard.field.problems import LONGEST, printable

MOST_LINES = 20  # that are shown of all that is printed


class Printed(io.TextIOBase):
    """A stream in place of stdout and stderr. `show` gets its first MOST_LINES lines, each as one that the program says."""

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
