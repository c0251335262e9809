"""The line between run.py and each of its processes: a socket, the standard input of the process.

run.py holds its end of the socket for as long as the process is to run. When run.py lets go of it,
or is gone, however that came, the process learns it, and ends. A process that ends by itself writes
its exit code on the line. A process that writes nothing there has died: of a signal, or of an
agent's `os._exit`. run.py starts it again.
"""

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from select import select
from socket import MSG_DONTWAIT, MSG_PEEK, SHUT_WR, socketpair
from threading import Thread, Timer

# Environment variable: run.py's process id, and the run's id.
STARTED_BY = "ORCHARD_STARTED_BY"
# s after a signal in which run.py may ask the process to end, too. When a machine is shut down,
# both get the signal: then the process ends in order, and does not die.
CONFIRM_SECONDS = 1.0
# s that a process may take to end when run.py, which would end it by force, is gone.
ALONE_SECONDS = 10.0


class Line:
    """run.py's end of the line to a process. `of_process` is the other end."""

    def __init__(self) -> None:
        self._end, self.of_process = socketpair()

    def write(self, words: str) -> None:
        """Send a line of text to the process: its options."""
        # The process may have died already.
        with suppress(OSError):
            self._end.sendall(f"{words}\n".encode())

    def let_go(self) -> None:
        """Ask the process to end."""
        with suppress(OSError):
            self._end.shutdown(SHUT_WR)

    def close(self) -> None:
        """Forget the line. The process has ended, and `code` is None from now on."""
        self._end.close()

    @property
    def code(self) -> int | None:
        """The exit code with which the process has ended by itself; None if it runs or died."""
        code = b""
        # OSError: nothing is there to read.
        with suppress(OSError):
            # The byte stays on the line, so this can be asked again.
            code = self._end.recv(1, MSG_PEEK | MSG_DONTWAIT)
        if code == b"":
            return None
        return code[0]


def environment(run: str) -> dict[str, str]:
    """Return the environment variables of a process that run.py starts."""
    return {STARTED_BY: f"{os.getpid()} {run}"}


def hold_on(ask_to_end: Callable[[], None]) -> Callable[[int], None] | None:
    """Call `ask_to_end` when run.py lets go of the line. Die of a signal that comes alone.

    Return the function that writes the exit code on the line; None if run.py has not started this
    process, so that there is no line.
    """
    if STARTED_BY not in os.environ:
        return None
    owner = int(os.environ.pop(STARTED_BY).split()[0])
    line = os.dup(0)
    # An agent that reads its standard input must not wait for run.py: it finds an empty file.
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), 0)
    Thread(target=_wait_for_end, args=(line, owner, ask_to_end), daemon=True).start()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, partial(_die_soon, line))
    return partial(_announce, line)


def _announce(line: int, code: int) -> None:
    """Write the exit code on the line."""
    # run.py may be gone.
    with suppress(OSError):
        os.write(line, bytes([code]))


def _wait_for_end(line: int, owner: int, ask_to_end: Callable[[], None]) -> None:
    """Wait until run.py lets go. End by force if the process does not end without run.py."""
    # The read ends with b"" when run.py lets go; if run.py was killed, the line is reset.
    with suppress(ConnectionResetError):
        while os.read(line, 1):
            pass
    ask_to_end()
    time.sleep(ALONE_SECONDS)
    # A process whose parent is gone gets another one.
    is_alone = os.getppid() != owner
    if is_alone:
        os._exit(1)


def _die_soon(line: int, number: int, frame: object) -> None:
    """Die of a signal in CONFIRM_SECONDS, unless run.py asks too."""
    timer = Timer(CONFIRM_SECONDS, _die, (line, number))
    timer.daemon = True
    timer.start()


def _die(line: int, number: int) -> None:
    """Die of a signal, unless run.py has let go: then the process ends as it is asked to."""
    has_let_go = bool(select([line], [], [], 0.0)[0])
    if not has_let_go:
        # As a shell reports a process that died of this signal.
        os._exit(128 + number)
