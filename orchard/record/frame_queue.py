"""What waits between the logger that hears and the recorder that writes: never more than so many pictures, however slow the writing is."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Protocol

from orchard.contract.events import Event, Frame, merged

MOST = 1000  # pictures that wait: 100 simulated seconds; of the largest orchard some 35 MB
AWAY = "the logger was away"

log = logging.getLogger("orchard")


class QueuedFrame(NamedTuple):
    """A picture, and what was said and done since the one before, each with its tick."""

    frame: Frame
    notes: list[Event]


class Recording(Protocol):
    """Where pages go: orchard.view.Recorder."""

    def tick(self, frame: Frame) -> None: ...
    def gap(self, since: int, until: int, why: str) -> None: ...
    def tell(self, event: Event) -> None: ...
    def close(self) -> None: ...


class FrameQueue:
    """Those that wait, between two threads. When too many do, the newest two become one: only the older's poses and scans are lost."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._waiting: deque[QueuedFrame] = deque()
        self._is_closed = False
        self._change = threading.Condition()
        self.left_out = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, page: QueuedFrame) -> None:
        """At once, whoever reads."""
        with self._change:
            if len(self._waiting) >= self._most:
                newest = self._waiting.pop()
                page = QueuedFrame(merged(newest.frame, page.frame), newest.notes + page.notes)
                self.left_out += 1
            self._waiting.append(page)
            self._change.notify()

    def close(self) -> None:
        """Nothing more will come."""
        with self._change:
            self._is_closed = True
            self._change.notify()

    def take(self) -> QueuedFrame | None:
        """The oldest, once there is one; None when there will be none."""
        with self._change:
            while not self._waiting and not self._is_closed:
                self._change.wait()
            return self._waiting.popleft() if self._waiting else None


class Writer(threading.Thread):
    """Writes pages, in a thread of its own, as fast as it can. What goes wrong in it is its `error`."""

    def __init__(self, pages: FrameQueue, begin: Callable[[], tuple[Recording, int | None]]) -> None:
        """`begin` gives what is written to, and the last tick that was recorded before; None if there is nothing to go on from."""
        super().__init__(name="writer", daemon=True)
        self._pages, self._begin = pages, begin
        self.error: Exception | None = None

    def run(self) -> None:
        try:
            recording, last = self._begin()
            try:
                write(self._pages, recording, last)
            finally:
                recording.close()
        except Exception as error:
            self.error = error


def write(pages: FrameQueue, recording: Recording, last: int | None) -> None:
    """All pages, until there will be no more."""
    while (page := pages.take()) is not None:
        frame = page.frame
        first = frame.tick - frame.left_out  # of those that this one stands for
        if last is not None and first > last + 1:
            recording.gap(last, first, AWAY)
        for event in page.notes:
            if event.tick < frame.tick - 1:
                recording.tell(event)
        recording.tick(replace(frame, events=[event for event in page.notes if event.tick >= frame.tick - 1]))
        last = frame.tick
