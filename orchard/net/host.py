"""A host runs any number of agents over one session: it receives what they observe, and sends their velocities."""

import logging
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

from orchard.agents.catalogue import guarded
from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.guard import Guard
from orchard.contract.mail import LocalMail, digest_of
from orchard.contract.messages import MAX_PAYLOAD, pack, unpack
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.field.plugins import MISTAKES, reraise_ctrl_c
from orchard.field.problems import printable
from orchard.field.scenario import check
from orchard.net.bus import Alive, Bus, Final, Item, Query, Replied, Sample, Signal
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.mailbox import DOUBT_SECONDS, MAILBOXES, LatestObservations, SentRequest
from orchard.net.refusals import NO_TOKEN, TAKEN, M, Refusals, Refused, read_message
from orchard.net.requests import (
    AGAIN_SECONDS,
    ANSWER_SECONDS,
    ErrorReply,
    ask,
    fetch_run,
    publish_refusals,
)
from orchard.wire.codec import report_of
from orchard.wire.keys import Keys
from orchard.wire.messages import (
    RESET,
    BinStatus,
    End,
    Join,
    Joined,
    Left,
    Letter,
    Lost,
    Recall,
    Recalled,
    Report,
    Velocities,
)

log = logging.getLogger("orchard")
GONE_SECONDS = (
    20.0  # how long a host waits for physics that is gone: physics or its router is started again
)
WARN_SECONDS = 1.0  # after which a host says that physics is gone; at the end of a run its `end` arrives sooner
JOIN_TRIES = 50  # 5 s in all: the network may learn of a token later than of a join
TAKEN_TRIES = 30  # 3 s in all: a predecessor that was cut off counts as alive for bus.LEASE_MS


# s after an answer, from which on a tick that comes again was sent without knowing the answer.
ANSWER_AGAIN_SECONDS = 0.25
# Messages in turn of ticks that are past, after which the newest tick was none of physics: it has changed on its way.
MOST_PAST = 3
REFUSED_TRIES = 5  # of a join that is refused for another reason: it may have changed on its way


def _most_tries(reasons: Collection[str]) -> int:
    """Return how often a join is tried that is refused for these reasons."""
    if not reasons:
        return 1
    if NO_TOKEN in reasons:
        return JOIN_TRIES
    if any(reason.startswith(TAKEN) for reason in reasons):
        return TAKEN_TRIES
    return REFUSED_TRIES


class HostEnded(Exception):
    """Raised when the run is over for this host. `code`: the exit code of its process."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


def end_if_asked(item: Item) -> None:
    """Raise HostEnded for a signal to stop: for a process that has not begun."""
    if isinstance(item, Signal):
        raise HostEnded(0, "asked to stop")


class _JoinAgain(Exception):
    """Raised when physics no longer waits for this host, or has come back."""


class AgentRunner:
    """An agent and its memory."""

    def __init__(self, name: str, agent: Guard) -> None:
        self.name, self._agent = name, agent
        self.memory: Any = None
        self._sent: bytes | None = None  # the packed memory that physics has

    def resume(self, memory: bytes | None) -> None:
        """Continue with the memory that physics has; without one if that is None, or of another class."""
        self.memory, self._sent = None, memory
        try:
            self.memory = None if memory is None else unpack(memory, self._agent.Memory)
        except MISTAKES as error:
            reraise_ctrl_c(error)
            log.warning(
                "%s starts without a memory; its last one is not of its class: %s",
                self.name,
                printable(str(error)),
            )

    def act(self, seen: Observation, mail: Mail) -> Action:
        action = self._agent.tick(seen, mail, self.memory)
        self.memory = action.memory
        return action

    def news(self) -> bytes | None:
        """Return the packed memory; None if physics has it already."""
        before, self._sent = self._sent, self._agent.packed
        return None if self._sent == before else self._sent


class StateBoard:
    """The states of the bins: published when they change, and sent in reply to queries."""

    def __init__(self, bus: Bus, keys: Keys, run: str) -> None:
        self._bus, self._keys, self._run = bus, keys, run
        self._states: dict[str, BinStatus] = {}

    def update(self, seen: Observation) -> None:
        """Store the state of an observed bin. Publish it if `full` or `coupled_to` has changed."""
        state = BinStatus(
            self._run, seen.tick, seen.full, seen.fill, seen.hitch.name if seen.hitch else ""
        )
        old, self._states[seen.name] = self._states.get(seen.name), state
        if old is None or (old.full, old.coupled_to) != (state.full, state.coupled_to):
            self._bus.publish(self._keys.of("state", seen.name), pack(state))

    def tell(self, name: str, question: Query) -> None:
        """Reply to a query for a bin's state. Raises Refused if it has a payload."""
        if question.payload:
            question.refuse("malformed: a query for a state has no payload")
            raise Refused("malformed", "a query for a state has no payload")
        if name not in self._states:
            question.refuse("not known before the first tick")
            return
        question.reply(pack(self._states[name]))
        question.drop()


