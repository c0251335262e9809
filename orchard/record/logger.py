"""Receives a run and records it with Rerun.

One thread receives and another writes, with a bounded queue between them: a slow disk delays no other process.
"""

import logging
import math
import threading
from collections import deque
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

from orchard.contract.events import Event, Frame, merged, talk_of
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import check
from orchard.net.bus import Alive, Bus, Item, Sample
from orchard.net.ending import Ending
from orchard.net.host import GONE_SECONDS, HostEnded, end_if_asked
from orchard.net.refusals import Refusals, Refused, read_message, refused_for
from orchard.net.requests import fetch_run, publish_refusals
from orchard.view.palette import Colour
from orchard.view.reader import before
from orchard.view.recorder import Recorder
from orchard.wire.codec import frame_of
from orchard.wire.keys import LOGGER, Keys
from orchard.wire.messages import (
    Bundle,
    End,
    Events,
    Letters,
    Lost,
    Picture,
    Refusal,
    SimulationState,
)

MOST = 2000  # frames that wait: 200 simulated seconds; some 70 MB for the largest orchard
MOST_NOTES = 10_000  # events that wait for a frame; a tick never has more than some hundreds
ENOUGH = 100  # bundles, of ten ticks or fewer, for which the logger does not wait longer
LOOK_SECONDS, LIVE_SECONDS = (
    0.5,
    0.05,
)  # between two looks at what has come quietly; for a file, and while viewers are served

THE_RUN = "the run"  # it is paused, and plays on
NAMELESS = "a client"  # a sender that does not say its session

log = logging.getLogger("orchard")

# -- between the thread that receives and the thread that writes


