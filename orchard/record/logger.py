"""Receives a run and records it with Rerun: the work of the process `processes/logger.py`.

One thread receives (`Logger`) and another writes (`write`), with a bounded queue between them
(`FrameQueue`): a slow disk delays no other process.

A frame is the picture of the orchard at a tick, with the events of the step that ended there: the
frame of tick k has the events of step k - 1. Physics publishes up to ten frames in one message, a
bundle. A recording that was stopped and went on has several files, its parts.
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
from orchard.field.layout import Layout
from orchard.net.bus import Alive, Bus, Item, Sample
from orchard.net.ending import Ending
from orchard.net.host import GONE_SECONDS, HostEnded, end_if_asked
from orchard.net.refusals import Refusals, Refused, read_message, refused_for
from orchard.net.requests import fetch_layout, publish_refusals
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
    Message,
    Refusal,
    SimulationState,
    TickStateMessage,
)

# Frames that wait: 200 simulated seconds; some 70 MB for the largest orchard.
MOST = 2000
# Events that wait for a frame; a tick never has more than some hundreds.
MOST_NOTES = 10_000
# So many bundles in the inbox wake the logger before its next look.
ENOUGH = 100
# Bundles come quietly: they wake no thread. The logger looks for them so often if it writes a file,
LOOK_SECONDS = 0.5
# and so often if people watch the run.
LIVE_SECONDS = 0.05

# The subject of the events "paused" and "playing".
THE_RUN = "the run"
# The subject of the event "refused", if the sender did not give its session.
NAMELESS = "a client"

log = logging.getLogger("orchard")

# -- between the thread that receives and the thread that writes


class FrameQueue:
    """The frames that wait for the thread that writes.

    When the queue is full, the newest frame in it and the next one become one, which has the events
    of both, and poses and scans of the next one only.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._waiting: deque[Frame] = deque()
        self._is_closed = False
        self._change = threading.Condition()
        # Frames that went into the one after them, because the queue was full.
        self.left_out = 0
        # Events after the last frame, which the writer adds at the end.
        self.rest: list[Event] = []

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
        """Let the reader end once the queue is empty."""
        with self._change:
            self._is_closed = True
            self._change.notify()

    def take(self) -> Frame | None:
        """Wait for a frame and return the oldest; None when the queue is closed and empty."""
        with self._change:
            self._change.wait_for(lambda: self._waiting or self._is_closed)
            if not self._waiting:
                return None
            return self._waiting.popleft()


def open_recording(
    layout: Layout, run: str, file: Path | None, port: int | None
) -> tuple[Recorder, int | None]:
    """Begin a recording, or a further part of one, and say on stdout where it is.

    Return the recorder, and the last tick of the earlier parts; None if there are none. `file`:
    None if nothing is written. `port`: of the server for viewers; None without a server.
    """
    last: int | None = None
    shown: Mapping[str, Mapping[str, Colour]] = {}
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file, last, shown = before(file, run)
    recorder = Recorder(layout, run, file, port)
    recorder.bodies.remember(shown)
    print("recording", recorder.uri or file, flush=True)
    return recorder, last


def write(queue: FrameQueue, recording: Recorder, last: int | None) -> Path | None:
    """Write all frames, and the gaps after tick `last` and between them, until the queue is closed.

    Return the file if all is in it; None if the disk was full, or nothing is written.
    """
    # The recorder sends rows in larger groups while many frames wait.
    recording.waiting = queue.__len__
    try:
        while (frame := queue.take()) is not None:
            # The tick of the first frame that this one stands for.
            first = frame.tick - frame.left_out
            if last is not None and first > last + 1:
                recording.gap(last, first, "the logger was away")
            last = frame.tick
            _write_frame(recording, frame)
        for event in queue.rest:
            recording.tell(event)
    finally:
        file = recording.close()
    return file