@dataclass
class SentAnswer:
    """What a host has sent for a tick. `tick`: -1 if it has answered none. `at`: when, s on the clock of the bus."""

    tick: int = -1
    messages: list[bytes] = field(default_factory=list)
    at: float = math.inf


class Host:
    """A session that hosts agents, until the end of the run. `patience`: how long it waits for physics that is gone, s."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        run: str,
        mode: str,
        layout: Layout,
        agents: Mapping[str, Agent],
        patience: float = GONE_SECONDS,
    ) -> None:
        self.bus, self.keys, self.run_id, self._patience, self._scenario = (
            bus,
            keys,
            run,
            patience,
            layout.scenario,
        )
        self.runners = {
            name: AgentRunner(name, guarded(layout, name, agent))
            for name, agent in sorted(agents.items())
        }
        self.bodies = [name for name in self.runners if name in layout.index]
        self.bins = [name for name in self.bodies if kind_of(name) == "bin"]
        self.latest = LatestObservations(run, self.runners, self.bodies)
        self.mailbox = MAILBOXES[mode](run, layout.agents)
        self.states = StateBoard(bus, keys, run)
        self.refusals = Refusals()
        self.thinking = ""  # the agent that is ticked now; '' between ticks
        self._answer = SentAnswer()
        self._ending = Ending(bus.clock)
        self._has_begun = False  # whether physics has been there
        self._has_warned = False  # that it is gone

    # -- joining

    def listen(self) -> None:
        """Declare subscribers, queryables and then the liveliness tokens (rule 10 in CONTRIBUTING.md)."""
        for what in ("lost", "end"):
            self.bus.subscribe(self.keys.of(what))
        self.bus.watch(self.keys.of("physics", self.run_id))
        self.bus.subscribe(self.keys.of("seen", session=self.bus.id))
        for name in self.bins:
            self.bus.answer(self.keys.of("state", name))
        for name in self.runners:
            self.bus.answer(self.keys.of("mail", name))
        for name in self.runners:
            self.bus.declare_alive(self.keys.of("alive", name, self.bus.id))

    def join(self) -> None:
        """Join the run: physics waits for the agents from the present tick on. Raises HostEnded if physics refuses them, or was reset."""
        if (
            check(
                fetch_run(self.bus, self.keys, self.handle).scenario,
                "the scenario that physics sent",
            )
            != self._scenario
        ):
            raise HostEnded(0, RESET)  # physics has died before it could keep a reset
        joined = self._joined()
        if joined.refused:
            raise HostEnded(
                2, "; ".join(f"{name}: {reason}" for name, reason in sorted(joined.refused.items()))
            )
        self.mailbox.join(joined.tick)
        self.latest.forget()
        self._answer = SentAnswer()
        for name, runner in self.runners.items():
            runner.resume(joined.memories.get(name))

    def _joined(self) -> Joined:
        """Ask physics for the agents, again while what it refuses may be right soon, or come right.

        Raises ErrorReply if physics answers with errors only.
        """
        request = pack(Join(self.run_id, self.bus.id, list(self.runners)))
        tries = 0
        while True:
            tries += 1
            try:
                joined = self._query("join", request, Joined)
                if tries >= _most_tries(joined.refused.values()):
                    return joined
            except ErrorReply:
                if tries >= REFUSED_TRIES:
                    raise
            self.bus.sleep(AGAIN_SECONDS)

    def _query(self, what: str, request: bytes, type_: type[M]) -> M:
        key, understand = (
            self.keys.of(what, session=self.bus.id),
            lambda payload: read_message(payload, type_, self.run_id),
        )
        return ask(
            self.bus,
            key,
            request,
            understand,
            ANSWER_SECONDS,
            self.handle,
            self.refusals,
            self._check_gone,
        )

    # -- one tick

    def run(self) -> NoReturn:
        """Tick until the run ends. Raises HostEnded at the end."""
        while True:
            try:
                self.join()
                while True:
                    self.tick()
            except _JoinAgain:
                log.warning("joining again after tick %d", self.mailbox.last)

    def tick(self) -> None:
        self._wait(lambda: self.latest.tick > self.mailbox.last)
        tick = self.latest.tick
        if not self.mailbox.is_settled(tick, self.latest.asked):
            self._wait(lambda: self.mailbox.is_settled(tick, self.latest.asked), DOUBT_SECONDS)
        mail, seen = self._mail(tick), self.latest.observations
        digests = {
            name: digest_of(heard) for name, heard in mail.items()
        }  # before the agents can change their mail
        actions = {
            name: self._act(name, observed, mail.get(name) or Mail())
            for name, observed in seen.items()
        }
        self.thinking = ""
        reports = {
            name: report_of(action, digests.get(name, b""), self.runners[name].news())
            for name, action in actions.items()
        }
        self._answer = SentAnswer(tick, self._packed(tick, reports))
        self._send_answer()
        self._send_rest(seen, actions)
        # What has come meanwhile was sent before the answer.
        self._answer.at = self.bus.clock()

    def _send_answer(self) -> None:
        for message in self._answer.messages:
            self.bus.publish(self.keys.of("velocities", session=self.bus.id), message)

    def _take_seen(self, payload: bytes) -> None:
        """Take what the agents observe. Answer a tick again that comes again: its answer may be lost, or have changed on its way.

        Join again if only past ticks come: the newest one was false, and physics would wait in vain.
        """
        try:
            self.latest.seen(payload)
        except Refused:
            if self.latest.past >= MOST_PAST:
                raise _JoinAgain from None
            raise
        answer, now = self._answer, self.bus.clock()
        if answer.tick == self.latest.tick and now >= answer.at + ANSWER_AGAIN_SECONDS:
            answer.at = now
            self._send_answer()

    def _send_rest(self, seen: dict[str, Observation], actions: dict[str, Action]) -> None:
        for name, action in actions.items():
            for asked in self.mailbox.write(name, action):
                letter = Letter(self.run_id, asked.tick, asked.sender, asked.number, asked.request)
                self.bus.ask(self.keys.of("mail", asked.to), pack(letter), asked)
        self.mailbox.close()
        for name in self.bins:
            if name in seen:
                self.states.update(seen[name])
        publish_refusals(self.bus, self.keys, self.run_id, self.refusals)

    def _act(self, name: str, seen: Observation, mail: Mail) -> Action:
        self.thinking = name
        return self.runners[name].act(seen, mail)

    def _mail(self, tick: int) -> dict[str, Mail]:
        doubts = self.mailbox.doubts(tick, self.latest.asked)
        mail = self.mailbox.deliver(tick)
        if not doubts:
            return mail
        self.mailbox.recall(tick)  # before the query: late requests may come while it waits
        request = pack(Recall(self.run_id, tick))
        try:
            recalled = self._query("recall", request, Recalled)
        except BusError as error:  # physics may have resumed at an earlier tick
            raise _JoinAgain from error
        if recalled.tick != tick:
            raise _JoinAgain
        return LocalMail(dict(recalled.letters)).deliver(tick)

    def _packed(self, tick: int, reports: dict[str, Report]) -> list[bytes]:
        packed, names = pack(Velocities(self.run_id, tick, self.bus.id, reports)), list(reports)
        if len(packed) <= MAX_PAYLOAD or len(names) == 1:
            return [packed]
        halves = names[: len(names) // 2], names[len(names) // 2 :]
        return [
            message
            for half in halves
            for message in self._packed(tick, {name: reports[name] for name in half})
        ]

    # -- what arrives

    def _wait(self, ready: Callable[[], bool], seconds: float = math.inf) -> None:
        """Handle all present items, so that no old tick is taken for the newest, then more until `ready()` or the time is over."""
        for _ in range(len(self.bus.inbox)):
            self._handle_next(0.0)
        deadline = self.bus.clock() + seconds
        while not ready() and (left := deadline - self.bus.clock()) > 0.0:
            check_at = self._ending.gone_at + (
                self._patience if self._has_warned else min(self._patience, WARN_SECONDS)
            )
            self._handle_next(min(left, check_at - self.bus.clock()))

    def _handle_next(self, seconds: float) -> None:
        item = self.bus.inbox.take(seconds)
        if item is not None:
            self.handle(item)
        else:
            self._check_gone()

    def _check_gone(self) -> None:
        now, gone_at = self.bus.clock(), self._ending.gone_at
        if now >= gone_at + WARN_SECONDS and not self._has_warned:
            self._has_warned = True
            log.warning("physics is gone; waiting for it")
        if now >= gone_at + self._patience:
            raise HostEnded(1, f"physics is gone; waited for {self._patience:g} s")

    def handle(self, item: Item) -> None:
        """Handle an item; count it if it is refused. Raises HostEnded at the end of the run."""
        try:
            self._handle(item)
        except Refused as refusal:
            self.refusals.note(getattr(item, "key", "a reply"), refusal)

    def _handle(self, item: Item) -> None:
        match item:
            case Sample():
                self._take_sample(item)
            case Query():
                self._take_query(item)
            case Replied(SentRequest() as asked, payload, ""):
                self.mailbox.replied(asked, payload)
            case Final(SentRequest() as asked):
                asked.final = True
            case Signal():
                self._leave("asked to stop")
            case Alive(token, up):
                self._track_physics(token, up)

    def _track_physics(self, token: str, up: bool) -> None:
        had_begun, self._has_begun, self._has_warned = self._has_begun, True, False
        self._ending.track(token, up)
        self._leave_if_over()
        if up and had_begun:
            raise _JoinAgain

    def _leave_if_over(self) -> None:
        if (end := self._ending.end) is not None:
            self._leave(end.why)

    def _leave(self, why: str) -> NoReturn:
        """Tell physics that this session leaves, or physics waits for it at the end: it may only be cut off."""
        self.bus.publish(self.keys.of("left", session=self.bus.id), pack(Left(self.run_id)))
        raise HostEnded(0, why)

    def _take_sample(self, sample: Sample) -> None:
        match self.keys.parts(sample.key):
            case ["hosts", _, "seen"]:
                self._take_seen(sample.payload)
            case ["end"]:
                self._ending.hear(read_message(sample.payload, End, self.run_id))
                self._leave_if_over()
            case ["lost"]:
                if read_message(sample.payload, Lost, self.run_id).owner == self.bus.id:
                    raise _JoinAgain
            case _:
                raise Refused("no such key")

    def _take_query(self, question: Query) -> None:
        match self.keys.parts(question.key):
            case [name, "state"]:
                self.states.tell(name, question)
            case [name, "mail"] if "*" not in name:
                self.mailbox.hear(name, question)
            case _:
                question.refuse("no such key")
                raise Refused("no such key")