class FrameQueue:
    """The frames that wait. When it is full, the two newest become one, without the older's poses and scans."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._waiting: deque[Frame] = deque()
        self._is_closed = False
        self._change = threading.Condition()
        self.left_out = 0
        self.rest: list[Event] = []  # events after the last frame

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, frame: Frame) -> None:
        """Add a frame, without waiting for the reader."""
        with self._change:
            if len(self._waiting) >= self._most:
                frame = merged(self._waiting.pop(), frame)
                self.left_out += 1
            self._waiting.append(frame)
            self._change.notify()

    def close(self) -> None:
        with self._change:
            self._is_closed = True
            self._change.notify()

    def take(self) -> Frame | None:
        """Wait for a frame and return the oldest; None when the queue is closed and empty."""
        with self._change:
            self._change.wait_for(lambda: self._waiting or self._is_closed)
            return self._waiting.popleft() if self._waiting else None


def open_recording(
    layout: Layout, run: str, file: Path | None, port: int | None
) -> tuple[Recorder, int | None]:
    """Begin a recording, or a further part of one. Return also the last tick of the earlier parts; None without."""
    last: int | None = None
    said: Mapping[str, Mapping[str, Colour]] = {}
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file, last, said = before(file, run)
    recorder = Recorder(layout, run, file, port)
    recorder.bodies.remember(said)
    print("recording", recorder.uri or file, flush=True)
    return recorder, last


def write(queue: FrameQueue, recording: Recorder, last: int | None) -> Path | None:
    """Write all frames, and the gaps after tick `last` and between them, until the queue is closed. Return the file if all is in it."""
    recording.waiting = queue.__len__
    try:
        while (frame := queue.take()) is not None:
            first = frame.tick - frame.left_out  # tick of the first frame that this one stands for
            if last is not None and first > last + 1:
                recording.gap(last, first, "the logger was away")
            for event in (late := [event for event in frame.events if event.tick < frame.tick - 1]):
                recording.tell(event)
            recording.tick(
                replace(
                    frame, events=[event for event in frame.events if event.tick >= frame.tick - 1]
                )
                if late
                else frame
            )
            last = frame.tick
        for event in queue.rest:
            recording.tell(event)
    finally:
        file = recording.close()
    return file


# -- the thread that receives


class Logger:
    """Receives one run's frames, events and messages, and passes them to the writer."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        run: str,
        layout: Layout,
        queue: FrameQueue,
        look: float = LOOK_SECONDS,
    ) -> None:
        """`look`: s between two looks at the bundles that have come."""
        self._look, self.bus, self.keys, self.run_id, self.layout, self.queue = (
            look,
            bus,
            keys,
            run,
            layout,
            queue,
        )
        self.refusals = Refusals()
        self._notes: list[Event] = []  # events that wait for the next frame
        # s, on the bus's clock, when physics counts as gone; inf while it is alive.
        self._gone_until = math.inf
        self._ending = Ending(bus.clock)
        self._tick: int | None = None  # of the newest frame that was passed on

    def listen(self) -> None:
        """Subscribe to the run. What comes often is read together: to wake a thread for each costs more than what it does."""
        for what in ("bundle", "lost", "refusals", "simulation_state", "end"):
            self.bus.subscribe(self.keys.of(what), quietly=what == "bundle")
        self.bus.watch(self.keys.of("physics", self.run_id))

    def run(self, writing: Future[Path | None]) -> tuple[int, Path | None]:
        """Record until the run ends. Return the exit code, and the part that is whole, if any. Raises what `writing` raises."""
        code = 1
        # From here on: to open a recording may take longer on a busy machine, and that physics is
        # there waits in the inbox.
        self._gone_until = self.bus.clock() + GONE_SECONDS
        try:
            while not writing.done() and self.bus.clock() < self._gone_until:
                if (item := self.bus.inbox.take(LOOK_SECONDS, ENOUGH, self._look)) is not None:
                    self._handle(item)
        except HostEnded as end:
            code = end.code
        finally:
            self.queue.rest = self._notes
            self.queue.close()
        part = writing.result()
        if self.queue.left_out:
            log.warning(
                "%d frames came faster than they could be recorded, and are left out",
                self.queue.left_out,
            )
        return code, part

    def _handle(self, item: Item) -> None:
        end_if_asked(item)
        if isinstance(item, Alive):
            self._ending.track(item.key, item.up)
            self._gone_until = self._ending.gone_at + GONE_SECONDS
        if isinstance(item, Sample):
            try:
                self._hear(item)
            except Refused as refusal:
                self.refusals.note(item.key, refusal)
                publish_refusals(self.bus, self.keys, self.run_id, self.refusals)
        if (end := self._ending.end) is not None:
            raise HostEnded(0, end.why)

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["bundle"]:
                self._unpack(read_message(sample.payload, Bundle, self.run_id))
            case ["lost"]:
                lost = read_message(sample.payload, Lost, self.run_id)
                self._note(
                    Event(lost.tick, "lost", name, "", "its agent does not answer; the body stands")
                    for name in lost.names
                )
            case ["refusals"]:
                self._note([refusal_event(read_message(sample.payload, Refusal, self.run_id))])
            case ["simulation_state"]:
                state = read_message(sample.payload, SimulationState, self.run_id)
                self._note([Event(state.tick, state.state, THE_RUN)])
            case ["end"]:
                self._ending.hear(read_message(sample.payload, End, self.run_id))
            case _:
                raise Refused("no such key")

    def _unpack(self, bundle: Bundle) -> None:
        """Take each picture after the events and letters of its step, which are of the tick before."""
        told = [*bundle.events, *bundle.letters, *bundle.pictures]
        for message in sorted(
            told, key=lambda message: message.tick - isinstance(message, Picture)
        ):
            match message:
                case Picture():
                    with refused_for("malformed"):
                        self._see(frame_of(message, self.layout))
                case Letters():
                    self._note(talk_of(message.tick, message.letters))
                case Events():
                    self._note(message.events)

    def _note(self, events: Iterable[Event]) -> None:
        if len(self._notes) >= MOST_NOTES:
            raise Refused("too many", f"{MOST_NOTES} events wait for a frame")
        self._notes += events

    def _see(self, frame: Frame) -> None:
        """Pass a frame on. After a missed one, wait for a whole one: others contain only what has changed."""
        if frame.is_whole or (self._tick is not None and frame.tick == self._tick + 1):
            self._tick = frame.tick
            # What comes on a key of its own may be ahead of the bundles: it waits for its frame.
            frame.events = [event for event in self._notes if event.tick < frame.tick]
            self._notes = [event for event in self._notes if event.tick >= frame.tick]
            self.queue.put(frame)


def refusal_event(refusal: Refusal) -> Event:
    """Return the event of a message that physics has refused."""
    detail = f", {refusal.detail}" if refusal.detail else ""
    words = f"{refusal.key}: {refusal.reason}{detail}"
    return Event(refusal.tick, "refused", refusal.session or NAMELESS, "", words)


def record(
    bus: Bus, keys: Keys, file: Path | None, port: int | None, session: str
) -> tuple[int, Path | None]:
    """Record a run into a file, and serve viewers on a port. Return as `Logger.run` does."""
    run = fetch_run(bus, keys, end_if_asked)
    layout = lay_out(check(run.scenario, "the scenario that physics sent"))
    logger = Logger(
        bus, keys, run.run, layout, FrameQueue(), LOOK_SECONDS if port is None else LIVE_SECONDS
    )
    logger.listen()  # so what comes while earlier parts are read is not lost
    recorder, last = open_recording(layout, run.run, file, port)
    bus.declare_alive(
        keys.of("alive", LOGGER, session or bus.id)
    )  # the first tick waits for it, and a whole frame comes
    return logger.run(bus.executor.submit(write, logger.queue, recorder, last))
