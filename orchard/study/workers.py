"""The workers that do the runs of a study.

They are an executor of processes on this machine, or that of a dask.distributed scheduler. Both do
work in any order and lose none of it when a worker dies. So what a study decides may depend on
whole rounds of work only.
"""

import os
import sys
import time
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

GLANCE = 0.2  # s between two looks whether to stop
# Workers that die one after another, without any work done between. Then the work itself kills
# them.
MOST_DEATHS = 3
CONNECTING = 10.0  # s to wait for a scheduler
# Work that waits in an executor for the next worker that is free.
ONE_AHEAD = 1
# Environment variable of Python: no folder is put on the path.
SAFE_PATH = "PYTHONSAFEPATH"
# s that the clocks of two machines may be apart: a worker gives up a run of the simulator by its
# own clock.
APART = 2.0

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkersError(Exception):
    """The workers cannot do the work: the text says why."""


class Workers:
    """So many workers of an executor, which is replaced when it breaks."""

    def __init__(self, start: Callable[[], Executor], count: int) -> None:
        """`start`: returns a new executor. `count`: of its workers."""
        self.count = count
        self._start = start
        self.executor = start()

    def do(
        self, work: Callable[[Item], Result], items: Sequence[Item], goes_on: Callable[[], bool]
    ) -> Iterator[tuple[Item, Result]]:
        """Yield each item with `work(item)`, in any order, as long as `goes_on`.

        What a worker had in hand when it died is done again. Raises WorkersError or the work's
        error.
        """
        remaining = dict(enumerate(items))
        deaths = 0
        while remaining and goes_on():
            try:
                for number, result in self._done(work, remaining, goes_on):
                    deaths = 0
                    yield remaining.pop(number), result
            except BrokenExecutor:
                deaths += 1
                if deaths == MOST_DEATHS:
                    raise WorkersError(
                        f"{deaths} times a worker died, and did nothing: is the memory full?"
                    ) from None
                self.executor.shutdown()
                self.executor = self._start()

    def _done(
        self, work: Callable[[Item], Result], items: Mapping[int, Item], goes_on: Callable[[], bool]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each item with its result. Raises BrokenExecutor if a worker dies.

        The executor gets no more than it can begin soon. So nothing has to be cancelled at a stop:
        the pool of Python 3.11 fails in its own thread if a worker dies then.
        """
        # A list, because a result takes its item out of the map meanwhile.
        waiting = iter(list(items.items()))
        pending: dict[Future[Result], int] = {}
        while goes_on():
            for number, item in islice(waiting, self.count + ONE_AHEAD - len(pending)):
                # This too fails if a worker has died meanwhile.
                pending[self.executor.submit(work, item)] = number
            if not pending:
                return
            for future in wait(pending, GLANCE, FIRST_COMPLETED).done:
                result = future.result()
                yield pending.pop(future), result


# -- on this machine


@contextmanager
def processes(count: int | None = None) -> Iterator[Workers]:
    """Yield so many processes of this machine; None: one for each core."""
    number = count or os.cpu_count() or 1
    workers = Workers(partial(_Processes, number), number)
    try:
        yield workers
    finally:
        workers.executor.shutdown()


class _Processes(ProcessPoolExecutor):
    """Processes that end at once, whatever they do.

    They end when the executor is shut down, and when this process dies.
    """

    def __init__(self, count: int) -> None:
        context = get_context("spawn")
        listens, self._alive = context.Pipe(duplex=False)
        with _own_modules_first() as before:
            super().__init__(
                count, context, initializer=_end_with_parent, initargs=(listens, before)
            )

    def submit(self, *work: Any, **named: Any) -> Any:
        """Start the processes with the first work.

        They never get Ctrl-C, which is the parent's, not even while they load.
        """
        before = pthread_sigmask(SIG_BLOCK, {SIGINT})
        try:
            with _own_modules_first():
                return super().submit(*work, **named)
        finally:
            pthread_sigmask(SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        self._alive.close()
        super().shutdown(wait, cancel_futures=cancel_futures)


@contextmanager
def _own_modules_first() -> Iterator[str | None]:
    """In this context a process that starts takes Python's own modules, not the user's files.

    Else it would take a file random.py in the folder where it starts. Yields the value before.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield before
    finally:
        _set_safe_path(before)


def _set_safe_path(value: str | None) -> None:
    if value is None:
        os.environ.pop(SAFE_PATH, None)
    else:
        os.environ[SAFE_PATH] = value


def _end_with_parent(alive: Connection, safe_path: str | None) -> None:
    """In a worker: end as soon as the parent closes its end of the pipe, or is killed.

    `safe_path`: of the parent's environment, which what own classes start gets too.

    The parent shows some of what own classes print. What C code writes to the file of stdout is
    not shown.
    """
    _set_safe_path(safe_path)
    sys.stdout = sys.stderr = Printed(partial(print, file=sys.stderr, flush=True))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    Thread(target=_exit_after, args=(alive,), daemon=True).start()


def _exit_after(alive: Connection) -> None:
    try:
        alive.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


# -- on several machines


@contextmanager
def scheduled(address: str) -> Iterator[Workers]:
    """Yield the workers of a dask.distributed scheduler, which replaces those that die.

    Each has this software, and the user's modules.
    Raises WorkersError if no scheduler answers, it has no workers, their clocks are wrong, or it
    ends while they work.
    """
    import distributed

    # It has no types.
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
