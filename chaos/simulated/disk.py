"""The disk of a simulated process: a write takes time.

If the process is killed, half of what is being written stays. A process (processes.py) has the disk
as the executor of its bus, which writes snapshots.
"""

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from math import inf
from random import Random
from typing import Any, Protocol
from unittest.mock import patch

from chaos.simulated.half import WriterKilled, takes_half
from chaos.simulated.scheduler import Scheduler, Task

LOOK_SECONDS = 0.01  # s between two looks whether a job is done


class SurroundingWorld(Protocol):
    """What a disk needs of its world."""

    #: The clock.
    scheduler: Scheduler
    random: Random
    #: s that a write takes at most.
    disk_seconds: float
    #: How many writes the disk has taken half of.
    half_writes: int


class WritingProcess(Protocol):
    """What a disk needs of its process."""

    pid: int
    #: The task of the process, which waits for its jobs.
    task: Task


class SimulatedFuture(Future[Any]):
    """The result of a job of the disk, for which a task waits in virtual time."""

    def __init__(self, world: SurroundingWorld, task: Task) -> None:
        super().__init__()
        self._world = world
        self._task = task

    def result(self, timeout: float | None = None) -> Any:
        deadline = inf
        if timeout is not None:
            deadline = self._world.scheduler.now + timeout
        while not self.done():
            if self._world.scheduler.now >= deadline:
                raise TimeoutError
            self._task.wait(LOOK_SECONDS)
        return super().result(0)


class SimulatedDisk(Executor):
    """Does one job of a process after the other, each after some time."""

    def __init__(self, world: SurroundingWorld, process: WritingProcess) -> None:
        self._world = world
        self._process = process
        # s, virtual: when all jobs are done that it has now.
        self._free_at = 0.0
        # The jobs that are not done, the oldest first.
        self._jobs: list[Callable[[], Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = SimulatedFuture(self._world, self._process.task)
        now = self._world.scheduler.now
        seconds = self._world.random.random() * self._world.disk_seconds
        self._free_at = max(self._free_at, now) + seconds
        job = partial(fn, *args)
        self._jobs.append(job)
        self._world.scheduler.after(self._free_at - now, lambda: self._do(future, job))
        return future

    def _do(self, future: Future[Any], job: Callable[[], Any]) -> None:
        """Do a job, unless it was cancelled or its process has ended."""
        if self._process.task.is_over:
            return
        self._jobs.remove(job)
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(job())
            except Exception as error:
                future.set_exception(error)

    def break_off(self) -> None:
        """Leave half of what is being written: the process is being killed."""
        if self._jobs:
            self._world.half_writes += 1
            # The name of the file that is written has the id of the process that writes.
            number = patch.object(os, "getpid", lambda: self._process.pid)
            with suppress(WriterKilled), takes_half(WriterKilled()), number:
                self._jobs[0]()
