"""Work for the workers of the tests, in a module that each of them can import."""

import gc
import logging
import os
import signal
from pathlib import Path


def double(item: tuple[int, Path]) -> int:
    """Return twice a number. The worker that gets 3 kills itself, once.

    `item`: the number, and a file that exists once a worker has died.
    """
    number, marker = item
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def deadly(item: int) -> int:
    """Kill the worker, each time."""
    os.kill(os.getpid(), signal.SIGKILL)
    return item


def faulty(item: int) -> int:
    """Raise an error."""
    raise LookupError(f"no {item}")


def loud(item: str) -> None:
    """Print much, in a way that a redirected stdout notices and in one that it does not."""
    print(f"{item}\n" * 1000)
    os.write(1, item.encode())


def complaining(item: str) -> None:
    """Log an error twice, as two runs do with the same policy, and then many others."""
    for number in (0, *range(100)):
        logging.getLogger("orchard").error("%s, tick %d", item, number)


def slow(item: Path) -> None:
    """Write which process works into a file, and work for ever."""
    item.write_text(str(os.getpid()))
    signal.pause()


def garbage_threshold(_: object) -> int:
    """Return how many objects a worker makes before Python's cycle collector runs."""
    return gc.get_threshold()[0]


def blocked_signals(_) -> set[int]:
    """Return the signals that the process blocks."""
    return signal.pthread_sigmask(signal.SIG_BLOCK, set())
