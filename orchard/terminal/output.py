"""What `orchard` prints on stdout and stderr, whatever these are and whatever the text holds.

A stream may be closed, on a full disk, or a pipe without a reader. Then what is printed is lost,
and the program goes on. A text, such as a path, may hold characters that would control a terminal.
"""

import errno
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, TimeElapsedColumn
from rich.table import Table

from orchard.contract.printed import diverted, printed
from orchard.terminal.long_calls import long_calls_told
from orchard.terminal.sudden_ends import sudden_ends_told


def harmless(text: str) -> str:
    """Return a text, such as a path, without what would control a terminal."""
    shown = ""
    for character in text:
        if character.isprintable() or character == "\n":
            shown += character
        else:
            shown += "?"
    return shown


def unwritten(name: str, error: OSError) -> str:
    """Return why stdout or stderr cannot be written. `name`: of that stream."""
    reason = error.strerror
    if error.errno == errno.EBADF:
        reason = "it is closed"
    return f"{name} cannot be written: {reason}"


class Output(Console):
    """Stdout or stderr. What cannot be written, as on a full disk, is lost.

    The other of the two streams says once that something is lost.
    """

    def __init__(self, stderr: bool) -> None:
        super().__init__(stderr=stderr, emoji=False, highlight=False)
        # Of stdout it is stderr, of stderr stdout.
        self.other: Output | None = None
        # Whether something could not be written.
        self.has_lost = False
        # Whether stderr has got the result of the command, which stdout has lost.
        self.is_repeated = False

    def print(self, *objects: Any, **options: Any) -> None:
        """Print texts without what would control a terminal, and Rich's objects as they are."""
        shown = []
        for part in objects:
            if isinstance(part, str):
                shown.append(harmless(part))
            else:
                shown.append(part)
        try:
            super().print(*shown, **options)
        except OSError as error:
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        """Forget what could not be written. The first time, tell it on the other stream."""
        # Rich would print it again with the next line.
        self._buffer.clear()
        is_first = not self.has_lost
        self.has_lost = True
        if is_first and self.other is not None:
            name = "stdout"
            if self.stderr:
                name = "stderr"
            warning = f"{unwritten(name, error)}; the run goes on without it"
            self.other.print(warning, markup=False, soft_wrap=True)

    def on_broken_pipe(self) -> None:
        """Raise the error that Rich has caught, so that `print` handles it.

        Rich would end the program here, before it has written its files.
        """
        raise

    def end(self) -> None:
        """Write what is left, or drop it.

        If Python could not write it at the exit, it would end with exit code 120.
        """
        try:
            self.file.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


console = Output(stderr=False)
errors = Output(stderr=True)
console.other = errors
errors.other = console


def print_line(text: str) -> None:
    """Print a text on stdout. The terminal wraps it."""
    console.print(text, markup=False, soft_wrap=True)


def print_error(text: object) -> None:
    """Print a text on stderr. The terminal wraps it."""
    errors.print(str(text), markup=False, soft_wrap=True)


def print_result(*parts: Any) -> None:
    """Print texts and tables on stdout; on stderr if stdout has lost some, as its disk is full."""
    _print_all(console, parts)
    if console.has_lost:
        _print_all(errors, parts)
        if not errors.has_lost:
            console.is_repeated = True


def _print_all(output: Output, parts: Iterable[Any]) -> None:
    """Print texts and tables. A terminal wraps texts."""
    for part in parts:
        output.print(part, markup=False, soft_wrap=isinstance(part, str))


def is_answer_lost() -> bool:
    """Whether stdout has lost what a command printed, and stderr has not got its result."""
    return console.has_lost and not console.is_repeated


def is_all_lost() -> bool:
    """Whether neither stdout nor stderr has shown all that was printed."""
    return console.has_lost and errors.has_lost


def table(caption: str | None, *heads: str) -> Table:
    """Return a table without rows: words in its first column, figures in the others."""
    empty = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left"
    )
    first, *others = heads
    empty.add_column(escape(first), justify="left", no_wrap=True, overflow="fold")
    for head in others:
        empty.add_column(escape(head), justify="right", overflow="fold")
    return empty


def bar(*more: ProgressColumn) -> Progress:
    """Return a bar, and the time since its begin, which a terminal shows in its `with` block."""
    return Progress(
        BarColumn(bar_width=20),
        TimeElapsedColumn(),
        *more,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


class _Log(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        """Print a record of the log."""
        _say(self.format(record))


def _say(text: str) -> None:
    """Print a line on stderr; above the table, if there is one on the terminal."""
    if console.is_terminal:
        print_line(text)
    else:
        print_error(text)


@contextmanager
def own_classes_run() -> Iterator[None]:
    """In this context, a user's own classes may run.

    What they print is shown as lines of the program; not all of it, if they print much. A call of
    them that lasts long, or that ends the program, is told.
    """
    log = logging.getLogger("orchard")
    handler = _Log()
    outputs: list[Any] = [console, errors]
    log.addHandler(handler)
    try:
        # Stdout and stderr are replaced, for Python's `print` and for C code. The program's own
        # words go to the streams that `diverted` yields, which lead where stdout and stderr led
        # before.
        with ExitStack() as stack:
            console.file, errors.file = stack.enter_context(diverted(_say))
            stack.enter_context(printed(_say))
            stack.enter_context(long_calls_told(_say))
            stack.enter_context(sudden_ends_told(_say, errors.file))
            yield
    finally:
        log.removeHandler(handler)
        for output in outputs:
            # Without a file Rich prints on what is stdout or stderr at that time.
            output.file = None
