"""Hosts any number of agents over one session: sees what they see, ticks them, carries their mail, sends their velocities."""

import logging
import math
import time
from collections.abc import Callable
from typing import Any, NoReturn

from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.guard import Guarded
from orchard.contract.mail import LocalMail, digest_of
from orchard.contract.messages import TRAFFIC, pack, unpack
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.net.bus import Alive, Bus, Final, Item, Query, Replied, Sample, Signal
from orchard.net.endpoints import BusError
from orchard.net.mailbox import DOUBT_SECONDS, MAILBOXES, LatestObservations, SentRequest
from orchard.net.refusals import Refusals, Refused, read_message
from orchard.net.requests import AGAIN_SECONDS, ANSWER_SECONDS, M, PhysicsRequest, ask, publish_refusals
from orchard.net.roster import NO_TOKEN, TAKEN
from orchard.wire.codec import drive_of
from orchard.wire.keys import PHYSICS, Keys
from orchard.wire.messages import BinStatus, Drive, End, Join, Joined, Lost, Recall, Recalled, Velocities

log = logging.getLogger("orchard")
RECALL_SECONDS = 5.0  # after which physics is asked again: the way to it may be cut
GONE_SECONDS = 20.0  # for how long physics may be gone: it is started again, or its router is
JOIN_TRIES = 50  # 5 s: the network may know of a token later than of a join
TAKEN_TRIES = 30  # 3 s: of a predecessor that was cut off the network believes for bus.LEASE_MS that it lives


class HostEnded(Exception):
    """The run is over for this host; with its exit code."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


class _JoinAgain(Exception):
    """Physics waits no longer for this host, has gone on without it, or has come back."""


class AgentRunner:
    """One agent, and what it remembers."""

    def __init__(self, name: str, agent: Agent) -> None:
        self.name = name
        self._agent = agent if isinstance(agent, Guarded) else Guarded(name, agent)
        self.memory: Any = None
        self._sent: bytes | None = None  # the memory that physics has

    def resume(self, memory: bytes | None) -> None:
        self.memory = None if memory is None else self._understood(memory)
        self._sent = memory

    def _understood(self, memory: bytes) -> Any:
        """What it remembers; nothing, where another class left the memory."""
        try:
            return unpack(memory, self._agent.Memory)
        except ValueError as error:
            log.warning("%s begins anew; its memory is not of its class: %s", self.name, error)
            return None

    def act(self, seen: Observation, mail: Mail) -> Action:
        """What the agent does; nothing, where it is broken, and the others go on."""
        action = self._agent.tick(seen, mail, self.memory)
        self.memory = action.memory
        return action

    def news(self) -> bytes | None:
        """The memory, if it is not what physics has."""
        memory = self._agent.packed
        if memory == self._sent:
            return None
        self._sent = memory
        return memory


class StateBoard:
    """The bins' states: published when they change, told to those who ask."""

    def __init__(self, bus: Bus, keys: Keys, run: str) -> None:
        self._bus, self._keys, self._run = bus, keys, run
        self._seen: dict[str, Observation] = {}

    def update(self, seen: Observation) -> None:
        coupled_to, old = seen.hitch.name if seen.hitch else "", self._seen.get(seen.name)
        self._seen[seen.name] = seen
        if old is None or (old.full, old.hitch.name if old.hitch else "") != (seen.full, coupled_to):
            self._bus.publish(self._keys.of("state", seen.name), pack(self._state(seen)))

    def _state(self, seen: Observation) -> BinStatus:
        return BinStatus(self._run, seen.tick, seen.full, seen.fill, seen.hitch.name if seen.hitch else "")

    def tell(self, name: str, question: Query) -> None:
        if question.payload:
            question.refuse("malformed: the query of a state has no payload")
            raise Refused("malformed", "the query of a state has no payload")
        if name not in self._seen:
            question.refuse("not known before the first tick")
            return
        question.reply(pack(self._state(self._seen[name])))
        question.drop()


