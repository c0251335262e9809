"""Owns the world and the clock: publishes each tick, waits for every agent's answer, steps.

    python -m processes.physics config/orchard.yaml --listen tcp/127.0.0.1:7447

It is the router for the others. There is no agent in it: a robot that nobody drives stands still. In realtime it waits no longer
than the clock allows: `lockstep.Answers` and `realtime.Live` decide when a tick's answers are in.
"""

import argparse
import logging
import math
import signal
import sys
import time
import uuid
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from orchard import wire
from orchard.agent import Observation
from orchard.bus import LOOPBACK, Alive, Bus, BusError, Inbox, Item, Question, Sample, Signal, client, router
from orchard.camera import Camera
from orchard.config import TIME_STEP, Scenario, ScenarioError, load
from orchard.keys import PHYSICS, PREFIX, Keys
from orchard.kinds import KINDS
from orchard.lockstep import Answers, Loose, Memories, Pacer, Refusals, Refused, Roster, understood
from orchard.messages import pack
from orchard.names import chosen
from orchard.realtime import Live
from processes.account import Account
from processes.announcer import Announcer

if TYPE_CHECKING:
    from orchard.engine import Engine

log = logging.getLogger("orchard")

NAG_SECONDS = 3.0  # between two lines that name who is missing
MOST_SESSIONS = 1000  # whose refusals are added up
FAREWELL_SECONDS = 2.0  # for how long the others may take to leave


@dataclass(frozen=True)
class Options:
    """How a run is run."""

    mode: str = "lockstep"
    speed: float = math.inf  # simulated seconds to one second of wall time
    ticks: float = math.inf  # after which it ends
    patience: float = 15.0  # s, for how long an agent may be silent
    absent: tuple[str, ...] = ()  # agents that are not waited for at the beginning
    run: str = ""  # the run's id; '': one is made


class Stopped(Exception):
    """Somebody ended the run."""


def _answers(roster: Roster, options: Options) -> Answers | Live:
    """Who decides when a tick's answers are in."""
    return Live(roster, TIME_STEP / options.speed) if options.mode == "realtime" else Answers(roster, options.patience)


