"""The workers that do the runs of a study: processes on this machine, or those of a dask.distributed scheduler.

Both do work in any order and lose none of it when a worker dies. So what a study decides may depend on whole rounds of work only.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar, cast

GLANCE = 0.2  # s between two looks whether to stop
MOST_DEATHS = 3  # of workers, one after another, without any work done between: then the work itself kills them
CONNECTING = 10.0  # s to wait for a scheduler
APART = 2.0  # s that the clocks of two machines may be apart: a worker gives up a run of the simulator by its own clock

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkersError(Exception):
    """The workers cannot do the work: the text says why."""


class Workers(Protocol):
    """Those that do the work of a study."""

    count: int

    def do(self, work: Callable[[Item], Result], items: Sequence[Item], goes_on: Callable[[], bool]) -> Iterator[tuple[Item, Result]]:
        """Yield each item with the result of `work(item)`, in any order, as long as `goes_on`. Raises WorkersError or the work's error."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...


class Processes:
    """Processes on this machine. One that dies is replaced, and its work is done again."""

    def __init__(self, count: int | None = None) -> None:
        self.count = count or os.cpu_count() or 1
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        listens, self._alive = context.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(self.count, context, initializer=_end_with_parent, initargs=(listens,))

    def _end(self) -> None:
        self._alive.close()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def do(self, work: Callable[[Item], Result], items: Sequence[Item], goes_on: Callable[[], bool]) -> Iterator[tuple[Item, Result]]:
        left, deaths = dict(enumerate(items)), 0
        while left and goes_on():
            try:
                for number, result in self._do(work, left, goes_on):
                    deaths = 0
                    yield left.pop(number), result
            except BrokenProcessPool:
                deaths += 1
                if deaths == MOST_DEATHS:
                    raise WorkersError(f"{deaths} times a worker died, and did nothing: is the memory full?") from None
                self._end()
                self._start()

    def _do(self, work: Callable[[Item], Result], items: dict[int, Item], goes_on: Callable[[], bool]) -> Iterator[tuple[int, Result]]:
        waiting: dict[Future[Result], int] = {self._pool.submit(work, item): number for number, item in items.items()}
        while waiting and goes_on():
            for future in wait(waiting, GLANCE, FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
        for future in waiting:
            future.cancel()


def _end_with_parent(alive: Connection) -> None:
    """In a worker: end as soon as the parent closes its end of the pipe, or is killed. Ctrl-C at the terminal is the parent's."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_exit_after, args=(alive,), daemon=True).start()


def _exit_after(alive: Connection) -> None:
    try:
        alive.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


class Scheduler:
    """The workers of a dask.distributed scheduler, which replaces those that die. Each must have this software, and the user's modules."""

    def __init__(self, address: str) -> None:
        """Raises WorkersError if no scheduler answers there, it has no workers, or their clocks are wrong."""
        import distributed

        self.address, self._dask = address, cast(Any, distributed)  # it has no types
        try:
            self._client = self._dask.Client(address, timeout=CONNECTING)
        except (OSError, ValueError) as error:
            raise WorkersError(f"{address}: no scheduler of dask.distributed answers: {error}") from None
        self.count = len(self._client.scheduler_info()["workers"])
        if trouble := self._trouble():
            self._client.close()
            raise WorkersError(f"{address}: {trouble}")

    def _trouble(self) -> str:
        """Why these workers cannot do the work; '' if they can."""
        if not self.count:
            return f"this scheduler has no workers; start some: dask worker {self.address}"
        asked, clocks, now = time.time(), self._client.run(time.time, on_error="ignore"), time.time()
        wrong = [f"{worker} by {clock - now:+.0f} s" for worker, clock in clocks.items() if not asked - APART < clock < now + APART]
        return f"clocks of workers differ from that of this machine: {', '.join(wrong)}; set them, as by NTP" if wrong else ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def do(self, work: Callable[[Item], Result], items: Sequence[Item], goes_on: Callable[[], bool]) -> Iterator[tuple[Item, Result]]:
        waiting: dict[Any, Item] = {self._client.submit(work, item, pure=False): item for item in items}
        while waiting and goes_on():
            try:
                done = self._dask.wait(list(waiting), timeout=GLANCE, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                continue
            for future in done:
                if future.cancelled():
                    raise WorkersError(f"{self.address}: the scheduler is gone, or it has cancelled the work")
                try:
                    result = future.result()
                except self._dask.KilledWorker as error:
                    raise WorkersError(f"{self.address}: {error}") from None
                yield waiting.pop(future), result
        for future in waiting:
            future.cancel()
