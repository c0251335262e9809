"""Streams everything that happens to Rerun: into a file, to live viewers, or both.

    python -m processes.logger --connect tcp/127.0.0.1:7447 --record runs/harvest.rrd

It only listens: one thread hears, another writes, and between them wait so many pictures at most (pages.py), so that a slow disk
holds up nobody. Killing it disturbs no run. Started again with the same file it goes on in a further part of the recording.
"""

import argparse
import logging
import math
import signal
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

from orchard.contract.events import Event, Frame
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check
from orchard.net.bus import Alive, Bus, Inbox, Item, Sample, Signal, client
from orchard.net.endpoints import BusError
from orchard.net.host import GONE_SECONDS, HostEnded
from orchard.net.refusals import Refusals, Refused, read_message
from orchard.net.requests import fetch_run, publish_refusals
from orchard.record.frame_queue import FrameQueue, QueuedFrame, Writer
from orchard.security.identity import identity_in
from orchard.sim.frames import talk_of
from orchard.view.reader import before, optimize
from orchard.view.recorder import Recorder
from orchard.wire.codec import frame_of
from orchard.wire.keys import LOGGER, PHYSICS, PREFIX, Keys
from orchard.wire.messages import End, Events, Letters, Lost, Picture

log = logging.getLogger("orchard")

MOST_NOTES = 10_000  # that wait for a picture; of a tick there are never more than some hundreds
LOOK_SECONDS = 0.5  # between two looks whether the writer still writes


class Logger:
    """One run's pictures and words, on their way to the writer."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout, pages: FrameQueue) -> None:
        self.bus, self.keys, self.run_id, self.layout, self.pages = bus, keys, run, layout, pages
        self.refusals = Refusals()
        self._notes: list[Event] = []  # those that wait for the next picture
        self._gone_until = math.inf  # on the clock: when physics, which is gone, counts as gone for ever
        self._tick: int | None = None  # of the newest picture that is of use

    def listen(self, session: str) -> None:
        """Physics sends a whole picture once the token is there."""
        for what in ("picture", "events", "letters", "lost", "end"):
            self.bus.subscribe(self.keys.of(what))
        self.bus.watch(self.keys.of("alive", PHYSICS))
        self.bus.declare_alive(self.keys.of("alive", LOGGER, session))

    def run(self, writer: Writer) -> int:
        """Record until the run ends, or somebody says stop; the exit code. Raises what went wrong with the writing."""
        code = self._hear_all(writer)
        self.pages.close()
        writer.join()
        if writer.error is not None:
            raise writer.error
        if self.pages.left_out:
            log.warning("%d pictures came faster than they could be recorded, and are left out", self.pages.left_out)
        return code

    def _hear_all(self, writer: Writer) -> int:
        try:
            while writer.error is None and time.monotonic() < self._gone_until:
                item = self.bus.inbox.take(LOOK_SECONDS)
                if item is not None:
                    self._handle(item)
        except HostEnded as end:
            log.info("%s", end)
            return end.code
        return 1 if self._gone_until < math.inf else 0

    def _handle(self, item: Item) -> None:
        if isinstance(item, Signal):
            raise HostEnded(0, "asked to stop")
        if isinstance(item, Alive) and item.key == self.keys.of("alive", PHYSICS, self.run_id):
            self._gone_until = math.inf if item.up else time.monotonic() + GONE_SECONDS
        if isinstance(item, Sample):
            try:
                self._hear(item)
            except Refused as refusal:
                self.refusals.note(item.key, refusal)
                publish_refusals(self.bus, self.keys, self.run_id, self.refusals)

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["picture"]:
                self._see(self._frame(sample.payload))
            case ["letters"]:
                letters = read_message(sample.payload, Letters, self.run_id)
                for name, written in letters.letters.items():
                    answers = [(given.to, given.body) for given in written.answers]
                    self._note(talk_of(letters.tick, name, written.requests, answers))
            case ["events"]:
                self._note(read_message(sample.payload, Events, self.run_id).events)
            case ["lost"]:
                lost = read_message(sample.payload, Lost, self.run_id)
                self._note(Event(lost.tick, "lost", name, "", "its agent does not answer; it stands") for name in lost.names)
            case ["end"]:
                raise HostEnded(0, read_message(sample.payload, End, self.run_id).why)
            case _:
                raise Refused("no such key")

    def _note(self, events: Iterable[Event]) -> None:
        if len(self._notes) >= MOST_NOTES:
            raise Refused("too many", f"{MOST_NOTES} notes wait for a picture")
        self._notes += events

    def _frame(self, payload: bytes) -> Frame:
        picture = read_message(payload, Picture, self.run_id)
        try:
            return frame_of(picture, self.layout)
        except ValueError as error:
            raise Refused("malformed", str(error)) from error

    def _see(self, frame: Frame) -> None:
        """Pass a picture on; after one that was missed only a whole one, because others tell only what has changed."""
        if frame.is_whole or (self._tick is not None and frame.tick == self._tick + 1):
            self._tick = frame.tick
            self.pages.put(QueuedFrame(frame, self._notes))
            self._notes = []


def main(argv: list[str] | None = None) -> int:
    arguments = _arguments(argv)
    logging.basicConfig(level=logging.WARNING, format="logger: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        with client(arguments.connect, inbox, identity=identity_in(arguments.secure, arguments.prefix)) as bus:
            code, file = _record(bus, arguments)
    except HostEnded as end:
        return end.code
    except (BusError, ScenarioError, ValueError, OSError, RuntimeError) as error:
        log.error("%s", error)
        return 2
    if file is not None and code == 0:
        optimize(file)
    return code


def _record(bus: Bus, arguments: argparse.Namespace) -> tuple[int, Path | None]:
    """The exit code, and the part that was written."""
    keys = Keys(arguments.prefix)
    run = fetch_run(bus, keys)
    layout = lay_out(check(run.scenario, "the scenario that physics sent"))
    opening, logger = Opening(layout, run.run, arguments.record, arguments.serve), Logger(bus, keys, run.run, layout, FrameQueue())
    logger.listen(arguments.session or bus.id)
    writer = Writer(logger.pages, opening.begin)
    writer.start()
    return logger.run(writer), opening.file


class Opening:
    """How a recording begins, or goes on: what is there of this run is read, while the logger hears already what comes next."""

    def __init__(self, layout: Layout, run: str, file: Path | None, port: int | None) -> None:
        self.layout, self.run_id, self.file, self.port = layout, run, file, port

    def begin(self) -> tuple[Recorder, int | None]:
        """The recorder, and the last tick that was recorded before; None where there is no file to tell it."""
        last: int | None = None
        said: Mapping[str, list[str]] = {}
        if self.file is not None:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            self.file, last, said = before(self.file, self.run_id)
        recorder = Recorder(self.layout, self.run_id, self.file, serve=self.port is not None, port=self.port or 0)
        recorder.bodies.remember(said)
        print("recording", recorder.uri or self.file, flush=True)
        return recorder, last


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.logger", description="Record a run for Rerun.")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="where physics or a router listens: tcp/127.0.0.1:7447")
    parser.add_argument("--secure", metavar="DIR", help="the role's directory: that of the logger")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="write a recording, or a further part of one of the same run")
    parser.add_argument("--serve", type=int, metavar="PORT", help="serve live viewers on this port of 127.0.0.1")
    parser.add_argument("--session", default="", metavar="ID", help="letters and digits that name it in its liveliness token")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
