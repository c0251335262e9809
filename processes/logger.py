"""Streams everything that happens to Rerun: into a file, to live viewers, or both.

    python -m processes.logger --connect tcp/127.0.0.1:7447 --record runs/harvest.rrd

It only listens. What arrives waits in its inbox, so that a slow disk holds up nobody; killing it disturbs no run.
"""

import argparse
import logging
import signal
import sys
from dataclasses import replace
from pathlib import Path

from orchard.bus import Alive, Bus, BusError, Inbox, Item, Sample, Signal, client
from orchard.camera import talk_of
from orchard.config import ScenarioError, check
from orchard.frames import Event
from orchard.host import Ended, tell_refusals, told
from orchard.keys import LOGGER, PHYSICS, PREFIX, Keys
from orchard.layout import Layout, lay_out
from orchard.lockstep import Refusals, Refused, understood
from orchard.view import Recorder, optimize
from orchard.wire import End, Events, Letters, Lost, Newcomer, Picture, frame_of, read

log = logging.getLogger("orchard")


class Logger:
    """One run's pictures and words, on their way to the recorder."""

    def __init__(self, bus: Bus, keys: Keys, run: str, recorder: Recorder) -> None:
        self.bus, self.keys, self.run_id, self.recorder = bus, keys, run, recorder
        self.refusals = Refusals()
        self._events: list[Event] = []  # those that wait for the next picture

    def listen(self) -> None:
        for what in ("picture", "events", "letters", "lost", "end"):
            self.bus.subscribe(self.keys.of(what))
        self.bus.watch(self.keys.of("alive", PHYSICS))
        self.bus.declare_alive(self.keys.of("alive", LOGGER, self.bus.id))

    def run(self) -> None:
        """Record until the run ends, or somebody says stop."""
        try:
            while True:
                item = self.bus.inbox.take()
                if item is not None:
                    self._handle(item)
        except Ended as end:
            log.info("%s", end)

    def _handle(self, item: Item) -> None:
        if isinstance(item, Signal):
            raise Ended(0, "asked to stop")
        if isinstance(item, Alive) and not item.up and self.keys.parts(item.key)[2] == self.run_id:
            raise Ended(0, "physics is gone")
        if isinstance(item, Sample):
            try:
                self._hear(item)
            except Refused as refusal:
                self.refusals.note(item.key, refusal)
                tell_refusals(self.bus, self.keys, self.run_id, self.refusals)

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["picture"]:
                frame = frame_of(understood(sample.payload, Picture, self.run_id))
                self.recorder.tick(replace(frame, events=self._events))
                self._events = []
            case ["letters"]:
                for name, written in understood(sample.payload, Letters, self.run_id).letters.items():
                    answers = [(given.to, given.body) for given in written.answers]
                    self._events += map(Event._make, talk_of(name, written.requests, answers))
            case ["events"]:
                events = understood(sample.payload, Events, self.run_id).events
                self._events += [Event(event["what"], event["who"], event["whom"], event["detail"]) for event in events]
            case ["lost"]:
                lost = understood(sample.payload, Lost, self.run_id)
                self._events += [Event("lost", name, "", "its agent does not answer; it stands") for name in lost.names]
            case ["end"]:
                raise Ended(0, understood(sample.payload, End, self.run_id).why)


def main(argv: list[str] | None = None) -> int:
    arguments = _arguments(argv)
    logging.basicConfig(level=logging.WARNING, format="logger: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        with client(arguments.connect, inbox) as bus:
            _record(bus, arguments)
    except Ended as end:
        return end.code
    except (BusError, ScenarioError, ValueError, OSError) as error:
        log.error("%s", error)
        return 2
    if arguments.record is not None:
        optimize(arguments.record)
    return 0


def _record(bus: Bus, arguments: argparse.Namespace) -> None:
    keys = Keys(arguments.prefix)
    run = read(told(bus, keys.of("scenario"), b"", lambda item: None), Newcomer)
    layout = lay_out(check(run.scenario, "the scenario that physics sent"))
    recorder = _recorder(layout, run.run, arguments)
    logger = Logger(bus, keys, run.run, recorder)
    logger.listen()
    print("recording", recorder.uri or arguments.record, flush=True)
    try:
        logger.run()
    finally:
        recorder.close()


def _recorder(layout: Layout, run: str, arguments: argparse.Namespace) -> Recorder:
    if arguments.record is not None:
        arguments.record.parent.mkdir(parents=True, exist_ok=True)
    serve = {} if arguments.serve is None else {"serve": True, "port": arguments.serve}
    return Recorder(layout, run, arguments.record, **serve)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.logger", description="Record a run for Rerun.")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="where physics or a router listens: tcp/127.0.0.1:7447")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="write a recording")
    parser.add_argument("--serve", type=int, metavar="PORT", help="serve live viewers on this port of 127.0.0.1")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
