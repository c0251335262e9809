"""Owns the world and the clock: publishes each tick, waits for every agent's answer, steps.

    python -m processes.physics config/orchard.yaml --listen tcp/127.0.0.1:7447

It is the router for the others. There is no agent in it: a robot that nobody drives stands still.
"""

import argparse
import logging
import math
import signal
import sys
import time
import uuid
from collections.abc import Container
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from orchard import wire
from orchard.agent import Action, Observation
from orchard.bus import LOOPBACK, Alive, Bus, BusError, Inbox, Item, Question, Sample, Signal, router
from orchard.camera import Camera
from orchard.config import TIME_STEP, Scenario, ScenarioError, load
from orchard.keys import PHYSICS, PREFIX, Keys
from orchard.kinds import KINDS, Laser
from orchard.layout import Layout
from orchard.lockstep import Answers, Loose, Memories, Pacer, Refusals, Refused, Roster, understood
from orchard.messages import pack
from processes.agents import chosen

if TYPE_CHECKING:
    from orchard.engine import Engine
    from orchard.events import Event

log = logging.getLogger("orchard")

FIGURES_SECONDS = 0.5  # of wall time between two messages with figures
NAG_SECONDS = 3.0  # between two lines that name who is missing
FAREWELL_SECONDS = 2.0  # for how long the others may take to leave


@dataclass(frozen=True)
class Options:
    """How a run is run."""

    speed: float = math.inf  # simulated seconds to one second of wall time
    ticks: float = math.inf  # after which it ends
    patience: float = 15.0  # s, for how long an agent may be silent
    absent: tuple[str, ...] = ()  # agents that are not waited for at the beginning


class Stopped(Exception):
    """Somebody ended the run."""


class Announcer:
    """What physics says."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout) -> None:
        self._bus, self._keys, self.run = bus, keys, run
        self._bodies = [(s.name, KINDS[s.kind].laser, keys.of("pose", s.name), keys.of("scan", s.name)) for s in layout.starts]

    def look(self, tick: int, seen: dict[str, Observation], holders: dict[str, list[str]], names: Container[str] | None = None) -> None:
        """Poses and scans of a tick, all or those of some, each on its key; all of a session's together; and then the clock."""
        sent = {body[0]: self._show(seen[body[0]], *body[1:]) for body in self._bodies if names is None or body[0] in names}
        for holder, held in holders.items():
            if len(held) > 1:
                bodies = {name: sent[name] for name in held if name in sent}
                self._bus.publish(self._keys.of("seen", session=holder), pack(wire.Seen(self.run, tick, bodies)))
        sec, tenths = divmod(tick, 10)
        self.say("clock", wire.Clock(self.run, tick, wire.Stamp(sec, tenths * 10**8)))

    def _show(self, seen: Observation, laser: Laser, pose_key: str, scan_key: str) -> tuple[bytes, bytes]:
        pose = pack(wire.odometry_of(self.run, seen))
        scan = pack(wire.scan_of(self.run, seen, laser, KINDS["bin"].laser))
        self._bus.publish(pose_key, pose)
        self._bus.publish(scan_key, scan)
        return pose, scan

    def happened(self, tick: int, events: "list[Event]") -> None:
        if events:
            self.say("events", wire.Events(self.run, tick, msgspec.to_builtins(events)))

    def lost(self, tick: int, released: dict[str, list[str]]) -> None:
        for holder, names in released.items():
            log.warning("no answer to tick %d from %s: no longer waited for", tick, ", ".join(names))
            self.say("lost", wire.Lost(self.run, tick, names, holder))

    def say(self, what: str, message: wire.Message) -> None:
        self._bus.publish(self._keys.of(what), pack(message))


class Account:
    """The run in figures, for those who watch it and for the summary."""

    def __init__(self, engine: "Engine") -> None:
        from orchard.metrics import Figures

        self._world = engine.world
        self._figures = Figures()
        self.actions: dict[str, Action] = {}
        self._begun = self._told = time.monotonic()

    def begin(self) -> None:
        self._begun = time.monotonic()

    def update(self, events: "list[Event]", actions: dict[str, Action]) -> None:
        self.actions = actions
        self._figures.update(self._world, events, actions)

    @property
    def jam(self) -> list[str]:
        """Who waits for whom, one line each, when nothing has gone on for ten minutes; else nothing."""
        from orchard.metrics import who_waits

        return (who_waits(self.actions) or ["nobody waits for anybody"]) if self._figures.jammed(self._world) else []

    def figures(self) -> dict[str, Any]:
        from orchard.metrics import harvest_figures

        wall = time.monotonic() - self._begun
        times = self._world.tick * TIME_STEP / wall if wall else 0.0
        return harvest_figures(self._world, self._figures) | {"wall_seconds": round(wall, 3), "times_real_time": round(times, 1)}

    def message(self, run: str, refused: dict[str, int]) -> wire.Figures:
        doing = {name: action.doing for name, action in self.actions.items() if action.doing}
        waits = {name: action.waits_for for name, action in self.actions.items() if action.waits_for}
        return wire.Figures(run, self._world.tick, self.figures(), doing, waits, refused)

    def is_due(self) -> bool:
        """Whether half a second has passed since this last said so."""
        now = time.monotonic()
        if now - self._told < FIGURES_SECONDS:
            return False
        self._told = now
        return True