class Physics:
    """One run, from the first agent to the last message."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: Options) -> None:
        self.bus, self.keys, self.engine, self.options = bus, keys, engine, options
        self.run_id = options.run or uuid.uuid4().hex[:16]
        self.account, self.camera = Account(engine), Camera(engine.world)
        self.roster = Roster(engine.agents)
        self.answers: Answers | Live = _answers(self.roster, options)
        self.announcer = Announcer(bus, keys, self.run_id, engine.layout, self.answers.newest_wins)
        self.loose, self.memories = Loose(), Memories()
        self.refusals = Refusals()
        self._refused_there: dict[str, dict[str, int]] = {}  # session -> what it refused
        self.pacer = Pacer(options.speed)
        self._seen: dict[str, Observation] = {}

    def listen(self) -> None:
        self.bus.subscribe(self.keys.of("velocity"), quietly=True)
        self.bus.subscribe(self.keys.of("refused"))
        for what in ("scenario", "join", "command"):
            self.bus.answer(self.keys.of(what))
        self.bus.watch(self.keys.of("alive"))
        self.bus.declare_alive(self.keys.of("alive", PHYSICS, self.run_id))

    def run(self) -> wire.End:
        """All ticks; the end that was told to everybody."""
        try:
            self._gather()
            self.account.begin()
            while not (why := self._end()):
                self._tick()
        except Stopped as stop:
            why = str(stop)
        end = self._summary(why)
        self.announcer.say("end", end)
        self._farewell()
        return end

    # -- the ticks

    def _gather(self) -> None:
        """Wait for all agents that are expected."""
        while missing := [name for name in self.roster.names if not self._is_expected_no_more(name)]:
            if not self._take(NAG_SECONDS):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))

    def _is_expected_no_more(self, name: str) -> bool:
        return name in self.roster.holders or name in self.options.absent or self.loose.drives(name)

    def _end(self) -> str:
        """Why the run is over; '' if it is not."""
        if self.engine.over:
            return "harvested"
        if self.engine.tick >= self.options.ticks:
            return "duration"
        return "\n".join(["jammed", *self.account.jam]) if self.account.jam else ""

    def _tick(self) -> None:
        tick = self.engine.tick
        self._seen = self.engine.observe()
        lag = self._pause()
        self.loose.begin(tick)
        self.answers.open(tick, lag)
        self.announcer.look(tick, self._seen, self.roster.by_holder())
        self._await_answers()
        actions = self.answers.actions() | self.loose.actions(tick)
        self.memories.keep(self.answers.velocities)
        events = self.engine.advance(actions, self.answers.digests())
        self.account.update(events, actions)
        self.announcer.happened(tick, events)
        self.announcer.say("picture", wire.picture_of(self.run_id, self.camera.frame(self.engine.scans, actions, events)))
        if self.account.is_due():
            self.announcer.say("figures", self.account.message(self.run_id, self._refused()))

    def _pause(self) -> float:
        """Until the tick's time has come; so many seconds after it."""
        while self._take(self.pacer.wait()) or self.pacer.wait():
            pass
        return self.pacer.begin()

    def _await_answers(self) -> None:
        answers = self.answers
        while answers.missing:
            self._take(max(0.0, answers.deadline - time.monotonic()), len(answers.missing))
            if time.monotonic() >= answers.deadline:
                self._release(answers.give_up())

    def _release(self, names: set[str]) -> None:
        """Nobody holds these agents any more."""
        for name in names:
            self.answers.release(name)
        self.announcer.lost(self.engine.tick, self.roster.release(names))

    def _summary(self, why: str) -> wire.End:
        engine, run = self.engine, {"mode": self.answers.mode, "hosts": len(set(self.roster.holders.values()))}
        figures = self.account.figures() | self.answers.figures()
        summary = {"hash": engine.hash} | run | figures | {"messages_refused": self._refused()}
        summary["finished"] = engine.over
        return wire.End(self.run_id, engine.tick, engine.over, why, engine.hash, summary)

    def _farewell(self) -> None:
        """Stay until all others have gone, so that the last message reaches them, but not for long."""
        self.roster.holders.clear()
        deadline = time.monotonic() + FAREWELL_SECONDS
        while self.roster.anybody() and (left := deadline - time.monotonic()) > 0:
            try:
                self._take(left)
            except Stopped:
                return

    # -- what arrives

    def _take(self, seconds: float, enough: int = 1) -> bool:
        """Handle one item; False if none came in time."""
        item = self.bus.inbox.take(seconds, enough)
        if item is not None:
            try:
                self._handle(item)
            except Refused as refusal:
                self.refusals.note(getattr(item, "key", ""), refusal)
        return item is not None

    def _handle(self, item: Item) -> None:
        if isinstance(item, Sample):
            self._hear(item)
        elif isinstance(item, Alive):
            self._token(item)
        elif isinstance(item, Question):
            self._reply(item)
        elif isinstance(item, Signal):
            raise Stopped("stopped")

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["hosts", session, "refused"]:
                counts = understood(sample.payload, wire.RefusedThere, self.run_id).counts
                if len(self._refused_there) < MOST_SESSIONS or session in self._refused_there:
                    self._refused_there[session] = counts
            case [name, "velocity"]:
                self._drive(name, sample.payload)

    def _refused(self) -> dict[str, int]:
        """What all have refused, by reason."""
        total = Counter(self.refusals.counts)
        for counts in self._refused_there.values():
            total.update(counts)
        return dict(sorted(total.items()))

    def _token(self, alive: Alive) -> None:
        _, name, holder = self.keys.parts(alive.key)
        if name == PHYSICS:
            self._refuse_another_run(alive.up, holder)
            return
        self.roster.token(name, holder, alive.up)
        if self.answers.releases_at_once and not alive.up and self.roster.holders.get(name) == holder:
            self._release({name})

    def _refuse_another_run(self, up: bool, run: str) -> None:
        """Before the first tick: at one router there is one run to a prefix."""
        if up and run != self.run_id and self.answers.tick < 0:
            raise BusError(f"{self.bus.endpoint}: run {run} goes on there, with prefix {self.keys.prefix}; choose another router or prefix")

    def _drive(self, name: str, payload: bytes) -> None:
        velocity = understood(payload, wire.Velocity, self.run_id)
        self._refuse_what_cannot_be(name, velocity)
        if name in self.roster.holders:
            self.answers.take(name, velocity)
        else:
            self.loose.take(name, velocity)

    def _refuse_what_cannot_be(self, name: str, velocity: wire.Velocity) -> None:
        layout = self.engine.layout
        if name not in layout.index:
            if name in self.roster.holders:
                return
            raise Refused("no such robot", name)
        kind = layout.starts[layout.index[name]].kind
        if velocity.linear.y and not KINDS[kind].sideways:
            raise Refused("out of bounds", f"linear.y: a {kind} does not move sideways")

    def _reply(self, question: Question) -> None:
        """Answer a query; nonsense gets an error."""
        reply = {"scenario": self._tell, "join": self._join, "command": self._obey}[self.keys.parts(question.key)[0]]
        try:
            reply(question)
        except Refused as refusal:
            question.refuse(str(refusal))
            raise
        question.drop()

    def _tell(self, question: Question) -> None:
        if question.payload:
            raise Refused("malformed", "the scenario query has no payload")
        scenario = self.engine.layout.scenario.model_dump()
        question.reply(pack(wire.Newcomer(self.run_id, self.engine.tick, self.answers.mode, list(self.roster.names), scenario)))

    def _join(self, question: Question) -> None:
        """Let a host hold all the agents that it names, or none."""
        join = understood(question.payload, wire.Join, self.run_id)
        refused = {name: why for name in join.names if (why := self.roster.may_join(name, join.holder))}
        held = [] if refused else join.names
        for name in held:
            self.roster.join(name, join.holder)
        question.reply(pack(wire.Joined(self.run_id, self.engine.tick, {name: self.memories.of(name) for name in held}, refused)))
        if held and self.answers.tick == self.engine.tick:
            self._bring_up(join.holder, held)

    def _bring_up(self, holder: str, joined: list[str]) -> None:
        """Show a newcomer the tick that is under way, and wait for it."""
        for name in joined:
            self.answers.expect(name)
        names = self.roster.by_holder()[holder]
        self.announcer.look(self.answers.tick, self._seen, {holder: names}, names)

    def _obey(self, question: Question) -> None:
        command = understood(question.payload, wire.Command, self.run_id)
        question.reply(pack(wire.Done(self.run_id, self.engine.tick)))
        question.drop()
        raise Stopped(f"{command.command}ped")


