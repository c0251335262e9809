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
from collections.abc import Collection
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from orchard.agent import Action
from orchard.bus import Alive, Bus, Inbox, Item, Question, Sample, Signal, client, router
from orchard.camera import Camera
from orchard.config import TIME_STEP, Scenario, ScenarioError, load
from orchard.endpoints import LOOPBACK, SECURE_LOOPBACK, BusError
from orchard.identity import Identity, identity_in
from orchard.keys import LOGGER, PHYSICS, PREFIX, Keys
from orchard.kinds import KINDS
from orchard.lockstep import (
    AGAIN_SECONDS,
    PATIENCE,
    Answers,
    Ledger,
    Loose,
    Pacer,
    Refusals,
    Refused,
    Roster,
    refuse_other_tick,
    understood,
)
from orchard.messages import pack
from orchard.names import chosen
from orchard.realtime import Live
from orchard.sights import Sights
from orchard.snapshot import Snapshot, SnapshotError
from orchard.stops import stopped
from orchard.wire.course import Command, Done, End, Join, Joined, Newcomer, Reason, RefusedThere, Stop, Stopped
from orchard.wire.driving import Velocities, Velocity
from orchard.wire.letters import Recall, Recalled
from orchard.wire.translate import picture_of, velocity_of
from orchard.wire.vocabulary import Session
from processes.account import Account
from processes.announcer import Announcer
from processes.keeper import SNAPSHOT_SECONDS, Keeper, last

if TYPE_CHECKING:
    from orchard.engine import Engine
    from orchard.events import Event

log = logging.getLogger("orchard")

NAG_SECONDS = 3.0  # between two lines that name who is missing
MOST_SESSIONS = 1000  # whose refusals are added up
LOGGER_SECONDS = 10.0  # for how long the first tick waits for a logger
FAREWELL_SECONDS = 2.0  # for how long the others may take to leave


@dataclass(frozen=True)
class Options:
    """How a run is run."""

    mode: str = "lockstep"
    speed: float = math.inf  # simulated seconds to one second of wall time
    ticks: float = math.inf  # after which it ends
    patience: float = PATIENCE  # s, for how long an agent may be silent
    absent: tuple[str, ...] = ()  # agents that are not waited for at the beginning
    run: str = ""  # the run's id; '': one is made
    recorded: bool = False  # a logger comes: wait for it, but not for long
    snapshots: Path | None = None  # the folder for them
    snapshot_every: float = SNAPSHOT_SECONDS  # s of wall time


class Step(NamedTuple):
    """What was done at a tick, and what happened."""

    tick: int
    events: "list[Event]"
    actions: dict[str, Action]


class Ended(Exception):
    """Somebody ended the run."""


def _answers(roster: Roster, options: Options) -> Answers | Live:
    """Who decides when a tick's answers are in."""
    return Live(roster, TIME_STEP / options.speed) if options.mode == "realtime" else Answers(roster, options.patience)


