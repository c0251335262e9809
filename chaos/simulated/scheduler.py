"""Virtual time: tasks that run one at a time and wait without cost, and events in the order of
their time.

A task is a greenlet: the code of a process runs in it unchanged, and is left where it waits.
"""

import heapq
import itertools
from collections.abc import Callable
from functools import partial
from math import inf, nextafter

from greenlet import GreenletExit, getcurrent, greenlet

from orchard.net.bus import Inbox, Item

# s that a look at an empty inbox takes. If it took no time, a process that looks again and again
# would keep the clock from going on.
LOOK_SECONDS = 2e-5


class Scheduler:
    """The clock and the events of one schedule."""

    def __init__(self) -> None:
        # s, virtual.
        self.now = 0.0
        # A heap of (time, number, what happens).
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        # Numbers of events: those of one time happen in the order in which they were planned.
        self._numbers = itertools.count()
        # The greenlet that takes one event after the other. Tasks go on in it when they wait.
        self._hub = getcurrent()
        # The task that runs; None: none does.
        self.current: Task | None = None

    def after(self, seconds: float, act: Callable[[], object]) -> None:
        """Let `act` happen in so many seconds."""
        heapq.heappush(self._events, (self.in_future(seconds), next(self._numbers), act))

    def in_future(self, seconds: float) -> float:
        """Return the time in so many seconds.

        It is later than now, even if the seconds are too few to change the sum: else a task that
        waits for so long would wait for ever.
        """
        at = self.now + seconds
        if at == self.now and seconds > 0.0:
            return nextafter(self.now, inf)
        return max(at, self.now)

    def spawn(self, name: str, body: Callable[[], None]) -> "Task":
        """Start a task."""
        task = Task(self, self._hub, name, body)
        self.after(0.0, task.resume)
        return task

    def step(self, limit: float) -> bool:
        """Let the next event happen. Return whether there is one until the time `limit`."""
        if not self._events or self._events[0][0] > limit:
            return False
        self.now, _, act = heapq.heappop(self._events)
        act()
        return True

    def run(self, is_over: Callable[[], bool], limit: float) -> None:
        """Let events happen until `is_over()`, or until there are none before the time `limit`."""
        while not is_over() and self.step(limit):
            pass


class Task:
    """A task of a schedule: a greenlet that runs until it waits."""

    def __init__(
        self, scheduler: Scheduler, hub: greenlet, name: str, body: Callable[[], None]
    ) -> None:
        self.name = name
        # The exception that ended it.
        self.error: Exception | None = None
        self._scheduler = scheduler
        self._hub = hub
        self._greenlet = greenlet(self._run, hub)
        self._body: Callable[[], None] = body
        # The number of its present wait: what would end an earlier wait does not count.
        self._waits = 0
        # Whether it does not run, as after SIGSTOP.
        self._is_frozen = False
        # Whether it would have gone on, had it not been frozen.
        self._is_due = False
        self.is_over = False

    def _run(self) -> None:
        """Do what it is for, in its greenlet."""
        try:
            self._body()
        except Exception as error:
            self.error = error
        self.is_over = True

    def wait(self, seconds: float) -> None:
        """Let other tasks run for so long, or until `wake`. Only the task itself calls it."""
        if self.is_over:
            raise GreenletExit
        self._waits += 1
        if seconds < inf:
            self._scheduler.after(seconds, partial(self.resume, self._waits))
        self._hub.switch()

    def wake(self) -> None:
        """End its wait."""
        self._scheduler.after(0.0, partial(self.resume, self._waits))

    def resume(self, number: int = 0) -> None:
        """Go on after the wait of this number, unless that is over."""
        if self.is_over or number != self._waits:
            return
        if self._is_frozen:
            self._is_due = True
            return
        self._waits += 1
        self._scheduler.current = self
        self._greenlet.switch()
        self._scheduler.current = None

    def freeze(self) -> None:
        """Stop it until `thaw`."""
        self._is_frozen = True

    def thaw(self) -> None:
        """Let it go on."""
        self._is_frozen = False
        if self._is_due:
            self._is_due = False
            self.wake()

    def kill(self) -> None:
        """End it where it waits. Its `finally` blocks still run, up to their first wait."""
        if not self.is_over:
            self.is_over = True
            # When it has ended, its parent goes on: that is the caller.
            self._greenlet.parent = getcurrent()
            self._greenlet.throw(GreenletExit)


class VirtualInbox(Inbox):
    """An inbox that is read in virtual time, by one task."""

    def __init__(self, scheduler: Scheduler) -> None:
        super().__init__()
        self._scheduler = scheduler
        # The task that waits for an item; None: none does.
        self._reader: Task | None = None
        # The task that reads it.
        self._task: Task

    def read_by(self, task: Task) -> None:
        """Say which task reads it."""
        self._task = task

    def _settle(self) -> None:
        """Do nothing: all is in one thread."""

    def _wake(self) -> None:
        if self._reader is not None:
            self._reader.wake()

    def take(self, seconds: float = inf, enough: int = 1, look: float = Inbox.LOOK) -> Item | None:
        self._enough = enough
        deadline = self._scheduler.in_future(max(seconds, LOOK_SECONDS))
        while not self._items:
            remaining = deadline - self._scheduler.now
            if remaining <= 0.0:
                return None
            if enough > 1:
                # Items that come quietly may not wake it.
                remaining = min(remaining, look)
            self._reader = self._task
            self._task.wait(remaining)
            self._reader = None
        return self._items.popleft()