def _write_frame(recording: Recorder, frame: Frame) -> None:
    """Write a frame. Events of earlier steps than its own, which came late, are written before."""
    late = [event for event in frame.events if event.tick < frame.tick - 1]
    for event in late:
        recording.tell(event)
    if late:
        own = [event for event in frame.events if event.tick >= frame.tick - 1]
        frame = replace(frame, events=own)
    recording.tick(frame)


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
        *,
        look: float = LOOK_SECONDS,
    ) -> None:
        """`look`: s between two looks at the bundles that have come."""
        self._look = look
        self.bus = bus
        self.keys = keys
        self.run_id = run
        self.layout = layout
        self.queue = queue
        self.refusals = Refusals()
        # Events that wait for the next frame.
        self._notes: list[Event] = []
        # When the logger gives up, s on the bus's clock: some time after physics has gone. Infinite
        # while physics is alive.
        self._gone_until = math.inf
        self._ending = Ending(bus.clock)
        # The tick of the newest frame that was passed on.
        self._tick: int | None = None

    def listen(self) -> None:
        """Subscribe to the run.

        What comes often is read together: to wake a thread for each costs more than what it does.
        """
        for key in ("bundle", "lost", "refusals", "simulation_state", "end"):
            self.bus.subscribe(self.keys.of(key), quietly=key == "bundle")
        self.bus.watch(self.keys.of("physics", self.run_id))

    def run(self, writing: Future[Path | None]) -> tuple[int, Path | None]:
        """Record until the run ends.

        Return the exit code, and the part that is whole, if any. Raises what `writing` raises.
        `writing`: the writer's thread; it is done before the run only if it has failed.
        """
        code = 1
        # The time is measured from here on, and not from the subscription: to open a recording may
        # take longer on a busy machine. Meanwhile the news that physics is alive wait in the inbox.
        self._gone_until = self.bus.clock() + GONE_SECONDS
        try:
            while not writing.done() and self.bus.clock() < self._gone_until:
                item = self.bus.inbox.take(LOOK_SECONDS, ENOUGH, self._look)
                if item is not None:
                    self._handle(item)
            if not writing.done():
                log.error(
                    "physics is gone; waited for %g s: %s", GONE_SECONDS, self._what_is_kept()
                )
        except HostEnded as end:
            code = end.code
        finally:
            self.queue.rest = self._notes
            self.queue.close()
        part = writing.result()
        left_out = self.queue.left_out
        if left_out:
            fault = "came faster than they could be recorded, and are left out"
            log.warning("%d frames %s", left_out, fault)
        return code, part

    def _what_is_kept(self) -> str:
        """Return how far the recording goes."""
        if self._tick is None:
            return "nothing is recorded"
        return f"the recording ends at tick {self._tick}"

    def _handle(self, item: Item) -> None:
        """Handle an item. Raises HostEnded if the run is over."""
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
        end = self._ending.end
        if end is not None:
            raise HostEnded(0, end.why)

    def _hear(self, sample: Sample) -> None:
        """Take what is published. Raises Refused."""
        match self.keys.parts(sample.key):
            case ["bundle"]:
                self._unpack(read_message(sample.payload, Bundle, self.run_id))
            case ["lost"]:
                lost = read_message(sample.payload, Lost, self.run_id)
                detail = "its agent does not answer; the body stands"
                self._note([Event(lost.tick, "lost", name, "", detail) for name in lost.names])
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
        """Take each picture after the events and letters of its step, which have a tick less."""
        messages = [*bundle.events, *bundle.letters, *bundle.pictures]
        for message in sorted(messages, key=_step_of):
            match message:
                case TickStateMessage():
                    with refused_for("malformed"):
                        self._see(frame_of(message, self.layout))
                case Letters():
                    self._note(talk_of(message.tick, message.letters))
                case Events():
                    self._note(message.events)

    def _note(self, events: Iterable[Event]) -> None:
        """Keep events for the next frame. Raises Refused if there are too many."""
        if len(self._notes) >= MOST_NOTES:
            raise Refused("too many", f"{MOST_NOTES} events wait for a frame")
        self._notes += events

    def _see(self, frame: Frame) -> None:
        """Pass a frame on.

        After a missed one, wait for a whole one: others contain only what has changed.
        """
        if frame.is_whole or (self._tick is not None and frame.tick == self._tick + 1):
            self._tick = frame.tick
            # An event that has come on a key of its own, outside the bundles, may be of a later
            # step: it waits for the frame of that step.
            frame.events = [event for event in self._notes if event.tick < frame.tick]
            self._notes = [event for event in self._notes if event.tick >= frame.tick]
            self.queue.put(frame)


def _step_of(message: Message) -> int:
    """Return the tick of a message's step. A picture has the tick at the end of its step."""
    if isinstance(message, TickStateMessage):
        return message.tick - 1
    return message.tick


def refusal_event(refusal: Refusal) -> Event:
    """Return the event of a message that physics has refused."""
    words = f"{refusal.key}: {refusal.reason}"
    if refusal.detail:
        words += f", {refusal.detail}"
    return Event(refusal.tick, "refused", refusal.session or NAMELESS, "", words)


def record(
    bus: Bus, keys: Keys, file: Path | None, port: int | None, session: str
) -> tuple[int, Path | None]:
    """Record a run into a file, and serve viewers on a port. Return as `Logger.run` does."""
    run, layout = fetch_layout(bus, keys, end_if_asked)
    look = LOOK_SECONDS
    if port is not None:
        look = LIVE_SECONDS
    logger = Logger(bus, keys, run.run, layout, FrameQueue(), look=look)
    # It listens before it opens the recording: what comes while earlier parts are read is not lost.
    logger.listen()
    recorder, last = open_recording(layout, run.run, file, port)
    # Physics does the first tick after it has seen this token. To a logger that comes later it
    # sends a whole frame then.
    bus.declare_alive(keys.of("alive", LOGGER, session or bus.id))
    return logger.run(bus.executor.submit(write, logger.queue, recorder, last))