class Physics:
    """One run, from the first agent to the last message."""

    def __init__(self, bus: Bus, keys: Keys, engine: "Engine", options: Options) -> None:
        self.bus, self.keys, self.engine, self.options = bus, keys, engine, options
        self.run_id = uuid.uuid4().hex[:16]
        self.announcer = Announcer(bus, keys, self.run_id, engine.layout)
        self.account, self.camera = Account(engine), Camera(engine.world)
        self.roster = Roster(engine.agents)
        self.answers, self.loose, self.memories = Answers(self.roster), Loose(), Memories()
        self.refusals = Refusals()
        self.pacer = Pacer(options.speed)
        self._seen: dict[str, Observation] = {}
        self._deadline = math.inf

    def listen(self) -> None:
        self.bus.subscribe(self.keys.of("velocity"), quietly=True)
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
        while missing := [name for name in self.roster.names if name not in self.roster.holders and name not in self.options.absent]:
            if not self._take(NAG_SECONDS):
                log.warning("waiting for %d agents: %s", len(missing), ", ".join(missing))

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
        self._pause()
        self.loose.begin(tick)
        self.answers.open(tick)
        self.announcer.look(tick, self._seen, self.roster.by_holder())
        self._await_answers()
        actions = self.answers.actions() | self.loose.actions(tick)
        self.memories.keep(self.answers.velocities)
        events = self.engine.advance(actions, self.answers.digests())
        self.account.update(events, actions)
        self.announcer.happened(tick, events)
        self.announcer.say("picture", wire.picture_of(self.run_id, self.camera.frame(self.engine.scans, actions, events)))
        if self.account.is_due():
            self.announcer.say("figures", self.account.message(self.run_id, dict(self.refusals.counts)))

    def _pause(self) -> None:
        """Until the tick's time has come."""
        while self._take(self.pacer.wait()) or self.pacer.wait():
            pass
        self.pacer.begin()

    def _await_answers(self) -> None:
        self._wait_on()
        while self.answers.missing:
            self._take(max(0.0, self._deadline - time.monotonic()), len(self.answers.missing))
            if time.monotonic() >= self._deadline:
                self.announcer.lost(self.answers.tick, self.roster.release(self.answers.missing))
                self.answers.missing.clear()

    def _wait_on(self) -> None:
        self._deadline = time.monotonic() + self.options.patience

    def _summary(self, why: str) -> wire.End:
        engine, run = self.engine, {"mode": "lockstep", "hosts": len(set(self.roster.holders.values()))}
        summary = {"hash": engine.hash} | run | self.account.figures() | {"messages_refused": dict(self.refusals.counts)}
        summary["finished"] = engine.over
        return wire.End(self.run_id, engine.tick, engine.over, why, engine.hash, summary)

    def _farewell(self) -> None:
        """Stay until all others have gone, so that the last message reaches them, but not for long."""
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
            self._drive(self.keys.parts(item.key)[0], item.payload)
        elif isinstance(item, Alive):
            _, name, holder = self.keys.parts(item.key)
            if name != PHYSICS:
                self.roster.token(name, holder, item.up)
        elif isinstance(item, Question):
            self._reply(item)
        elif isinstance(item, Signal):
            raise Stopped("stopped")

    def _drive(self, name: str, payload: bytes) -> None:
        velocity = understood(payload, wire.Velocity, self.run_id)
        if name in self.roster.holders:
            self.answers.take(name, velocity)
            return
        self._refuse_what_cannot_be(name, velocity)
        self.loose.take(name, velocity)

    def _refuse_what_cannot_be(self, name: str, velocity: wire.Velocity) -> None:
        layout = self.engine.layout
        if name not in layout.index:
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
        scenario = self.engine.layout.scenario.model_dump()
        question.reply(pack(wire.Newcomer(self.run_id, self.engine.tick, list(self.roster.names), scenario)))

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
        self._wait_on()
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
        with router(arguments.listen, inbox) as bus:
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
    physics = Physics(bus, keys, engine, Options(arguments.speed, ticks, arguments.patience, tuple(absent)))
    physics.listen()
    print(f"listening on {bus.endpoint}, prefix {keys.prefix}, run {physics.run_id}", flush=True)
    end = physics.run()
    print(f"{end.why}: tick {end.tick}, {end.summary['wall_seconds']} s, hash {end.hash}", flush=True)
    return 1 if end.why.startswith("jammed") else 0


def _speed(text: str) -> float:
    speed = math.inf if text == "max" else float(text)
    if not speed > 0:
        raise ValueError
    return speed


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise ValueError
    return value


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m processes.physics", description="Own the world and the clock of an orchard.")
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO.yaml", help="default: the built-in scenario")
    parser.add_argument("--listen", default=LOOPBACK, metavar="ENDPOINT", help="default: a free port of 127.0.0.1")
    parser.add_argument("--prefix", default=PREFIX, help="first part of every key")
    parser.add_argument("--speed", type=_speed, default=math.inf, metavar="X|max", help="simulated seconds to a second; default max")
    parser.add_argument("--duration", type=_positive, metavar="SECONDS", help="simulated seconds after which the run ends")
    parser.add_argument("--patience", type=_positive, default=15.0, metavar="SECONDS", help="how long an agent may be silent")
    parser.add_argument("--absent", action="append", default=[], metavar="KIND|NAME", help="do not wait for these (repeatable)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