class Host:
    """Some agents, from joining the run to its end."""

    def __init__(
        self, bus: Bus, keys: Keys, run: str, mode: str, layout: Layout, agents: dict[str, Agent], patience: float = GONE_SECONDS
    ) -> None:
        """`patience`: s for which physics may be gone."""
        self.bus, self.keys, self.run_id, self._patience = bus, keys, run, patience
        self.performers = {name: AgentRunner(name, agent) for name, agent in sorted(agents.items())}
        self.bodies = [name for name in self.performers if name in layout.index]
        self.bins = [name for name in self.bodies if kind_of(name) == "bin"]
        self.sight = LatestObservations(run, self.performers, self.bodies)
        self.mailbox = MAILBOXES[mode](run, (*layout.names, TRAFFIC))
        self.states = StateBoard(bus, keys, run)
        self.refusals = Refusals()
        self.thinking = ""  # the agent whose turn it is
        self._answer = b""  # to the tick that was last ticked
        self._gone_until = math.inf  # on the clock: when physics counts as gone for ever

    # -- joining

    def listen(self) -> None:
        """Rule 10: tokens come last, after all that this host wants to hear."""
        for what in ("lost", "end"):
            self.bus.subscribe(self.keys.of(what))
        self.bus.watch(self.keys.of("alive", PHYSICS))
        self.bus.subscribe(self.keys.of("seen", session=self.bus.id))
        for name in self.bins:
            self.bus.answer(self.keys.of("state", name))
        for name in self.performers:
            self.bus.answer(self.keys.of("mail", name))
        for name in self.performers:
            self.bus.declare_alive(self.keys.of("alive", name, self.bus.id))

    def join(self) -> None:
        """Hold the agents: from the present tick on physics waits for them."""
        joined = self._joined()
        if joined.refused:
            raise HostEnded(2, "; ".join(f"{name}: {reason}" for name, reason in sorted(joined.refused.items())))
        self.mailbox.join(joined.tick)
        self.sight.forget()
        for name, performer in self.performers.items():
            performer.resume(joined.memories.get(name))

    def _joined(self) -> Joined:
        """What physics says to the wish."""
        request = pack(Join(self.run_id, self.bus.id, list(self.performers)))
        for tries in range(1, JOIN_TRIES + 1):
            joined = self._told("join", request, Joined)
            is_taken = any(why.startswith(TAKEN) for why in joined.refused.values())
            if NO_TOKEN not in joined.refused.values() and not (is_taken and tries < TAKEN_TRIES):
                break
            time.sleep(AGAIN_SECONDS)
        return joined

    def _told(self, what: str, request: bytes, type_: type[M], seconds: float = ANSWER_SECONDS) -> M:
        """What physics replies; others are refused."""
        asking = PhysicsRequest(
            self.keys.of(what, session=self.bus.id), request, lambda payload: read_message(payload, type_, self.run_id), seconds
        )
        return ask(self.bus, asking, self.handle, self.refusals, self._check_gone)

    # -- one tick

    def run(self) -> NoReturn:
        """Tick after tick, until HostEnded is raised."""
        while True:
            try:
                self.join()
                while True:
                    self.tick()
            except _JoinAgain:
                log.warning("joining again after tick %d", self.mailbox.last)

    def tick(self) -> None:
        self._wait(lambda: self.sight.tick > self.mailbox.last)
        tick = self.sight.tick
        if not self.mailbox.follows(tick):
            raise _JoinAgain
        if not self.mailbox.is_settled(tick, self.sight.asked):
            self._wait(lambda: self.mailbox.is_settled(tick, self.sight.asked), DOUBT_SECONDS)
        mail, seen = self._mail(tick), self.sight.observations()
        actions = {name: self._act(name, seen[name], mail.get(name) or Mail()) for name in self.performers}
        self.thinking = ""
        drives = {name: self._drive(name, action, mail.get(name)) for name, action in actions.items()}
        self._answer = pack(Velocities(self.run_id, tick, self.bus.id, drives))
        self._send()
        self._tell(seen, actions)

    def _tell(self, seen: dict[str, Observation], actions: dict[str, Action]) -> None:
        """What others wait for less than physics does: requests, answers, the bins' states, what was refused."""
        for name, action in actions.items():
            for asked in self.mailbox.write(name, action):
                self.bus.ask(self.keys.of("mail", asked.to), self.mailbox.letter(asked), asked)
        self.mailbox.close()
        for name in self.bins:
            self.states.update(seen[name])
        publish_refusals(self.bus, self.keys, self.run_id, self.refusals)

    def _act(self, name: str, seen: Observation, mail: Mail) -> Action:
        self.thinking = name
        return self.performers[name].act(seen, mail)

    def _mail(self, tick: int) -> dict[str, Mail]:
        """Everybody's mail of a tick: what has arrived, or, where some may be missing, what physics knows of it."""
        doubts = self.mailbox.doubts(tick, self.sight.asked)
        mail = self.mailbox.deliver(tick)
        if not doubts:
            return mail
        request = pack(Recall(self.run_id, tick))
        try:
            recalled = self._told("recall", request, Recalled, RECALL_SECONDS)
        except BusError as error:  # physics may have gone back to an earlier tick
            raise _JoinAgain from error
        if recalled.tick != tick:
            raise _JoinAgain
        return LocalMail(dict(recalled.letters)).deliver(tick)

    def _drive(self, name: str, action: Action, mail: Mail | None) -> Drive:
        return drive_of(action, b"" if mail is None else digest_of(mail), self.performers[name].news())

    def _send(self) -> None:
        self.bus.publish(self.keys.of("velocities", session=self.bus.id), self._answer)

    # -- what arrives

    def _wait(self, ready: Callable[[], bool], seconds: float = math.inf) -> None:
        """Handle what arrives until something is so, or the time is over.

        What is there already comes first, so that no old tick is taken for the newest.
        """
        for _ in range(len(self.bus.inbox)):
            self._handle_next(0.0)
        deadline = time.monotonic() + seconds
        while not ready() and (left := deadline - time.monotonic()) > 0.0:
            self._handle_next(min(left, self._gone_until - time.monotonic()))

    def _handle_next(self, seconds: float) -> None:
        item = self.bus.inbox.take(seconds)
        if item is not None:
            self.handle(item)
        else:
            self._check_gone()

    def _check_gone(self) -> None:
        if time.monotonic() >= self._gone_until:
            raise HostEnded(1, f"physics is gone; waited for {self._patience:g} s")

    def handle(self, item: Item) -> None:
        try:
            self._handle(item)
        except Refused as refusal:
            self.refusals.note(getattr(item, "key", "a reply"), refusal)

    def _handle(self, item: Item) -> None:
        if isinstance(item, Sample):
            self._hear(item)
        elif isinstance(item, Query):
            self._asked(item)
        elif isinstance(item, Replied) and isinstance(item.ticket, SentRequest):
            if not item.error:
                self.mailbox.replied(item.ticket, item.payload)
        elif isinstance(item, Final) and isinstance(item.ticket, SentRequest):
            item.ticket.final = True
        elif isinstance(item, Signal):
            raise HostEnded(0, "asked to stop")
        elif isinstance(item, Alive) and item.key == self.keys.of("alive", PHYSICS, self.run_id):
            self._physics(item.up)

    def _physics(self, up: bool) -> None:
        """Physics, or the way to it, is gone, or there again."""
        was_gone, self._gone_until = self._gone_until < math.inf, math.inf
        if not up:
            log.warning("physics is gone; waiting for it")
            self._gone_until = time.monotonic() + self._patience
        elif was_gone:
            raise _JoinAgain

    def _hear(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["hosts", _, "seen"]:
                if not self.sight.seen(sample.payload) and self.sight.tick == self.mailbox.last:
                    self._send()
            case ["end"]:
                raise HostEnded(0, read_message(sample.payload, End, self.run_id).why)
            case ["lost"]:
                if read_message(sample.payload, Lost, self.run_id).holder == self.bus.id:
                    raise _JoinAgain
            case _:
                raise Refused("no such key")

    def _asked(self, question: Query) -> None:
        name, what = self.keys.parts(question.key)
        if what == "state":
            self.states.tell(name, question)
        else:
            self.mailbox.hear(name, question)
