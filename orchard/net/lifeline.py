"""The line from run.py to each of its processes: a pipe. Its read end is the process' standard input.

run.py holds the other end for as long as the process is to run. So the process learns that run.py asks it to end, and also that run.py
is gone, however that ended. A signal is no such request: a process that gets one dies of it, and run.py starts it again.
"""

import os
import signal
import time
from collections.abc import Callable
from select import select
from threading import Thread, Timer

STARTED_BY = "ORCHARD_STARTED_BY"  # environment variable of a process on a line: run.py's process id, and the run's id
OVER = 100  # exit code of such a process when the run is over, or when run.py has asked: not 0, which an agent's os._exit(0) gives
CONFIRM_SECONDS = 1.0  # after a signal, in which run.py may ask too: the signal was sent to all, as when a machine is shut down
ALONE_SECONDS = 10.0  # that a process may take to end when run.py, which would end it by force, is gone


def environment(run: str) -> dict[str, str]:
    """Return the environment variables of a process that this one starts on a line."""
    return {STARTED_BY: f"{os.getpid()} {run}"}


def is_held() -> bool:
    """Whether run.py has started this process, and holds its line."""
    return STARTED_BY in os.environ


def hold_on(ask_to_end: Callable[[], None]) -> None:
    """Call `ask_to_end`, in another thread, when run.py lets go of the line. After a signal without that, end the process."""
    owner, line = int(os.environ.pop(STARTED_BY).split()[0]), os.dup(0)
    with open(os.devnull) as nothing:  # an agent that reads its input must not wait for run.py
        os.dup2(nothing.fileno(), 0)
    Thread(target=_wait_for_end, args=(line, owner, ask_to_end), daemon=True).start()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: _die_soon(line, number))


def _wait_for_end(line: int, owner: int, ask_to_end: Callable[[], None]) -> None:
    while os.read(line, 1):
        pass
    ask_to_end()
    time.sleep(ALONE_SECONDS)
    if os.getppid() != owner:
        os._exit(1)


def _die_soon(line: int, number: int) -> None:
    timer = Timer(CONFIRM_SECONDS, _die, (line, number))
    timer.daemon = True
    timer.start()


def _die(line: int, number: int) -> None:
    if not select([line], [], [], 0.0)[0]:
        os._exit(128 + number)
