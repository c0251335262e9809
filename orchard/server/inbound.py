"""Handles what arrives at physics: samples, liveliness tokens and queries.

Samples are messages on a key; queries are questions that get a reply. A process declares a
liveliness token, a key that shows the others that it is connected. A message that does not count is
refused: it is counted, and its sender is told why.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import msgspec

from orchard.contract.messages import pack
from orchard.field.problems import printable
from orchard.field.scenario import check
from orchard.net.bus import Alive, Bus, Final, Item, Query, Replied, Sample, Signal
from orchard.net.endpoints import BusError
from orchard.net.refusals import (
    Refused,
    read_message,
    refuse_other_run,
    refuse_other_tick,
    refused_for,
)
from orchard.net.requests import REFUSED_TRIES
from orchard.server.run import PhysicsRun, RunEnded, RunReset
from orchard.sim.stops import stopped
from orchard.wire import messages as wire
from orchard.wire.codec import orchard_of, velocities_of
from orchard.wire.keys import LOGGER, Keys

# The queries that only ask: they have no payload.
NO_PAYLOAD = ("scenario", "layout", "simulation_state")
# Refusals that are published in a second.
MOST_PUBLISHED = 100
# s after physics begins to listen. A run that appears later is the newer one, and must end itself.
OTHER_RUN_SECONDS = 3.0


class Queries:
    """Replies to the queries that physics receives."""

    def __init__(self, keys: Keys, run: PhysicsRun) -> None:
        self._keys = keys
        self._run = run
        # Kind of key -> what replies to a query for it.
        self.replies: dict[str, Callable[[Query], None]] = {
            "scenario": self._scenario,
            "layout": self._layout,
            "recall": self._recall,
            "stop": self._stop,
            "simulation_state": self._simulation_state,
            "set_simulation_state": self._set_simulation_state,
            "step_simulation": self._step_simulation,
            "reset_simulation": self._reset_simulation,
        }

    def reply(self, query: Query) -> None:
        """Reply to a query, and drop it: that tells the sender that no more replies come.

        A query for steps gets its reply when they are done. A query that is refused gets an error
        reply, and Refused is raised.
        """
        try:
            self._method_for(query)(query)
        except Refused as refusal:
            query.refuse(str(refusal))
            raise
        if not self._run.control.keeps(query):
            query.drop()

    def _method_for(self, query: Query) -> Callable[[Query], None]:
        """Return what replies to a query. Raises Refused for an unknown key."""
        match self._keys.parts(query.key):
            case [what] if what in self.replies:
                if query.payload and what in NO_PAYLOAD:
                    raise Refused("malformed", f"a query for {what} has no payload")
                return self.replies[what]
            case ["hosts", session, "join"]:
                return partial(self._join, session)
        raise Refused("no such key")

    def _scenario(self, query: Query) -> None:
        """Reply with what a process must know of the run before it joins."""
        engine = self._run.engine
        drivers = self._run.drivers
        info = wire.RunInfo(
            run=self._run.id,
            tick=engine.tick,
            mode=drivers.answers.mode,
            agents=list(drivers.roster.names),
            scenario=engine.scenario.model_dump(),
        )
        query.reply(pack(info))

    def _layout(self, query: Query) -> None:
        """Reply with the orchard that follows from the scenario."""
        engine = self._run.engine
        query.reply(pack(orchard_of(self._run.id, engine.tick, engine.layout)))

    def _simulation_state(self, query: Query) -> None:
        """Reply whether simulated time goes on."""
        query.reply(pack(self._run.control.state))

    def _step_simulation(self, query: Query) -> None:
        """Do some steps. The reply comes when they are done."""
        steps = read_message(query.payload, wire.StepSimulation, self._run.id).steps
        self._run.control.step(query, steps)

    def _join(self, session: str, query: Query) -> None:
        """Let a session own agents. The reply has their memories.

        Then the agents are asked: their session must have the memories before the first tick.
        """
        join = read_message(query.payload, wire.Join, self._run.id)
        _refuse_other_session(join.owner, session)
        drivers = self._run.drivers
        refused = drivers.join(join.names, join.owner)
        owned = join.names
        if refused:
            owned = []
        known = drivers.memories()
        memories = {name: known.get(name) for name in owned}
        query.reply(pack(wire.Joined(self._run.id, self._run.engine.tick, memories, refused)))
        drivers.expect(owned, join.owner)

    def _recall(self, query: Query) -> None:
        """Reply with the letters of the last two ticks."""
        run = self._run
        recall = read_message(query.payload, wire.Recall, run.id)
        tick = run.engine.tick
        refuse_other_tick(recall.tick, tick, tick)
        query.reply(pack(wire.Recalled(run.id, tick, run.drivers.letters())))

    def _stop(self, query: Query) -> None:
        """Stop robots, or let stopped ones move again. Nothing else moves a stopped robot.

        The reply says whether the stop is in a snapshot on the disk, so that it outlives physics.
        """
        run = self._run
        engine = run.engine
        request = read_message(query.payload, wire.Stop, run.id)
        # A snapshot may be written now, and must have the figures of the last step.
        run.report()
        with refused_for("no such robot"):
            if request.stop:
                changed = engine.stop(request.names)
            else:
                changed = engine.reset(request.names)
        if changed:
            kept = run.keep_at_once()
        else:
            kept = run.is_kept()
        query.reply(pack(wire.Stopped(run.id, engine.tick, changed, stopped(engine.world), kept)))

    def _set_simulation_state(self, query: Query) -> None:
        """Let the run play, pause it, or end it. Raises RunEnded for the end."""
        wanted = read_message(query.payload, wire.SetSimulationState, self._run.id)
        control = self._run.control
        control.set(wanted.state)
        query.reply(pack(control.state))
        query.drop()
        if wanted.state == "quitting":
            raise RunEnded("stopped")

    def _reset_simulation(self, query: Query) -> None:
        """Let the run begin again, with another seed if the query has one. Raises RunReset."""
        run = self._run
        wanted = read_message(query.payload, wire.ResetSimulation, run.id)
        if run.drivers.roster.has_logger:
            way_out = "start the run without one (--record none)"
            raise Refused("recorded", f"the recording would hold two runs; {way_out}")
        scenario = run.engine.scenario.model_dump()
        if wanted.seed is not None:
            scenario["seed"] = wanted.seed
        with refused_for("malformed"):
            check(scenario, "the scenario")
        # Before it says yes, it writes a snapshot. If physics dies, the run goes on from there and
        # can be reset again.
        run.report()
        if run.may_be_kept and not run.keep_at_once():
            risk = "the death of physics would undo the reset"
            raise Refused("not kept", f"no snapshot can be written, and {risk}; is the disk full?")
        query.reply(pack(run.control.state))
        query.drop()
        raise RunReset(scenario)


class OtherRuns:
    """Ends this run if an older run is active at the same router with the same prefix.

    Theory of operation. The liveliness token of another run does not show that it is active: a
    process that was killed keeps it for a moment, and in an open run any client may declare it. So
    physics asks for the run at this router, as a host does that wants to join. The other run counts
    if it replies while its token is there.
    """

    def __init__(self, bus: Bus, keys: Keys, run: str) -> None:
        """`run`: the id of this run."""
        self._bus = bus
        self._keys = keys
        self._run = run
        # s, on the clock of the bus: a run that appears later is newer than this one.
        self._newer_from = math.inf
        # The keys of the tokens of runs that were there before this one.
        self._tokens: set[str] = set()
        # How many questions have been sent since the last token came.
        self._asked = 0
        # An object that marks the replies to the last question.
        self._ticket: object = None

    def listen(self) -> None:
        """Record that physics begins to listen."""
        self._newer_from = self._bus.clock() + OTHER_RUN_SECONDS

    def track(self, alive: Alive, run: str, has_begun: bool) -> None:
        """Record a token of physics, of any run. `has_begun`: whether this run has begun."""
        is_newer = has_begun or self._bus.clock() >= self._newer_from
        if not alive.up:
            self._tokens.discard(alive.key)
        elif run != self._run and not is_newer:
            self._tokens.add(alive.key)
            self._asked = 0
            self._ask()

    def hear(self, item: Replied | Final) -> None:
        """Take a reply, or the end of the replies, to a question.

        Raises BusError if another run is active, Refused if the reply is malformed.
        """
        if item.ticket is not self._ticket:
            return
        if isinstance(item, Final):
            # The reply may have been lost, or have changed on its way.
            if self._tokens and self._asked < REFUSED_TRIES:
                self._ask()
        elif not item.error:
            with refused_for("malformed"):
                run = wire.read(item.payload, wire.RunInfo).run
            self._end_beside(run)

    def _ask(self) -> None:
        """Ask for the run at this router."""
        self._asked += 1
        self._ticket = object()
        self._bus.ask(self._keys.of("scenario"), b"", self._ticket)

    def _end_beside(self, run: str) -> None:
        """Raise BusError if a run that has replied is an older one whose token is there."""
        # The key of a token is alive/physics/RUN/SESSION.
        runs = [self._keys.parts(token)[2] for token in self._tokens]
        if run in runs:
            fault = f"{self._bus.endpoint}: run {printable(run)} is active there"
            way_out = "choose another router or prefix"
            raise BusError(f"{fault}, with prefix {self._keys.prefix}; {way_out}")


class Inbound:
    """Passes on what arrives at physics, and counts what is refused."""

    def __init__(self, bus: Bus, keys: Keys, run: PhysicsRun) -> None:
        self._bus = bus
        self._keys = keys
        self._run = run
        self._queries = Queries(keys, run)
        # (key, reason) of the refusals that were published in this second.
        self._published: set[tuple[str, wire.Reason]] = set()
        self._published_since = -math.inf  # s, on the clock of the bus
        self._other_runs = OtherRuns(bus, keys, run.id)

    def listen(self) -> None:
        """Subscribe, and declare the queryables.

        The liveliness token comes last: it shows that physics is ready.
        """
        for kind in ("velocities", "velocity"):
            self._bus.subscribe(self._keys.of(kind), quietly=True)
        for kind in ("advice", "refused", "left"):
            self._bus.subscribe(self._keys.of(kind))
        for kind in (*self._queries.replies, "join"):
            self._bus.answer(self._keys.of(kind))
        self._other_runs.listen()
        for kind in ("alive", "physics"):
            self._bus.watch(self._keys.of(kind))
        self._bus.declare_alive(self._token_of_physics)

    def leave(self) -> None:
        """Remove the liveliness token.

        Only then the other processes believe the message of the end: see orchard/net/ending.py.
        """
        self._bus.withdraw(self._token_of_physics)

    @property
    def _token_of_physics(self) -> str:
        """The key of the liveliness token of physics, with the run and the session."""
        return self._keys.of("physics", self._run.id, self._bus.id)

    def take(self, seconds: float, enough: int = 1) -> bool:
        """Handle one item. Return False if none came in `seconds`.

        `enough`: how many items wake it that came quietly, as for `Inbox.take`. Raises RunEnded.
        """
        item = self._bus.inbox.take(seconds, enough)
        if item is not None:
            try:
                self._handle(item)
            except Refused as refusal:
                self._refuse(getattr(item, "key", ""), refusal)
        return item is not None

    def _refuse(self, key: str, refusal: Refused) -> None:
        """Count a refusal, and publish it for its sender.

        Each key and reason is published once a second, and at most MOST_PUBLISHED in all.
        """
        self._run.refusal_totals.note(key, refusal)
        now = self._bus.clock()
        if now - self._published_since >= 1.0:
            self._published = set()
            self._published_since = now
        if (key, refusal.reason) in self._published or len(self._published) >= MOST_PUBLISHED:
            return
        self._published.add((key, refusal.reason))
        session = refusal.session
        match self._keys.parts(key):
            case ["hosts", owner, _]:
                session = owner
        message = wire.Refusal(
            run=self._run.id,
            tick=self._run.engine.tick,
            key=printable(key),
            reason=refusal.reason,
            detail=refusal.detail,
            session=printable(session),
        )
        self._bus.publish(self._keys.of("refusals"), pack(message), newest_wins=True)

    def take_after_end(self, seconds: float) -> Item | None:
        """Handle one item after the run's end, when only tokens and `left` count.

        Return the item; None if none came in `seconds`.
        """
        item = self._bus.inbox.take(seconds)
        with suppress(Refused):
            if isinstance(item, Query):
                item.drop()
            elif isinstance(item, Alive):
                roster = self._run.drivers.roster
                roster.token(*self._owner_of(item.key), item.up)
            elif isinstance(item, Sample) and self._keys.parts(item.key)[-1] == "left":
                self._hear(item)
        return item

    def _handle(self, item: Item) -> None:
        """Handle an item. Raises Refused if it does not count, RunEnded for a signal."""
        if isinstance(item, Sample):
            self._hear(item)
        elif isinstance(item, Alive):
            self._token(item)
        elif isinstance(item, Query):
            self._queries.reply(item)
        elif isinstance(item, Replied | Final):
            self._other_runs.hear(item)
        elif isinstance(item, Signal):
            raise RunEnded("stopped")

    def _hear(self, sample: Sample) -> None:
        """Take a message of a session or client. Raises Refused."""
        run = self._run.id
        match self._keys.parts(sample.key):
            case ["hosts", session, "refused"]:
                counts = read_message(sample.payload, wire.RefusedThere, run).counts
                self._run.refusal_totals.hear(_session(session), counts)
            case ["hosts", session, "left"]:
                read_message(sample.payload, wire.Departure, run)
                self._run.drivers.leave(_session(session))
            case [name, "velocity"]:
                self._drive(name, read_message(sample.payload, wire.Velocity, run))
            case [name, "advice"]:
                self._run.drivers.advise(name, read_message(sample.payload, wire.Advice, run))
            case ["hosts", session, "velocities"]:
                for refusal in self._drive_all(sample.payload, session):
                    self._refuse(sample.key, refusal)
            case _:
                raise Refused("no such key")

    def _drive(self, name: str, velocity: wire.Velocity) -> None:
        """Take a velocity for one robot. Raises Refused."""
        try:
            self._run.drivers.drive(name, velocity)
        except Refused as refusal:
            refusal.session = velocity.owner
            raise

    def _drive_all(self, payload: bytes, session: str) -> list[Refused]:
        """Take the actions of a session.

        Return the refusals. Raises Refused if the whole message does not count.
        """
        with refused_for("malformed"):
            actions, faults = velocities_of(payload)
        refuse_other_run(actions, self._run.id)
        _refuse_other_session(actions.owner, session)
        refused = {name: Refused("malformed", f"{name}: {fault}") for name, fault in faults.items()}
        return self._run.drivers.act_all(actions, refused)

    def _token(self, alive: Alive) -> None:
        """Record a token of physics, of the logger or of an agent. Raises Refused."""
        match self._keys.parts(alive.key):
            case ["alive", "physics", run, _]:
                self._other_runs.track(alive, run, self._run.has_begun)
            case _:
                name, owner = self._owner_of(alive.key)
                if name == LOGGER and alive.up:
                    # A logger that has just come can record from a whole frame on.
                    self._run.account.begin_whole()
                self._run.drivers.token(name, owner, alive.up)

    def _owner_of(self, token: str) -> tuple[str, str]:
        """Return the agent, or logger, and the session of a liveliness token. Raises Refused."""
        match self._keys.parts(token):
            case ["alive", name, session]:
                roster = self._run.drivers.roster
                if name == LOGGER or name in roster.names:
                    return name, _session(session)
        raise Refused("no such agent")


def _refuse_other_session(owner: str, session: str) -> None:
    """Raise Refused unless the owner is the session of the key.

    A secured router lets a session use only its own.
    """
    if owner != session:
        raise Refused("not the owner", f"{owner!r} is not the session of the key")


def _session(text: str) -> str:
    """Return the id of a session. Raises Refused for a text that is none."""
    with refused_for("malformed", "a session's id: "):
        return str(msgspec.convert(text, wire.Session))