class Physics:
    """One run, from the first agent to the last message."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: Options, before: Snapshot | None = None) -> None:
        """`before`: the snapshot that the engine was made of."""
        self.bus, self.keys, self.engine, self.options = bus, keys, engine, options
        self.run_id = options.run or (before.run if before else uuid.uuid4().hex[:16])
        self.account, self.camera = Account(engine, before.figures if before else {}), Camera(engine.world)
        self.roster = Roster(engine.agents)
        self.answers: Answers | Live = _answers(self.roster, options)
        self.announcer = Announcer(bus, keys, self.run_id, engine.layout, self.answers.newest_wins)
        self.loose, self.ledger = Loose(), Ledger(before.memories, before.letters) if before else Ledger()
        self.keeper = Keeper(options.snapshots, options.snapshot_every)
        self.refusals = Refusals()
        self._held_before = before.held if before else None
        self._refused_there: dict[str, dict[Reason, int]] = {}  # session -> what it refused
        self.pacer = Pacer(options.speed)
        self._seen: Sights | None = None
        self._undelivered = False  # whether a request of this tick may not have arrived
        self._recall = False  # whether one of the last tick did not
        self._stepped: Step | None = None  # that is not yet accounted for

    def listen(self) -> None:
        self.bus.subscribe(self.keys.of("velocities"), quietly=True)
        self.bus.subscribe(self.keys.of("velocity"), quietly=True)
        self.bus.subscribe(self.keys.of("refused"))
        for what in ("scenario", "join", "recall", "stop", "command"):
            self.bus.answer(self.keys.of(what))
        self.bus.watch(self.keys.of("alive"))
        self.bus.declare_alive(self.keys.of("alive", PHYSICS, self.run_id))

    def run(self) -> End:
        """All ticks; the end that was told to everybody."""
        try:
            self._gather()
            self.account.begin()
            self.announcer.say("figures", self.account.message(self.run_id, self._refused()))
            while not (why := self._end()):
                self._tick()
        except Ended as stop:
            why = str(stop)
        self._account()
        if why == "stopped":
            self.keeper.keep(self.snapshot())
        self.keeper.finish()
        end = self._summary(why)
        self.announcer.say("end", end)
        self._farewell()
        return end

    # -- the ticks

    def _gather(self) -> None:
        """Wait for all agents that are expected, and for the logger, so that the recording begins with the run.

        Those that were held in a run that goes on have some time to come back; and again, whenever one of them has: many are slow to start.
        """
        names = self.roster.names if self._held_before is None else tuple(self._held_before)
        patience = math.inf if self._held_before is None else self.options.patience
        end, fewest = time.monotonic() + patience, len(names)
        while (missing := [name for name in names if not self._is_expected_no_more(name)]) and (left := end - time.monotonic()) > 0.0:
            if len(missing) < fewest:
                end, fewest = time.monotonic() + patience, len(missing)
            elif not self._take(min(left, NAG_SECONDS)):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))
        deadline = time.monotonic() + LOGGER_SECONDS
        while self.options.recorded and not self.roster.is_there(LOGGER) and (left := deadline - time.monotonic()) > 0.0:
            self._take(left)

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
        """Show the tick; while the agents think, account for the last one; take their answers; step."""
        tick = self.engine.tick
        self._seen = self.engine.observe()
        lag = self._pause()
        self.loose.begin(tick)
        self.answers.open(tick, lag)
        self._recall, self._undelivered = self._undelivered, False
        self.announcer.look(self._seen, self.roster.by_holder(), self._recall)
        self._account()
        if self.keeper.is_due():
            self.keeper.keep(self.snapshot())
        self._await_answers()
        self._advance(tick)

    def snapshot(self) -> Snapshot:
        """The run between two ticks, as data."""
        engine, ledger = self.engine, self.ledger
        scenario, held = engine.layout.scenario.model_dump(), sorted(self.roster.holders)
        letters = sorted(ledger.letters.items())
        return Snapshot(
            self.run_id, scenario, engine.as_data(), engine.digest, ledger.memories, letters, self.account.as_data(), held
        )

    def _advance(self, tick: int) -> None:
        actions = self.answers.actions() | self.loose.actions(tick)
        self.ledger.keep(tick, self.answers.velocities)
        self._stepped = Step(tick, self.engine.advance(actions, self.answers.digests()), actions)

    def _account(self) -> None:
        """Tell and count what came of the last step."""
        if self._stepped is None:
            return
        (tick, events, actions), self._stepped = self._stepped, None
        self.account.update(events, actions)
        self.announcer.happened(tick, events)
        self.announcer.wrote(tick, self.ledger.letters.get(tick, {}))
        if self.announcer.is_heard("picture"):
            self.announcer.say("picture", picture_of(self.run_id, self.camera.frame(self.engine.scans, actions, events)))
        if self.account.is_due():
            self.announcer.say("figures", self.account.message(self.run_id, self._refused()))

    def _pause(self) -> float:
        """Until the tick's time has come; so many seconds after it."""
        while self._take(self.pacer.wait()) or self.pacer.wait():
            pass
        return self.pacer.begin()

    def _await_answers(self) -> None:
        """Until all are in, or their time is over. Whoever is silent is shown the tick again: it may have been lost."""
        answers, again = self.answers, time.monotonic() + AGAIN_SECONDS
        while answers.missing:
            until = min(answers.deadline, again)
            self._take(max(0.0, until - time.monotonic()), len(self._silent()))
            now = time.monotonic()
            if now >= answers.deadline:
                self._release(answers.give_up())
            elif now >= again:
                again = now + AGAIN_SECONDS
                self._show(self._silent())

    def _silent(self) -> set[str]:
        """The sessions whose answers are missing."""
        return {self.roster.holders[name] for name in self.answers.missing}

    def _show(self, holders: Collection[str]) -> None:
        """Show the tick that is under way, again or to newcomers."""
        assert self._seen is not None
        by_holder = self.roster.by_holder()
        self.announcer.listen()
        self.announcer.look(self._seen, {holder: by_holder[holder] for holder in sorted(holders)}, self._recall)

    def _release(self, names: set[str]) -> None:
        """Nobody holds these agents any more."""
        for name in names:
            self.answers.release(name)
        self.announcer.lost(self.engine.tick, self.roster.release(names))

    def _summary(self, why: str) -> End:
        engine, run = self.engine, {"mode": self.answers.mode, "hosts": len(set(self.roster.holders.values()))}
        figures = self.account.figures() | self.answers.figures()
        summary = {"hash": engine.hash} | run | figures | {"messages_refused": self._refused()}
        summary |= {"finished": engine.over, "violations": engine.violations()}
        return End(self.run_id, engine.tick, engine.over, why, engine.hash, summary)

    def _farewell(self) -> None:
        """Stay until all others have gone, so that the last message reaches them, but not for long."""
        deadline = time.monotonic() + FAREWELL_SECONDS
        while self.roster.anybody() and (left := deadline - time.monotonic()) > 0:
            item = self.bus.inbox.take(left)
            if isinstance(item, Signal):
                return
            if isinstance(item, Question):
                item.drop()
            elif isinstance(item, Alive):
                with suppress(Refused):
                    self.roster.token(*self._whose(item), item.up)

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
            raise Ended("stopped")

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["hosts", session, "refused"]:
                counts = understood(sample.payload, RefusedThere, self.run_id).counts
                if len(self._refused_there) >= MOST_SESSIONS and session not in self._refused_there:
                    raise Refused("too many", f"{MOST_SESSIONS} sessions have refused something")
                self._refused_there[_session(session)] = counts
            case [name, "velocity"]:
                self._drive(name, understood(sample.payload, Velocity, self.run_id))
            case ["hosts", session, "velocities"]:
                self._drive_all(session, sample)
            case _:
                raise Refused("no such key")

    def _drive_all(self, session: str, sample: Sample) -> None:
        """Each velocity of a session counts, or is refused, for itself. Who may put on whose key, a secured router sees to."""
        velocities = understood(sample.payload, Velocities, self.run_id)
        if velocities.holder != session:
            raise Refused("not the holder", f"{velocities.holder!r} is not the session of the key")
        for name in tuple(velocities.velocities):
            try:
                velocity = velocity_of(velocities, name)
                self._drive(name, velocity)
                self.announcer.driven(name, velocity)
            except Refused as refusal:
                self.refusals.note(sample.key, refusal)
                del velocities.velocities[name]
        self._undelivered |= velocities.undelivered and self._are_held(velocities)

    def _are_held(self, velocities: Velocities) -> bool:
        """Whether any of the requests in it is to somebody who is held, and hears it."""
        letters = [drive.report.letters for drive in velocities.velocities.values() if drive.report and drive.report.letters]
        return any(to in self.roster.holders for written in letters for to, _ in written.requests)

    def _refused(self) -> dict[str, int]:
        """What all have refused, by reason."""
        total: Counter[str] = Counter(self.refusals.counts)
        for counts in self._refused_there.values():
            total.update(counts)
        return dict(sorted(total.items()))

    def _token(self, alive: Alive) -> None:
        name, holder = self._whose(alive)
        if name == PHYSICS:
            self._refuse_another_run(alive.up, holder)
            return
        if name == LOGGER and alive.up:
            self.camera.forget()
        self.roster.token(name, holder, alive.up)
        if self.answers.releases_at_once and not alive.up and self.roster.holders.get(name) == holder:
            self._release({name})

    def _whose(self, alive: Alive) -> tuple[str, str]:
        """Name and session of a liveliness token."""
        match self.keys.parts(alive.key):
            case ["alive", name, session] if name in self.roster.names or name in (PHYSICS, LOGGER):
                return name, _session(session)
        raise Refused("no such agent")

    def _refuse_another_run(self, up: bool, run: str) -> None:
        """Before the first tick: at one router there is one run to a prefix."""
        if up and run != self.run_id and self.answers.tick < 0:
            raise BusError(f"{self.bus.endpoint}: run {run} goes on there, with prefix {self.keys.prefix}; choose another router or prefix")

    def _drive(self, name: str, velocity: Velocity) -> None:
        self._refuse_what_cannot_be(name, velocity)
        if name in self.roster.holders:
            self.answers.take(name, velocity)
        else:
            self.loose.take(name, velocity)

    def _refuse_what_cannot_be(self, name: str, velocity: Velocity) -> None:
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
        replies = {"scenario": self._tell, "join": self._join, "recall": self._recall_mail, "stop": self._stop, "command": self._obey}
        reply = replies[self.keys.parts(question.key)[0]]
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
        question.reply(pack(Newcomer(self.run_id, self.engine.tick, self.answers.mode, list(self.roster.names), scenario)))

    def _join(self, question: Question) -> None:
        """Let a host hold all the agents that it names, or none."""
        join = understood(question.payload, Join, self.run_id)
        refused = {name: why for name in join.names if (why := self.roster.may_join(name, join.holder))}
        held = [] if refused else join.names
        for name in held:
            self.roster.join(name, join.holder)
        memories = {name: self.ledger.memories.get(name) for name in held}
        question.reply(pack(Joined(self.run_id, self.engine.tick, memories, refused)))
        if held and self.answers.tick == self.engine.tick:
            for name in held:
                self.answers.expect(name)
            self._show([join.holder])

    def _recall_mail(self, question: Question) -> None:
        """Tell a host the letters of the last two ticks."""
        recall = understood(question.payload, Recall, self.run_id)
        refuse_other_tick(recall.tick, self.engine.tick, self.engine.tick)
        question.reply(pack(Recalled(self.run_id, recall.tick, sorted(self.ledger.letters.items()))))

    def _stop(self, question: Question) -> None:
        """Latch or reset an emergency stop; the engine sees to it that nothing outranks it. A run that goes on from a snapshot knows it."""
        wish = understood(question.payload, Stop, self.run_id)
        self._account()
        try:
            changed = self.engine.stop(wish.names) if wish.stop else self.engine.reset(wish.names)
        except ValueError as error:
            raise Refused("no such robot", str(error)) from error
        if self.answers.tick >= 0:
            self.keeper.keep(self.snapshot())
            self.keeper.finish()
        question.reply(pack(Stopped(self.run_id, self.engine.tick, changed, stopped(self.engine.world))))

    def _obey(self, question: Question) -> None:
        command = understood(question.payload, Command, self.run_id)
        question.reply(pack(Done(self.run_id, self.engine.tick)))
        question.drop()
        raise Ended(f"{command.command}ped")


