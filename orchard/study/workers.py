"""The workers that do the runs of a study: processes on this machine, or the workers of a
dask.distributed scheduler.

Runs end in any order, and those of a worker that dies are done again. So a study must not decide by
which runs ended first: it waits until all runs that it has asked for are done.
"""

import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, pthread_sigmask
from threading import Thread
from typing import Any, TypeVar, cast

from orchard.contract.printed import Printed
from orchard.memory import collect_seldom
from orchard.terminal.long_calls import tell_long_calls

GLANCE = 0.2  # s between two looks whether to stop
# So many workers may die with the same work. Then the work itself seems to kill them.
MOST_DEATHS = 3
# Different errors of own classes that a worker shows.
MOST_ERRORS = 3
CONNECTING = 10.0  # s to wait for a scheduler
# Runs that wait in the executor beyond one for each worker, so that a free worker has work at once.
ONE_AHEAD = 1
# Environment variable of Python: the folder of the script is not put on the path of modules.
SAFE_PATH = "PYTHONSAFEPATH"
# s by which the clocks of two machines may differ. A worker compares the end of the budget with its
# own clock.
APART = 2.0

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkersError(Exception):
    """The workers cannot do the work: the text says why."""


class WorkerDied(WorkersError):
    """A worker died again and again with the same work, which is `item`."""

    def __init__(self, item: Any) -> None:
        super().__init__(
            f"{MOST_DEATHS} times a worker died, and did nothing: own code has ended it, or the"
            " memory is full"
        )
        self.item = item


