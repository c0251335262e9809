"""Work for the workers of the tests, in a module that each of them can import."""

import os
import signal
from pathlib import Path


def double(item: tuple[int, Path]) -> int:
    """Twice a number. The worker that gets 3 dies of it, once.

    `item`: the number, and the file that exists once a worker has died.
    """
    number, marker = item
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def deadly(item: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return item


def faulty(item: int) -> int:
    raise LookupError(f"no {item}")


def loud(item: str) -> None:
    """Print much, in a way that a redirected stdout notices and in one that it does not."""
    print(f"{item}\n" * 1000)
    os.write(1, item.encode())


def slow(item: Path) -> None:
    """Tell which process works, and work for a long time."""
    item.write_text(str(os.getpid()))
    signal.pause()


def blocked_signals(_) -> set[int]:
    return signal.pthread_sigmask(signal.SIG_BLOCK, set())