def _session(text: str) -> str:
    """A session's id in a key. Raises Refused for what is none."""
    try:
        session: str = msgspec.convert(text, Session)
    except ValueError as error:
        raise Refused("malformed", f"a session's id: {error}") from error
    return session


# -- the process


def main(argv: list[str] | None = None) -> int:
    arguments = _arguments(argv)
    logging.basicConfig(level=logging.WARNING, format="physics: %(message)s")
    inbox = Inbox()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        before = last(arguments.snapshots) if arguments.resume else None
        keys = Keys(arguments.prefix)
        with _meeting(arguments, inbox, identity_in(arguments.secure, arguments.prefix)) as bus:
            return _run(bus, keys, before, arguments)
    except (BusError, ScenarioError, SnapshotError, ValueError) as error:
        log.error("%s", error)
        return 2


def _meeting(arguments: argparse.Namespace, inbox: Inbox, identity: Identity | None) -> AbstractContextManager[Bus]:
    """The session: with a router elsewhere, or as the router."""
    if arguments.connect:
        return client(arguments.connect, inbox, identity=identity)
    return router(arguments.listen or (LOOPBACK if identity is None else SECURE_LOOPBACK), inbox, identity)


def _run(bus: Bus, keys: Keys, before: Snapshot | None, arguments: argparse.Namespace) -> int:
    # Late, because numba takes seconds to load on a busy machine, and meanwhile the others can find the router.
    from orchard.engine import Engine

    scenario = load(arguments.scenario) if arguments.scenario else Scenario()
    engine = Engine.begin(scenario) if before is None else Engine.resume(before)
    absent = chosen(engine.agents, arguments.absent, []) if arguments.absent else []
    ticks = math.inf if arguments.duration is None else round(arguments.duration / TIME_STEP)
    pace, kept = _pace(arguments), (arguments.snapshots, arguments.snapshot_every)
    options = Options(arguments.mode, pace, ticks, arguments.patience, tuple(absent), arguments.run, arguments.recorded, *kept)
    physics = Physics(bus, keys, engine, options, before)
    physics.listen()
    where = "connected to" if arguments.connect else "listening on"
    print(f"{where} {bus.endpoint}, prefix {keys.prefix}, run {physics.run_id}", flush=True)
    end = physics.run()
    print(f"{end.why}: tick {end.tick}, {end.summary['wall_seconds']} s, hash {end.hash}", flush=True)
    for violation in end.summary["violations"]:
        print(f"violated: {violation}", flush=True)
    return 1 if end.why.startswith("jammed") or end.summary["violations"] else 0


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
    place.add_argument("--listen", metavar="ENDPOINT", help="default: a free port of 127.0.0.1")
    place.add_argument("--connect", metavar="ENDPOINT", help="that of a router elsewhere")
    parser.add_argument("--secure", metavar="DIR", help="the role's directory: endpoints are tls/..., and each role may do its own only")
    parser.add_argument("--run", default="", metavar="ID", help="the run's id; default: a new one")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--mode", choices=["lockstep", "realtime"], default="lockstep", help="wait for all agents, or for none")
    parser.add_argument("--speed", type=_speed, metavar="X|max", help="simulated seconds to a second; default max, in realtime 1")
    parser.add_argument("--duration", type=_positive, metavar="SECONDS", help="simulated seconds after which the run ends")
    parser.add_argument("--patience", type=_positive, default=PATIENCE, metavar="SECONDS", help="how long an agent may be silent")
    parser.add_argument("--absent", action="append", default=[], metavar="KIND|NAME", help="do not wait for these (repeatable)")
    parser.add_argument("--recorded", action="store_true", help="begin when a logger is there, or after 10 s")
    parser.add_argument("--snapshots", type=Path, metavar="DIR", help="keep snapshots of the run there")
    parser.add_argument("--snapshot-every", type=_positive, default=SNAPSHOT_SECONDS, metavar="SECONDS", help="wall time; default 2")
    parser.add_argument("--resume", action="store_true", help="go on from the newest snapshot in there, if there is one")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