# -- the process


def main(argv: list[str] | None = None) -> int:
    arguments = _arguments(argv)
    logging.basicConfig(level=logging.WARNING, format="physics: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        scenario = load(arguments.scenario) if arguments.scenario else Scenario()
        keys = Keys(arguments.prefix)
        meeting = client(arguments.connect, inbox) if arguments.connect else router(arguments.listen, inbox)
        with meeting as bus:
            return _run(bus, keys, scenario, arguments)
    except (BusError, ScenarioError, ValueError) as error:
        log.error("%s", error)
        return 2


def _run(bus: Bus, keys: Keys, scenario: Scenario, arguments: argparse.Namespace) -> int:
    # Late, because numba takes seconds to load on a busy machine, and meanwhile the others can find the router.
    from orchard.engine import Engine

    engine = Engine.begin(scenario)
    absent = chosen(engine.agents, arguments.absent, []) if arguments.absent else []
    ticks = math.inf if arguments.duration is None else round(arguments.duration / TIME_STEP)
    physics = Physics(bus, keys, engine, Options(arguments.mode, _pace(arguments), ticks, arguments.patience, tuple(absent), arguments.run))
    physics.listen()
    where = "connected to" if arguments.connect else "listening on"
    print(f"{where} {bus.endpoint}, prefix {keys.prefix}, run {physics.run_id}", flush=True)
    end = physics.run()
    print(f"{end.why}: tick {end.tick}, {end.summary['wall_seconds']} s, hash {end.hash}", flush=True)
    return 1 if end.why.startswith("jammed") else 0


def _speed(text: str) -> float:
    speed = math.inf if text == "max" else float(text)
    if not speed > 0:
        raise ValueError
    return speed


def _pace(arguments: argparse.Namespace) -> float:
    """Simulated seconds to a second, which realtime needs to know."""
    speed = arguments.speed if arguments.speed is not None else 1.0 if arguments.mode == "realtime" else math.inf
    if arguments.mode == "realtime" and math.isinf(speed):
        raise ValueError("--speed max: in realtime the wall clock sets the pace; wanted is a number, 1 for real time")
    return speed


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise ValueError
    return value


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.physics", description="Own the world and the clock of an orchard.")
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO.yaml", help="default: the built-in scenario")
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--listen", default=LOOPBACK, metavar="ENDPOINT", help="default: a free port of 127.0.0.1")
    place.add_argument("--connect", metavar="ENDPOINT", help="that of a router elsewhere")
    parser.add_argument("--run", default="", metavar="ID", help="the run's id; default: a new one")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--mode", choices=["lockstep", "realtime"], default="lockstep", help="wait for all agents, or for none")
    parser.add_argument("--speed", type=_speed, metavar="X|max", help="simulated seconds to a second; default max, in realtime 1")
    parser.add_argument("--duration", type=_positive, metavar="SECONDS", help="simulated seconds after which the run ends")
    parser.add_argument("--patience", type=_positive, default=15.0, metavar="SECONDS", help="how long an agent may be silent")
    parser.add_argument("--absent", action="append", default=[], metavar="KIND|NAME", help="do not wait for these (repeatable)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