class Workers:
    """The workers of an executor. When a worker dies the executor is broken, and is replaced."""

    def __init__(self, start: Callable[[], Executor], count: int) -> None:
        """`start`: returns a new executor. `count`: how many workers it has."""
        self.count = count
        self._start = start
        self.executor = start()

    def do(
        self, work: Callable[[Item], Result], items: Sequence[Item], goes_on: Callable[[], bool]
    ) -> Iterator[tuple[Item, Result]]:
        """Yield each item with `work(item)`, in any order, as long as `goes_on` returns True.

        An item whose worker died is done again. Raises WorkerDied for one that kills each worker,
        or the error that `work` raised.
        """
        remaining = dict(enumerate(items))
        # By the number of the item: how many workers have died while it was with them.
        deaths = Counter[int]()
        while remaining and goes_on():
            pending: dict[Future[Result], int] = {}
            try:
                for number, result in self._done(work, _next(remaining, deaths), pending, goes_on):
                    yield remaining.pop(number), result
            except BrokenExecutor:
                deaths.update(pending.values())
                for number in pending.values():
                    if deaths[number] >= MOST_DEATHS:
                        raise WorkerDied(remaining[number]) from None
                self.executor.shutdown()
                self.executor = self._start()

    def _done(
        self,
        work: Callable[[Item], Result],
        items: Mapping[int, Item],
        pending: dict[Future[Result], int],
        goes_on: Callable[[], bool],
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each item with its result. Raises BrokenExecutor if a worker dies.

        `pending` is empty. It gets the numbers of the items that the executor has.

        The executor gets only as much work as it can begin soon, so that nothing need be cancelled
        when the study stops. With cancelled work the pool of Python 3.11 fails in its own thread if
        a worker dies then.
        """
        # A copy, because the caller takes items out of the map meanwhile.
        waiting = iter(list(items.items()))
        while goes_on():
            for number, item in islice(waiting, self.count + ONE_AHEAD - len(pending)):
                # This too fails if a worker has died meanwhile.
                pending[self.executor.submit(work, item)] = number
            if not pending:
                return
            for future in wait(pending, GLANCE, FIRST_COMPLETED).done:
                result = future.result()
                yield pending.pop(future), result


def _next(remaining: Mapping[int, Item], deaths: Mapping[int, int]) -> Mapping[int, Item]:
    """Return the items to do next: all, or one alone of those that a dead worker may have had.

    Alone it shows whether it kills its worker, and kills no other work.
    """
    for number, item in remaining.items():
        if deaths[number]:
            return {number: item}
    return remaining


# -- on this machine


@contextmanager
def processes(count: int | None = None) -> Iterator[Workers]:
    """Yield workers that are processes of this machine.

    `count`: how many; None: one for each core.
    """
    number = count or os.cpu_count() or 1
    workers = Workers(partial(_Processes, number), number)
    try:
        yield workers
    finally:
        workers.executor.shutdown()


class _Processes(ProcessPoolExecutor):
    """Processes that end at once when the executor is shut down, or when this process dies.

    Each holds one end of a pipe, and ends when this process closes the other end.
    """

    def __init__(self, count: int) -> None:
        context = get_context("spawn")
        listens, self._alive = context.Pipe(duplex=False)
        with _own_modules_first() as before:
            super().__init__(
                count, context, initializer=_end_with_parent, initargs=(listens, before)
            )

    def submit(self, *work: Any, **named: Any) -> Any:
        """Submit work. The first work starts the processes.

        Ctrl-C is blocked in them from their start: this process decides what it means.
        """
        before = pthread_sigmask(SIG_BLOCK, {SIGINT})
        try:
            with _own_modules_first():
                return super().submit(*work, **named)
        finally:
            pthread_sigmask(SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Let the processes end. Little is left to cancel: see `_done`."""
        self._alive.close()
        super().shutdown(wait, cancel_futures=cancel_futures)


@contextmanager
def _own_modules_first() -> Iterator[str | None]:
    """In this context a process that starts imports Python's own modules before the user's files.

    Otherwise a user's file random.py in the folder where it starts would take the place of
    Python's. Yields the value of the environment variable before, or None.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield before
    finally:
        _set_safe_path(before)


def _set_safe_path(value: str | None) -> None:
    """Set the environment variable, or remove it for None."""
    if value is None:
        os.environ.pop(SAFE_PATH, None)
    else:
        os.environ[SAFE_PATH] = value


def _end_with_parent(alive: Connection, safe_path: str | None) -> None:
    """Prepare a worker process: it is to end as soon as the parent closes its end of the pipe, or
    dies.

    `alive`: the worker's end of the pipe. `safe_path`: the value of SAFE_PATH in the parent's
    environment, which processes that own classes start must get too.

    What own classes print goes to stderr, as far as `Printed` lets it. What C code writes to stdout
    itself is thrown away.
    """
    collect_seldom()
    _set_safe_path(safe_path)
    show = partial(print, file=sys.stderr, flush=True)
    logging.getLogger("orchard").addHandler(_FirstErrors(show))
    sys.stdout = sys.stderr = Printed(show)
    tell_long_calls(show)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    Thread(target=_exit_after, args=(alive,), daemon=True).start()


class _FirstErrors(logging.Handler):
    """Shows the first errors that runs log, as of a policy. A study tells how many there were."""

    def __init__(self, show: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._show = show
        self._shown = set[str]()

    def emit(self, record: logging.LogRecord) -> None:
        """Show an error, once, unless there were MOST_ERRORS others."""
        words = self.format(record)
        if words not in self._shown and len(self._shown) < MOST_ERRORS:
            self._shown.add(words)
            self._show(words)


def _exit_after(alive: Connection) -> None:
    """End this process when the other end of the pipe is closed. Nothing is ever sent."""
    try:
        alive.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


# -- on several machines


@contextmanager
def scheduled(address: str) -> Iterator[Workers]:
    """Yield the workers of a dask.distributed scheduler, which replaces workers that die.

    The user must have installed this software, and the own classes, on each of their machines.
    Raises WorkersError if no scheduler answers, it has no workers, their clocks are wrong, or it
    ends while they work.
    """
    import distributed

    # The package has no types.
    dask = cast(Any, distributed)
    try:
        client = dask.Client(address, timeout=CONNECTING)
    except (OSError, ValueError) as error:
        raise WorkersError(
            f"{address}: no scheduler of dask.distributed answers: {error}"
        ) from None
    with client:
        trouble = _trouble(client, address)
        if trouble:
            raise WorkersError(f"{address}: {trouble}")
        count = len(client.scheduler_info()["workers"])
        try:
            yield Workers(partial(client.get_executor, pure=False), count)
        except dask.KilledWorker as error:
            raise WorkersError(f"{address}: {error}") from None
        except CancelledError:
            raise WorkersError(
                f"{address}: the scheduler is gone, or it has cancelled the work"
            ) from None


def _trouble(client: Any, address: str) -> str:
    """Return why the workers of a scheduler cannot do the work; "" if they can."""
    if not client.scheduler_info()["workers"]:
        return f"this scheduler has no workers; start some: dask worker {address}"
    asked_at = time.time()
    clocks = client.run(time.time, on_error="ignore")
    answered_at = time.time()
    wrong = [
        f"{worker} by {clock - answered_at:+.0f} s"
        for worker, clock in clocks.items()
        if not asked_at - APART < clock < answered_at + APART
    ]
    if not wrong:
        return ""
    return (
        f"clocks of workers differ from that of this machine: {', '.join(wrong)}; "
        "set them, as by NTP"
    )
